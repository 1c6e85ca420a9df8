# SPDX-License-Identifier: Apache-2.0
"""The guardian on board as a node: topics and the flight link's service around its port.

It hears its own vehicle on the vehicle's own master, and the others and the control PC over the
radio while there is one.
"""

import os
import signal
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List

import rospy
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.flight import messages as flight
from fcsv_control.guardian.messages import (
    AskMode,
    Cause,
    GuardianVerdict,
    HoldAt,
    RestartLink,
    Warned,
)
from fcsv_control.guardian.port import GuardianPort, OtherGuarded, TrackerConfidence
from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.ros import board_messages as convert
from fcsv_control.ros.mission.vehicle_messages import TOPICS
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros import telemetry_messages as telemetry
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.relay_ages import publisher_of
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import (
    Calibration,
    Command,
    CommandAck,
    GuardianState,
    Heartbeat,
    Home,
    LinkHealth,
    ModeAsked,
    ParameterReport,
)
from fcsv_msgs.msg import Fence as FenceMessage
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import SetMode

_STEP_HZ = 25.0


@dataclass(frozen=True)
class GuardianParameters:
    """Parameters of the node; ``vehicles`` are all of the column."""

    vehicle: str
    vehicles: List[str] = field(default_factory=list)
    rules: GuardianRules = field(default_factory=GuardianRules)


class GuardianNode:
    """Modes are asked for in threads of their own, one per mode, so that a slow service blocks
    nothing."""

    def __init__(self):
        p = node.parameters(GuardianParameters)
        self._name, self._lock = p.vehicle, threading.RLock()
        self._port = GuardianPort(p.vehicle, p.rules, time.monotonic())
        self._asking: Dict[str, threading.Thread] = {}
        self._health = Health(p.vehicle)
        self._states = rospy.Publisher(
            "guardian/state", GuardianState, queue_size=5, latch=True, tcp_nodelay=True
        )
        self._texts = rospy.Publisher("guardian/said", StatusText, queue_size=20)
        self._set_points = rospy.Publisher(
            "mavros/setpoint_position/local", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._asks = rospy.Publisher(
            "flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True
        )
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._do: Dict[type, Callable[[Any], None]] = {
            AskMode: lambda o: self._ask(o.mode),
            HoldAt: self._hold,
            RestartLink: self._end_link,
            Warned: self._show_warning,
            GuardianVerdict: self._publish,
        }
        self._subscribe([v for v in p.vehicles if v != p.vehicle])
        self._timer = node.every(1.0 / _STEP_HZ, self._step)

    def _subscribe(self, others: List[str]) -> None:
        own = self._name

        def subscribe(topic, kind, take):
            taking = convert.taking(topic, take, self._receive, self._health)
            rospy.Subscriber(topic, kind, taking, queue_size=20, tcp_nodelay=True)

        subscribe("mavros/vision_pose/pose", PoseStamped, convert.fed_of)
        subscribe("mavros/local_position/pose", PoseStamped, convert.estimated_of)
        subscribe("odometry/state", Odometry, lambda m: TrackerConfidence(convert.confidence_of(m)))
        subscribe(
            "mavros/state",
            State,
            lambda m: tm.VehicleState(own, "", Mode(m.mode), m.armed, m.connected),
        )
        subscribe(
            "mavros/battery",
            BatteryState,
            lambda m: tm.BatteryCharge(own, "", conversions.battery_share(m)),
        )
        subscribe("flight_link/health", LinkHealth, convert.link_lives_of)
        subscribe("flight_link/parameters", ParameterReport, convert.limits_of)
        subscribe("flight_link/mode_asked", ModeAsked, self._asked_by_others)
        subscribe("agent/alive", Heartbeat, convert.agent_alive_of)
        subscribe("command", Command, convert.instruction_of)
        subscribe("command_ack", CommandAck, convert.ack_of)
        subscribe("/mission/fence", FenceMessage, convert.fence_of)
        subscribe("/mission/alive", Heartbeat, convert.mission_alive_of)
        subscribe("/calibration", Calibration, telemetry.calibration_of)
        subscribe("/home", Home, telemetry.home_of)
        telemetry.subscribe(own, [tm.OdometryEpoch], self._receive, self._health)
        telemetry.subscribe_epochs(self._receive)
        telemetry.subscribe_relay(self._receive, f"/{own}")
        for name in others:
            telemetry.subscribe(
                name, [tm.VehicleOdometry, tm.VehicleState], self._receive, self._health, TOPICS
            )
            guarded = lambda m, name=name: OtherGuarded(name, convert.verdict_of(m))  # noqa: E731
            subscribe(f"/{name}/guardian/state", GuardianState, guarded)

    def _receive(self, data: object) -> None:
        with self._lock:
            self._port.receive(time.monotonic(), data)

    def _asked_by_others(self, message: ModeAsked):
        """What this node asks for itself its core knows."""
        own = publisher_of(message) == rospy.get_name()
        return None if own else flight.ModeAsked(Mode(message.mode))

    # ---- what is done ----------------------------------------------------------------------------

    def _step(self, _event) -> None:
        with self._lock:
            outputs = self._port.step(time.monotonic())
        for output in outputs:
            self._do[type(output)](output)

    def _hold(self, output: HoldAt) -> None:
        frame = frames.odom(self._name)
        self._set_points.publish(
            conversions.pose_stamped(output.T_odom_body, rospy.get_time(), frame)
        )

    def _ask(self, mode: Mode) -> None:
        self._asks.publish(ModeAsked(conversions.header(rospy.get_time(), ""), mode))
        running = self._asking.get(mode)
        if running is None or not running.is_alive():
            thread = threading.Thread(
                target=self._ask_now, args=(mode,), name=f"guardian {mode}", daemon=True
            )
            self._asking[mode] = thread
            thread.start()

    def _ask_now(self, mode: Mode) -> None:
        try:
            if not self._set_mode(0, mode).mode_sent:
                rospy.logerr("%s: the autopilot did not go to %s", self._name, mode)
        except (rospy.ServiceException, rospy.ROSException) as error:
            rospy.logerr("%s: %s cannot be asked for: %s", self._name, mode, error)

    def _end_link(self, output: RestartLink) -> None:
        """roslaunch starts it again. Only a process that is the flight link still: numbers are
        given again."""
        try:
            with open(f"/proc/{output.pid}/cmdline", "rb") as file:
                if b"flight_link" in file.read():
                    os.kill(output.pid, signal.SIGKILL)
                    rospy.logerr(
                        "%s: the flight link hung and was ended; it starts again", self._name
                    )
        except OSError as error:
            rospy.logerr("%s: the flight link is silent and cannot be ended: %s", self._name, error)

    def _show_warning(self, warned: Warned) -> None:
        rospy.logerr("guardian of %s", warned.text)
        severity = StatusText.ALERT if warned.acts else StatusText.CRITICAL
        self._texts.publish(
            StatusText(conversions.header(rospy.get_time(), ""), severity, warned.text)
        )

    def _publish(self, v: GuardianVerdict) -> None:
        self._health.problem("guardian", f"{self._name}: {v.in_words}" if v.action else "")
        self._health.value("not to be handed over", "; ".join(v.forbids) or "nothing against it")
        # pilots who fly move their sticks
        wrong = [f.text for f in v.forbidden if f.cause is not Cause.STICK]
        self._health.problem(
            "not to be handed over", f"{self._name}: {'; '.join(wrong)}" if wrong else ""
        )
        header = conversions.header(rospy.get_time(), "")
        self._states.publish(
            GuardianState(
                header=header,
                vehicle=self._name,
                action=v.action,
                holds=v.holds,
                uncontrolled=v.uncontrolled,
                lost=v.lost,
                lost_s=v.lost_s,
                taken=v.taken,
                sent=v.going_to_m is not None,
                going_to=Point(*(v.going_to_m or ())),
                reasons=list(v.reasons),
                forbids=list(v.forbids),
                causes=[f.cause for f in v.forbidden],
            )
        )


def main() -> int:
    """Run the node."""
    return node.run("guardian", GuardianNode)
