# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle flew in the last moments, and where it comes to rest if it stops now."""

from collections import deque
from typing import Deque, Tuple

import numpy as np

from fcsv_geometry import transforms

_WAY_S = 0.3
_STOPS_MPS2, _LONGEST_STOP_S = 2.5, 1.0  # how an ArduCopter in GUIDED comes to rest


class RecentWay:
    """Keeps the recent way of the autopilot's estimate, in the odometry frame."""

    def __init__(self):
        self._way: Deque[Tuple[float, np.ndarray]] = deque()  # time, position

    def add(self, now_s: float, p_m: np.ndarray) -> None:
        """The estimate came, (3,) m."""
        self._way.append((now_s, p_m))
        while self._way[0][0] < now_s - _WAY_S:
            self._way.popleft()

    def forget(self) -> None:
        """The estimate jumped: what was before is no way to here."""
        self._way.clear()

    def velocity_mps(self) -> np.ndarray:
        """(3,); zero while there is too little of it."""
        if not self._way:
            return np.zeros(3)
        (early_s, p_then), (late_s, p_now) = self._way[0], self._way[-1]
        return (
            (p_now - p_then) / (late_s - early_s)
            if late_s - early_s > 0.5 * _WAY_S
            else np.zeros(3)
        )

    def rest(self, T_odom_body: np.ndarray) -> np.ndarray:
        """Level T_odom_body where one that is here comes to rest: a place behind it would be
        overshot, and flown back to."""
        v = self.velocity_mps()
        T_rest = transforms.level(T_odom_body)
        T_rest[:3, 3] += v * min(float(np.linalg.norm(v)) / (2.0 * _STOPS_MPS2), _LONGEST_STOP_S)
        return T_rest
