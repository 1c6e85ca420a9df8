# SPDX-License-Identifier: Apache-2.0
"""What the link knows of where its Tello is: the tracker's poses, and before the first of them its
own odometry."""

import math
from typing import Optional

import numpy as np

from fcsv_control.tello.messages import FlightReport, FrameMoved, LogReport
from fcsv_control.tello.observer import Observer, ObserverRules
from fcsv_control.tello.pid import StickModel
from fcsv_geometry import transforms
from fcsv_geometry.streams.stream import Stream

_LOG_DELAY_S = 0.07  # of its log packets (docs/design/trackers.md)


class Tracking:
    """Ages in s, by monotonic time; ``T_odom_body`` is an estimate for now."""

    def __init__(self, rules: ObserverRules, sticks: StickModel, doubt_s: float):
        self.observer = Observer(rules, sticks)
        self._doubt_s = doubt_s
        self._own: Optional[np.ndarray] = None
        self._log_s = -math.inf
        self._good_since_s = self._good_s = self._refused_since_s = -math.inf
        self._refusing = False
        self._fed: Stream[None] = Stream(2.0)
        self.report: Optional[FlightReport] = None

    @property
    def T_odom_body(self) -> Optional[np.ndarray]:
        """Gives the pose by the tracker, else by its own odometry; None before either."""
        return self.observer.T_odom_body if self.observer.known else self._own

    @property
    def height_m(self) -> float:
        """Above take-off, by itself; its log is finer than its flight data."""
        if self._own is not None:
            return float(self._own[2, 3])
        return 0.0 if self.report is None else self.report.height_m

    def age_s(self, now_s: float) -> float:
        """Since the newest good pose was measured; infinite before the first."""
        return now_s - self.observer.stamp_s

    def steady_s(self, now_s: float, old_s: float) -> float:
        """Says for how long good poses have come without a gap of ``old_s``; nought where they do
        not."""
        return now_s - self._good_since_s if self.age_s(now_s) <= old_s else 0.0

    def rate_hz(self, now_s: float) -> float:
        """Counts the rate of good poses."""
        return self._fed.rate_hz(now_s)

    def doubt(self, now_s: float) -> str:
        """Why the tracker's poses are not believed; empty where they are."""
        if not self._refusing or now_s - self._refused_since_s < self._doubt_s:
            return ""
        return f"the tracker's poses are refused: {self.observer.why_refused}"

    def pose(
        self, now_s: float, stamp_s: float, T_odom_body: np.ndarray, gap_s: float
    ) -> Optional[FrameMoved]:
        """A pose of the tracker came; the first one moves the estimate's frame."""
        before = self.T_odom_body if not self.observer.known else None
        if not self.observer.pose(now_s, stamp_s, T_odom_body):
            if not self._refusing:
                self._refusing, self._refused_since_s = True, now_s
            return None
        self._refusing = False
        if now_s - self._good_s > gap_s:
            self._good_since_s = now_s
        self._good_s = now_s
        self._fed.tell(now_s)
        if before is None:
            return None
        return FrameMoved(T_odom_body[:3, 3] - before[:3, 3])

    def log(self, now_s: float, log: LogReport) -> None:
        """A log packet came."""
        if np.isfinite(log.T_own_body).all():
            self._own = transforms.level(log.T_own_body)
            self.observer.velocity(now_s, now_s - _LOG_DELAY_S, log.v_body_mps, now_s - self._log_s)
            self._log_s = now_s

    def forget(self) -> None:
        """The next pose counts, wherever it is: on the ground, or where a pilot flies by sight."""
        self.observer.forget()
        self._refusing, self._good_since_s = False, -math.inf
