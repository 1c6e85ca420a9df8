# SPDX-License-Identifier: Apache-2.0
"""The flight link's part beside MAVROS: the feed of poses, streams and origin, its health, and why
a request fails."""

import math
import os
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Dict

import rospy
from geometry_msgs.msg import PointStamped

from fcsv_control.flight import messages
from fcsv_control.flight.link import FlightLink
from fcsv_control.flight.mavros import COMPONENT
from fcsv_control.flight.mavros_watch import MavrosWatch, MavrosWatchRules
from fcsv_control.flight.messages import HomeReceived, LinkText, PoseEstimated, Refused
from fcsv_control.flight.port import FlightLinkPort
from fcsv_control.flight.pose_feed.feed import PoseGateParameters
from fcsv_control.flight.pose_feed.feed_check import PoseCheckRules
from fcsv_control.flight.pose_feed.watchdog import WatchdogParameters
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.ros.flight_link.link_messages import LinkMessages, header
from fcsv_control.ros.flight_link.link_setup import link_setup
from fcsv_control.ros.flight_link.mavros_line import MavrosLine
from fcsv_control.ros.flight_link.mavros_process import MavrosProcess, mind
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import ModeAsked, Refusal
from mavros_msgs.msg import StatusText

_ASK_S, _SLOW_S = 0.5, 1.0


@dataclass(frozen=True)
class MavrosCompanionParameters:
    """Parameters of the node, as the flight link's. ``component``: with which MAVROS speaks (its
    component_id). ``fcu_url`` is MAVROS's, and tells the autopilot's port where ``autopilot_port``
    does not."""

    vehicle: str
    autopilot_profile: str
    vehicles_dir: str = ""
    component: int = COMPONENT
    fcu_url: str = ""
    autopilot_port: int = -1
    link: LinkParameters = field(default_factory=LinkParameters)
    feed: PoseGateParameters = field(default_factory=PoseGateParameters)
    watchdog: WatchdogParameters = field(default_factory=WatchdogParameters)
    feed_check: PoseCheckRules = field(default_factory=PoseCheckRules)
    mavros_watch: MavrosWatchRules = field(default_factory=MavrosWatchRules)


class MavrosCompanionNode:
    """Modes, arming, take-off and targets are MAVROS's own; all else that a flight link does is
    here."""

    def __init__(self):
        p = node.parameters(MavrosCompanionParameters)
        self._name, self._odom = p.vehicle, frames.odom(p.vehicle)
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._refusals = rospy.Publisher("flight_link/refusal", Refusal, queue_size=5)
        self._home = rospy.Publisher("flight_link/home", PointStamped, queue_size=2, latch=True)
        self._messages = LinkMessages(self._name, self._health)
        self._send: Dict[type, Callable[[Any], None]] = {
            HomeReceived: self._publish_home,
            LinkText: lambda m: self._show_text(m.severity, m.text),
            PoseEstimated: lambda _m: self._health.tick("autopilot"),
            Refused: self._refuse,
        }  # the rest MAVROS tells itself
        self._line = MavrosLine()
        beside = FlightLinkPort(
            self._name, *link_setup(p), os.getpid(), time.monotonic(), p.component
        )
        self._link = FlightLink(self._line, beside, self._publish_output)
        rospy.on_shutdown(self._link.close)
        asked = lambda m: self._link.receive(messages.ModeAsked(Mode(m.mode)))  # noqa: E731
        rospy.Subscriber(
            "flight_link/mode_asked", ModeAsked, asked, queue_size=10, tcp_nodelay=True
        )
        self._messages.subscribe(self._link)
        self._process = MavrosProcess(rospy.resolve_name("mavros"))
        self._hang = MavrosWatch(p.mavros_watch, time.monotonic())
        self._timers = node.every(_SLOW_S, self._slowly), node.every(_ASK_S, self._watch_mavros)

    def _publish_output(self, output: object) -> None:
        if not self._messages.publish(output) and type(output) in self._send:
            self._send[type(output)](output)

    def _slowly(self, _event) -> None:
        gone = (
            ""
            if self._line.there
            else f"{self._name}: no MAVROS listens on {rospy.resolve_name('mavlink/to')}"
        )
        self._health.problem("mavros", gone)

    def _watch_mavros(self, _event) -> None:
        """One that hangs is ended: roslaunch starts it again."""
        words = mind(self._hang, self._process, lambda: self._line.heard_s)
        if words:
            self._show_text(StatusText.CRITICAL, f"{self._name}: {words}")
        self._health.value("MAVROS hung, times", self._hang.ended)

    def _refuse(self, m: Refused) -> None:
        rospy.logwarn("%s: %s", self._name, m.reason)
        self._refusals.publish(Refusal(header(), m.reason))

    def _publish_home(self, m: HomeReceived) -> None:
        """Only its height is known."""
        message = PointStamped(header=conversions.header(rospy.get_time(), self._odom))
        message.point.x, message.point.y, message.point.z = math.nan, math.nan, m.above_origin_m
        self._home.publish(message)

    def _show_text(self, severity: int, text: str) -> None:
        """Speaks to people, beside what MAVROS passes on of the autopilot."""
        rospy.logwarn("%s", text)
        self._texts.publish(StatusText(header(), severity, text))


def main() -> int:
    """Run the node."""
    return node.run("flight_link", MavrosCompanionNode)
