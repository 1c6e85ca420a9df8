# SPDX-License-Identifier: Apache-2.0
"""What runs on a rehearsed vehicle's computer: odometry, flight link, agent and guardian, the cores that fly."""

from functools import lru_cache
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.agent.core import AgentRules
from fcsv_control.agent.messages import Ack, AgentAlive, Ask, AskAnswered, Instruction, Kind, Pictures, SetPoint
from fcsv_control.agent.port import AgentPort
from fcsv_control.control_messages import MissionAlive
from fcsv_control.errors import ControlError
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.feed import FeedParameters, FeedVerdict, VisionFeed
from fcsv_control.flight.feed_check import FeedCheck
from fcsv_control.flight.messages import (
    AutopilotLimits,
    BarometerHeard,
    BatteryHeard,
    EstimateMoved,
    LinkLives,
    ModeAsked,
    PoseEstimated,
    PoseFed,
    PoseHeard,
    Refused,
    StateHeard,
)
from fcsv_control.flight.profile import Profile, load_profile
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import AskMode, HoldAt, Verdict
from fcsv_control.guardian.port import GuardianPort, OtherGuarded
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import telemetry as tm
from fcsv_geometry import transforms
from fcsv_geometry.arrivals import RELAY
from fcsv_geometry.flight_limits import FlightBounds
from fcsv_geometry.flow import RateGate
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.bringup import bringup
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, BodyPose
from fcsv_tracking.scene_motion import SceneLook

WALL_S = 1.7e9  # the wall clock at the rehearsal's zero
_TEXTS = {"STATUSTEXT": "text", "PARAM_VALUE": "param_id", "PARAM_SET": "param_id", "PARAM_REQUEST_READ": "param_id"}
_PORT = 2  # of the autopilot, at which the companion is
_GUARDIAN_EVERY = 4  # passes between two steps of the guardian: 25 Hz


class OnBoard:
    """The companion of one vehicle. ``clock_offset_s``: its wall clock against the others'."""

    _server: MavlinkServer  # the other end of its line
    _passes = 0
    now_s = 0.0  # its monotonic clock

    def __init__(self, geometry: VehicleGeometry, rules: AgentRules, guardian: GuardianRules):
        self.geometry, self.name = geometry, geometry.name
        self.clock_offset_s = 0.0
        self._odometry = BodyOdometry(geometry.T_body_t265)
        self.epoch = self._odometry.epoch
        self._feed = VisionFeed(FeedParameters())
        self.watchdog = FeedWatchdog(WatchdogParameters(), 0.0)
        self.link = new_link(geometry)
        self.agent_port = AgentPort(self.name, rules, f"agent-{self.name}", 0.0)
        self.guardian_port = GuardianPort(self.name, guardian, 0.0)
        self.verdict = Verdict()  # as its guardian told it last
        self.check = FeedCheck()
        self.battery_said: Optional[float] = None  # what its monitor says, where that is not the truth
        self._latched: Dict[object, object] = {}  # what the control PC told for good, as it came last
        self.agent_runs = self.link_runs = True
        self._tell_epoch()
        self.recording = False
        self.pictures = 0
        self.acks: List[Ack] = []
        self.odometry: Optional[BodyPose] = None
        self.T_odom_body: Optional[np.ndarray] = None  # of that; never changed in place
        self.height_m = self._ground_m = 0.0
        self.modes_asked: List[Tuple[float, str]] = []  # every mode command that left the companion
        self.told: Callable[[float, str, object], None] = _nobody  # "sent" a message, "ordered" an instruction, "held"
        self._requests: List[Tuple[Ask, object]] = []
        self._gate, self._urgent = RateGate(5.0), ()
        self._do: Dict[type, Callable[[float, object], None]] = {
            Ack: self._acknowledge, AgentAlive: self.guardian_port.receive, Ask: self._ask,
            ModeAsked: self.guardian_port.receive, Pictures: self._switch, SetPoint: self._hold,
        }  # fmt: skip

    # ---- the radio ---------------------------------------------------------------------------------------------

    def obey(self, instruction: Instruction) -> None:
        """A command came over the radio."""
        now_s = self.now_s
        self.told(now_s, "ordered", instruction)
        self._on_board_hear(now_s, instruction)

    def hear_control(self, alive: MissionAlive, latched: Mapping[object, object]) -> None:
        """A sign of life of the mission came, and what the control PC told for good: once each."""
        now_s = self.now_s
        self._on_board_hear(now_s, alive)
        for key, message in latched.items():
            if self._latched.get(key) is not message:
                self._latched[key] = message
                self.guardian_port.receive(now_s, message)
                if isinstance(message, tm.EpochsFound):
                    self._tell_agent(now_s, message)

    def _tell_agent(self, now_s: float, message: object) -> None:
        if self.agent_runs:
            self.agent_port.receive(now_s, message)

    def _on_board_hear(self, now_s: float, message: object) -> None:
        """Agent and guardian."""
        self.guardian_port.receive(now_s, message)
        self._tell_agent(now_s, message)

    def tell(self) -> Sequence[object]:
        """What the other vehicles are told."""
        if self.odometry is None:
            return ()
        p, state = self.odometry, self.link.state
        return (
            tm.VehicleOdometry(self.name, RELAY, p.stamp_s, self.T_odom_body, p.linear_mps),
            tm.VehicleState(self.name, RELAY, state.mode, state.armed, self.link.connected(self.now_s)),
            OtherGuarded(self.name, self.verdict),
        )

    def hear_other(self, sent_s: float, messages: Sequence[object]) -> None:
        """Another vehicle told of itself, at ``sent_s`` as the relay measured it."""
        topics = [f"/{m.vehicle}/{m.topic}" for m in messages if isinstance(m, tm.VehicleOdometry)]
        for message in (tm.RelayAges(topics, [sent_s] * len(topics)), *messages):
            self.guardian_port.receive(self.now_s, message)

    @property
    def guardian(self) -> Guardian:
        """To look at."""
        return self.guardian_port.core

    # ---- odometry, link, agent, guardian -----------------------------------------------------------------------

    def _sampled(self, now_s: float, stamp_s: float, T: np.ndarray, linear: np.ndarray, angular: np.ndarray) -> None:
        """A sample of the tracker, through the odometry's gate, to the autopilot."""
        p, q = tuple(T[:3, 3].tolist()), transforms.fast_quaternion_xyzw(T)
        try:
            twist = tuple(linear.tolist()), tuple(angular.tolist())
            self.odometry = self._odometry.feed(stamp_s, p, q, *twist, came_s=now_s)
        except OdometryRejected:
            return
        self.T_odom_body = transforms.from_xyz_quaternion(self.odometry.p_odom_body, self.odometry.q_odom_body_xyzw)
        if self._odometry.epoch != self.epoch:
            self.epoch = self._odometry.epoch
            self._tell_epoch()
        if self._feed.judge(now_s, stamp_s)[0] is FeedVerdict.SEND:
            T_odom_body, stamp_s = self.T_odom_body, self._feed.stamp_s
            self.guardian_port.receive(now_s, PoseFed(T_odom_body))
            if not self.link_runs:
                return  # who judges poses is the link's process, too
            in_the_air = self.link.state.in_the_air
            if self.check.waits(now_s, in_the_air):
                self.watchdog.feed(now_s)
                return
            if not self.check.passes(now_s, stamp_s, T_odom_body, self.link.state.armed, in_the_air):
                return
            if self.check.came_back:
                self.link.note_reset()
            self.link.send_pose(stamp_s, T_odom_body)
            self.watchdog.feed(now_s)

    def _tell_epoch(self) -> None:
        self._on_board_hear(self.now_s, tm.OdometryEpoch(self.name, "", self.epoch.number, self.epoch.reason))

    def _scene_looked(self, now_s: float, seen: SceneLook) -> None:
        """Its pictures were held against its tracker."""
        if self.link_runs:
            self.check.scene(now_s, seen.span_s, seen.off_rad, seen.turn_rad, seen.points, seen.one_way)

    def _on_board(self, now_s: float) -> None:  # noqa: C901
        """The line between autopilot and link, the link's events, the watchdog, the agent."""
        for message in self._server.outgoing():
            self.link.take(now_s, _as_received(message))
        self._end_requests(now_s)
        for event in self.link.events():
            if isinstance(event, PoseHeard):
                self._estimate(now_s, event)
            elif isinstance(event, BarometerHeard):
                self.check.barometer(now_s, event.height_m)
            elif isinstance(event, EstimateMoved):
                self._tell_agent(now_s, event)
            elif self.link.state.mode and isinstance(event, (StateHeard, BatteryHeard)):
                self._tell_state(now_s)
        state = self.link.state
        if self.watchdog.check(now_s, state.armed, state.mode, self.link.mode_is_ours) is Alarm.LAND:
            self._set_mode(now_s, "LAND")
        if self._passes % _GUARDIAN_EVERY == 0:
            self._guard(now_s)
        for output in self.agent_port.step(now_s) if self.agent_runs else ():
            handler = self._do.get(type(output))
            if handler is not None:
                handler(now_s, output)
        self.link.step(now_s)
        for message in self.link.outgoing():
            self._to_autopilot(now_s, message)
        if self.recording and self._passes % 10 == 0:
            self.pictures += 1

    def _guard(self, now_s: float) -> None:
        """One step of the guardian, and what it wants done."""
        s = self.link.state
        if self.link_runs and self._link_tells(now_s):
            parameters = self.link.heard.parameters
            wrong = parameters.wrong()
            health = LinkLives(
                self.check.doubt, s.ekf_variance, s.throttle, now_s - s.throttle_heard_s, s.system_status,
                self.link.origin_set(now_s), parameters.known and not wrong, wrong[0] if wrong else "", s.in_the_air,
                self.link.connected(now_s), pid=0,
            )  # fmt: skip
            limits = AutopilotLimits({n: parameters.value(n) for n in FlightBounds().autopilot_parameters})
            for message in (limits, health):
                self.guardian_port.receive(now_s, message)
        for output in self.guardian_port.step(now_s):
            if isinstance(output, AskMode) and self.link_runs:
                self._set_mode(now_s, output.mode)
            elif isinstance(output, HoldAt):
                self.link.send_set_point(output.T_odom_body)
                self.told(now_s, "held", output)
            elif isinstance(output, Verdict):
                self.verdict = output
                self._tell_agent(now_s, output)

    def _tell_state(self, now_s: float) -> None:
        """Mode and battery."""
        s = self.link.state
        self._on_board_hear(now_s, tm.VehicleState(self.name, "", s.mode, s.armed, self.link.connected(now_s)))
        share = s.battery_share if self.battery_said is None else self.battery_said
        self.guardian_port.receive(now_s, tm.BatteryCharge(self.name, "", share))

    def _link_tells(self, now_s: float) -> bool:
        """Whether it tells of itself now, as LinkHealthReport does."""
        s, before = self.link.state, self._urgent
        self._urgent = (self.check.doubt, self.link.connected(now_s), self.link.origin_set(now_s), s.booting)
        return self._urgent != before or self._gate.passes(now_s)

    def _estimate(self, now_s: float, heard: PoseHeard) -> None:
        T_odom_body = heard.T_odom_body
        self._on_board_hear(now_s, PoseEstimated(T_odom_body))
        self.check.estimate(now_s, T_odom_body, heard.v_odom_mps)
        if self.link.state.mode and not self.link.state.armed:
            self._ground_m = float(T_odom_body[2, 3])
        self.height_m = float(T_odom_body[2, 3]) - self._ground_m

    # ---- what the agent wants ----------------------------------------------------------------------------------

    def _ask(self, now_s: float, ask: Ask) -> None:
        """The agent calls a service of the link."""
        try:
            if ask.kind is Kind.SET_MODE:
                self.modes_asked.append((now_s, ask.mode))
                request = self.link.set_mode(now_s, ask.mode)
            elif ask.kind is Kind.ARM:
                request = self.link.arm(now_s, ask.flag)
            else:
                request = self.link.take_off(now_s, ask.altitude_m)
        except ControlError as error:
            self._refuse(now_s, ask, error)
            return
        self._requests.append((ask, request))

    def _refuse(self, now_s: float, ask: Ask, error: ControlError) -> None:
        self._tell_agent(now_s, Refused(str(error)))
        self._tell_agent(now_s, AskAnswered(ask.number, False))

    def _set_mode(self, now_s: float, mode: str):
        self.modes_asked.append((now_s, mode))
        self.guardian_port.receive(now_s, ModeAsked(mode))
        return self.link.set_mode(now_s, mode)

    def _end_requests(self, now_s: float) -> None:
        for ask, request in [r for r in self._requests if r[1].over]:
            self._requests.remove((ask, request))
            try:
                request.require_done()
                self._tell_agent(now_s, AskAnswered(ask.number, True))
            except ControlError as error:
                self._refuse(now_s, ask, error)

    def _acknowledge(self, now_s: float, ack: Ack) -> None:
        self.acks.append(ack)
        self.guardian_port.receive(now_s, ack)

    def _switch(self, _now_s: float, output: Pictures) -> None:
        self.recording = output.on

    def _hold(self, _now_s: float, output: SetPoint) -> None:
        self.link.send_set_point(output.T_odom_body)

    def _to_autopilot(self, now_s: float, message) -> None:
        self.told(now_s, "sent", message)
        self._server.take(now_s, _as_received(message))

    # ---- processes that die ------------------------------------------------------------------------------------

    def swap_link(self, link, watchdog, died: bool = False, knows: bool = True) -> None:
        """Another link process in place of the one that runs. What was asked of one that ``died`` fails; a new one
        ``knows`` nothing of what it was fed before."""
        self.link, self.watchdog, self._feed = link, watchdog, VisionFeed(FeedParameters())
        self.check = self.check if knows else FeedCheck()
        for ask, _ in self._requests if died else []:
            self._tell_agent(self.now_s, AskAnswered(ask.number, False, "the flight link died"))
        self._requests = [] if died else self._requests

    def _wall_s(self, now_s: float) -> float:
        return WALL_S + now_s + self.clock_offset_s


def new_link(geometry: VehicleGeometry) -> LinkCore:
    """A flight link's process as it begins, with the parameters that an autopilot must have."""
    return LinkCore(LinkParameters(target_system=geometry.system_id), _profile())


@lru_cache(maxsize=None)
def _profile() -> Profile:
    """As launch/uav.launch names it."""
    return load_profile(str(bringup() / "config" / "autopilot" / "arducopter-4.3-t265.param")).at_port(_PORT)


def _nobody(_now_s: float, _what: str, _which: object) -> None:
    """Nobody is told."""


def _as_received(message):
    """A message as the other side reads it: texts are strings, not bytes."""
    name = _TEXTS.get(message.get_type())
    value = getattr(message, name) if name else None
    if isinstance(value, bytes):
        setattr(message, name, value.rstrip(b"\0").decode("ascii", "replace"))
    return message
