# SPDX-License-Identifier: Apache-2.0
"""The flight link as a node, in MAVROS's topic layout and semantics."""

import threading
import time
from dataclasses import dataclass, field, replace

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.flight.feed import FeedParameters
from fcsv_control.flight.feed_check import FeedCheckRules
from fcsv_control.flight.link import FlightLink, LinkParameters
from fcsv_control.flight.profile import load_profile, port_of
from fcsv_control.flight.signing import read_key
from fcsv_control.flight.texts import severity_name
from fcsv_control.flight.transport import Transport
from fcsv_control.flight.watchdog import WatchdogParameters
from fcsv_control.ros.command_services import Commands, CommandServices
from fcsv_control.ros.link_health import LinkHealthReport
from fcsv_control.ros.pose_feed import WATCH_S, PoseFeed
from fcsv_control.ros.posed import pose_in
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from mavros_msgs.msg import State, StatusText

_STATE_PERIOD_S = 0.4  # so that one that is lost on the radio is no second of silence
_DIAGNOSE_S = 1.0


@dataclass(frozen=True)
class FlightLinkNodeParameters:
    """Parameters of the node. With ``vehicles_dir`` the system id in the vehicle's file is the one listened to.
    ``autopilot_profile``: config/autopilot/NAME.param, what the autopilot's parameters must be. ``signing_key``: file
    of the key with which MAVLink is signed. ``autopilot_port``: its serial port at the other end, whose stream rates
    (SRn_) the profile means; -1: by ``fcu_url`` (USB 0, another device 2)."""

    vehicle: str
    fcu_url: str
    autopilot_profile: str
    vehicles_dir: str = ""
    signing_key: str = ""
    autopilot_port: int = -1
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
        self._published, self._published_s = None, float("-inf")
        self._diagnosed_s = float("-inf")
        self._state_lock = threading.Lock()
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        p = self._parameters
        self._feed = PoseFeed(self._name, p.feed, p.watchdog, p.feed_check, self._health, self._on_text)
        self._told = LinkHealthReport(self._name, self._odom, self._health)
        self._state = rospy.Publisher("mavros/state", State, queue_size=5, latch=True)
        self._pose = rospy.Publisher("mavros/local_position/pose", PoseStamped, queue_size=5, tcp_nodelay=True)
        self._battery = rospy.Publisher("mavros/battery", BatteryState, queue_size=2)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        port = p.autopilot_port if p.autopilot_port >= 0 else port_of(p.fcu_url)
        self._link = FlightLink(
            Transport(p.fcu_url, read_key(p.signing_key) if p.signing_key else None),
            self._link_parameters(),
            load_profile(p.autopilot_profile).at_port(port),
            on_state=self._on_state,
            on_pose=self._on_pose,
            on_barometer=lambda height_m: self._feed.barometer(height_m),
            on_battery=self._on_battery,
            on_text=self._on_text,
            on_rc=lambda: self._told.rc(self._link),
            on_estimate_moved=self._told.estimate_moved,
        )
        rospy.on_shutdown(self._link.close)
        link = self._link
        self._services = CommandServices(Commands(link.set_mode, link.arm, link.take_off), self._on_text)
        rospy.Service("~odometry_reset", Trigger, self._odometry_reset)
        self._feed.begin(self._link)
        self._timer = node.every(WATCH_S, self._watch)
        rospy.Subscriber(
            "mavros/setpoint_position/local", PoseStamped, self._on_set_point, queue_size=1, tcp_nodelay=True
        )

    def _link_parameters(self) -> LinkParameters:
        link, folder = self._parameters.link, self._parameters.vehicles_dir
        if link.target_system or not folder:
            return link
        return replace(link, target_system=node.vehicles(folder, [self._name])[self._name].system_id)

    # ---- towards the autopilot -----------------------------------------------------------------------------

    def _on_set_point(self, message: PoseStamped) -> None:
        T_odom_body = pose_in(self._odom, message, "set-point", self._health)
        if T_odom_body is not None:
            self._link.send_set_point(T_odom_body)

    def _watch(self, _event) -> None:
        now_s = time.monotonic()
        self._told.publish(now_s, self._link, self._feed.doubt)
        self._feed.watch(now_s)
        if now_s - self._diagnosed_s >= _DIAGNOSE_S or not self._link.connected:
            self._diagnosed_s = now_s
            self._told.diagnose(self._link)
        if now_s - self._published_s >= _STATE_PERIOD_S or not self._link.connected:
            self._on_state()

    # ---- from the autopilot --------------------------------------------------------------------------------

    def _on_state(self) -> None:
        """Publish the state where it changed, and 2.5 times a second."""
        connected, s = self._link.snapshot()
        now = (connected, s.armed, s.guided, s.manual_input, s.mode, s.system_status)
        with self._state_lock:
            if now == self._published and time.monotonic() - self._published_s < _STATE_PERIOD_S:
                return
            self._published, self._published_s = now, time.monotonic()
            self._state.publish(State(conversions.header(rospy.get_time(), ""), *now))

    def _on_pose(self, T_odom_body: np.ndarray, v_odom_mps: np.ndarray) -> None:
        self._health.tick("autopilot")
        self._feed.estimate(T_odom_body, v_odom_mps)
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
        log("autopilot of %s: %s: %s", self._name, severity_name(severity), text)
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, text))

    # ---- services ------------------------------------------------------------------------------------------

    def _odometry_reset(self, _request) -> TriggerResponse:
        self._feed.begin_again()
        return TriggerResponse(True, "the next pose is adopted at once; the set-point has to be issued again")


def main() -> int:
    """Run the node."""
    return node.run("flight_link", FlightLinkNode)
