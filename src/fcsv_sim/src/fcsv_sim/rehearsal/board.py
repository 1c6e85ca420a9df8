# SPDX-License-Identifier: Apache-2.0
"""What runs on a rehearsed vehicle's computer: odometry, flight link, agent and guardian, the cores that fly."""

import math
from dataclasses import dataclass
from typing import Callable, Dict, List, Optional, Tuple

import numpy as np

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.messages import Ack, Ask, Instruction, Kind, Pictures, SetPoint
from fcsv_control.errors import ControlError
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.feed import FeedParameters, FeedVerdict, VisionFeed
from fcsv_control.flight.feed_check import FeedCheck
from fcsv_control.flight.listener import BarometerHeard, BatteryHeard, EstimateMoved, PoseHeard, StateHeard
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_control.guardian.air import AUTOPILOT_FAILSAFE, LinkReport, Other
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import AskMode, HoldAt
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.fence import Fence
from fcsv_geometry.home import Place
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, BodyPose
from fcsv_tracking.scene_motion import SceneLook

WALL_S = 1.7e9  # the wall clock at the rehearsal's zero
_TEXTS = {"STATUSTEXT": "text", "PARAM_VALUE": "param_id", "PARAM_SET": "param_id", "PARAM_REQUEST_READ": "param_id"}
_GUARDIAN_EVERY = 4  # passes between two steps of the guardian: 25 Hz


@dataclass(frozen=True)
class Told:
    """What a vehicle tells the others of itself."""

    name: str
    T_odom_body: np.ndarray
    speed_mps: float
    armed: bool
    mode: str
    uncontrolled: bool
    lost: bool
    lost_s: float
    taken: bool
    going_to_m: Optional[Tuple[float, float, float]]


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
        self.link = LinkCore(LinkParameters(target_system=geometry.system_id))
        self.agent = AgentCore(self.name, rules)
        self.guardian = Guardian(self.name, guardian)
        self.check = FeedCheck()
        self.battery_said: Optional[float] = None  # what its monitor says, where that is not the truth
        self.places: Dict[str, Place] = {}  # of odometry frames in home, as the control PC told it last
        self._tell_epoch()
        self.recording = False
        self.pictures = 0
        self.acks: List[Ack] = []
        self.odometry: Optional[BodyPose] = None
        self.T_odom_body: Optional[np.ndarray] = None  # of that; never changed in place
        self.height_m = self._ground_m = 0.0
        self.modes_asked: List[Tuple[float, str]] = []  # every mode command that left the companion
        self.told: Callable[[float, str, object], None] = _nobody  # "sent" a message, "ordered" an instruction, "held"
        self.agent_runs = self.link_runs = True
        self._requests: List[Tuple[Ask, object]] = []
        self._do: Dict[type, Callable[[float, object], None]] = {
            Ack: lambda now_s, o: self.acks.append(o), Ask: self._ask, Pictures: self._switch, SetPoint: self._hold,
        }  # fmt: skip

    # ---- the radio ---------------------------------------------------------------------------------------------

    def obey(self, instruction: Instruction) -> None:
        """A command came over the radio."""
        now_s = self.now_s
        self.told(now_s, "ordered", instruction)
        if instruction.kind in (Kind.GOTO, Kind.HOLD):
            self.guardian.moved(now_s, instruction.target)
        self.agent.take(now_s, instruction)

    def hear_control(self, sender: str, sent_s: float, places: Dict[str, Place], fence: Fence) -> None:
        """The mission's state and fence came, sent at ``sent_s`` by its own monotonic clock, and where odometry frames
        stand in home."""
        self.agent.control_heard(self.now_s, sender, sent_s)
        self.guardian.control_heard(self.now_s)
        self.guardian.mission_fence(fence)
        self.places = places
        place = places.get(self.name)
        if place is None:
            self.guardian.home(None)
        else:
            self.guardian.home(place.T_a_b, place.sigma_m(self.guardian.air.p_odom_m))

    def calibrated(self, epoch: Optional[int]) -> None:
        """For which epoch of its odometry a calibration was found."""
        if epoch is not None:
            self.guardian.calibrated(epoch)
            if self.agent_runs:
                self.agent.rights.frame.calibrated(epoch)

    def tell(self) -> Optional[Told]:
        """What the other vehicles are told."""
        if self.odometry is None:
            return None
        state, v = self.link.state, self.guardian.verdict
        speed = math.hypot(*self.odometry.linear_mps)
        who = (self.name, self.T_odom_body, speed, state.armed, state.mode)
        return Told(*who, v.uncontrolled, v.lost, v.lost_s, v.taken, v.going_to_m)

    def hear_other(self, now_s: float, told: Told) -> None:
        """Another vehicle told of itself."""
        place = self.places.get(told.name)
        if place is not None:
            p_odom = told.T_odom_body[:3, 3]
            p, sigma_m = transforms.apply(place.T_a_b, p_odom), place.sigma_m(p_odom)
            other = Other(p, now_s, told.speed_mps, told.armed, told.mode, sigma_m=sigma_m).guarded(told)
            self.guardian.other(told.name, other.sent(place.T_a_b, told.going_to_m))

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
            self.guardian.feed(now_s, T_odom_body)
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
        self.agent.epoch(self.epoch.number, self.epoch.reason)
        self.guardian.epoch(self.epoch.number)

    def _scene_looked(self, now_s: float, seen: SceneLook) -> None:
        """Its pictures were held against its tracker."""
        if self.link_runs:
            self.check.scene(now_s, seen.span_s, seen.off_rad, seen.turn_rad, seen.points, seen.one_way)

    def _on_board(self, now_s: float) -> None:  # noqa: C901
        """The line between autopilot and link, the link's events, the watchdog, the agent."""
        for message in self._server.outgoing():
            self.link.take(now_s, _as_received(message))
        self._end_requests()
        for event in self.link.events():
            if isinstance(event, PoseHeard):
                self._estimate(now_s, event)
            elif isinstance(event, BarometerHeard):
                self.check.barometer(now_s, event.height_m)
            elif isinstance(event, EstimateMoved):
                self.agent.estimate_moved(now_s, event.step_m)
            elif self.link.state.mode and isinstance(event, (StateHeard, BatteryHeard)):
                self.agent.state(self.link.state.mode, self.link.state.armed)
                self.guardian.state(now_s, self.link.state.mode, self.link.state.armed)
                share = self.link.state.battery_share if self.battery_said is None else self.battery_said
                self.guardian.battery(now_s, share)
        state = self.link.state
        if self.watchdog.check(now_s, state.armed, state.mode) is Alarm.LAND:
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
        if self.link_runs:
            s = self.link.state
            failsafe = s.system_status in AUTOPILOT_FAILSAFE
            report = LinkReport(
                self.check.doubt, s.ekf_variance, s.throttle, failsafe, self.link.origin_set(now_s),
                in_the_air=s.in_the_air,
            )  # fmt: skip
            self.guardian.link(now_s, report)
        self.guardian.step(now_s)
        for output in self.guardian.outgoing():
            if isinstance(output, AskMode) and self.link_runs:
                self._set_mode(now_s, output.mode)
            elif isinstance(output, HoldAt):
                self.link.send_set_point(output.T_odom_body)
                self.told(now_s, "held", output)
        verdict = self.guardian.verdict
        self.agent.guarded(now_s, verdict.action, verdict.holds, "; ".join(verdict.reasons), verdict.forbids)

    def _estimate(self, now_s: float, heard: PoseHeard) -> None:
        T_odom_body = heard.T_odom_body
        self.agent.pose(now_s, T_odom_body)
        self.guardian.estimate(now_s, T_odom_body)
        self.check.estimate(now_s, T_odom_body, heard.v_odom_mps)
        if self.link.state.mode and not self.link.state.armed:
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

    def swap_link(self, link, watchdog, died: bool = False, knows: bool = True) -> None:
        """Another link process in place of the one that runs. What was asked of one that ``died`` fails; a new one
        ``knows`` nothing of what it was fed before."""
        self.link, self.watchdog, self._feed = link, watchdog, VisionFeed(FeedParameters())
        self.check = self.check if knows else FeedCheck()
        for ask, _ in self._requests if died else []:
            self.agent.finished(ask, "the flight link died")
        self._requests = [] if died else self._requests

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
