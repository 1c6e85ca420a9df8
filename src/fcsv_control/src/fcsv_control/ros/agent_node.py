# SPDX-License-Identifier: Apache-2.0
"""The agent on board as a node: topics and services around its core."""

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Callable, Dict

import rospy
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from std_msgs.msg import Bool

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.holder import Limits
from fcsv_control.agent.messages import DONE, Ack, Ask, Output, Pictures, Said, SetPoint
from fcsv_control.agent.twins import Twins
from fcsv_control.ros.board_messages import instruction_of
from fcsv_control.ros.link_services import LinkServices
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Command, CommandAck, Epoch, Epochs, GuardianState, Heartbeat, MissionState
from mavros_msgs.msg import State

_STEP_HZ = 50.0
_ALIVE_S = 0.2


@dataclass(frozen=True)
class AgentParameters:
    """Parameters of the node."""

    vehicle: str
    set_point_rate_hz: float = 10.0
    service_timeout_s: float = 3.0
    maintenance: bool = False  # commands may ask for any mode; never in a flight with people about
    guardian: bool = True  # nothing is handed over without a living one; never False with people about
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
    """Requests to the flight link run in threads of their own, so that a slow service blocks nothing."""

    def __init__(self):
        p = self._parameters = node.parameters(AgentParameters)
        self._name = p.vehicle
        self._started_s = time.monotonic()
        self._instance = f"agent-{self._name}-{os.getpid()}-{os.urandom(3).hex()}"
        self._core = AgentCore(self._name, p.rules, Twins(self._instance, self._started_s))
        self._lock = threading.RLock()
        self._health = Health(self._name)
        self._alive = rospy.Publisher("agent/alive", Heartbeat, queue_size=2, tcp_nodelay=True)
        self._acks = rospy.Publisher("command_ack", CommandAck, queue_size=20, tcp_nodelay=True)
        self._set_points = rospy.Publisher(
            "mavros/setpoint_position/local", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._pictures = rospy.Publisher("recorder/pictures", Bool, queue_size=1, latch=True)
        self._link = LinkServices(p.service_timeout_s)
        self._send: Dict[type, Callable[[Output], None]] = {
            Ack: self._send_ack,
            Ask: self._send_ask,
            Pictures: lambda o: self._pictures.publish(Bool(o.on)),
            Said: self._say,
            SetPoint: self._send_set_point,
        }
        self._timers = node.every(1.0 / _STEP_HZ, lambda _event: self._do()), node.every(_ALIVE_S, self._live)
        rospy.Subscriber("agent/alive", Heartbeat, self._on_agent, queue_size=5)
        rospy.Subscriber("flight_link/estimate_moved", Vector3Stamped, self._on_moved, queue_size=20)
        rospy.Subscriber("guardian/state", GuardianState, self._on_guardian, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber("odometry/epoch", Epoch, self._on_epoch, queue_size=1)
        rospy.Subscriber("/calibration_epochs", Epochs, self._on_calibration, queue_size=1)
        rospy.Subscriber("mavros/state", State, self._on_state, queue_size=5)
        rospy.Subscriber("mavros/local_position/pose", PoseStamped, self._on_pose, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber("/mission/state", MissionState, self._on_mission, queue_size=1)
        rospy.Subscriber("/mission/alive", Heartbeat, self._on_mission_alive, queue_size=5)
        rospy.Subscriber("command", Command, self._on_command, queue_size=20, tcp_nodelay=True)

    # ---- what is heard -------------------------------------------------------------------------------------

    def _on_state(self, message: State) -> None:
        self._do(lambda: self._core.state(message.mode, message.armed))
        self._health.problem("link", "" if message.connected else f"{self._name}: no autopilot")

    def _on_pose(self, message: PoseStamped) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose)
        except FcsvError as error:
            self._health.drop("local position", str(error))
            return
        self._do(lambda: self._core.pose(time.monotonic(), T_odom_body))

    def _on_mission(self, _message: MissionState) -> None:
        self._do(lambda: self._core.control_heard(time.monotonic()))

    def _on_mission_alive(self, m: Heartbeat) -> None:
        self._do(lambda: self._core.control_heard(time.monotonic(), m.instance, m.sent_s))

    def _on_agent(self, m: Heartbeat) -> None:
        self._do(lambda: self._core.twins.heard(time.monotonic(), m.instance, m.sent_s - m.started_s))

    def _on_moved(self, m: Vector3Stamped) -> None:
        self._do(lambda: self._core.estimate_moved(time.monotonic(), (m.vector.x, m.vector.y, m.vector.z)))

    def _on_guardian(self, m: GuardianState) -> None:
        self._do(lambda: self._core.guarded(time.monotonic(), m.action, m.holds, "; ".join(m.reasons), m.forbids))

    def _on_epoch(self, m: Epoch) -> None:
        self._do(lambda: self._core.epoch(m.epoch, m.reason))

    def _on_calibration(self, m: Epochs) -> None:
        epoch = conversions.epochs_of(m).get(self._name)
        if epoch is not None:
            self._do(lambda: self._core.rights.frame.calibrated(epoch))

    def _on_command(self, message: Command) -> None:
        try:
            instruction = instruction_of(message)
        except FcsvError as error:
            self._send_ack(Ack(message.sender, message.number, CommandAck.REFUSED, str(error)))
            return
        self._do(lambda: self._core.take(time.monotonic(), instruction))

    # ---- what is done --------------------------------------------------------------------------------------

    def _do(self, heard: Callable[[], None] = lambda: None) -> None:
        """Let the core hear something, let time pass, and send what it wants sent, in its order."""
        with self._lock:
            heard()
            self._core.step(time.monotonic())
            for output in self._core.outgoing():
                self._send[type(output)](output)

    def _live(self, _event) -> None:
        """A sign of life, and whether another agent of this vehicle goes first."""
        now_s = time.monotonic()
        with self._lock:
            older, sender = self._core.twins.older(now_s), self._core.rights.lease.holder(now_s)
        problem = f"{self._name}: {older} is its agent already; this second one does nothing, end it" if older else ""
        self._health.problem("second agent", problem)
        header = conversions.header(rospy.get_time(), "")
        self._alive.publish(Heartbeat(header, self._instance, self._started_s, now_s, sender, problem))

    def _send_ask(self, ask: Ask) -> None:
        threading.Thread(target=self._ask, args=(ask,), name=ask.kind.name.lower(), daemon=True).start()

    def _ask(self, ask: Ask) -> None:
        try:
            self._link.ask(ask)
            refusal = ""
        except (FcsvError, rospy.ServiceException, rospy.ROSException) as error:
            refusal = str(error) or "the flight link did not answer"
        self._do(lambda: self._core.finished(ask, refusal))

    def _send_ack(self, ack: Ack) -> None:
        if ack.result != DONE:
            self._health.drop("command", ack.reason)
        header = conversions.header(rospy.get_time(), "")
        self._acks.publish(CommandAck(header, self._name, ack.sender, ack.number, ack.result, ack.reason))

    def _send_set_point(self, output: SetPoint) -> None:
        frame = frames.odom(self._name)
        self._set_points.publish(conversions.pose_stamped(output.T_odom_body, rospy.get_time(), frame))

    def _say(self, output: Said) -> None:
        rospy.logerr("%s", output.text)
        self._health.drop("said", output.text)


def main() -> int:
    """Run the node."""
    return node.run("agent", AgentNode)
