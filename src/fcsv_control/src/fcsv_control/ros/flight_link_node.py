# SPDX-License-Identifier: Apache-2.0
"""The flight link as a node, in MAVROS's topic layout and semantics."""

import threading
import time
from dataclasses import dataclass, field, replace
from typing import Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.errors import CommandRefused, ControlError
from fcsv_control.flight.commands import ACCEPTED, FAILED
from fcsv_control.flight.feed import FeedParameters, FeedVerdict, VisionFeed
from fcsv_control.flight.feed_check import FeedCheck, FeedCheckRules
from fcsv_control.flight.link import FlightLink, LinkParameters
from fcsv_control.flight.profile import load_profile
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_control.ros.link_health import LinkHealthReport
from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Refusal
from mavros_msgs.msg import State, StatusText
from mavros_msgs.srv import CommandBool, CommandBoolResponse, CommandTOL, CommandTOLResponse, SetMode, SetModeResponse

_WATCH_S = 0.05
_STALL_S = 0.25  # a check that comes later than this was delayed itself
_STATE_PERIOD_S = 1.0


@dataclass(frozen=True)
class FlightLinkNodeParameters:
    """Parameters of the node. With ``vehicles_dir`` the system id in the vehicle's file is the one listened to.
    ``autopilot_profile``: config/autopilot/NAME.param, what the autopilot's parameters must be."""

    vehicle: str
    fcu_url: str
    autopilot_profile: str
    vehicles_dir: str = ""
    link: LinkParameters = field(default_factory=LinkParameters)
    feed: FeedParameters = field(default_factory=FeedParameters)
    watchdog: WatchdogParameters = field(default_factory=WatchdogParameters)
    feed_check: FeedCheckRules = field(default_factory=FeedCheckRules)


class FlightLinkNode:
    """Poses in, estimates out, services with real acknowledgements, and a watchdog on the pose feed."""

    def __init__(self):
        self._parameters = node.parameters(FlightLinkNodeParameters)
        self._name = self._parameters.vehicle
        self._odom = frames.odom(self._name)
        self._feed = VisionFeed(self._parameters.feed)
        self._watchdog = FeedWatchdog(self._parameters.watchdog, time.monotonic())
        self._check = FeedCheck(self._parameters.feed_check)
        self._watched_s = time.monotonic()
        self._warned = False
        self._landing: Optional[threading.Thread] = None
        self._published, self._published_s = None, float("-inf")
        self._state_lock = threading.Lock()
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        self._told = LinkHealthReport(self._name, self._odom, self._health)
        self._state = rospy.Publisher("mavros/state", State, queue_size=5, latch=True)
        self._pose = rospy.Publisher("mavros/local_position/pose", PoseStamped, queue_size=5, tcp_nodelay=True)
        self._battery = rospy.Publisher("mavros/battery", BatteryState, queue_size=2)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._refusals = rospy.Publisher("flight_link/refusal", Refusal, queue_size=5)
        self._link = FlightLink(
            self._parameters.fcu_url,
            self._link_parameters(),
            load_profile(self._parameters.autopilot_profile),
            on_state=self._on_state,
            on_pose=self._on_pose,
            on_battery=self._on_battery,
            on_text=self._on_text,
            on_rc=lambda: self._told.rc(self._link),
            on_estimate_moved=self._told.estimate_moved,
        )
        rospy.on_shutdown(self._link.close)
        rospy.Service("mavros/set_mode", SetMode, self._set_mode)
        rospy.Service("mavros/cmd/arming", CommandBool, self._arm)
        rospy.Service("mavros/cmd/takeoff", CommandTOL, self._take_off)
        rospy.Service("mavros/cmd/land", CommandTOL, self._land)
        rospy.Service("~odometry_reset", Trigger, self._odometry_reset)
        self._timer = node.every(_WATCH_S, self._watch)
        rospy.Subscriber("mavros/vision_pose/pose", PoseStamped, self._on_vision, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber(
            "mavros/setpoint_position/local", PoseStamped, self._on_set_point, queue_size=1, tcp_nodelay=True
        )

    def _link_parameters(self) -> LinkParameters:
        link, folder = self._parameters.link, self._parameters.vehicles_dir
        if link.target_system or not folder:
            return link
        return replace(link, target_system=node.vehicles(folder, [self._name])[self._name].system_id)

    # ---- towards the autopilot -----------------------------------------------------------------------------

    def _on_vision(self, message: PoseStamped) -> None:
        verdict, why = self._feed.judge(time.monotonic(), message.header.stamp.to_sec())
        if verdict is FeedVerdict.DROP:
            self._health.drop("late pose", why)
        if verdict is not FeedVerdict.SEND:
            return
        T_odom_body = self._converted(message, "pose feed")
        if T_odom_body is not None:
            now_s, stamp_s = time.monotonic(), self._feed.stamp_s
            if self._believed(now_s, stamp_s, T_odom_body):
                self._link.send_pose(stamp_s, T_odom_body)
                self._watchdog.feed(now_s)
                self._health.tick("pose feed")

    def _believed(self, now_s: float, stamp_s: float, T_odom_body: np.ndarray) -> bool:
        """Whether a pose agrees with what the autopilot feels. On the ground there is nothing to feel."""
        state = self._link.state
        if state.armed and state.in_the_air:
            believed = self._check.judge(now_s, stamp_s, T_odom_body)
        else:
            self._check.begin_again()
            believed = True
        self._health.problem("tracker", f"{self._name}: {self._check.doubt}" if self._check.doubt else "")
        return believed

    def _on_set_point(self, message: PoseStamped) -> None:
        T_odom_body = self._converted(message, "set-point")
        if T_odom_body is not None:
            self._link.send_set_point(T_odom_body)

    def _converted(self, message: PoseStamped, what: str) -> Optional[np.ndarray]:
        if message.header.frame_id != self._odom:
            self._health.drop(f"{what} in a wrong frame", f"'{message.header.frame_id}' is not '{self._odom}'")
            return None
        try:
            return conversions.pose_to_transform(message.pose)
        except FcsvError as error:
            self._health.drop(f"{what} that is no pose", str(error))
            return None

    def _watch(self, _event) -> None:
        now_s, s = time.monotonic(), self._link.state
        pause_s, self._watched_s = now_s - self._watched_s, now_s
        if pause_s > _STALL_S:
            rospy.logwarn("%s: this computer did not let the flight link run for %.2f s", self._name, pause_s)
            self._watchdog.slept(now_s, pause_s - _WATCH_S)
        self._told.publish(now_s, self._link, self._check.doubt)
        self._mind_feed(now_s, s)
        if now_s - self._published_s >= _STATE_PERIOD_S or not self._link.connected:
            self._told.diagnose(self._link)
            self._on_state()

    def _mind_feed(self, now_s: float, s) -> None:
        """What the age of the feed asks for."""
        alarm = self._watchdog.check(now_s, s.armed, s.mode, self._link.mode_is_ours)
        late = alarm is not Alarm.NONE
        age = f"pose feed is {self._watchdog.age_s(now_s):.1f} s old"
        self._health.problem("feed", f"{self._name}: {age} while flying in {s.mode}" if late else "")
        if late and not self._warned:
            by_hand = "" if s.mode == "GUIDED" or self._link.mode_is_ours else f" in {s.mode}: fly in ALT_HOLD, or land"
            self._on_text(StatusText.CRITICAL, f"{self._name}: {age}{by_hand}")
        self._warned = late
        if alarm is Alarm.LAND and (self._landing is None or not self._landing.is_alive()):
            self._on_text(StatusText.ALERT, f"{self._name}: {age}, landing")
            self._landing = threading.Thread(target=self._land_now, name="failsafe", daemon=True)
            self._landing.start()

    def _land_now(self) -> None:
        try:
            self._link.set_mode("LAND")
        except ControlError as error:
            rospy.logerr("landing after the loss of the pose feed: %s", error)

    # ---- from the autopilot --------------------------------------------------------------------------------

    def _on_state(self) -> None:
        """Publish the state where it changed, and once a second."""
        connected, s = self._link.snapshot()
        now = (connected, s.armed, s.guided, s.manual_input, s.mode, s.system_status)
        with self._state_lock:
            if now == self._published and time.monotonic() - self._published_s < _STATE_PERIOD_S:
                return
            self._published, self._published_s = now, time.monotonic()
            self._state.publish(State(conversions.header(rospy.get_time(), ""), *now))

    def _on_pose(self, T_odom_body: np.ndarray, v_odom_mps: np.ndarray) -> None:
        self._health.tick("autopilot")
        self._check.estimate(time.monotonic(), T_odom_body, v_odom_mps)
        self._pose.publish(conversions.pose_stamped(T_odom_body, rospy.get_time(), self._odom))

    def _on_battery(self) -> None:
        s = self._link.state
        message = BatteryState(header=conversions.header(rospy.get_time(), ""), voltage=s.voltage_v, present=True)
        message.percentage, message.current = s.battery_share, -s.current_a
        message.charge = message.capacity = message.design_capacity = float("nan")
        message.power_supply_technology = BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO
        self._battery.publish(message)

    def _on_text(self, severity: int, text: str) -> None:
        log = rospy.loginfo if severity >= StatusText.NOTICE else rospy.logwarn
        log("autopilot of %s: %s", self._name, text)
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, text))

    # ---- services ------------------------------------------------------------------------------------------

    def _set_mode(self, request) -> SetModeResponse:
        return SetModeResponse(self._attempt(lambda: self._link.set_mode(request.custom_mode)) == ACCEPTED)

    def _arm(self, request) -> CommandBoolResponse:
        result = self._attempt(lambda: self._link.arm(request.value))
        return CommandBoolResponse(result == ACCEPTED, result)

    def _take_off(self, request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._link.take_off(request.altitude))
        return CommandTOLResponse(result == ACCEPTED, result)

    def _land(self, _request) -> CommandTOLResponse:
        result = self._attempt(lambda: self._link.set_mode("LAND"))
        return CommandTOLResponse(result == ACCEPTED, result)

    def _odometry_reset(self, _request) -> TriggerResponse:
        self._link.note_reset()
        self._check.begin_again()
        return TriggerResponse(True, "the next pose is adopted at once; the set-point has to be issued again")

    def _attempt(self, action) -> int:
        """MAV_RESULT: 0 accepted, 4 failed. Before the service answers, the reason goes to the agent (refusal) and to
        people (status text)."""
        try:
            action()
            return ACCEPTED
        except CommandRefused as error:
            severity, reason = StatusText.ERROR, str(error)
        except ControlError as error:
            severity, reason = StatusText.CRITICAL, str(error)
        self._refusals.publish(Refusal(conversions.header(rospy.get_time(), ""), reason))
        self._on_text(severity, reason)
        return FAILED


def main() -> int:
    """Run the node."""
    return node.run("flight_link", FlightLinkNode)
