# SPDX-License-Identifier: Apache-2.0
"""The agent on board as a node: topics and services around its port."""

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Optional

import rospy
from geometry_msgs.msg import PointStamped, PoseStamped, Vector3Stamped
from std_msgs.msg import Bool

from fcsv_control.agent.core import AgentRules
from fcsv_control.agent.holder import Limits
from fcsv_control.agent.messages import (
    DONE,
    Ack,
    AgentAlive,
    AgentText,
    Ask,
    AskAnswered,
    Instruction,
    Kind,
    Pictures,
    SetPoint,
)
from fcsv_control.agent.port import AgentPort
from fcsv_control.flight import messages
from fcsv_control.ros import board_messages as convert
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import Command, CommandAck, GuardianState, Heartbeat, ModeAsked, Refusal
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import CommandBool, CommandTOL, SetMode

_STEP_HZ = 50.0


@dataclass(frozen=True)
class AgentParameters:
    """Parameters of the node."""

    vehicle: str
    set_point_rate_hz: float = 10.0
    service_timeout_s: float = 3.0
    maintenance: bool = False  # commands may ask for any mode; never in a flight with people about
    # nothing is handed over without a living one; never False with people about
    guardian: bool = True
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self):
        if not 2.0 <= self.set_point_rate_hz <= 50.0:
            raise ValueError(f"set_point_rate_hz: {self.set_point_rate_hz} is not in 2..50")
        if not 0.1 <= self.service_timeout_s <= 30.0:
            raise ValueError(f"service_timeout_s: {self.service_timeout_s} is not in 0.1..30")

    @property
    def rules(self) -> AgentRules:
        """What the core needs of them."""
        return AgentRules(self.set_point_rate_hz, self.maintenance, self.guardian, self.limits)


class AgentNode:
    """Requests to the flight link run in threads of their own, so that a slow service blocks
    nothing."""

    def __init__(self):
        p = node.parameters(AgentParameters)
        self._name, self._timeout_s, self._lock = p.vehicle, p.service_timeout_s, threading.RLock()
        instance = f"agent-{self._name}-{os.getpid()}-{os.urandom(3).hex()}"
        self._port = AgentPort(p.vehicle, p.rules, instance, time.monotonic())
        self._health = Health(self._name)
        self._alive = rospy.Publisher("agent/alive", Heartbeat, queue_size=2, tcp_nodelay=True)
        self._acks = rospy.Publisher("command_ack", CommandAck, queue_size=20, tcp_nodelay=True)
        self._set_points = rospy.Publisher(
            "mavros/setpoint_position/local", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._pictures = rospy.Publisher("recorder/pictures", Bool, queue_size=1, latch=True)
        self._asks = rospy.Publisher(
            "flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True
        )
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._arming = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
        self._takeoff = rospy.ServiceProxy("mavros/cmd/takeoff", CommandTOL)
        self._send: Dict[type, Callable[[Any], None]] = {
            Ack: self._send_ack,
            AgentAlive: self._live,
            Ask: self._send_ask,
            messages.ModeAsked: lambda o: self._asks.publish(ModeAsked(self._header(), o.mode)),
            Pictures: lambda o: self._pictures.publish(Bool(o.on)),
            AgentText: self._log_text,
            SetPoint: self._send_set_point,
        }
        self._timer = node.every(1.0 / _STEP_HZ, lambda _event: self._step())
        self._subscribe()

    def _subscribe(self) -> None:
        def subscribe(topic, kind, take):
            taking = convert.taking(topic, take, self._receive, self._health)
            rospy.Subscriber(topic, kind, taking, queue_size=20, tcp_nodelay=True)

        subscribe("agent/alive", Heartbeat, convert.agent_alive_of)
        subscribe("flight_link/estimate_moved", Vector3Stamped, convert.moved_of)
        subscribe("flight_link/home", PointStamped, convert.home_above_of)
        subscribe("flight_link/refusal", Refusal, lambda m: messages.Refused(m.reason))
        subscribe(
            "mavros/statustext/recv",
            StatusText,
            lambda m: messages.TextReceived(m.severity, m.text),
        )
        subscribe("guardian/state", GuardianState, convert.verdict_of)
        subscribe("mavros/state", State, self._state)
        subscribe("mavros/local_position/pose", PoseStamped, convert.estimated_of)
        subscribe("/mission/alive", Heartbeat, convert.mission_alive_of)
        telemetry.subscribe(self._name, [tm.OdometryEpoch], self._receive, self._health)
        telemetry.subscribe_epochs(self._receive)
        subscribe("command", Command, self._command)

    def _state(self, m: State) -> tm.VehicleState:
        self._health.problem("link", "" if m.connected else f"{self._name}: no autopilot")
        return tm.VehicleState(self._name, "", Mode(m.mode), m.armed, m.connected)

    def _command(self, message: Command) -> Optional[Instruction]:
        try:
            return convert.instruction_of(message)
        except FcsvError as error:
            self._send_ack(Ack(message.sender, message.number, CommandAck.REFUSED, str(error)))
            return None

    # ---- what is done ----------------------------------------------------------------------------

    def _receive(self, message: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), message)
            self._step()

    def _step(self) -> None:
        """What the port wants sent, in its order."""
        with self._lock:
            for output in self._port.step(time.monotonic()):
                self._send[type(output)](output)

    def _live(self, m: AgentAlive) -> None:
        self._health.problem("second agent", m.problem)
        self._alive.publish(
            Heartbeat(self._header(), m.instance, m.started_s, m.sent_s, m.commander, m.problem)
        )

    def _send_ask(self, ask: Ask) -> None:
        threading.Thread(
            target=self._call, args=(ask,), name=ask.kind.name.lower(), daemon=True
        ).start()

    def _call(self, ask: Ask) -> None:
        service = {
            Kind.SET_MODE: self._set_mode,
            Kind.ARM: self._arming,
            Kind.TAKEOFF: self._takeoff,
        }[ask.kind]
        try:
            rospy.wait_for_service(service.resolved_name, timeout=self._timeout_s)
            if ask.kind is Kind.SET_MODE:
                took = service(0, ask.mode).mode_sent
            elif ask.kind is Kind.ARM:
                took = service(ask.flag).success
            else:
                took = service(0, 0, 0, 0, ask.altitude_m).success
            self._receive(AskAnswered(ask.number, took))
        except (rospy.ServiceException, rospy.ROSException) as error:
            self._receive(
                AskAnswered(ask.number, False, str(error) or "the flight link did not answer")
            )

    def _send_ack(self, ack: Ack) -> None:
        if ack.result != DONE:
            self._health.drop("command", ack.reason)
        self._acks.publish(
            CommandAck(self._header(), self._name, ack.sender, ack.number, ack.result, ack.reason)
        )

    def _send_set_point(self, output: SetPoint) -> None:
        frame = frames.odom(self._name)
        self._set_points.publish(
            conversions.pose_stamped(output.T_odom_body, rospy.get_time(), frame)
        )

    def _log_text(self, output: AgentText) -> None:
        rospy.logerr("%s", output.text)
        self._health.drop("said", output.text)

    def _header(self):
        return conversions.header(rospy.get_time(), "")


def main() -> int:
    """Run the node."""
    return node.run("agent", AgentNode)
