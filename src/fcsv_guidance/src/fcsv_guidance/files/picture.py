# SPDX-License-Identifier: Apache-2.0
"""The ground from above as one picture: free, uncertain, obstacle, unknown, and a route."""

from pathlib import Path
from typing import Optional

import numpy as np

from fcsv_guidance.ground import tuning
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.search import Route

_MOST_SHOWN = 3000  # cells along a side
_COLOURS = {"unknown": "#8c8c8c", "obstacle": "#b2182b", "uncertain": "#fdb863", "free": "#1b9e57"}


def draw(
    ground: Ground, robot: Robot, stands: np.ndarray, path: Path, route: Optional[Route] = None
) -> None:
    """Writes a PNG: where the robot can stand on the left, height on the right."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    grid = ground.grid
    n = 1 + max(grid.shape) // _MOST_SHOWN  # a site's cells are more than a picture shows
    stands, height = stands[::n, ::n], ground.height_m[::n, ::n]
    with np.errstate(invalid="ignore"):
        classes = np.select(
            [~np.isfinite(stands), stands <= tuning.OBSTACLE_P, stands < tuning.FREE_P],
            [0, 1, 2],
            3,
        )
    figure = Figure(figsize=(14, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    colours = ListedColormap(list(_COLOURS.values()))
    left.imshow(
        classes,
        origin="lower",
        extent=grid.extent_m,
        cmap=colours,
        vmin=-0.5,
        vmax=3.5,
        interpolation="nearest",
    )
    if route is not None:
        left.plot(*route.points_home_m.T, color="black", linewidth=2)
    left.set_title(f"where the robot '{robot.name}' can stand (free: p >= {tuning.FREE_P})")
    left.legend(
        handles=[Patch(color=c, label=n) for n, c in _COLOURS.items()], loc="upper left", fontsize=8
    )
    shown = right.imshow(
        height, origin="lower", extent=grid.extent_m, cmap="viridis", interpolation="nearest"
    )
    right.set_title("height of the ground (m above home); white: unknown")
    figure.colorbar(shown, ax=right, shrink=0.8)
    for axes in (left, right):
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    figure.savefig(path, dpi=100)
