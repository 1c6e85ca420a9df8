# SPDX-License-Identifier: Apache-2.0
"""A drive from above: truth, what was known, routes, the way driven, contacts."""

from pathlib import Path

import numpy as np

from fcsv_guidance import tuning
from fcsv_sim.robot.mapped import MappedPlace
from fcsv_sim.robot.rehearsal import DriveRecord, DriveResult

_COLOURS = {
    "unknown": "#8c8c8c",
    "not free": "#f2c9b0",
    "free": "#8fd3b4",
    "stops the robot": "#303030",
}


def draw_drive(place: MappedPlace, track: DriveRecord, result: DriveResult, path: Path) -> None:
    """Writes a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    grid, plan = track.grid, place.town.plan
    xy = grid.middle_of(*np.indices(grid.shape))
    with np.errstate(invalid="ignore"):
        classes = np.where(np.isfinite(track.stands), 1 + (track.stands >= tuning.FREE_P), 0)
    classes = np.where(place.clear.at(xy[..., 0], xy[..., 1]) <= 0.0, 3, classes)
    figure = Figure(figsize=(9, 9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    colours = ListedColormap(list(_COLOURS.values()))
    axes.imshow(
        classes,
        origin="lower",
        extent=grid.extent_m,
        cmap=colours,
        vmin=-0.5,
        vmax=3.5,
        interpolation="nearest",
    )
    for route in track.routes:
        axes.plot(*route.points_home_m.T, color="tab:blue", linewidth=1)
    if track.way:
        axes.plot(*np.array(track.way).T, color="black", linewidth=2)
    for box in track.boxes[:: max(1, len(track.boxes) // 12)]:
        c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
        corners = (
            np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * box.half_m @ [[c, s], [-s, c]]
        )
        axes.plot(*(corners + [box.x_m, box.y_m]).T, color="tab:orange", linewidth=1)
    axes.plot(*plan.start_m, "o", color="tab:blue")
    axes.plot(*plan.goal_m, "*", color="tab:purple", markersize=14)
    if track.contact is not None:
        axes.plot(*track.contact, "x", color="red", markersize=14, markeredgewidth=3)
    axes.set_title(
        f"{place.name}, {result.fault}: {result.broke or result.ended} after {result.time_s:.0f} s"
    )
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    handles = [Patch(color=colour, label=name) for name, colour in _COLOURS.items()]
    handles += [Patch(color="tab:blue", label="routes"), Patch(color="black", label="way driven")]
    handles += [Patch(color="tab:orange", label="in the way"), Patch(color="red", label="contact")]
    axes.legend(handles=handles, loc="upper right", fontsize=8)
    figure.savefig(path, dpi=80)
