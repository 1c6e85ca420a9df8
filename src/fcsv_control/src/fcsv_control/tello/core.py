# SPDX-License-Identifier: Apache-2.0
"""The decisions of an autopilot for a Tello, which has none of its own: modes, take-off, holding,
landing, failsafes.

No ROS, no thread, no clock. ``now_s`` is monotonic. In GUIDED and BRAKE the PID flies by the
tracker's poses; without fresh ones sticks are let go, and the Tello's own flow sensor holds.
Whatever a pilot's stick says, he wins.
"""

import math
from typing import List, Optional

import numpy as np

from fcsv_control import conditions
from fcsv_control.errors import CommandRefused
from fcsv_control.tello.climb import Climb
from fcsv_control.tello.messages import (
    ALERT,
    CRITICAL,
    INFO,
    NOTICE,
    WARNING,
    FlightReport,
    GiveSticks,
    LandNow,
    LogReport,
    Output,
    StayUp,
    TelloState,
    TelloText,
)
from fcsv_control.tello.observer import ObserverRules
from fcsv_control.tello.pid import PidConfig, PositionPid, Sticks
from fcsv_control.tello.rules import BRAKE, GUIDED, LAND, MODES, PILOT, TelloRules
from fcsv_control.tello.tracking import Tracking
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

_STOPS_S = 0.5  # a vehicle that is told to hold comes to rest so much further
_OURS = (GUIDED, BRAKE)
_STAY_UP_TIMES = 10  # at 25 Hz: one of them may be lost in the air
_LONGEST_STEP_S = 0.2


class TelloCore:
    """One Tello: what is heard, what is asked for, and ``step`` at 25 Hz; ``outgoing`` says what to
    do."""

    def __init__(
        self, name: str, pid: PidConfig, rules: TelloRules, observer: Optional[ObserverRules] = None
    ):
        self._name, self._rules = name, rules
        self._pid = PositionPid(pid)
        self.tracking = Tracking(observer or ObserverRules(), pid.sticks, rules.doubt_s)
        self.mode = PILOT
        self._target: Optional[np.ndarray] = None
        self._climb: Optional[Climb] = None
        self._sticks, self._step_s = Sticks(), -math.inf
        self._pilot, self._pilot_s = Sticks(), -math.inf
        self._heard_s = self._land_asked_s = self._entered_s = -math.inf
        self._stay_up_left = 0
        self._on_flow = self._silent = False
        self._battery_said = math.inf
        self._out: List[Output] = []

    # ---- what is heard ---------------------------------------------------------------------------

    def tello_lives(self, now_s: float) -> None:
        """Any packet of the Tello."""
        if self._silent:
            self._give_text(NOTICE, f"the Wi-Fi is back after {now_s - self._heard_s:.1f} s")
            self._silent = False
            self._pid.reset()
        self._heard_s = now_s

    def flight(self, now_s: float, report: FlightReport) -> None:
        """Flight data."""
        self.tello_lives(now_s)
        first, landed = self.tracking.report is None, self.flying and not report.in_the_air
        self.tracking.report = report
        if first and report.in_the_air:
            self._enter(now_s, BRAKE, WARNING, "it flies already: holding it where it is")
        if landed:
            self._climb = None
            self._give_text(INFO, "on the ground, motors off")

    def log(self, now_s: float, report: LogReport) -> None:
        """A log packet: its own odometry."""
        self.tello_lives(now_s)
        self.tracking.log(now_s, report)

    def pose(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> None:
        """A pose of the tracker, measured at ``stamp_s``."""
        by_sight = self.mode == PILOT or not self.flying
        if by_sight and self.tracking.doubt(now_s):
            self.tracking.forget()  # who is carried or flown by hand may be anywhere
        moved = self.tracking.pose(now_s, stamp_s, T_odom_body, self._rules.feed_old_s)
        if moved is not None:
            self._out.append(moved)

    def set_point(self, T_odom_body: np.ndarray) -> None:
        """Where it should be; obeyed in GUIDED only, and none that is not finite."""
        if self.mode == GUIDED and np.isfinite(T_odom_body).all():
            self._target = transforms.level(T_odom_body)

    def pilot(self, now_s: float, sticks: Sticks) -> None:
        """The pilot's sticks; one that he moves takes the vehicle."""
        self._pilot, self._pilot_s = sticks, now_s
        if self.flying and self.mode != PILOT and sticks.moved > self._rules.pilot_moved:
            self._climb = None
            self._enter(
                now_s, PILOT, WARNING, f"the pilot's stick was moved in {self.mode}: he flies"
            )

    # ---- what is asked for; each raises CommandRefused with the reason ---------------------------

    def set_mode(self, now_s: float, mode: Mode) -> None:
        """One of MODES."""
        if mode not in MODES:
            raise CommandRefused(
                f"{self._name}: a Tello has no mode '{mode}'; it has {', '.join(MODES)}"
            )
        if mode == GUIDED:
            self._require_guided(now_s)
        if mode != self.mode:
            if mode in (BRAKE, LAND):
                self._climb = None
            self._enter(now_s, mode, INFO, f"{mode} was asked for")

    def arm(self, value: bool) -> None:
        """A Tello arms by taking off, and disarms by landing."""
        if value != self.flying:
            raise CommandRefused(
                f"{self._name}: a Tello's motors start with its take-off and stop with its landing"
            )

    def take_off(self, now_s: float, altitude_m: float) -> None:
        """Takes off to an altitude above where it stands, in a pilot's hands or, with a tracker
        that sees it, in GUIDED."""
        r, report = self._rules, self.tracking.report
        if not self.state(now_s).connected or report is None:
            raise CommandRefused(f"{self._name}: no flight data; look at its Wi-Fi")
        if self.flying or self._climb is not None:
            raise CommandRefused(f"{self._name}: it flies, or is taking off already")
        if not 0.5 <= altitude_m <= r.highest_m:
            raise CommandRefused(
                f"{self._name}: altitude {altitude_m:g} m is not in 0.5..{r.highest_m:g}"
            )
        battery = conditions.battery(report.battery_share, r.warn_battery)
        if not battery.green:
            raise CommandRefused(f"{self._name}: {battery.words}: charge it")
        if self.mode not in (PILOT, GUIDED):
            self._enter(now_s, PILOT, INFO, "taking off")
        self._pid.reset()
        self._climb = Climb(now_s, altitude_m, r)

    def _require_guided(self, now_s: float) -> None:
        r = self._rules
        doubt = self.tracking.doubt(now_s)
        if not self.state(now_s).connected:
            raise CommandRefused(f"{self._name}: GUIDED needs its Wi-Fi, which is lost")
        if doubt:
            raise CommandRefused(f"{self._name}: {doubt}")
        if self.tracking.steady_s(now_s, r.feed_old_s) < r.feed_steady_s:
            raise CommandRefused(
                f"{self._name}: GUIDED needs poses of the tracker for {r.feed_steady_s:g} s"
            )
        empty = conditions.battery(self.state(now_s).battery_share, r.land_battery)
        if empty.red:
            raise CommandRefused(f"{self._name}: {empty.words}")

    # ---- time ------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Failsafes, then sticks."""
        dt_s = min(max(now_s - self._step_s, 1e-3), _LONGEST_STEP_S)
        self._step_s = now_s
        self.tracking.observer.step(now_s, self._sticks)
        if self.flying or self._climb is not None:
            self._watch_wifi(now_s)
            self._watch_battery(now_s)
            self._watch_poses(now_s)
        self._stay_up()
        self._sticks = self._decide(now_s, dt_s)
        self._out.append(GiveSticks(self._sticks))

    def outgoing(self) -> List[Output]:
        """What to do now, each given once."""
        out, self._out = self._out, []
        return out

    @property
    def flying(self) -> bool:
        """Says whether it flies, as its flight data said last."""
        return self.tracking.report is not None and self.tracking.report.in_the_air

    def state(self, now_s: float) -> TelloState:
        """What is shown."""
        report = self.tracking.report
        return TelloState(
            now_s - self._heard_s <= self._rules.silent_s,
            self.flying,
            self.mode,
            None if report is None else report.in_the_air,
            math.nan if report is None else report.battery_share,
            self.tracking.height_m,
        )

    def pilot_stick(self, now_s: float) -> Sticks:
        """The pilot's sticks while he is heard."""
        return self._pilot if now_s - self._pilot_s <= self._rules.pilot_old_s else Sticks()

    # ---- failsafes -------------------------------------------------------------------------------

    def _watch_wifi(self, now_s: float) -> None:
        age_s, r = now_s - self._heard_s, self._rules
        lost, gone = (conditions.wifi_age(age_s, s) for s in (r.silent_s, r.silent_land_s))
        if lost.red and not self._silent:
            self._silent = True
            then = "it holds by itself, and lands after 15 s without sticks"
            self._give_text(CRITICAL, f"{lost.words}: {then}")
        if gone.red and self.mode != LAND:
            self._enter(now_s, LAND, ALERT, f"{gone.words}: landing")

    def _watch_battery(self, now_s: float) -> None:
        r, share = self._rules, self.state(now_s).battery_share
        for bound in (r.warn_battery, r.land_battery):
            found = conditions.battery(share, bound)
            if found.red and bound < self._battery_said:
                self._battery_said = bound
                self._give_text(CRITICAL, found.words)
        if found.red and self.mode in _OURS:
            self._enter(now_s, LAND, ALERT, f"{found.words}: landing")

    def _watch_poses(self, now_s: float) -> None:
        age_s, r = min(self.tracking.age_s(now_s), now_s - self._entered_s), self._rules
        old, lost = (conditions.feed_age(age_s, s) for s in (r.feed_old_s, r.feed_land_s))
        late = self.mode in _OURS and old.red
        if late and not self._on_flow:
            why = self.tracking.doubt(now_s) or "the tracker has lost it"
            self._give_text(CRITICAL, f"{why}: holding by its own flow sensor")
        elif self._on_flow and not late:
            self._pid.reset()
        self._on_flow = late
        if late and lost.red:
            self._enter(now_s, LAND, ALERT, f"{lost.words}: landing")

    # ---- sticks ----------------------------------------------------------------------------------

    def _decide(self, now_s: float, dt_s: float) -> Sticks:
        if self.mode == LAND:
            self._land(now_s)
            return Sticks()
        if self._climb is not None:
            return self._take_off_step(now_s)
        if not self.flying or self._silent:
            return Sticks()
        if self.mode == PILOT:
            return self.pilot_stick(now_s)
        if self._target is None and self.tracking.age_s(now_s) <= self._rules.feed_old_s:
            self._target = self._here()  # the tracker did not know it when the mode began
        if self._on_flow or self._target is None:
            return Sticks()
        observer = self.tracking.observer
        return self._pid.sticks(dt_s, observer.T_odom_body, observer.v_mps, self._target)

    def _land(self, now_s: float) -> None:
        if (self.flying or self._silent) and now_s - self._land_asked_s >= self._rules.repeat_s:
            self._land_asked_s = now_s
            self._out.append(LandNow())

    def _stay_up(self) -> None:
        """A Tello that was told to land goes on landing, whatever its sticks say, until it is told
        to stay."""
        if self._stay_up_left and self.flying and not self._silent:
            self._stay_up_left -= 1
            self._out.append(StayUp())

    def _take_off_step(self, now_s: float) -> Sticks:
        climb = self._climb
        wish = climb.step(now_s, self.flying, self.tracking.height_m)
        if climb.over:
            self._climb = None
            if climb.failed:
                self._give_text(CRITICAL, f"take-off: {climb.failed}")
            if self.mode == GUIDED:
                self._target = self._here()
        if isinstance(wish, Sticks):
            return wish
        self._out.append(wish)
        return Sticks()

    def _enter(self, now_s: float, mode: Mode, severity: int, why: str) -> None:
        self._stay_up_left = _STAY_UP_TIMES if self.mode == LAND and mode != LAND else 0
        self.mode, self._on_flow, self._entered_s = mode, False, now_s
        self._give_text(severity, why)
        self._pid.reset()
        self._target = self._here() if mode in _OURS else None
        self._land_asked_s = -math.inf

    def _here(self) -> Optional[np.ndarray]:
        """Where it comes to rest, level; None where the tracker does not know."""
        observer = self.tracking.observer
        if not observer.known:
            return None
        T = observer.T_odom_body
        return transforms.transform(T[:3, :3], T[:3, 3] + _STOPS_S * observer.v_mps)

    def _give_text(self, severity: int, text: str) -> None:
        self._out.append(TelloText(severity, f"{self._name}: {text}"))
