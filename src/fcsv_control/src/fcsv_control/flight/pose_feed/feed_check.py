# SPDX-License-Identifier: Apache-2.0
"""Whether the external navigation can be believed, held against the autopilot's own velocity and
estimate.

A T265 that looks down is known to freeze (one pose with fresh stamps) and to run off. Both pass
every gate on stamps and steps. The velocity of the autopilot's filter comes from its IMU; a wrong
feed pulls it only within about half a second (measured: a step of 0.5 m is followed within 1 s). A
pose that this velocity cannot explain is withheld at once, so that the filter does not learn from
it; when such poses go on, the feed is in doubt.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Deque, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.flight.pose_feed.estimate import apart_m
from fcsv_control.flight.pose_feed.height_check import HeightCheck, HeightCheckRules
from fcsv_control.flight.pose_feed.scene_check import SceneCheck, SceneCheckRules
from fcsv_geometry.config import require_positive
from fcsv_geometry.vehicles.thresholds import APART_IN_FLIGHT_M

_CLOCK_STEP_S = 0.15  # between the sender's clock and ours
_GAP_S = 0.5  # silence after which nothing of before counts
# so long the autopilot's filter needs after one, or after a reset that was announced:
_SETTLE_S = 1.5
_IGNORES_S = 1.08  # with VISO_TYPE 2 ArduCopter ignores poses for so long, and adopts the next one
_HEARS_S = 1.5  # until a link that was just started has heard from the autopilot

Vector = Tuple[float, float, float]


@dataclass(frozen=True)
class PoseCheckRules:
    """Bounds. In hover a T265's noise moves its pose by some millimetres and hundredths of a degree
    in 0.3 s."""

    frozen_s: float = 0.3
    frozen_m: float = 0.001  # span of the position
    frozen_deg: float = 0.02  # span of the attitude
    least_samples: int = 6
    horizon_s: float = 0.4  # over which a pose is predicted
    noise_m: float = 0.06  # of two poses and the way between them
    speed_mps: float = 0.12  # of the filter's velocity
    lag_s: float = 0.04  # between both: counts while the velocity changes
    most_gaps: int = 3  # silences of more than half a second in one flight
    # between estimate and feed after such a silence: more is not to be followed, but adopted
    returns_m: float = 0.3
    withheld_s: float = 0.25  # so long nothing believable came: doubt
    # between estimate and feed, beyond what is flown in apart_lag_s
    apart_m: float = APART_IN_FLIGHT_M.link.red
    apart_lag_s: float = 0.2
    apart_s: float = 0.5  # for so long
    height: HeightCheckRules = field(default_factory=HeightCheckRules)
    scene: SceneCheckRules = field(default_factory=SceneCheckRules)

    def __post_init__(self):
        require_positive(self)


class PoseCheck:
    """``doubt`` says why the feed of a flying vehicle is not to be believed; it stays until the
    vehicle is on the ground, because a tracker that comes to itself again has lost its place."""

    def __init__(self, rules: Optional[PoseCheckRules] = None):
        self._rules = rules or PoseCheckRules()
        # time, way by velocity (m, odom), velocity
        self._way: Deque[Tuple[float, Vector, Vector]] = deque()
        self._estimate: Optional[Vector] = None
        self._skew_s = 0.0
        self._settled_s = self._adopted_s = self._new_frame_s = -math.inf
        self._announced = False
        self._height = HeightCheck(self._rules.height)
        self._scene = SceneCheck(self._rules.scene)
        self._first_s: Optional[float] = None
        self.came_back = False
        self._clear()

    def begin_again(self) -> None:
        """The odometry frame was begun anew, and the autopilot is told so: nothing of before
        counts. Estimate and feed are compared again once the autopilot has adopted the new frame.
        The first pose in it may come a little later than the announcement."""
        self._clear()
        self._announced = True

    def _clear(self) -> None:
        self._clock_s: Optional[float] = None
        self._gaps = 0
        # stamp; position, forward and left axes (9,)
        self._samples: Deque[Tuple[float, Tuple[float, ...]]] = deque()
        # stamp, position, way, velocity
        self._believed: Deque[Tuple[float, Vector, Vector, Vector]] = deque()
        self._withheld_since_s: Optional[float] = None
        self._apart_since_s: Optional[float] = None
        self._off_m = 0.0
        self._tracker_m: Optional[float] = None  # its height
        self._height.begin_again()
        self._scene.begin_again()
        self.scene_says = ""  # stays like a doubt
        self.doubt = ""

    def on_ground(self) -> None:
        """Not flying: nothing of before counts, and the height of the ground is here."""
        self._clear()
        self._announced = False
        self._height.on_ground()

    def waits(self, now_s: float, in_the_air: Optional[bool]) -> bool:
        """Whether a pose is held back because a link that was just started does not know yet
        whether it flies, and where the autopilot believes to be: what is elsewhere must be told as
        a reset. Not for long."""
        self._first_s = now_s if self._first_s is None else self._first_s
        knows = in_the_air is False or (in_the_air is True and self._estimate is not None)
        return not knows and now_s - self._first_s < _HEARS_S

    def estimate(self, now_s: float, T_odom_body: np.ndarray, v_odom_mps: Sequence[float]) -> None:
        """The autopilot's position and velocity (m/s, odom)."""
        self._estimate = tuple(T_odom_body[:3, 3].tolist())
        x, y, z = v_odom_mps
        way = (0.0, 0.0, 0.0)
        if self._way:
            before_s, (wx, wy, wz), (bx, by, bz) = self._way[-1]
            half_s = 0.5 * min(now_s - before_s, _GAP_S)
            way = (wx + half_s * (x + bx), wy + half_s * (y + by), wz + half_s * (z + bz))
        self._way.append((now_s, way, (x, y, z)))
        while self._way[0][0] < now_s - 2.0 * _GAP_S:
            self._way.popleft()

    def barometer(self, now_s: float, height_m: float) -> None:
        """The autopilot's, of a flying vehicle: only how it changes counts."""
        if self._tracker_m is not None:
            off_m = self._height.barometer(now_s, height_m, self._tracker_m)
            self.doubt = self.doubt or self._height.doubt(off_m)

    def scene(
        self,
        now_s: float,
        span_s: float,
        off_rad: float,
        turn_rad: float,
        points: int,
        one_way: float = 0.0,
    ) -> None:
        """What the vehicle's own pictures say of the tracker's motion (SceneMotion.msg), while it
        flies."""
        if self._tracker_m is not None:
            self.scene_says = (
                self._scene.look(now_s, span_s, off_rad, turn_rad, points) or self.scene_says
            )
            said = self._scene.one_way(now_s, span_s, one_way, self._height.above_m)
            self.scene_says = self.scene_says or said
            if self._rules.scene.lands:
                self.doubt = self.doubt or self.scene_says
            elif self._rules.scene.one_way_lands:
                self.doubt = self.doubt or said

    def passes(
        self,
        now_s: float,
        stamp_s: float,
        T_odom_body: np.ndarray,
        armed: bool,
        in_the_air: Optional[bool],
    ) -> bool:
        """Whether a pose may go to the autopilot. On the ground there is nothing to feel;
        ``in_the_air`` None: the autopilot has not said."""
        if armed and in_the_air:
            return self.passes_in_flight(now_s, stamp_s, T_odom_body)
        self.came_back = False
        (self._clear if in_the_air is None else self.on_ground)()
        return True

    def passes_in_flight(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> bool:
        """Whether a pose of a flying vehicle may go to the autopilot. ``came_back``: it is the
        first after a silence and elsewhere, so that the autopilot must be told of a reset. It would
        take the step for flight, and meet the ground too fast.

        Times go by the poses' own stamps: when they arrive tells how busy the computer is. A clock
        that was set, and a gap, begin anew.
        """
        gap = self._continue(now_s, stamp_s)
        if self._announced:
            self._announced = False
            self._adopted_s, self._new_frame_s = now_s + _SETTLE_S, now_s + _IGNORES_S
        rows = T_odom_body.tolist()
        p_m = (rows[0][3], rows[1][3], rows[2][3])
        self.came_back = gap and apart_m(p_m, self._estimate) > self._rules.returns_m
        self._tracker_m = p_m[2]
        pose = (*p_m, rows[0][0], rows[1][0], rows[2][0], rows[0][1], rows[1][1], rows[2][1])
        repeats = bool(self._samples) and pose == self._samples[-1][1]  # to the last bit: no news
        self._samples.append((stamp_s, pose))
        while self._samples[0][0] < stamp_s - self._rules.frozen_s - 0.05:
            self._samples.popleft()
        believed = not repeats and (
            self._explained(stamp_s, p_m) or self._is_new_frame(now_s, stamp_s, p_m)
        )
        if believed:
            self._withheld_since_s = None
        elif self._withheld_since_s is None:
            self._withheld_since_s = stamp_s
        doubt = (
            self.doubt or self._comes_and_goes() or self._frozen(stamp_s) or self._ran_off(stamp_s)
        )
        self.doubt = doubt or self._apart(now_s, p_m)
        return believed and not self.doubt

    def _continue(self, now_s: float, stamp_s: float) -> bool:
        """Goes on after a step of the sender's clock, or a gap, everything but a doubt begins anew.
        After a gap (True) the autopilot's filter finds its way back first."""
        gap = self._clock_s is None and not self._height.ground_seen  # of whoever fed before
        if gap:
            self._settled_s = now_s + _SETTLE_S
        elif self._clock_s is not None:
            step_s, arrived_s = stamp_s - self._clock_s, now_s - self._skew_s - self._clock_s
            gap = arrived_s > _GAP_S
            if gap:
                self._settled_s = now_s + _SETTLE_S
                self._gaps += 1
            if abs(step_s - arrived_s) > _CLOCK_STEP_S or not 0.0 < step_s < _GAP_S:
                doubt, gaps = self.doubt, self._gaps
                self._clear()
                self.doubt, self._gaps = doubt, gaps
        self._clock_s, self._skew_s = stamp_s, now_s - stamp_s
        return gap

    # ---- against the velocity --------------------------------------------------------------------

    def _explained(self, stamp_s: float, p_m: Vector) -> bool:
        """Whether the velocity has brought the vehicle here, from what was believed last and some
        time ago."""
        if not self._way or stamp_s + self._skew_s < self._settled_s:
            return True
        r, (way, v) = self._rules, self._way_at(stamp_s + self._skew_s)
        known = (self._believed[0], self._believed[-1]) if self._believed else ()
        for then_s, p_then, way_then, v_then in known:
            (x, y, z), (ax, ay, az), (bx, by, bz) = p_then, way_then, way
            off_m = math.dist(p_m, (x + bx - ax, y + by - ay, z + bz - az))
            bound_m = r.noise_m + r.speed_mps * min(stamp_s - then_s, r.horizon_s)
            if off_m > bound_m + r.lag_s * math.dist(v, v_then):
                self._off_m = off_m
                return False
        self._off_m = 0.0
        self._believed.append((stamp_s, p_m, way, v))
        while len(self._believed) > 2 and self._believed[1][0] <= stamp_s - r.horizon_s:
            self._believed.popleft()
        return True

    def _is_new_frame(self, now_s: float, stamp_s: float, p_m: Vector) -> bool:
        """Whether a pose that is elsewhere is the first one in a frame that was announced a moment
        ago; once."""
        if now_s >= self._new_frame_s:
            return False
        self._new_frame_s = -math.inf
        self._believed.clear()
        return self._explained(stamp_s, p_m)

    def _way_at(self, at_s: float) -> Tuple[Vector, Vector]:
        """Way (m) and velocity (m/s) at a time of our clock, by the velocities heard."""
        late_s, way, v = self._way[-1]
        if at_s >= late_s:
            ahead_s = min(at_s - late_s, 0.1)
            return (way[0] + ahead_s * v[0], way[1] + ahead_s * v[1], way[2] + ahead_s * v[2]), v
        for early_s, way_before, v_before in reversed(self._way):
            if early_s <= at_s:
                share = (at_s - early_s) / (late_s - early_s)
                between = tuple(a + share * (b - a) for a, b in zip(way_before, way))
                return between, tuple(a + share * (b - a) for a, b in zip(v_before, v))
            late_s, way, v = early_s, way_before, v_before
        return way, v

    # ---- doubt -----------------------------------------------------------------------------------

    def _comes_and_goes(self) -> str:
        """Says what comes and goes: after a gap poses are believed for a while; a tracker that
        begins anew again and again tells nothing."""
        return "the tracker comes and goes" if self._gaps >= self._rules.most_gaps else ""

    def _frozen(self, stamp_s: float) -> str:
        r, newest = self._rules, self._samples[-1][1]
        if (
            len(self._samples) < r.least_samples
            or stamp_s - self._samples[0][0] < r.frozen_s - 0.05
        ):
            return ""
        angle_rad = math.radians(r.frozen_deg)
        for _, pose in self._samples:  # the oldest first: mostly it has moved already
            if any(abs(a - b) >= r.frozen_m for a, b in zip(pose[:3], newest)):
                return ""
            if any(abs(a - b) >= angle_rad for a, b in zip(pose[3:], newest[3:])):
                return ""
        return f"the tracker has not moved at all for {r.frozen_s:g} s: frozen"

    def _ran_off(self, stamp_s: float) -> str:
        since_s = self._withheld_since_s
        if since_s is None or stamp_s - since_s < self._rules.withheld_s or not self._off_m:
            return ""
        return f"the tracker is {self._off_m:.1f} m from where the vehicle can be: it runs off"

    def _apart(self, now_s: float, p_m: Vector) -> str:
        r = self._rules
        if not self._way or now_s < max(self._settled_s, self._adopted_s):
            return ""
        distance_m = apart_m(p_m, self._estimate)
        if not distance_m > r.apart_m + r.apart_lag_s * math.hypot(*self._way[-1][2]):
            self._apart_since_s = None
            return ""
        if self._apart_since_s is None:
            self._apart_since_s = now_s
        lasts = now_s - self._apart_since_s > r.apart_s
        return f"tracker and autopilot are {distance_m:.1f} m apart" if lasts else ""
