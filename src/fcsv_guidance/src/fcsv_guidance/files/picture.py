# SPDX-License-Identifier: Apache-2.0
"""The ground from above as one picture: free, uncertain, obstacle, unknown, and a route."""

from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple, Union

import numpy as np

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import tuning
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.look_from import LookFrom
from fcsv_guidance.route.search import NoRoute, Route

_MOST_SHOWN = 3000  # cells along a side
_COLOURS = {"unknown": "#8c8c8c", "obstacle": "#b2182b", "uncertain": "#fdb863", "free": "#1b9e57"}


@dataclass(frozen=True)
class RouteDrawn:
    """What was asked for and found between ``start_m`` and ``goal_m`` (x, y in home): a route, or
    the cells that would have to be seen and ``looks``, where to see them from."""

    start_m: Tuple[float, float]
    goal_m: Tuple[float, float]
    found: Union[Route, NoRoute]
    looks: Optional[LookFrom] = None


def draw(
    ground: Ground, robot: Robot, stands: np.ndarray, path: Path, asked: Optional[RouteDrawn] = None
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
    handles = [Patch(color=c, label=n) for n, c in _COLOURS.items()]
    if asked is not None:
        handles += _draw_route(left, grid, asked)
    left.set_title(f"where the robot '{robot.name}' can stand (free: p >= {tuning.FREE_P})")
    left.legend(handles=handles, loc="upper left", fontsize=8)
    shown = right.imshow(
        height, origin="lower", extent=grid.extent_m, cmap="viridis", interpolation="nearest"
    )
    right.set_title("height of the ground (m above home); white: unknown")
    figure.colorbar(shown, ax=right, shrink=0.8)
    for axes in (left, right):
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    figure.savefig(path, dpi=100)


def _draw_route(axes, grid: Grid, asked: RouteDrawn) -> list:
    """Handles of the legend. What lies outside of the grid widens the picture."""
    drawn, found = [], asked.found
    if isinstance(found, Route):
        drawn += axes.plot(*found.points_home_m.T, color="black", linewidth=2, label="route")
        cells, label = found.unknown_cells, "crossed unseen"
    else:
        cells, label = found.to_see, "to be seen first"
    if len(cells):
        xy = grid.middle_of(*cells.T)
        drawn += axes.plot(*xy.T, ".", color="#2166ac", markersize=4, label=label)
    for (x_m, y_m), mark, label in ((asked.start_m, "o", "start"), (asked.goal_m, "*", "goal")):
        drawn += axes.plot(x_m, y_m, mark, color="black", markersize=10, label=label)
    if asked.looks is not None:
        x_m, y_m = asked.looks.p_home_cam[:2]
        ahead_m = 3.0 * np.array([np.cos(asked.looks.yaw_rad), np.sin(asked.looks.yaw_rad)])
        drawn += axes.plot(x_m, y_m, "^", color="#762a83", markersize=10, label="look from here")
        axes.annotate(
            "", (x_m, y_m) + ahead_m, (x_m, y_m), arrowprops={"arrowstyle": "->", "lw": 2}
        )
    return drawn
