# SPDX-License-Identifier: Apache-2.0
"""One vehicle of a rehearsal: airframe, autopilot and tracker of the simulation; odometry, link and agent that fly."""

import math
from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Tuple

import numpy as np

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.messages import Ack, Ask, Instruction, Kind, Pictures, SetPoint
from fcsv_control.errors import ControlError
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.feed import FeedParameters, FeedVerdict, VisionFeed
from fcsv_control.flight.feed_check import FeedCheck
from fcsv_control.flight.listener import BatteryHeard, EstimateMoved, PoseHeard, StateHeard
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_control.guardian.air import AUTOPILOT_FAILSAFE, LinkReport, Other
from fcsv_control.guardian.core import AskMode, Guardian, HoldAt
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.tracker import T265_PROFILE, TrackerProfile
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.people.operator import Sight, Sticks
from fcsv_sim.people.rc import frame_of
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.vehicles.dynamics import STEP_S, Airframe, Quadrotor
from fcsv_sim.vehicles.vehicle import PASS_S, Piloted
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, BodyPose, EpochBegan

WALL_S = 1.7e9  # the wall clock at the rehearsal's zero
_SUBSTEPS = int(round(PASS_S / STEP_S))
_TEXTS = {"STATUSTEXT": "text", "PARAM_VALUE": "param_id", "PARAM_SET": "param_id", "PARAM_REQUEST_READ": "param_id"}
_BOARD_EVERY = 2  # passes between two steps of link and agent
_GUARDIAN_EVERY = 4  # and of the guardian: 25 Hz
_TRACKER_EVERY = 3  # passes between two samples of the tracker: 33 Hz, what goes to the autopilot of its 200 Hz


@dataclass
class Heard:
    """What the control PC was sent of a vehicle last, and when it arrived."""

    pose: Optional[np.ndarray] = None  # T_odom_body
    epoch: Optional[EpochBegan] = None
    speed_mps: float = math.inf
    pose_s: float = -math.inf
    mode: str = ""
    armed: bool = False
    connected: bool = False
    state_s: float = -math.inf
    height_m: float = 0.0
    battery_share: float = math.nan
    pictures: int = 0
    recorder_s: float = -math.inf


@dataclass(frozen=True)
class Start:
    """Where a vehicle stands (x, y, z, yaw in the world) and what the wind is."""

    xyz_yaw: Tuple[float, float, float, float]
    wind_mps: float = 1.0
    tracker: TrackerProfile = T265_PROFILE
    rules: AgentRules = field(default_factory=AgentRules)
    guardian: GuardianRules = field(default_factory=GuardianRules)


@dataclass(frozen=True)
class Told:
    """What a vehicle tells the others of itself."""

    name: str
    T_odom_body: np.ndarray
    speed_mps: float
    armed: bool
    mode: str
    uncontrolled: bool


class RehearsedVehicle:
    """``step`` advances everything on board by one pass. ``clock_offset_s``: its wall clock against the others'."""

    def __init__(self, geometry: VehicleGeometry, start: Start, seed: int):
        seed = seed * 1000 + geometry.system_id
        *position, yaw = start.xyz_yaw
        self.geometry, self.name = geometry, geometry.name
        self.clock_offset_s = 0.0
        self.body = Quadrotor(Airframe(), transforms.from_xyz_yaw(position, yaw), seed, start.wind_mps)
        self.autopilot = Autopilot(self.body.hover_thrust, seed)
        self._server = MavlinkServer(self.autopilot, geometry.system_id)
        self.tracker = T265(start.tracker, geometry.T_body_t265, seed)
        self.tracker_on = True
        self._odometry = BodyOdometry(geometry.T_body_t265)
        self.epoch = self._odometry.epoch
        self._feed = VisionFeed(FeedParameters())
        self._watchdog = FeedWatchdog(WatchdogParameters(), 0.0)
        self.link = LinkCore(LinkParameters(target_system=geometry.system_id))
        self.agent = AgentCore(self.name, start.rules)
        self.guardian = Guardian(self.name, start.guardian)
        self._check = FeedCheck()
        self.battery_said: Optional[float] = None  # what its monitor says, where that is not the truth
        self.T_home_odom: Dict[str, np.ndarray] = {}  # as the control PC told it last
        self.agent.epoch(self.epoch.number, self.epoch.reason)
        self.recording = False
        self.pictures = 0
        self.acks: List[Ack] = []
        self.odometry: Optional[BodyPose] = None
        self.height_m = self._ground_m = 0.0
        self.modes_asked: List[Tuple[float, str]] = []  # every mode command that left the companion
        self.told: Callable[[float, str, object], None] = _nobody  # "sent" a message, "ordered" an instruction, "held"
        self.by_hand: Optional[Tuple[float, int]] = None  # when its transmitter chose which mode
        self._switch_at = ""
        self.agent_runs = self.link_runs = True
        self._requests: List[Tuple[Ask, object]] = []
        self._command = (0.0, 0.0, 0.0, 0.0)
        self._piloted = Piloted(self.body, self.autopilot)
        self._passes = 0
        self._do: Dict[type, Callable[[float, object], None]] = {
            Ack: lambda now_s, o: self.acks.append(o), Ask: self._ask, Pictures: self._switch, SetPoint: self._hold,
        }  # fmt: skip

    # ---- what people see and do --------------------------------------------------------------------------------

    @property
    def p_world_m(self) -> np.ndarray:
        """Where it truly is."""
        return self.body.position_m

    def sight(self) -> Sight:
        """What a pilot sees of it."""
        mode, armed = self.link.state.mode, self.autopilot.armed
        return Sight(self.body.T_world_body, self.body.velocity_mps, armed, mode)

    def sticks(self, now_s: float, s: Sticks) -> None:
        """A frame of its transmitter."""
        self.autopilot.rc_frame(now_s, frame_of(s.roll, s.pitch, s.throttle, s.yaw, s.mode))
        moved, self._switch_at = s.mode != self._switch_at, s.mode
        if moved and self.autopilot.mode == modes.NUMBERS[s.mode]:
            self.by_hand = (now_s, self.autopilot.mode)

    def obey(self, instruction: Instruction, now_s: float) -> None:
        """A command came over the radio."""
        self.told(now_s, "ordered", instruction)
        if instruction.kind in (Kind.GOTO, Kind.HOLD):
            self.guardian.moved(now_s)
        self.agent.take(now_s, instruction)

    def hear_control(self, now_s: float, T_home_odom: Dict[str, np.ndarray]) -> None:
        """The mission's state came, and where odometry frames stand in home."""
        self.agent.control_heard(now_s, "mission")
        self.guardian.control_heard(now_s)
        self.T_home_odom = T_home_odom
        self.guardian.home(T_home_odom.get(self.name))

    def tell(self) -> Optional[Told]:
        """What the other vehicles are told."""
        if self.odometry is None:
            return None
        state, blind = self.link.state, self.guardian.verdict.uncontrolled
        speed = math.hypot(*self.odometry.linear_mps)
        return Told(self.name, self.T_odom_body, speed, state.armed, state.mode, blind)

    def hear_other(self, now_s: float, told: Told) -> None:
        """Another vehicle told of itself."""
        T_home_odom = self.T_home_odom.get(told.name)
        if T_home_odom is not None:
            p = (T_home_odom @ told.T_odom_body)[:3, 3]
            self.guardian.other(
                told.name, Other(p, now_s, told.speed_mps, told.armed, told.mode, told.uncontrolled)
            )

    # ---- time --------------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """One pass of the autopilot (10 ms), which ends at ``now_s``."""
        state = self.body.advance(self._command, _SUBSTEPS)[-1]
        rpy_rad = self._piloted.sense(now_s, state)
        self._passes += 1
        if self.tracker_on and self._passes % _TRACKER_EVERY == 0:
            self._track(now_s)
        if self._passes % _BOARD_EVERY == 0:
            self._server.step(now_s, rpy_rad)
            self._on_board(now_s)
        self._command = self._piloted.decide(now_s, state)

    def _track(self, now_s: float) -> None:
        """A sample of the tracker, through the odometry's gate, to the autopilot."""
        stamp_s = self._wall_s(now_s)
        T, linear, angular = self.tracker.odometry(stamp_s, self.body.T_world_body)
        p, q = tuple(T[:3, 3].tolist()), transforms.fast_quaternion_xyzw(T)
        try:
            twist = tuple(linear.tolist()), tuple(angular.tolist())
            self.odometry = self._odometry.feed(stamp_s, p, q, *twist, came_s=now_s)
        except OdometryRejected:
            return
        if self._odometry.epoch != self.epoch:
            self.epoch = self._odometry.epoch
            self.agent.epoch(self.epoch.number, self.epoch.reason)
        if self._feed.judge(now_s, stamp_s)[0] is FeedVerdict.SEND:
            T_odom_body, stamp_s = self.T_odom_body, self._feed.stamp_s
            self.guardian.feed(now_s, T_odom_body)
            if not self.guardian.air.flying:
                self._check.begin_again()
            elif not self._check.judge(now_s, stamp_s, T_odom_body):
                return
            self.link.send_pose(stamp_s, T_odom_body)
            self._watchdog.feed(now_s)

    @property
    def T_odom_body(self) -> np.ndarray:
        """What the odometry says."""
        return transforms.from_xyz_quaternion(self.odometry.p_odom_body, self.odometry.q_odom_body_xyzw)

    def _on_board(self, now_s: float) -> None:
        """The line between autopilot and link, the link's events, the watchdog, the agent."""
        for message in self._server.outgoing():
            self.link.take(now_s, _as_received(message))
        self._end_requests()
        for event in self.link.events():
            if isinstance(event, PoseHeard):
                self._estimate(now_s, event)
            elif isinstance(event, EstimateMoved):
                self.agent.estimate_moved(now_s, event.step_m)
            elif isinstance(event, (StateHeard, BatteryHeard)):
                self.agent.state(self.link.state.mode, self.link.state.armed)
                self.guardian.state(now_s, self.link.state.mode, self.link.state.armed)
                share = self.link.state.battery_share if self.battery_said is None else self.battery_said
                self.guardian.battery(share)
        state = self.link.state
        if self._watchdog.check(now_s, state.armed, state.mode) is Alarm.LAND:
            self._set_mode(now_s, "LAND")
        if self._passes % _GUARDIAN_EVERY == 0:
            self._guard(now_s)
        if self.agent_runs:
            self.guardian.agent_lives(now_s)
        self.agent.step(now_s)
        for output in self.agent.outgoing():
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
        self.guardian.confidence(self.tracker.confidence)
        if self.link_runs:
            s = self.link.state
            failsafe = s.system_status in AUTOPILOT_FAILSAFE
            self.guardian.link(now_s, LinkReport(self._check.doubt, s.ekf_variance, s.throttle, failsafe))
        self.guardian.step(now_s)
        for output in self.guardian.outgoing():
            if isinstance(output, AskMode) and self.link_runs:
                self._set_mode(now_s, output.mode)
            elif isinstance(output, HoldAt):
                self.link.send_set_point(output.T_odom_body)
                self.told(now_s, "held", output)
        verdict = self.guardian.verdict
        self.agent.guarded(verdict.action, verdict.holds, "; ".join(verdict.reasons), verdict.forbids)

    def _estimate(self, now_s: float, heard: PoseHeard) -> None:
        T_odom_body = heard.T_odom_body
        self.agent.pose(now_s, T_odom_body)
        self.guardian.estimate(now_s, T_odom_body)
        self._check.estimate(now_s, T_odom_body, heard.v_odom_mps)
        if not self.link.state.armed:
            self._ground_m = float(T_odom_body[2, 3])
        self.height_m = float(T_odom_body[2, 3]) - self._ground_m

    # ---- what the agent wants ----------------------------------------------------------------------------------

    def _ask(self, now_s: float, ask: Ask) -> None:
        try:
            if ask.kind is Kind.SET_MODE:
                request = self._set_mode(now_s, ask.mode)
            elif ask.kind is Kind.ARM:
                request = self.link.arm(now_s, ask.flag)
            else:
                request = self.link.take_off(now_s, ask.altitude_m)
        except ControlError as error:
            self.agent.finished(ask, str(error))
            return
        self._requests.append((ask, request))

    def _set_mode(self, now_s: float, mode: str):
        self.modes_asked.append((now_s, mode))
        self.guardian.mode_asked(now_s, mode)
        return self.link.set_mode(now_s, mode)

    def _end_requests(self) -> None:
        for ask, request in [r for r in self._requests if r[1].over]:
            self._requests.remove((ask, request))
            try:
                request.require_done()
                self.agent.finished(ask, "")
            except ControlError as error:
                self.agent.finished(ask, str(error))

    def _switch(self, _now_s: float, output: Pictures) -> None:
        self.recording = output.on

    def _hold(self, _now_s: float, output: SetPoint) -> None:
        self.link.send_set_point(output.T_odom_body)

    def _to_autopilot(self, now_s: float, message) -> None:
        self.told(now_s, "sent", message)
        self._server.take(now_s, _as_received(message))

    # ---- processes that die ------------------------------------------------------------------------------------

    @property
    def flown_by_hand(self) -> bool:
        """Whether the autopilot is in a mode that the pilot chose."""
        return self.by_hand is not None and self.by_hand[1] == self.autopilot.mode

    def swap_link(self, link, watchdog, died: bool = False) -> None:
        """Another link process in place of the one that runs. What was asked of one that ``died`` fails."""
        self.link, self._watchdog, self._feed = link, watchdog, VisionFeed(FeedParameters())
        for ask, _ in self._requests if died else []:
            self.agent.finished(ask, "the flight link died")
        self._requests = [] if died else self._requests

    @property
    def watchdog(self) -> FeedWatchdog:
        """The link's, on the feed."""
        return self._watchdog

    def _wall_s(self, now_s: float) -> float:
        return WALL_S + now_s + self.clock_offset_s


def _nobody(_now_s: float, _what: str, _which: object) -> None:
    """Nobody is told."""


def _as_received(message):
    """A message as the other side reads it: texts are strings, not bytes."""
    name = _TEXTS.get(message.get_type())
    value = getattr(message, name) if name else None
    if isinstance(value, bytes):
        setattr(message, name, value.rstrip(b"\0").decode("ascii", "replace"))
    return message
