# SPDX-License-Identifier: Apache-2.0
"""The flight link's process without its transport: poses, set-points and requests in; what the
autopilot says out.

Which poses of the odometry go on, which are believed, and what follows where they stop is decided
here, for our own link and beside MAVROS.
"""

import logging
import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Union

from fcsv_control.agent.messages import Ask, Kind, SetPoint
from fcsv_control.errors import CommandRefused, ControlError
from fcsv_control.flight.core import LinkCore
from fcsv_control.flight.mavlink.firmware import COPTER
from fcsv_control.flight.mavlink.requests import Request
from fcsv_control.flight.mavlink.texts import ALERT, CRITICAL
from fcsv_control.flight.mavros import MavrosCore
from fcsv_control.flight.messages import (
    AutopilotLimits,
    AutopilotState,
    BarometerReceived,
    BatteryReading,
    BatteryReceived,
    EstimateMoved,
    Event,
    FromAutopilot,
    LinkLives,
    LinkText,
    ModeAsked,
    OdometryReset,
    ParametersChecked,
    PoseEstimated,
    PoseFed,
    PosePassed,
    PoseReceived,
    RcReceived,
    RequestOver,
    StateReceived,
    ToAutopilot,
    TransmitterReading,
)
from fcsv_control.flight.pose_feed.feed import PoseGate, PoseGateParameters, PoseVerdict
from fcsv_control.flight.pose_feed.feed_check import PoseCheck, PoseCheckRules
from fcsv_control.flight.pose_feed.watchdog import Alarm, PoseWatchdog, WatchdogParameters
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import Profile
from fcsv_control.flight.take_off import TakeOff
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode

_LOG = logging.getLogger(__name__)
_WATCH_S, _STALL_S = 0.05, 0.25  # a watch that comes later than the second was delayed itself
_STATE_S = 0.4  # so that one that is lost on the radio is no second of silence
_HEALTH_HZ, _DIAGNOSE_S = 5.0, 1.0
_LIMITS = tuple(FlightBounds().autopilot_parameters)


@dataclass(frozen=True)
class ExternalNavigationRules:
    """Which poses go on, which are believed, and what follows where they stop."""

    feed: PoseGateParameters = field(default_factory=PoseGateParameters)
    watchdog: WatchdogParameters = field(default_factory=WatchdogParameters)
    check: PoseCheckRules = field(default_factory=PoseCheckRules)


class FlightLinkPort:
    """Gives messages to the autopilot first; step it after each message, and at least 20 times a
    second. ``pid``: of the process that it runs in; ``mavros``: the component with which a MAVROS
    speaks that it stands beside."""

    def __init__(
        self,
        vehicle: str,
        link: LinkParameters,
        profile: Profile,
        rules: ExternalNavigationRules,
        pid: int,
        now_s: float,
        mavros: Optional[int] = None,
    ):
        core = LinkCore(link, profile) if mavros is None else MavrosCore(link, profile, mavros)
        self.core, self.check = core, PoseCheck(rules.check)  # to look at
        self._vehicle, self._pid = vehicle, pid
        self._feed, self._watchdog = PoseGate(rules.feed), PoseWatchdog(rules.watchdog, now_s)
        self._watched_s, self._warned = now_s, False
        self._landing: Optional[Request] = None
        self._asked: Dict[int, Union[Request, TakeOff]] = {}
        self._gate, self._urgent = RateGate(_HEALTH_HZ), ()
        self._shown: Optional[AutopilotState] = None
        self._shown_s = self._diagnosed_s = -math.inf
        self._parameters: Optional[ParametersChecked] = None
        self._feed_problems: Dict[str, str] = {}
        self._out: List[object] = []
        self._take = Takers(
            {
                Ask: self._ask,
                FromAutopilot: lambda now_s, m: core.receive(now_s, m.message),
                ModeAsked: lambda _now_s, m: core.mode_asked(m.mode),
                OdometryReset: self._begin_again,
                PoseFed: self._fed,
                SetPoint: lambda _now_s, m: core.send_set_point(m.T_odom_body),
                tm.SceneLook: lambda now_s, m: self.check.scene(
                    now_s, m.span_s, m.off_rad, m.turn_rad, m.points, m.one_way
                ),
            },
            "a flight link takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def step(self, now_s: float) -> Sequence[object]:
        """Time passes: what goes to the autopilot, what it said, what became of requests, and of
        the feed."""
        self.core.step(now_s)
        for event in self.core.events():
            self._on_event(now_s, event)
        if now_s - self._watched_s >= _WATCH_S:
            self._watch(now_s)
        self._end_requests()
        out = [*map(ToAutopilot, self.core.outgoing()), *self._out]
        self._out = []
        return out

    # ---- from the autopilot ----------------------------------------------------------------------

    def _on_event(self, now_s: float, event: Event) -> None:
        s = self.core.state
        if isinstance(event, StateReceived):
            self._show(now_s)
        elif isinstance(event, PoseReceived):
            self.check.estimate(now_s, event.T_odom_body, event.v_odom_mps)
            self._out.append(PoseEstimated(event.T_odom_body))
        elif isinstance(event, BarometerReceived):
            self.check.barometer(now_s, event.height_m)
        elif isinstance(event, BatteryReceived):
            self._out.append(BatteryReading(s.battery_share, s.voltage_v, s.current_a))
        elif isinstance(event, RcReceived):
            self._out.append(TransmitterReading(s.rc_channels, s.rc_rssi))
        else:
            if isinstance(event, EstimateMoved):
                moved_m = math.hypot(*event.step_m)
                _LOG.warning("%s: the autopilot's estimate moved by %.2f m", self._vehicle, moved_m)
            self._out.append(event)

    def _show(self, now_s: float) -> None:
        """The state where it changed, and 2.5 times a second."""
        s = self.core.state
        shown = AutopilotState(
            self.core.connected(now_s), s.armed, s.guided, s.manual_input, s.mode, s.system_status
        )
        if shown != self._shown or now_s - self._shown_s >= _STATE_S:
            self._shown, self._shown_s = shown, now_s
            self._out.append(shown)

    # ---- requests --------------------------------------------------------------------------------

    def _ask(self, now_s: float, ask: Ask) -> None:
        try:
            if ask.kind is Kind.SET_MODE:
                self._asked[ask.number] = self.core.set_mode(now_s, ask.mode)
            elif ask.kind is Kind.ARM:
                self._asked[ask.number] = self.core.arm(now_s, ask.flag)
            else:
                self._asked[ask.number] = self.core.take_off(now_s, ask.altitude_m)
        except ControlError as error:
            self._out.append(_over(ask.number, error))

    def _end_requests(self) -> None:
        for number, request in [r for r in self._asked.items() if r[1].over] if self._asked else ():
            del self._asked[number]
            try:
                request.require_done()
                self._out.append(RequestOver(number))
            except ControlError as error:
                self._out.append(_over(number, error))
        if self._landing is not None and self._landing.over:
            try:
                self._landing.require_done()
            except ControlError as error:
                _LOG.error("landing after the loss of the pose feed: %s", error)
            self._landing = None

    # ---- the feed of poses -----------------------------------------------------------------------

    def _begin_again(self, _now_s: float, _m: OdometryReset) -> None:
        self.core.note_reset()
        self.check.begin_again()

    def _fed(self, now_s: float, m: PoseFed) -> None:
        verdict, why = self._feed.decide(now_s, m.stamp_s)
        if verdict is PoseVerdict.DROP:
            self._out.append(tm.Dropped("late pose", why))
        if verdict is not PoseVerdict.SEND:
            return
        if self.check.waits(now_s, self.core.state.in_the_air):
            self._watchdog.pose_sent(now_s)
        elif self._believed(now_s, m):
            self.core.send_pose(self._feed.stamp_s, m.T_odom_body, now_s)
            self._watchdog.pose_sent(now_s)
            self._out.append(PosePassed())

    def _believed(self, now_s: float, m: PoseFed) -> bool:
        """Whether a pose agrees with what the autopilot feels."""
        s = self.core.state
        believed = self.check.passes(
            now_s, self._feed.stamp_s, m.T_odom_body, s.armed, s.in_the_air
        )
        if believed and self.check.came_back:
            self.core.note_reset()
        self._problem("tracker", self.check.doubt or self.check.scene_says)
        return believed

    def _watch(self, now_s: float) -> None:
        """What the age of the feed asks for; state, health and diagnosis where they are due."""
        pause_s, self._watched_s = now_s - self._watched_s, now_s
        if pause_s > _STALL_S:
            _LOG.warning(
                "%s: this computer did not let the flight link run for %.2f s",
                self._vehicle,
                pause_s,
            )
            self._watchdog.slept(now_s, pause_s - _WATCH_S)
        self._watch_poses(now_s)
        self._show(now_s)
        self._live(now_s)
        if now_s - self._diagnosed_s >= _DIAGNOSE_S or not self.core.connected(now_s):
            self._diagnosed_s = now_s
            self._check_parameters()
            self._out.append(self._diagnosis(now_s))

    def _watch_poses(self, now_s: float) -> None:
        s, ours = self.core.state, self.core.mode_is_ours
        alarm = self._watchdog.check(now_s, s.armed, s.mode, ours)
        late = alarm is not Alarm.NONE
        age = f"pose feed is {self._watchdog.age_s(now_s):.1f} s old" if late else ""
        self._problem("feed", f"{age} while flying in {s.mode}" if late else "")
        if late and not self._warned:
            by_hand = (
                "" if s.mode == Mode.GUIDED or ours else f" in {s.mode}: fly in ALT_HOLD, or land"
            )
            self._out.append(LinkText(CRITICAL, f"{self._vehicle}: {age}{by_hand}"))
        self._warned = late
        if alarm is Alarm.LAND and self._landing is None:
            self._out.append(LinkText(ALERT, f"{self._vehicle}: {age}, landing"))
            self._out.append(ModeAsked(Mode.LAND))  # else it is a pilot's
            try:
                self._landing = self.core.set_mode(now_s, Mode.LAND)
                self.core.step(now_s)
            except ControlError as error:
                _LOG.error("landing after the loss of the pose feed: %s", error)

    # ---- what it tells of itself -----------------------------------------------------------------

    def _live(self, now_s: float) -> None:
        """Tells that it lives, at 5 Hz, and at once where there is another doubt of the poses, or
        where it is no longer known whether the autopilot may be flown."""
        core, s, parameters = self.core, self.core.state, self.core.listener.parameters
        connected, origin_set, doubt = (
            core.connected(now_s),
            core.origin_set(now_s),
            self.check.doubt,
        )
        urgent = (doubt, connected, origin_set, parameters.known, s.booting)
        if urgent == self._urgent and not self._gate.passes(now_s):
            return
        self._urgent = urgent
        wrong = parameters.wrong()
        self._out.append(
            LinkLives(
                doubt,
                s.ekf_variance,
                s.throttle,
                now_s - s.throttle_heard_s,
                s.system_status,
                origin_set,
                parameters.known and not wrong,
                wrong[0] if wrong else "",
                s.in_the_air,
                connected,
                self._pid,
                s.ekf_flags,
                now_s - s.ekf_heard_s,
                core.pose_rate_hz(now_s),
                core.pose_age_s(now_s),
                core.estimate_apart_m(now_s),
                s.prearm_ok,
            )
        )

    def _check_parameters(self) -> None:
        """What the autopilot's parameters are against the profile, where that is news."""
        check = self.core.listener.parameters
        limits = AutopilotLimits({name: check.value(name) for name in _LIMITS})
        found = ParametersChecked(
            check.profile.name,
            self._firmware,
            check.complete,
            check.problems(),
            check.warnings(),
            check.unknown(),
            limits,
        )
        if found != self._parameters:
            self._parameters = found
            self._out.append(found)

    @property
    def _firmware(self) -> str:
        """Names the firmware, as "ArduCopter 4.6.2"; empty before it was told."""
        return f"{COPTER} {self.core.listener.version}" if self.core.listener.version else ""

    def _problem(self, key: str, text: str) -> None:
        """Keeps a problem of the feed: told at once."""
        problem = f"{self._vehicle}: {text}" if text else ""
        if problem != self._feed_problems.get(key, ""):
            self._feed_problems[key] = problem
            self._out.append(tm.Diagnosis({key: problem}, {}))

    def _diagnosis(self, now_s: float) -> tm.Diagnosis:
        """What changes slowly."""
        heard, s = self.core.listener, self.core.state
        wrong, weak = "; ".join(heard.parameters.problems()), "; ".join(heard.parameters.warnings())
        imitated = heard.identities.imitated(now_s, heard.target)
        silent = heard.foreigner or "no heartbeat of the autopilot"
        restart = "origin's altitude is 0, height runs away: restart the autopilot"
        problems = {
            "link": "" if self.core.connected(now_s) else silent,
            "parameters": f"autopilot's parameters: {wrong}" if wrong else "",
            "advised": f"advised parameters: {weak}" if weak else "",
            "autopilots": f"a second autopilot, {heard.strangers}, is on the line"
            if heard.strangers
            else "",
            "heartbeats": imitated,
            "origin": restart if heard.origin_at_zero and not s.armed else "",
        }
        trip_s, offset_s = heard.timesync.round_trip_s, heard.timesync.offset_s
        values = {
            "firmware": self._firmware,
            "line's round trip (ms)": "" if trip_s is None else f"{1e3 * trip_s:.1f}",
            "autopilot's clock (s)": "" if offset_s is None else f"{offset_s:.4f}",
            "mode": s.mode,
            "armed": s.armed,
            "ready to arm": s.prearm_ok,
            "origin": self.core.origin_set(now_s),
            "EKF flags": hex(s.ekf_flags),
            "EKF variance": f"{s.ekf_variance:.2f}",
            "throttle stick": f"{s.throttle:.2f}",
            "stick heard (s ago)": f"{now_s - s.throttle_heard_s:.1f}",
        }
        return tm.Diagnosis(
            {k: f"{self._vehicle}: {text}" if text else "" for k, text in problems.items()}, values
        )


def _over(number: int, error: ControlError) -> RequestOver:
    return RequestOver(number, str(error), isinstance(error, CommandRefused))
