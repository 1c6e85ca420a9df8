# SPDX-License-Identifier: Apache-2.0
"""Whether the external navigation can be believed, held against the autopilot's own velocity and estimate.

A T265 that looks down is known to freeze (one pose with fresh stamps) and to run off. Both pass every gate on stamps and steps.
The velocity of the autopilot's filter comes from its IMU; a wrong feed pulls it only within about half a second (measured:
a step of 0.5 m is followed within 1 s). A pose that this velocity cannot explain is withheld at once, so that the filter
does not learn from it; when such poses go on, the feed is in doubt.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Tuple

import numpy as np

from fcsv_geometry.config import require_positive

_CLOCK_STEP_S = 0.15  # between the sender's clock and ours
_GAP_S = 0.5  # silence after which nothing of before counts


@dataclass(frozen=True)
class FeedCheckRules:
    """Bounds. In hover a T265's noise moves its pose by some millimetres and hundredths of a degree in 0.3 s."""

    frozen_s: float = 0.3
    frozen_m: float = 0.001  # span of the position
    frozen_deg: float = 0.02  # span of the attitude
    least_samples: int = 6
    horizon_s: float = 0.4  # over which a pose is predicted
    noise_m: float = 0.06  # of two poses and the way between them
    speed_mps: float = 0.12  # of the filter's velocity
    lag_s: float = 0.04  # between both: counts while the velocity changes
    withheld_s: float = 0.25  # so long nothing believable came: doubt
    apart_m: float = 0.5  # between estimate and feed, beyond what is flown in apart_lag_s
    apart_lag_s: float = 0.2
    apart_s: float = 0.5  # for so long

    def __post_init__(self):
        require_positive(self)


class FeedCheck:
    """``doubt`` says why the feed of a flying vehicle is not to be believed; it stays until the vehicle is on the ground,
    because a tracker that comes to itself again has lost its place."""

    def __init__(self, rules: Optional[FeedCheckRules] = None):
        self._rules = rules or FeedCheckRules()
        self._way: Deque[Tuple[float, np.ndarray, np.ndarray]] = deque()  # time, way by velocity (m, odom), velocity
        self._estimate: Optional[np.ndarray] = None
        self._clock_s: Optional[float] = None
        self._skew_s = 0.0
        self.begin_again()

    def begin_again(self) -> None:
        """On the ground, or the odometry frame was begun anew: nothing of before counts."""
        self._samples: Deque[Tuple[float, np.ndarray]] = deque()  # stamp; position and forward, left axes (3, 3)
        self._believed: Deque[Tuple[float, np.ndarray, np.ndarray, np.ndarray]] = deque()  # stamp, position, way, velocity
        self._withheld_since_s: Optional[float] = None
        self._apart_since_s: Optional[float] = None
        self._off_m = 0.0
        self.doubt = ""

    def estimate(self, now_s: float, T_odom_body: np.ndarray, v_odom_mps: np.ndarray) -> None:
        """The autopilot's position and velocity (m/s, (3,), odom)."""
        self._estimate = T_odom_body[:3, 3]
        v = np.asarray(v_odom_mps, float)
        if self._way:
            before_s, way, v_before = self._way[-1]
            way = way + 0.5 * (v + v_before) * min(now_s - before_s, _GAP_S)
        else:
            way = np.zeros(3)
        self._way.append((now_s, way, v))
        while self._way[0][0] < now_s - 2.0 * _GAP_S:
            self._way.popleft()

    def judge(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> bool:
        """Whether a pose of a flying vehicle may go to the autopilot.

        Times go by the poses' own stamps: when they arrive tells how busy the computer is. A clock that was set, and a gap,
        begin anew.
        """
        self._continue(now_s, stamp_s)
        pose = T_odom_body[:3, [3, 0, 1]]
        repeats = bool(self._samples) and np.array_equal(pose, self._samples[-1][1])  # to the last bit: no news
        self._samples.append((stamp_s, pose))
        while self._samples[0][0] < stamp_s - self._rules.frozen_s - 0.05:
            self._samples.popleft()
        believed = not repeats and self._explained(stamp_s, pose[:, 0])
        if believed:
            self._withheld_since_s = None
        elif self._withheld_since_s is None:
            self._withheld_since_s = stamp_s
        self.doubt = self.doubt or self._frozen(stamp_s) or self._ran_off(stamp_s) or self._apart(now_s)
        return believed and not self.doubt

    def _continue(self, now_s: float, stamp_s: float) -> None:
        """After a step of the sender's clock, or a gap, everything but a doubt begins anew."""
        if self._clock_s is not None:
            stepped = abs(now_s - stamp_s - self._skew_s) > _CLOCK_STEP_S
            if stepped or not 0.0 < stamp_s - self._clock_s < _GAP_S:
                kept = self.doubt
                self.begin_again()
                self.doubt = kept
        self._clock_s, self._skew_s = stamp_s, now_s - stamp_s

    # ---- against the velocity --------------------------------------------------------------------------------

    def _explained(self, stamp_s: float, p_m: np.ndarray) -> bool:
        """Whether the velocity has brought the vehicle here, from what was believed last and some time ago."""
        if not self._way:
            return True
        way, v = self._way_at(stamp_s + self._skew_s)
        known = (self._believed[0], self._believed[-1]) if self._believed else ()
        for then_s, p_then, way_then, v_then in known:
            off_m = float(np.linalg.norm(p_m - p_then - (way - way_then)))
            r = self._rules
            bound_m = r.noise_m + r.speed_mps * min(stamp_s - then_s, r.horizon_s)
            if off_m > bound_m + r.lag_s * float(np.linalg.norm(v - v_then)):
                self._off_m = off_m
                return False
        self._off_m = 0.0
        self._believed.append((stamp_s, p_m.copy(), way, v))
        while len(self._believed) > 2 and self._believed[1][0] <= stamp_s - self._rules.horizon_s:
            self._believed.popleft()
        return True

    def _way_at(self, at_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """Way (m) and velocity (m/s) at a time of our clock, by the velocities heard."""
        late_s, way, v = self._way[-1]
        for early_s, way_before, v_before in reversed(self._way):
            if early_s <= at_s:
                break
            late_s, way, v = early_s, way_before, v_before
        else:
            return way, v
        if early_s == late_s:
            return way_before + v_before * min(at_s - early_s, 0.1), v_before
        share = (at_s - early_s) / (late_s - early_s)
        return way_before + share * (way - way_before), v_before + share * (v - v_before)

    # ---- doubt -----------------------------------------------------------------------------------------------

    def _frozen(self, stamp_s: float) -> str:
        r = self._rules
        recent = [pose for sample_s, pose in self._samples if sample_s >= stamp_s - r.frozen_s - 0.02]
        if len(recent) < r.least_samples or stamp_s - self._samples[0][0] < r.frozen_s - 0.05:
            return ""
        span = np.ptp(np.array(recent), axis=0)
        still = float(span[:, 0].max()) < r.frozen_m and float(span[:, 1:].max()) < math.radians(r.frozen_deg)
        return f"the tracker has not moved at all for {r.frozen_s:g} s: frozen" if still else ""

    def _ran_off(self, stamp_s: float) -> str:
        since_s = self._withheld_since_s
        if since_s is None or stamp_s - since_s < self._rules.withheld_s or not self._off_m:
            return ""
        return f"the tracker is {self._off_m:.1f} m from where the vehicle can be: it runs off"

    def _apart(self, now_s: float) -> str:
        r = self._rules
        if self._estimate is None or not self._way:
            return ""
        distance_m = float(np.linalg.norm(self._samples[-1][1][:, 0] - self._estimate))
        if distance_m <= r.apart_m + r.apart_lag_s * float(np.linalg.norm(self._way[-1][2])):
            self._apart_since_s = None
            return ""
        if self._apart_since_s is None:
            self._apart_since_s = now_s
        lasts = now_s - self._apart_since_s > r.apart_s
        return f"tracker and autopilot are {distance_m:.1f} m apart" if lasts else ""
