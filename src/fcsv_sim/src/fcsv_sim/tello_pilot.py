# SPDX-License-Identifier: Apache-2.0
"""Who flies a Tello to a place: sticks from where it is and where it should be, as thesis 4.3 has its controller."""

from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.autopilot.controller import approach_speed
from fcsv_sim.autopilot.estimator import wrap

_GAIN_PER_S, _BRAKE_MPS2 = 0.8, 0.4  # poses are up to a third of a second old: no faster than that allows
_YAW_GAIN_PER_S, _YAW_MOST_RPS = 0.8, np.radians(25.0)


def sticks_to(T_a_body: np.ndarray, T_a_target: np.ndarray, most_mps: float = 0.6) -> Tuple[np.ndarray, float]:
    """Velocity forward, left, up (3,) m/s and turn to the left rad/s; frame a has z up, only headings count.

    >>> v, turn = sticks_to(transforms.from_xyz_yaw([0, 0, 1], np.pi / 2), transforms.from_xyz_yaw([0, 0.1, 1], 0.0))
    >>> np.round(v, 3).tolist(), turn < 0
    ([0.08, 0.0, 0.0], True)
    """
    error = T_a_target[:3, 3] - T_a_body[:3, 3]
    away_m = float(np.linalg.norm(error))
    speed = min(most_mps, approach_speed(away_m, _GAIN_PER_S, _BRAKE_MPS2))
    heading = transforms.yaw(T_a_body)
    R_heading_a = transforms.from_xyz_yaw(np.zeros(3), heading)[:3, :3].T
    turn = _YAW_GAIN_PER_S * wrap(transforms.yaw(T_a_target) - heading)
    v = R_heading_a @ error * (speed / away_m if away_m > 1e-6 else 0.0)
    return v, float(np.clip(turn, -_YAW_MOST_RPS, _YAW_MOST_RPS))
