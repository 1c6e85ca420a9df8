# SPDX-License-Identifier: Apache-2.0
"""A simulated rig calibrated as on a bench: its cameras look at a board of tags while they turn
through their range."""

from typing import List

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.tilting.rig import SimulatedRig
from fcsv_tracking.tilting.board import SideBoardView, TagBoard
from fcsv_tracking.tilting.calibrate import TiltSolution, calibrate
from fcsv_tracking.tilting.rig import SIDES, TiltAngles

#: Where the board stands in the rig's frame (m, deg); it faces the rig.
STATIONS = (
    ([0.9, 0.1, 0.05], [5.0, 20.0, 0.0]),
    ([1.1, 0.05, 0.1], [-10.0, -25.0, 15.0]),
    ([0.8, 0.15, 0.2], [0.0, 5.0, -20.0]),
)
ANGLES_DEG = (0.0, 10.0, 20.0, 30.0)
_NOISE_PX = 0.1  # of a corner
_BORDER_PX = 3.0


def T_rig_board(station: int) -> np.ndarray:
    """The board's frame (x right, y down, z into it) at a station."""
    xyz_m, rpy_deg = STATIONS[station]
    T = transforms.from_xyz_rpy(xyz_m, np.radians(rpy_deg))
    return T @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def board_views(rig: SimulatedRig, board: TagBoard, seed: int) -> List[SideBoardView]:
    """Gives views of every station, angle and side: the tags that are whole in the picture, corners
    with noise, angles as read."""
    random, views = np.random.default_rng([seed, 8]), []
    points = np.concatenate(
        [board.corners(board.first_id + i) for i in range(board.columns * board.rows)]
    )
    for station in range(len(STATIONS)):
        for angle in np.radians(ANGLES_DEG):
            rig.turn(TiltAngles(angle, angle))
            read = rig.read()
            for k, (side, T_rig_cam) in enumerate(zip(SIDES, rig.T_rig_cams())):
                camera = getattr(rig.true, side).camera
                uv = camera.project(
                    transforms.apply(transforms.invert(T_rig_cam) @ T_rig_board(station), points)
                )
                most = np.array([camera.width, camera.height]) - 1.0 - _BORDER_PX
                inside = (
                    ((uv > _BORDER_PX) & (uv < most))
                    .all(axis=1)
                    .reshape(-1, 4)
                    .all(axis=1)
                    .repeat(4)
                )
                if inside.any():
                    corners = uv[inside] + random.normal(0.0, _NOISE_PX, (int(inside.sum()), 2))
                    seen = camera.normalize(corners)
                    views.append(
                        SideBoardView(
                            str(station), side, float(read[k]), seen, points[inside], camera.fx
                        )
                    )
    return views


def calibrate_simulated(rig: SimulatedRig, seed: int = 1) -> TiltSolution:
    """Leads from its file to what was found; the rig itself is left as it was told. Raises
    CalibrationRefused."""
    return calibrate(rig.told, board_views(rig, TagBoard(), seed))
