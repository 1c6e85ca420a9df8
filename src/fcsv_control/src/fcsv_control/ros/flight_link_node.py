# SPDX-License-Identifier: Apache-2.0
"""The flight link as a node, in MAVROS's topic layout and semantics."""

import logging
import time

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState

from fcsv_control.errors import CommandRefused, ControlError
from fcsv_control.flight.link import FlightLink, LinkParameters
from fcsv_control.flight.watchdog import FeedWatchdog
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import State, StatusText
from fcsv_msgs.srv import CommandBool, CommandBoolResponse, CommandTOL, CommandTOLResponse, SetMode, SetModeResponse

_FEED_PERIOD_S = 1.0 / 40.0  # 30 Hz passes, 200 Hz would be thinned
_STALE_S = 0.3


class FlightLinkNode:
    """Poses in, estimates out, services with real acknowledgements, and a watchdog on the pose feed."""

    def __init__(self):
        self._name = rospy.get_param("~vehicle")
        parameters = LinkParameters(rospy.get_param("~fcu_url"), rospy.get_param("~position_rate_hz", 30.0))
        self._watchdog = FeedWatchdog(rospy.get_param("~feed_warn_s", 0.4), rospy.get_param("~feed_land_s", 0.8))
        rospy.loginfo("%s, %s", parameters, self._watchdog)
        self._last_fed_s = 0.0
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        self._state = rospy.Publisher("mavros/state", State, queue_size=5, latch=True)
        self._pose = rospy.Publisher("mavros/local_position/pose", PoseStamped, queue_size=5)
        self._battery = rospy.Publisher("mavros/battery", BatteryState, queue_size=2)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._link = FlightLink(
            parameters,
            on_state=self._on_state,
            on_pose=self._on_pose,
            on_battery=self._on_battery,
            on_text=self._on_text,
        )
        rospy.on_shutdown(self._link.close)
        rospy.Service("mavros/set_mode", SetMode, self._set_mode)
        rospy.Service("mavros/cmd/arming", CommandBool, self._arm)
        rospy.Service("mavros/cmd/takeoff", CommandTOL, self._take_off)
        rospy.Service("mavros/cmd/land", CommandTOL, self._land)
        self._timer = rospy.Timer(rospy.Duration(0.1), self._check)
        rospy.Subscriber("mavros/vision_pose/pose", PoseStamped, self._on_vision, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber(
            "mavros/setpoint_position/local", PoseStamped, self._on_set_point, queue_size=1, tcp_nodelay=True
        )

    # ---- towards the autopilot -----------------------------------------------------------------------------

    def _on_vision(self, message: PoseStamped) -> None:
        stamp_s = message.header.stamp.to_sec()
        if stamp_s - self._last_fed_s < _FEED_PERIOD_S:
            return
        age_s = rospy.get_time() - stamp_s
        if not -0.1 < age_s < _STALE_S:
            self._health.drop("stale pose", f"{age_s:.2f} s old")
            return
        T_odom_body = self._converted(message)
        if T_odom_body is None:
            return
        self._last_fed_s = stamp_s
        self._link.send_pose(stamp_s, T_odom_body)
        self._watchdog.feed(time.monotonic())
        self._health.tick("pose feed")

    def _on_set_point(self, message: PoseStamped) -> None:
        T_odom_body = self._converted(message)
        if T_odom_body is not None:
            self._link.send_set_point(T_odom_body)

    def _converted(self, message: PoseStamped):
        if message.header.frame_id != frames.odom(self._name):
            self._health.drop("wrong frame", f"{message.header.frame_id} is not {frames.odom(self._name)}")
            return None
        try:
            return conversions.pose_to_transform(message.pose)
        except FcsvError as error:
            self._health.drop("pose", str(error))
            return None

    def _check(self, _event) -> None:
        state = self._link.state
        verdict = self._watchdog.check(time.monotonic(), state.armed, state.mode)
        text = f"{self._name}: pose feed is {self._watchdog.age_s(time.monotonic()):.1f} s old" if verdict else ""
        self._health.problem("feed", text)
        wrong = [f"{k} is {v:g}" for k, v in state.wrong_parameters.items()]
        self._health.problem("parameters", f"{self._name}: autopilot parameters: {', '.join(wrong)}" if wrong else "")
        if verdict == "land":
            self._on_text(2, "pose feed lost: landing")
            try:
                self._link.set_mode("LAND")
            except ControlError as error:
                rospy.logerr("landing after the loss of the pose feed: %s", error)
        if not state.connected(time.monotonic()) and state.heartbeat_s is not None:
            self._on_state()

    # ---- from the autopilot --------------------------------------------------------------------------------

    def _on_state(self) -> None:
        s = self._link.state
        self._state.publish(
            State(
                header=conversions.header(rospy.get_time(), ""),
                connected=s.connected(time.monotonic()),
                armed=s.armed,
                guided=s.guided,
                manual_input=s.manual_input,
                mode=s.mode,
                system_status=s.system_status,
            )
        )

    def _on_pose(self, T_odom_body) -> None:
        self._health.tick("autopilot")
        self._pose.publish(conversions.pose_stamped(T_odom_body, rospy.get_time(), frames.odom(self._name)))

    def _on_battery(self) -> None:
        s = self._link.state
        message = BatteryState(header=conversions.header(rospy.get_time(), ""), voltage=s.voltage_v, present=True)
        message.percentage = s.battery_share
        message.current = message.charge = message.capacity = message.design_capacity = float("nan")
        self._battery.publish(message)

    def _on_text(self, severity: int, text: str) -> None:
        rospy.loginfo("autopilot of %s: %s", self._name, text)
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, text))

    # ---- services ------------------------------------------------------------------------------------------

    def _set_mode(self, request) -> SetModeResponse:
        return SetModeResponse(self._attempt(lambda: self._link.set_mode(request.custom_mode)) == 0)

    def _arm(self, request) -> CommandBoolResponse:
        result = self._attempt(lambda: self._link.arm(request.value))
        return CommandBoolResponse(result == 0, result)

    def _take_off(self, request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._link.take_off(request.altitude))
        return CommandTOLResponse(result == 0, result)

    def _land(self, _request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._link.set_mode("LAND"))
        return CommandTOLResponse(result == 0, result)

    def _attempt(self, action) -> int:
        """MAV_RESULT: 0 accepted, 4 failed. The reason is published as a status text and logged."""
        try:
            action()
            return 0
        except CommandRefused as error:
            self._on_text(3, str(error))
        except ControlError as error:
            self._on_text(2, str(error))
        return 4


def main() -> None:
    """Run the node."""
    logging.basicConfig(level=logging.INFO)
    rospy.init_node("flight_link")
    FlightLinkNode()
    rospy.spin()
