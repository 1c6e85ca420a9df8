# SPDX-License-Identifier: Apache-2.0
"""What runs on a rehearsed vehicle's computer: the ports of odometry, flight link, agent and
guardian."""

import itertools
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.agent.core import AgentRules
from fcsv_control.agent.messages import (
    Ack,
    AgentAlive,
    Ask,
    AskAnswered,
    Instruction,
    Kind,
    Pictures,
    SetPoint,
)
from fcsv_control.agent.port import AgentPort
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import (
    AutopilotState,
    BatteryReading,
    EstimateMoved,
    FromAutopilot,
    LinkLives,
    ModeAsked,
    ParametersChecked,
    PoseEstimated,
    PoseFed,
    Refused,
    RequestOver,
    TextReceived,
    ToAutopilot,
)
from fcsv_control.flight.port import ExternalNavigationRules, FlightLinkPort
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import Profile, load_profile
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import AskMode, GuardianVerdict, HoldAt
from fcsv_control.guardian.port import GuardianPort, OtherGuarded
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.programs.workspace import bringup
from fcsv_geometry.streams.arrivals import RELAY
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.tracker import TrackerProfile
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.rehearsal.processes import RehearsedProcess
from fcsv_tracking.odometry import BodyPose, EpochBegan
from fcsv_tracking.odometry_port import BodySample, OdometryPort, TrackerSample

WALL_S = 1.7e9  # the wall clock at the rehearsal's zero
_TEXTS = {
    "STATUSTEXT": "text",
    "PARAM_VALUE": "param_id",
    "PARAM_SET": "param_id",
    "PARAM_REQUEST_READ": "param_id",
}
_PORT = 2  # of the autopilot, at which the companion is
_SAMPLES_HZ = 200.0  # those of the tracker that would not go on are not simulated
_GUARDIAN_EVERY = 4  # passes between two steps of the guardian: 25 Hz
# so long a caller waits for a service that is not there: the agent's service_timeout_s
_SERVICE_S = 3.0
_AGENT, _GUARDIAN = "agent", "guardian"


@dataclass
class _Call:
    """Is a call of a service of the flight link; ``number`` 0: it waits for the service, until a
    time."""

    by: str
    ask: Ask
    until_s: float
    number: int = 0


class OnBoard:
    """The companion of one vehicle. ``clock_offset_s``: its wall clock against the others'."""

    _server: MavlinkServer  # the other end of its line
    _passes = 0
    now_s = 0.0  # its monotonic clock

    def __init__(
        self,
        geometry: VehicleGeometry,
        tracker: TrackerProfile,
        rules: AgentRules,
        guardian: GuardianRules,
    ):
        self.geometry, self.name = geometry, geometry.name
        self.clock_offset_s = 0.0
        self._odometry = OdometryPort(self.name, geometry.T_body_t265, tracker, _SAMPLES_HZ)
        self._frames = (tracker.odom_frame(self.name), tracker.pose_frame(self.name))
        self.epoch = EpochBegan()  # as its odometry told it last
        self.link = RehearsedProcess(self._new_link)
        self.agent = RehearsedProcess(
            lambda now_s: AgentPort(self.name, rules, f"agent-{self.name}-{now_s}", now_s)
        )
        self.guardian_port = GuardianPort(self.name, guardian, 0.0)
        self.state = AutopilotState(False, False, False, False, "", 0)  # as its link told it last
        self.state_s = -np.inf  # when that was
        self.battery_share = np.nan
        self.verdict = GuardianVerdict()  # as its guardian told it last
        # what its monitor says, where that is not the truth
        self.battery_said: Optional[float] = None
        # what the control PC told for good, as it came last
        self._latched: Dict[object, object] = {}
        self.recording = False
        self.pictures = 0
        self.acks: List[Ack] = []
        self.odometry: Optional[BodyPose] = None
        self.T_odom_body: Optional[np.ndarray] = None  # of that; never changed in place
        self.height_m = self._ground_m = 0.0
        # every mode command that left the companion
        self.modes_asked: List[Tuple[float, Mode]] = []
        # "sent" a message, "ordered" an instruction, "held"
        self.told: Callable[[float, str, object], None] = _nobody
        self._calls: List[_Call] = []
        self._numbers = itertools.count(1)
        self._do: Dict[type, Callable[[float, Any], None]] = {
            Ack: self._acknowledge,
            AgentAlive: self.guardian_port.receive,
            Ask: self._agent_asks,
            AskMode: self._guardian_asks,
            AutopilotState: self._shown,
            BatteryReading: self._battery,
            BodySample: self._on_body,
            EstimateMoved: self.agent.receive,
            HoldAt: self._hold,
            LinkLives: self.guardian_port.receive,
            ModeAsked: self._mode_asked,
            ParametersChecked: lambda now_s, m: self.guardian_port.receive(now_s, m.limits),
            Pictures: self._switch,
            PoseEstimated: self._estimated,
            RequestOver: self._request_over,
            SetPoint: self._tell_link,
            TextReceived: self.agent.receive,
            ToAutopilot: self._to_autopilot,
            GuardianVerdict: self._judged,
            tm.OdometryEpoch: self._began,
        }
        self._give(0.0, self._odometry)

    def _new_link(self, now_s: float) -> FlightLinkPort:
        """A flight link's process as it begins, with the parameters that an autopilot must have."""
        link = LinkParameters(target_system=self.geometry.system_id)
        return FlightLinkPort(self.name, link, _profile(), ExternalNavigationRules(), 0, now_s)

    # ---- the radio -------------------------------------------------------------------------------

    def obey(self, instruction: Instruction) -> None:
        """A command came over the radio."""
        self.told(self.now_s, "ordered", instruction)
        self._deliver(self.now_s, instruction)

    def on_control(self, alive: MissionAlive, latched: Mapping[object, object]) -> None:
        """A sign of life of the mission came, and what the control PC told for good: once each."""
        now_s = self.now_s
        self._deliver(now_s, alive)
        for key, message in latched.items():
            if self._latched.get(key) is not message:
                self._latched[key] = message
                self.guardian_port.receive(now_s, message)
                if isinstance(message, tm.EpochsFound):
                    self.agent.receive(now_s, message)

    def tell(self) -> Sequence[object]:
        """What the other vehicles are told."""
        if self.odometry is None:
            return ()
        p, s = self.odometry, self.state
        return (
            tm.VehicleOdometry(self.name, RELAY, p.stamp_s, self.T_odom_body, p.linear_mps),
            tm.VehicleState(self.name, RELAY, s.mode, s.armed, s.connected),
            OtherGuarded(self.name, self.verdict),
        )

    def on_other_vehicle(self, sent_s: float, messages: Sequence[object]) -> None:
        """Another vehicle told of itself, at ``sent_s`` as the relay measured it."""
        topics = [f"/{m.vehicle}/{m.topic}" for m in messages if isinstance(m, tm.VehicleOdometry)]
        for message in (tm.RelayAges(topics, [sent_s] * len(topics)), *messages):
            self.guardian_port.receive(self.now_s, message)

    @property
    def guardian(self) -> Guardian:
        """Gives the guardian to look at."""
        return self.guardian_port.core

    def _deliver(self, now_s: float, message: object) -> None:
        """Agent and guardian hear it."""
        self.guardian_port.receive(now_s, message)
        self.agent.receive(now_s, message)

    # ---- odometry --------------------------------------------------------------------------------

    def _sampled(
        self, now_s: float, stamp_s: float, T: np.ndarray, linear: np.ndarray, angular: np.ndarray
    ) -> None:
        """A sample of the tracker came."""
        p, q = tuple(T[:3, 3].tolist()), transforms.fast_quaternion_xyzw(T)
        twist = tuple(linear.tolist()), tuple(angular.tolist())
        self._odometry.receive(now_s, TrackerSample(self._frames, stamp_s, p, q, *twist, ()))
        self._give(now_s, self._odometry)

    def _on_body(self, now_s: float, m: BodySample) -> None:
        if not m.goes_on:
            return
        self.odometry = m.pose
        self.T_odom_body = transforms.from_xyz_quaternion(
            m.pose.p_odom_body, m.pose.q_odom_body_xyzw
        )
        fed = PoseFed(self.T_odom_body, m.pose.stamp_s)
        self.guardian_port.receive(now_s, fed)
        self.link.receive(now_s, fed)

    def _began(self, now_s: float, m: tm.OdometryEpoch) -> None:
        self.epoch = EpochBegan(m.number, m.reason)
        self._deliver(now_s, m)

    # ---- time ------------------------------------------------------------------------------------

    def _on_board(self, now_s: float) -> None:
        """One step of each process. What a link is asked goes out at once."""
        for message in self._server.outgoing():
            self.link.receive(now_s, FromAutopilot(_as_received(message)))
        self._give(now_s, self.link)
        if self._calls:
            self._place_calls(now_s)
        if self._passes % _GUARDIAN_EVERY == 0:
            self._give(now_s, self.guardian_port)
        self._give(now_s, self.agent)
        if self.recording and self._passes % 10 == 0:
            self.pictures += 1

    def _give(self, now_s: float, port) -> None:
        """Whoever is concerned is given what a port has to send."""
        for output in port.step(now_s):
            do = self._do.get(type(output))
            if do is not None:
                do(now_s, output)

    # ---- what the flight link tells --------------------------------------------------------------

    def _to_autopilot(self, now_s: float, output: ToAutopilot) -> None:
        self.told(now_s, "sent", output.message)
        self._server.receive(now_s, _as_received(output.message))

    def _shown(self, now_s: float, s: AutopilotState) -> None:
        self.state, self.state_s = s, now_s
        self._deliver(now_s, tm.VehicleState(self.name, "", s.mode, s.armed, s.connected))

    def _battery(self, now_s: float, m: BatteryReading) -> None:
        self.battery_share = m.share if self.battery_said is None else self.battery_said
        self.guardian_port.receive(now_s, tm.BatteryCharge(self.name, "", self.battery_share))

    def _mode_asked(self, now_s: float, m: ModeAsked) -> None:
        """Notes that a mode was asked for by the agent, or by the link itself where the feed
        died."""
        self.modes_asked.append((now_s, m.mode))
        self.guardian_port.receive(now_s, m)

    def _estimated(self, now_s: float, m: PoseEstimated) -> None:
        self._deliver(now_s, m)
        if self.state.mode and not self.state.armed:
            self._ground_m = float(m.T_odom_body[2, 3])
        self.height_m = float(m.T_odom_body[2, 3]) - self._ground_m

    # ---- what the flight link is told and asked --------------------------------------------------

    def _tell_link(self, now_s: float, message: object) -> None:
        self.link.receive(now_s, message)
        self._give(now_s, self.link)

    def _agent_asks(self, now_s: float, ask: Ask) -> None:
        self._call(now_s, _AGENT, ask)

    def _guardian_asks(self, now_s: float, output: AskMode) -> None:
        """A mode that is still asked for is not asked for again."""
        if not any(c.by == _GUARDIAN and c.ask.mode == output.mode for c in self._calls):
            self.modes_asked.append((now_s, output.mode))
            self._call(now_s, _GUARDIAN, Ask(Kind.SET_MODE, output.mode))

    def _call(self, now_s: float, by: str, ask: Ask) -> None:
        self._calls.append(_Call(by, ask, now_s + _SERVICE_S))
        self._place_calls(now_s)

    def _place_calls(self, now_s: float) -> None:
        """Calls wait for a while for a link that does not run; they end with one that dies."""
        for call in [c for c in self._calls if not c.number]:
            if self.link.lives:
                call.number = next(self._numbers)
                self._tell_link(now_s, replace(call.ask, number=call.number))
            elif now_s > call.until_s:
                self._end_call(
                    now_s, call, AskAnswered(call.ask.number, False, "the flight link does not run")
                )

    def _request_over(self, now_s: float, over: RequestOver) -> None:
        for call in [c for c in self._calls if c.number == over.number]:
            if over.refusal and call.by == _AGENT:
                self.agent.receive(now_s, Refused(over.refusal))
            self._end_call(now_s, call, AskAnswered(call.ask.number, not over.refusal))

    def _end_call(self, now_s: float, call: _Call, answer: AskAnswered) -> None:
        self._calls.remove(call)
        if call.by == _AGENT:
            self.agent.receive(now_s, answer)

    def kill_link(self) -> None:
        """Its process dies, and with it what was asked of it."""
        self.link.kill()
        for call in [c for c in self._calls if c.number]:
            self._end_call(
                self.now_s, call, AskAnswered(call.ask.number, False, "the flight link died")
            )

    # ---- what agent and guardian tell ------------------------------------------------------------

    def _acknowledge(self, now_s: float, ack: Ack) -> None:
        self.acks.append(ack)
        self.guardian_port.receive(now_s, ack)

    def _switch(self, _now_s: float, output: Pictures) -> None:
        self.recording = output.on

    def _hold(self, now_s: float, output: HoldAt) -> None:
        self._tell_link(now_s, SetPoint(output.T_odom_body))
        self.told(now_s, "held", output)

    def _judged(self, now_s: float, verdict: GuardianVerdict) -> None:
        self.verdict = verdict
        self.agent.receive(now_s, verdict)

    def _wall_s(self, now_s: float) -> float:
        return WALL_S + now_s + self.clock_offset_s


@lru_cache(maxsize=None)
def _profile() -> Profile:
    """Loads the profile, as launch/uav.launch names it."""
    return load_profile(
        str(bringup() / "config" / "autopilot" / "arducopter-4.3-t265.param")
    ).at_port(_PORT)


def _nobody(_now_s: float, _what: str, _which: object) -> None:
    """Nobody is told."""


def _as_received(message):
    """A message as the other side reads it: texts are strings, not bytes."""
    name = _TEXTS.get(message.get_type())
    value = getattr(message, name) if name else None
    if isinstance(value, bytes):
        setattr(message, name, value.rstrip(b"\0").decode("ascii", "replace"))
    return message
