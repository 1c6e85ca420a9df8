# SPDX-License-Identifier: Apache-2.0
"""A drive from above: truth, what was known, routes, the way driven, contacts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Sequence, Tuple

import numpy as np

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import tuning
from fcsv_sim.robot.things import Box

_COLOURS = {
    "unknown": "#8c8c8c",
    "not free": "#f2c9b0",
    "free": "#8fd3b4",
    "stops the robot": "#303030",
}
_WAY = "#c51b7d"


@dataclass(frozen=True)
class FromAbove:
    """What is drawn, all in one frame (m): ``stands`` probabilities and ``stops`` bool (rows,
    columns) of ``grid``; ``routes`` each (N,2), ``way`` (N,2) as driven; ``within_m`` x0, x1, y0,
    y1 that the picture shows."""

    grid: Grid
    stands: np.ndarray
    stops: np.ndarray
    routes: Sequence[np.ndarray]
    way: np.ndarray
    start_m: Tuple[float, float]
    goal_m: Tuple[float, float]
    boxes: Sequence[Box] = ()
    contact_m: Optional[Tuple[float, float]] = None
    within_m: Optional[Tuple[float, float, float, float]] = None


def draw_from_above(shown: FromAbove, title: str, path: Path) -> None:
    """Writes a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    with np.errstate(invalid="ignore"):
        classes = np.where(np.isfinite(shown.stands), 1 + (shown.stands >= tuning.FREE_P), 0)
    classes = np.where(shown.stops, 3, classes)
    figure = Figure(figsize=(9, 9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.imshow(
        classes,
        origin="lower",
        extent=shown.grid.extent_m,
        cmap=ListedColormap(list(_COLOURS.values())),
        vmin=-0.5,
        vmax=3.5,
        interpolation="nearest",
    )
    for route in shown.routes:
        axes.plot(*route.T, color="tab:blue", linewidth=1)
    if len(shown.way):
        axes.plot(*shown.way.T, color=_WAY, linewidth=2)
    for box in shown.boxes:
        c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
        corners = (
            np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * box.half_m @ [[c, s], [-s, c]]
        )
        axes.plot(*(corners + [box.x_m, box.y_m]).T, color="tab:orange", linewidth=1)
    axes.plot(*shown.start_m, "o", color="tab:blue")
    axes.plot(*shown.goal_m, "*", color="tab:purple", markersize=14)
    if shown.contact_m is not None:
        axes.plot(*shown.contact_m, "x", color="red", markersize=14, markeredgewidth=3)
    if shown.within_m is not None:
        axes.set_xlim(*shown.within_m[:2])
        axes.set_ylim(*shown.within_m[2:])
    axes.set_title(title)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    handles = [Patch(color=colour, label=name) for name, colour in _COLOURS.items()]
    handles += [Patch(color="tab:blue", label="routes"), Patch(color=_WAY, label="way driven")]
    if len(shown.boxes):
        handles.append(Patch(color="tab:orange", label="in the way"))
    handles.append(Patch(color="red", label="contact"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8)
    figure.savefig(path, dpi=80)
