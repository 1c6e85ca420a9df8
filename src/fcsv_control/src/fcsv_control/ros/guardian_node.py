# SPDX-License-Identifier: Apache-2.0
"""The guardian on board as a node: topics and the flight link's service around its core.

It hears its own vehicle on the vehicle's own master, and the others and the control PC over the radio while
there is one.
"""

import math
import os
import signal
import threading
import time
from dataclasses import dataclass, field
from typing import Dict, List

import rospy
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.guardian.air import AUTOPILOT_FAILSAFE, LinkReport
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.findings import STICK
from fcsv_control.guardian.messages import AskMode, HoldAt, RestartLink, Verdict, Warned
from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.ros.guardian_others import OtherVehicles
from fcsv_control.tracker_confidence import confidence
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, fences, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import (
    Command,
    CommandAck,
    Epoch,
    Epochs,
    GuardianState,
    Heartbeat,
    LinkHealth,
    ModeAsked,
    ParameterReport,
)
from fcsv_msgs.msg import Fence as FenceMessage
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import SetMode

_STEP_HZ = 25.0
_STATE_S = 0.2
_THROTTLE_OLD_S = 2.0
_MOVES = (Command.GOTO, Command.HOLD)


@dataclass(frozen=True)
class GuardianParameters:
    """Parameters of the node; ``vehicles`` are all of the column."""

    vehicle: str
    vehicles: List[str] = field(default_factory=list)
    rules: GuardianRules = field(default_factory=GuardianRules)


class GuardianNode:
    """Modes are asked for in threads of their own, one per mode, so that a slow service blocks nothing."""

    def __init__(self):
        p = node.parameters(GuardianParameters)
        self._name, self._lock = p.vehicle, threading.RLock()
        self._core = Guardian(p.vehicle, p.rules, time.monotonic())
        self._others = OtherVehicles(p.vehicle, p.vehicles)
        self._asking: Dict[str, threading.Thread] = {}
        self._link_pid = 0
        self._orders: Dict[int, Command] = {}
        self._published, self._published_s = Verdict(), float("-inf")
        self._health = Health(p.vehicle)
        self._states = rospy.Publisher("guardian/state", GuardianState, queue_size=5, latch=True, tcp_nodelay=True)
        self._texts = rospy.Publisher("guardian/said", StatusText, queue_size=20)
        self._set_points = rospy.Publisher(
            "mavros/setpoint_position/local", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._asks = rospy.Publisher("flight_link/mode_asked", ModeAsked, queue_size=10, tcp_nodelay=True)
        self._set_mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
        self._subscribe()
        self._timer = node.every(1.0 / _STEP_HZ, self._step)

    def _subscribe(self) -> None:
        def hear(topic, kind, call):
            return rospy.Subscriber(topic, kind, call, queue_size=5, tcp_nodelay=True)

        hear("mavros/vision_pose/pose", PoseStamped, lambda m: self._pose(self._core.feed, m))
        hear("mavros/local_position/pose", PoseStamped, lambda m: self._pose(self._core.estimate, m))
        hear("odometry/state", Odometry, self._on_odometry)
        hear("odometry/epoch", Epoch, self._on_epoch)
        hear("/calibration_epochs", Epochs, self._on_calibrated)
        hear("mavros/state", State, self._on_state)
        hear("mavros/battery", BatteryState, self._on_battery)
        hear("flight_link/health", LinkHealth, self._on_link)
        hear("flight_link/parameters", ParameterReport, self._on_parameters)
        hear("agent/alive", Heartbeat, lambda _m: self._hear(self._core.agent_lives))
        hear("/mission/fence", FenceMessage, self._on_fence)
        hear("/mission/alive", Heartbeat, lambda _m: self._hear(self._core.control_heard))
        hear("command", Command, self._on_command)
        hear("command_ack", CommandAck, self._on_ack)

    # ---- what is heard -------------------------------------------------------------------------------------

    def _hear(self, hear, *what) -> None:
        with self._lock:
            hear(time.monotonic(), *what)

    def _pose(self, hear, message: PoseStamped) -> None:
        try:
            T_odom_body = conversions.pose_to_transform(message.pose)
        except FcsvError as error:
            self._health.drop("pose", str(error))
            return
        self._hear(hear, T_odom_body)

    def _on_odometry(self, message: Odometry) -> None:
        with self._lock:
            self._core.confidence(confidence(message.pose.covariance[0]))

    def _on_epoch(self, message: Epoch) -> None:
        with self._lock:
            self._core.epoch(message.epoch)

    def _on_calibrated(self, message: Epochs) -> None:
        epoch = conversions.epochs_of(message).get(self._name)
        if epoch is not None:
            with self._lock:
                self._core.calibrated(epoch)

    def _on_state(self, message: State) -> None:
        if message.mode:
            self._hear(self._core.state, message.mode, message.armed)

    def _on_fence(self, message: FenceMessage) -> None:
        try:
            fence = fences.from_message(message)
        except FcsvError as error:
            self._health.drop("fence of the mission", str(error))
            return
        rospy.loginfo("%s: the mission's fence is %s", self._name, fence)
        with self._lock:
            self._core.mission_fence(fence)

    def _on_battery(self, message: BatteryState) -> None:
        self._hear(self._core.battery, conversions.battery_share(message))

    def _on_link(self, m: LinkHealth) -> None:
        throttle = m.throttle if m.throttle_age_s < _THROTTLE_OLD_S else math.nan  # no transmitter is heard
        self._link_pid = m.pid
        in_the_air = None if m.in_the_air < 0 else bool(m.in_the_air)
        report = LinkReport(
            m.doubt, m.ekf_variance, throttle, m.system_status in AUTOPILOT_FAILSAFE, m.origin_set, m.parameters_ok,
            m.parameter, in_the_air, m.connected,
        )  # fmt: skip
        self._hear(self._core.link, report)

    def _on_parameters(self, m: ParameterReport) -> None:
        found = dict(zip(m.limits, m.limit_values))
        with self._lock:
            self._core.slows(found.get("WPNAV_ACCEL", math.nan) / 100.0)  # cm/s²

    def _on_command(self, m: Command) -> None:
        self._hear(self._core.control_heard)
        if m.kind == Command.SET_MODE:
            self._hear(self._core.mode_asked, m.mode)
        elif m.kind == Command.LAND:
            self._hear(self._core.mode_asked, "LAND")
        self._orders = {**dict(list(self._orders.items())[-20:]), m.number: m}

    def _on_ack(self, m: CommandAck) -> None:
        """A way-point that the agent took: the mission flies the vehicle, as its operator has confirmed."""
        order = self._orders.get(m.number)
        if order is not None and m.result == CommandAck.DONE and order.sender == m.sender and order.kind in _MOVES:
            self._moved(order)

    def _moved(self, order: Command) -> None:
        try:
            there = conversions.pose_to_transform(order.target.pose) if order.kind == Command.GOTO else None
        except FcsvError as error:
            self._health.drop("way-point", str(error))
            there = None
        self._hear(self._core.moved, there)

    # ---- what is done --------------------------------------------------------------------------------------

    def _step(self, _event) -> None:
        now_s = time.monotonic()
        place, others = self._others.now()
        with self._lock:
            if place is None:
                self._core.home(None)
            else:
                self._core.home(place.T_a_b, place.sigma_m(self._core.air.p_odom_m))
            for name, other in others.items():
                self._core.other(name, other)
            self._core.step(now_s)
            outputs, verdict = self._core.outgoing(), self._core.verdict
        for output in outputs:
            if isinstance(output, AskMode):
                self._ask(output.mode)
            elif isinstance(output, HoldAt):
                frame = frames.odom(self._name)
                self._set_points.publish(conversions.pose_stamped(output.T_odom_body, rospy.get_time(), frame))
            elif isinstance(output, RestartLink):
                self._end_link()
            elif isinstance(output, Warned):
                self._say(output)
        if verdict != self._published or now_s - self._published_s >= _STATE_S:
            self._publish(now_s, verdict)

    def _ask(self, mode: str) -> None:
        self._asks.publish(ModeAsked(conversions.header(rospy.get_time(), ""), mode))
        running = self._asking.get(mode)
        if running is None or not running.is_alive():
            thread = threading.Thread(target=self._ask_now, args=(mode,), name=f"guardian {mode}", daemon=True)
            self._asking[mode] = thread
            thread.start()

    def _ask_now(self, mode: str) -> None:
        try:
            if not self._set_mode(0, mode).mode_sent:
                rospy.logerr("%s: the autopilot did not go to %s", self._name, mode)
        except (rospy.ServiceException, rospy.ROSException) as error:
            rospy.logerr("%s: %s cannot be asked for: %s", self._name, mode, error)

    def _end_link(self) -> None:
        """roslaunch starts it again. Only a process that is the flight link still: numbers are given again."""
        try:
            with open(f"/proc/{self._link_pid}/cmdline", "rb") as file:
                if b"flight_link" in file.read():
                    os.kill(self._link_pid, signal.SIGKILL)
                    rospy.logerr("%s: the flight link hung and was ended; it starts again", self._name)
        except OSError as error:
            rospy.logerr("%s: the flight link is silent and cannot be ended: %s", self._name, error)

    def _say(self, warned: Warned) -> None:
        rospy.logerr("guardian of %s", warned.text)
        severity = StatusText.ALERT if warned.acts else StatusText.CRITICAL
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, warned.text))

    def _publish(self, now_s: float, v: Verdict) -> None:
        self._published, self._published_s = v, now_s
        self._health.problem("guardian", f"{self._name}: {v.in_words}" if v.action else "")
        self._health.value("not to be handed over", "; ".join(v.forbids) or "nothing against it")
        wrong = [text for text in v.forbids if text != STICK]  # pilots who fly move their sticks
        self._health.problem("not to be handed over", f"{self._name}: {'; '.join(wrong)}" if wrong else "")
        header = conversions.header(rospy.get_time(), "")
        self._states.publish(
            GuardianState(
                header=header, vehicle=self._name, action=v.action, holds=v.holds, uncontrolled=v.uncontrolled,
                lost=v.lost, lost_s=v.lost_s, taken=v.taken, sent=v.going_to_m is not None,
                going_to=Point(*(v.going_to_m or ())), reasons=list(v.reasons), forbids=list(v.forbids),
            )
        )  # fmt: skip


def main() -> int:
    """Run the node."""
    return node.run("guardian", GuardianNode)
