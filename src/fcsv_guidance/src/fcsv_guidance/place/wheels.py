# SPDX-License-Identifier: Apache-2.0
"""Wheel odometry as a robot's driver sends it: which readings count, and jumps that no wheels made.

A driver that starts again begins at 0; what the robot drove then is not known.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Deque, NamedTuple, Optional

import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.config import require_positive
from fcsv_guidance.clock import ahead_of_clock, behind_clock
from fcsv_guidance.robot import Robot

_FASTER = 2.0  # than its file says
_NOISE = 0.1  # m and rad between two readings that no speed explains
_SILENT_S, _AT_START_M, _AWAY_M = 1.0, 0.1, 0.3  # of a driver that started again


@dataclass(frozen=True)
class WheelOdometry:
    """Where the wheels say that the robot is, in a frame of their own: x, y (m), yaw (rad)."""

    stamp_s: float
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True)
class WheelRules:
    """A robot is never faster than ``fastest_mps`` and ``fastest_radps``: its odometry has jumped. A
    reading older than ``oldest_s`` says that clocks differ."""

    fastest_mps: float = 5.0
    fastest_radps: float = 6.0
    oldest_s: float = 5.0

    def __post_init__(self):
        require_positive(self)

    def of_robot(self, robot: Robot) -> "WheelRules":
        """The same where ``robot`` is known, which is sometimes driven faster than its file says."""
        return replace(
            self,
            fastest_mps=min(self.fastest_mps, _FASTER * robot.speed_mps),
            fastest_radps=min(self.fastest_radps, _FASTER * robot.turning_rate_radps),
        )


class _Jump(NamedTuple):
    """Two readings, by their stamps, between which the odometry jumped."""

    from_s: float
    to_s: float


class WheelReader:
    """Readings in the order of their stamps become one way without jumps."""

    def __init__(self, rules: WheelRules = WheelRules()):
        self._rules = rules
        self._raw: Optional[WheelOdometry] = None  # the last reading as it came
        self._read: Optional[WheelOdometry] = None  # the same, on the way
        self._off: Optional[np.ndarray] = None  # x, y, yaw of the driver's frame on the way
        self._jumps: Deque[_Jump] = deque(maxlen=50)
        #: why the last reading does not count; empty where it does
        self.refusal = ""
        #: how the odometry jumped at the last reading; empty where it did not
        self.jump = ""

    def read(self, now_s: float, raw: WheelOdometry) -> Optional[WheelOdometry]:
        """The reading on the way; None where it does not count, is late, or came twice."""
        self.jump, self.refusal = "", self._refusal(now_s, raw)
        if self.refusal or (self._raw is not None and raw.stamp_s <= self._raw.stamp_s):
            return None
        self.jump = "" if self._raw is None else self._jumped(self._raw, raw)
        if self.jump:
            self._jumps.append(_Jump(self._raw.stamp_s, raw.stamp_s))
            self._off = _frame_of(raw, self._read)
        self._raw = raw
        self._read = raw if self._off is None else _in_frame(self._off, raw)
        return self._read

    def unknown(self, from_s: float, to_s: float) -> np.ndarray:
        """(3,) variances of x, y (m^2) and yaw (rad^2): what the robot may have driven in jumps
        between two times."""
        found = np.zeros(3)
        for jump in self._jumps:
            shared_s = min(to_s, jump.to_s) - max(from_s, jump.from_s)
            if shared_s > 0.0:
                lasts_s = jump.to_s - jump.from_s
                far_m = self._rules.fastest_mps * lasts_s
                turned_rad = min(np.pi, self._rules.fastest_radps * lasts_s)
                whole = np.array([0.5 * far_m**2, 0.5 * far_m**2, turned_rad**2])
                found += shared_s / lasts_s * whole
        return found

    def _refusal(self, now_s: float, raw: WheelOdometry) -> str:
        if not np.isfinite([raw.stamp_s, raw.x_m, raw.y_m, raw.yaw_rad]).all():
            return "wheel odometry is not finite"
        off = ahead_of_clock(now_s, raw.stamp_s)
        off = off or behind_clock(now_s, raw.stamp_s, self._rules.oldest_s)
        return off and f"wheel odometry {off}"

    def _jumped(self, a: WheelOdometry, b: WheelOdometry) -> str:
        elapsed_s = b.stamp_s - a.stamp_s
        far_m = float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m))
        turned_rad = abs(rotations.wrap(b.yaw_rad - a.yaw_rad))
        began_anew = (
            elapsed_s > _SILENT_S
            and np.hypot(b.x_m, b.y_m) < _AT_START_M
            and np.hypot(a.x_m, a.y_m) > _AWAY_M
        )
        if not (
            began_anew
            or far_m > self._rules.fastest_mps * elapsed_s + _NOISE
            or turned_rad > self._rules.fastest_radps * elapsed_s + _NOISE
        ):
            return ""
        return (
            f"wheel odometry jumped by {far_m:.1f} m and {np.degrees(turned_rad):.0f} degrees in "
            f"{elapsed_s:.2f} s: what the robot drove then is not known; has its driver started again?"
        )


def between(a: WheelOdometry, b: WheelOdometry, stamp_s: float) -> WheelOdometry:
    """A reading between two, as if the wheels had turned evenly."""
    share = (stamp_s - a.stamp_s) / (b.stamp_s - a.stamp_s)
    yaw = a.yaw_rad + share * rotations.wrap(b.yaw_rad - a.yaw_rad)
    return WheelOdometry(
        stamp_s, a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m), yaw
    )


def _frame_of(raw: WheelOdometry, read: WheelOdometry) -> np.ndarray:
    """(3,) x, y, yaw of the driver's frame, where ``raw`` in it is ``read``."""
    yaw = rotations.wrap(read.yaw_rad - raw.yaw_rad)
    c, s = np.cos(yaw), np.sin(yaw)
    x_m = read.x_m - (c * raw.x_m - s * raw.y_m)
    return np.array([x_m, read.y_m - (s * raw.x_m + c * raw.y_m), yaw])


def _in_frame(off: np.ndarray, raw: WheelOdometry) -> WheelOdometry:
    c, s = np.cos(off[2]), np.sin(off[2])
    x_m = float(off[0] + c * raw.x_m - s * raw.y_m)
    y_m = float(off[1] + s * raw.x_m + c * raw.y_m)
    return WheelOdometry(raw.stamp_s, x_m, y_m, rotations.wrap(float(off[2]) + raw.yaw_rad))
