# SPDX-License-Identifier: Apache-2.0
"""Who flies a Tello to a place: sticks from where it is and where it should be, as thesis 4.3 has its controller."""

from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.rotations import wrap
from fcsv_sim.autopilot.controller import approach_speed

_GAIN_PER_S, _BRAKE_MPS2 = 0.8, 0.4  # poses are up to a third of a second old: no faster than that allows
_YAW_GAIN_PER_S, _YAW_MOST_RPS = 0.8, np.radians(25.0)

_TRIM_PER_S2, _TRIM_WITHIN_M, _TRIM_MPS = 0.15, 0.4, 0.12


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


class Hand:
    """sticks_to() and a trim against what draws a hovering vehicle aside: wind, a flow sensor that is off."""

    def __init__(self):
        self._trim_a_mps = np.zeros(3)

    def sticks(self, dt_s: float, T_a_body: np.ndarray, T_a_target: np.ndarray) -> Tuple[np.ndarray, float]:
        """As sticks_to(); ``dt_s`` since the last time."""
        error = T_a_target[:3, 3] - T_a_body[:3, 3]
        if np.linalg.norm(error) < _TRIM_WITHIN_M:
            self._trim_a_mps = np.clip(self._trim_a_mps + _TRIM_PER_S2 * error * dt_s, -_TRIM_MPS, _TRIM_MPS)
        v, turn = sticks_to(T_a_body, T_a_target)
        R_heading_a = transforms.from_xyz_yaw(np.zeros(3), transforms.yaw(T_a_body))[:3, :3].T
        return v + R_heading_a @ self._trim_a_mps, turn
