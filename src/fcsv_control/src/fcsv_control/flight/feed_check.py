# SPDX-License-Identifier: Apache-2.0
"""Whether the external navigation can be believed, held against the autopilot's own attitude and estimate.

A T265 that looks down is known to freeze (one pose with fresh stamps) and to run off. Both pass every gate on stamps
and steps. The attitude of the autopilot comes from its IMU and knows nothing of the tracker.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

import numpy as np

from fcsv_geometry.config import require_positive

_G_MPS2 = 9.81


@dataclass(frozen=True)
class FeedCheckRules:
    """Bounds. In hover a T265's noise moves its pose by some millimetres and hundredths of a degree in 0.3 s."""

    frozen_s: float = 0.3
    frozen_m: float = 0.001  # span of the position
    frozen_deg: float = 0.02  # span of the attitude
    least_samples: int = 6
    run_off_s: float = 0.5  # over which a change of velocity is held against the lean
    run_off_mps: float = 1.5  # between both; drag and gusts make up to 0.7 m/s
    climb_mps: float = 6.0  # no vehicle here climbs or sinks as fast
    apart_m: float = 0.8  # between estimate and feed, beyond what is flown in apart_lag_s
    apart_lag_s: float = 0.2
    apart_s: float = 0.5  # for so long

    def __post_init__(self):
        require_positive(self)


class FeedCheck:
    """``doubt`` says why the feed of an armed vehicle is not to be believed; it stays until the vehicle is disarmed,
    because a tracker that comes to itself again has lost its place."""

    def __init__(self, rules: Optional[FeedCheckRules] = None):
        self._rules = rules or FeedCheckRules()
        self._samples: Deque[Tuple[float, np.ndarray, np.ndarray]] = deque()  # stamp, position, forward and left axes
        self._leans: Deque[Tuple[float, np.ndarray]] = deque()  # time, acceleration (m/s2, odom) that the lean makes
        self._estimate: Optional[np.ndarray] = None
        self._apart_since_s: Optional[float] = None
        self.doubt = ""

    def begin_again(self) -> None:
        """Motors are off, or the odometry frame was begun anew: nothing of before counts."""
        self._samples.clear()
        self._leans.clear()
        self._apart_since_s = None
        self.doubt = ""

    def estimate(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """The autopilot's: its position, and an attitude whose roll and pitch are its IMU's."""
        self._estimate = T_odom_body[:3, 3]
        up = T_odom_body[:3, 2]
        lean = np.array([up[0], up[1]]) * (_G_MPS2 / max(float(up[2]), 0.3))
        self._leans.append((now_s, lean))
        while self._leans[0][0] < now_s - 2.0 * self._rules.run_off_s:
            self._leans.popleft()

    def feed(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> str:
        """A pose of an armed vehicle on its way to the autopilot; the doubt, empty where there is none.

        Speeds go by the poses' own stamps: when they arrive tells how busy the computer is. A clock that was set begins
        anew.
        """
        if self._samples and not 0.0 < stamp_s - self._samples[-1][0] < 1.0:
            self._samples.clear()
        self._samples.append((stamp_s, T_odom_body[:3, 3].copy(), T_odom_body[:3, :2].copy()))
        while self._samples[0][0] < stamp_s - self._rules.run_off_s - 0.2:
            self._samples.popleft()
        self.doubt = self.doubt or self._frozen(stamp_s) or self._ran_off(now_s, stamp_s) or self._apart(now_s)
        return self.doubt

    def _frozen(self, stamp_s: float) -> str:
        r = self._rules
        recent = [s for s in self._samples if s[0] >= stamp_s - r.frozen_s - 0.02]
        if len(recent) < r.least_samples or recent[-1][0] - recent[0][0] < r.frozen_s - 0.05:
            return ""
        first = recent[0]
        still = all(
            float(np.abs(p - first[1]).max()) < r.frozen_m
            and float(np.abs(axes - first[2]).max()) < math.radians(r.frozen_deg)
            for _, p, axes in recent[1:]
        )
        return f"the tracker has not moved at all for {r.frozen_s:g} s: frozen" if still else ""

    def _ran_off(self, now_s: float, stamp_s: float) -> str:
        """The feed's change of velocity against what the lean can have made of it."""
        r = self._rules
        before = [s for s in self._samples if s[0] <= stamp_s - r.run_off_s]
        if len(before) < 2 or len(self._samples) < len(before) + r.least_samples or len(self._leans) < 2:
            return ""
        v_then, v_now = _velocity(before[-1], before[0]), _velocity(self._samples[-1], self._samples[-4])
        if v_then is None or v_now is None:
            return ""
        if abs(float(v_now[2])) > r.climb_mps:
            return f"the tracker climbs at {float(v_now[2]):.0f} m/s: it runs off"
        leans = [lean for at_s, lean in self._leans if at_s >= now_s - r.run_off_s]
        expected = np.mean(leans, axis=0) * r.run_off_s if leans else np.zeros(2)
        off_mps = float(np.linalg.norm(v_now[:2] - v_then[:2] - expected))
        return f"the tracker's speed changes by {off_mps:.1f} m/s without a lean: it runs off" if (
            off_mps > r.run_off_mps
        ) else ""  # fmt: skip

    def _apart(self, now_s: float) -> str:
        r = self._rules
        if self._estimate is None:
            return ""
        v = _velocity(self._samples[-1], self._samples[0])
        speed = 0.0 if v is None else float(np.linalg.norm(v))
        distance_m = float(np.linalg.norm(self._samples[-1][1] - self._estimate))
        if distance_m <= r.apart_m + r.apart_lag_s * speed:
            self._apart_since_s = None
            return ""
        if self._apart_since_s is None:
            self._apart_since_s = now_s
        lasts = now_s - self._apart_since_s > r.apart_s
        return f"tracker and autopilot are {distance_m:.1f} m apart" if lasts else ""


def _velocity(late, early) -> Optional[np.ndarray]:
    """(3,) m/s between two samples; None where they are one."""
    dt_s = late[0] - early[0]
    return (late[1] - early[1]) / dt_s if dt_s > 0.02 else None
