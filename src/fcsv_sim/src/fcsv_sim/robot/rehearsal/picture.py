# SPDX-License-Identifier: Apache-2.0
"""A rehearsed drive from above."""

from pathlib import Path

import numpy as np

from fcsv_sim.robot.above_picture import FromAbove, draw_from_above
from fcsv_sim.robot.places.mapped import MappedPlace
from fcsv_sim.robot.rehearsal.one_drive import DriveRecord, DriveResult


def draw_drive(place: MappedPlace, track: DriveRecord, result: DriveResult, path: Path) -> None:
    """Writes a PNG."""
    plan = place.town.plan
    xy = track.grid.middle_of(*np.indices(track.grid.shape))
    shown = FromAbove(
        track.grid,
        track.stands,
        place.clear.stopped(xy[..., 0], xy[..., 1], track.grid.cell_m),
        track.routes,
        np.array(track.way),
        plan.start_m,
        plan.goal_m,
        track.boxes[:: max(1, len(track.boxes) // 12)],
        track.contact,
    )
    ended = f"{result.broke or result.ended} after {result.time_s:.0f} s"
    draw_from_above(shown, f"{place.name}, {result.fault}: {ended}", path)
