# SPDX-License-Identifier: Apache-2.0
"""The flight link's part beside MAVROS: the feed of poses, streams and origin, its health, and why a request fails."""

import math
import time
from dataclasses import dataclass, field, replace

import rospy
from geometry_msgs.msg import PointStamped
from std_srvs.srv import Trigger, TriggerResponse

from fcsv_control.flight.feed import FeedParameters
from fcsv_control.flight.feed_check import FeedCheckRules
from fcsv_control.flight.link import FlightLink, LinkParameters
from fcsv_control.flight.mavros import COMPONENT, MavrosCore
from fcsv_control.flight.mavros_watch import MavrosWatch, MavrosWatchRules
from fcsv_control.flight.profile import load_profile, port_of
from fcsv_control.flight.watchdog import WatchdogParameters
from fcsv_control.ros.link_health import LinkHealthReport
from fcsv_control.ros.mavros_line import MavrosLine
from fcsv_control.ros.mavros_process import MavrosProcess, mind
from fcsv_control.ros.pose_feed import WATCH_S, PoseFeed
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.flow import RateGate
from fcsv_msgs.msg import ModeAsked, Refusal
from mavros_msgs.msg import StatusText

_ASK_S = 0.5


@dataclass(frozen=True)
class MavrosCompanionParameters:
    """Parameters of the node, as the flight link's. ``component``: with which MAVROS speaks (its component_id).
    ``fcu_url`` is MAVROS's, and tells the autopilot's port where ``autopilot_port`` does not."""

    vehicle: str
    autopilot_profile: str
    vehicles_dir: str = ""
    component: int = COMPONENT
    fcu_url: str = ""
    autopilot_port: int = -1
    link: LinkParameters = field(default_factory=LinkParameters)
    feed: FeedParameters = field(default_factory=FeedParameters)
    watchdog: WatchdogParameters = field(default_factory=WatchdogParameters)
    feed_check: FeedCheckRules = field(default_factory=FeedCheckRules)
    mavros_watch: MavrosWatchRules = field(default_factory=MavrosWatchRules)


class MavrosCompanionNode:
    """Modes, arming, take-off and targets are MAVROS's own; all else that a flight link does is here."""

    def __init__(self):
        p = node.parameters(MavrosCompanionParameters)
        self._name, self._odom = p.vehicle, frames.odom(p.vehicle)
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        self._slow = RateGate(1.0)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._refusals = rospy.Publisher("flight_link/refusal", Refusal, queue_size=5)
        self._home = rospy.Publisher("flight_link/home", PointStamped, queue_size=2, latch=True)
        self._feed = PoseFeed(self._name, p.feed, p.watchdog, p.feed_check, self._health, self._say)
        self._told = LinkHealthReport(self._name, self._odom, self._health, transmitter=False)
        link = p.link
        if p.vehicles_dir and not link.target_system:
            link = replace(link, target_system=node.vehicles(p.vehicles_dir, [self._name])[self._name].system_id)
        self._line = MavrosLine()
        port = p.autopilot_port if p.autopilot_port >= 0 else port_of(p.fcu_url)
        self._core = MavrosCore(link, load_profile(p.autopilot_profile).at_port(port), p.component)
        self._link = FlightLink(
            self._line, link, core=self._core, on_pose=self._on_pose, on_barometer=self._feed.barometer,
            on_refused=self._on_refused, on_home=self._on_home, on_estimate_moved=self._told.estimate_moved,
        )  # fmt: skip
        rospy.on_shutdown(self._link.close)
        rospy.Service("~odometry_reset", Trigger, self._odometry_reset)
        asked = lambda m: self._core.mode_asked(m.mode)  # noqa: E731
        rospy.Subscriber("flight_link/mode_asked", ModeAsked, asked, queue_size=10, tcp_nodelay=True)
        self._feed.begin(self._link)
        self._process = MavrosProcess(rospy.resolve_name("mavros"))
        self._hang = MavrosWatch(p.mavros_watch, time.monotonic())
        self._timers = node.every(WATCH_S, self._watch), node.every(_ASK_S, self._watch_mavros)

    def _watch(self, _event) -> None:
        now_s = time.monotonic()
        self._told.publish(now_s, self._link, self._feed.doubt)
        self._feed.watch(now_s)
        if self._slow.passes(now_s):
            self._told.diagnose(self._link)
            gone = "" if self._line.there else f"{self._name}: no MAVROS listens on {rospy.resolve_name('mavlink/to')}"
            self._health.problem("mavros", gone)

    def _watch_mavros(self, _event) -> None:
        """One that hangs is ended: roslaunch starts it again."""
        words = mind(self._hang, self._process, lambda: self._line.heard_s)
        if words:
            self._say(StatusText.CRITICAL, f"{self._name}: {words}")
        self._health.value("MAVROS hung, times", self._hang.ended)

    def _on_pose(self, T_odom_body, v_odom_mps) -> None:
        self._health.tick("autopilot")
        self._feed.estimate(T_odom_body, v_odom_mps)

    def _on_refused(self, reason: str) -> None:
        rospy.logwarn("%s: %s", self._name, reason)
        self._refusals.publish(Refusal(conversions.header(rospy.get_time(), ""), reason))

    def _on_home(self, above_origin_m: float) -> None:
        """Only its height is known."""
        message = PointStamped(header=conversions.header(rospy.get_time(), self._odom))
        message.point.x, message.point.y, message.point.z = math.nan, math.nan, above_origin_m
        self._home.publish(message)

    def _say(self, severity: int, text: str) -> None:
        """To people, beside what MAVROS passes on of the autopilot."""
        rospy.logwarn("%s", text)
        self._texts.publish(StatusText(conversions.header(rospy.get_time(), ""), severity, text))

    def _odometry_reset(self, _request) -> TriggerResponse:
        self._feed.begin_again()
        return TriggerResponse(True, "the next pose is adopted at once; the set-point has to be issued again")


def main() -> int:
    """Run the node."""
    return node.run("flight_link", MavrosCompanionNode)
