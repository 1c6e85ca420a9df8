# SPDX-License-Identifier: Apache-2.0
"""How wrong a vehicle's odometry may have become since it was calibrated, from the way that it flew
since.

The error of position and yaw is propagated along the flown path: a random walk of the position over
the distance, one of the heading (whose error displaces everything flown after it), a scale error,
and a slow walk over time that also a hovering vehicle has.
"""

import math
from collections import deque
from typing import Deque, List, Optional, Tuple

import numpy as np

from fcsv_geometry.home import about_z
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile

_STEP_M = 0.1  # shorter movements are the tracker's noise: summed up they would be metres of path
_KEPT_S = 10.0  # a calibration is heard of this long after its moment at most


class Drift:
    """Covariance of one vehicle's odometry against what it was when ``begin`` was called; the
    caller brings the time.

    ``path_m`` is the distance flown since.
    """

    def __init__(self, rates: TrackerProfile = T265_PROFILE):
        self._rates = rates
        self._recent: Deque[Tuple[float, np.ndarray]] = deque()
        self.begin()

    def begin(self, stamp_s: Optional[float] = None) -> None:
        """A new calibration: the odometry is what it says at its moment, and drifts from there on.

        It is heard of after its moment ``stamp_s``: what was flown in between counts. None: now.
        """
        since = [] if stamp_s is None else self._since(stamp_s)
        self.path_m = 0.0
        self._P = np.zeros((5, 5))  # of x, y, z, yaw, scale
        self._P[4, 4] = self._rates.scale**2
        self._p_m: Optional[np.ndarray] = None
        self._stamp_s: Optional[float] = None
        self._recent.clear()
        for then_s, p_m in since:
            self.add(then_s, p_m)

    def _since(self, stamp_s: float) -> List[Tuple[float, np.ndarray]]:
        """What was fed from a moment on, with the position before it; nothing of a clock that was
        set meanwhile."""
        before = [k for k in self._recent if k[0] <= stamp_s]
        return before[-1:] + [k for k in self._recent if stamp_s < k[0] <= stamp_s + _KEPT_S]

    def add(self, stamp_s: float, p_odom_body_m: np.ndarray) -> None:
        """The newest position; one that is not newer is passed over."""
        p = np.asarray(p_odom_body_m, float)
        if self._p_m is None:
            self._p_m, self._stamp_s = p.copy(), stamp_s
            self._keep(stamp_s, p)
            return
        dt_s = stamp_s - self._stamp_s
        if dt_s <= 0.0:
            return
        self._keep(stamp_s, p)
        self._widen(self._rates.walk_m_per_sqrt_s**2 * dt_s)
        self._stamp_s = stamp_s
        step = p - self._p_m
        length_m = math.sqrt(step @ step)
        if length_m < _STEP_M:
            return
        F = np.eye(5)
        F[:3, 3], F[:3, 4] = about_z(step), step
        self._P = F @ self._P @ F.T
        self._widen(self._rates.walk_m_per_sqrt_m**2 * length_m)
        self._P[3, 3] += np.radians(self._rates.heading_deg_per_sqrt_m) ** 2 * length_m
        self.path_m += length_m
        self._p_m = p.copy()

    def _widen(self, variance_m2: float) -> None:
        """Adds to the variance of x, y and z."""
        for k in range(3):
            self._P[k, k] += variance_m2

    def _keep(self, stamp_s: float, p_m: np.ndarray) -> None:
        self._recent.append((stamp_s, p_m.copy()))
        while self._recent[0][0] < stamp_s - _KEPT_S:
            self._recent.popleft()

    @property
    def covariance(self) -> np.ndarray:
        """(4, 4) of the body's x, y, z (odometry's axes) and yaw."""
        return self._P[:4, :4].copy()
