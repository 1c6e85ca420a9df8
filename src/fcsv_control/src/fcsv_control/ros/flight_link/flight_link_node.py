# SPDX-License-Identifier: Apache-2.0
"""The flight link as a node, in MAVROS's topic layout and semantics, around its port."""

import math
import os
import time
from dataclasses import astuple, dataclass, field
from typing import Any, Callable, Dict

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState, NavSatFix, NavSatStatus

from fcsv_control.agent.messages import Kind, SetPoint
from fcsv_control.flight.link import FlightLink
from fcsv_control.flight.mavlink.signing import read_key
from fcsv_control.flight.mavlink.texts import severity_name
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.messages import (
    AutopilotState,
    BatteryReading,
    FixReceived,
    LinkText,
    PoseEstimated,
    TextReceived,
    TransmitterReading,
)
from fcsv_control.flight.port import FlightLinkPort
from fcsv_control.flight.pose_feed.feed import PoseGateParameters
from fcsv_control.flight.pose_feed.feed_check import PoseCheckRules
from fcsv_control.flight.pose_feed.watchdog import WatchdogParameters
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.ros.flight_link.command_services import Commands, CommandServices
from fcsv_control.ros.flight_link.link_messages import LinkMessages, header
from fcsv_control.ros.flight_link.link_setup import link_setup
from fcsv_control.ros.flight_link.posed import pose_in
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from mavros_msgs.msg import RCIn, State, StatusText


@dataclass(frozen=True)
class FlightLinkNodeParameters:
    """Parameters of the node. With ``vehicles_dir`` the system id in the vehicle's file is the one
    listened to. ``autopilot_profile``: config/autopilot/NAME.param, what the autopilot's parameters
    must be. ``signing_key``: file of the key with which MAVLink is signed. ``autopilot_port``: its
    serial port at the other end, whose stream rates (SRn_) the profile means; -1: by ``fcu_url``
    (USB 0, another device 2)."""

    vehicle: str
    fcu_url: str
    autopilot_profile: str
    vehicles_dir: str = ""
    signing_key: str = ""
    autopilot_port: int = -1
    link: LinkParameters = field(default_factory=LinkParameters)
    feed: PoseGateParameters = field(default_factory=PoseGateParameters)
    watchdog: WatchdogParameters = field(default_factory=WatchdogParameters)
    feed_check: PoseCheckRules = field(default_factory=PoseCheckRules)


class FlightLinkNode:
    """Poses in, estimates out, services with real acknowledgements, and a watchdog on the pose
    feed."""

    def __init__(self):
        p = node.parameters(FlightLinkNodeParameters)
        self._name, self._odom = p.vehicle, frames.odom(p.vehicle)
        self._health = Health(self._name, {"pose feed": 10.0, "autopilot": 5.0})
        self._messages = LinkMessages(self._name, self._health)
        self._state = rospy.Publisher("mavros/state", State, queue_size=5, latch=True)
        self._pose = rospy.Publisher(
            "mavros/local_position/pose", PoseStamped, queue_size=5, tcp_nodelay=True
        )
        self._battery = rospy.Publisher("mavros/battery", BatteryState, queue_size=2)
        self._texts = rospy.Publisher("mavros/statustext/recv", StatusText, queue_size=20)
        self._rc = rospy.Publisher("mavros/rc/in", RCIn, queue_size=5)
        self._fix = rospy.Publisher("mavros/global_position/raw/fix", NavSatFix, queue_size=5)
        self._send: Dict[type, Callable[[Any], None]] = {
            AutopilotState: lambda m: self._state.publish(State(header(), *astuple(m))),
            BatteryReading: self._publish_battery,
            FixReceived: self._publish_fix,
            LinkText: lambda m: self._show_text(m.severity, m.text),
            PoseEstimated: self._publish_pose,
            TextReceived: lambda m: self._show_text(m.severity, m.text),
            TransmitterReading: lambda m: self._rc.publish(header(), m.rssi, m.channels),
        }
        link = self._link = FlightLink(
            Transport(p.fcu_url, read_key(p.signing_key) if p.signing_key else None),
            FlightLinkPort(self._name, *link_setup(p), os.getpid(), time.monotonic()),
            self._publish_output,
        )
        rospy.on_shutdown(link.close)
        commands = Commands(
            lambda mode: link.ask(Kind.SET_MODE, mode=mode),
            lambda flag: link.ask(Kind.ARM, flag=flag),
            lambda altitude_m: link.ask(Kind.TAKEOFF, altitude_m=altitude_m),
        )
        self._services = CommandServices(commands, self._show_text)
        self._messages.subscribe(link)
        rospy.Subscriber(
            "mavros/setpoint_position/local",
            PoseStamped,
            self._on_set_point,
            queue_size=1,
            tcp_nodelay=True,
        )

    def _on_set_point(self, message: PoseStamped) -> None:
        T_odom_body = pose_in(self._odom, message, "set-point", self._health)
        if T_odom_body is not None:
            self._link.receive(SetPoint(T_odom_body))

    def _publish_output(self, output: object) -> None:
        if not self._messages.publish(output):
            self._send[type(output)](output)

    def _publish_pose(self, m: PoseEstimated) -> None:
        self._health.tick("autopilot")
        self._pose.publish(conversions.pose_stamped(m.T_odom_body, rospy.get_time(), self._odom))

    def _publish_battery(self, m: BatteryReading) -> None:
        message = BatteryState(header=header(), voltage=m.voltage_v, present=True)
        message.percentage, message.current = m.share, -m.current_a
        message.charge = message.capacity = message.design_capacity = float("nan")
        message.power_supply_technology = BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO
        self._battery.publish(message)

    def _publish_fix(self, m: FixReceived) -> None:
        message = NavSatFix(
            header=conversions.header(rospy.get_time(), frames.base_link(self._name))
        )
        message.status.status, message.status.service = m.status, NavSatStatus.SERVICE_GPS
        message.latitude, message.longitude = m.latitude_deg, m.longitude_deg
        message.altitude = m.height_m
        if math.isfinite(m.sigma_m) and math.isfinite(m.height_sigma_m):
            across, up = m.sigma_m**2, m.height_sigma_m**2
            message.position_covariance = [across, 0, 0, 0, across, 0, 0, 0, up]
            message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
        self._fix.publish(message)

    def _show_text(self, severity: int, text: str) -> None:
        log = rospy.loginfo if severity >= StatusText.NOTICE else rospy.logwarn
        log("autopilot of %s: %s: %s", self._name, severity_name(severity), text)
        self._texts.publish(StatusText(header(), severity, text))


def main() -> int:
    """Run the node."""
    return node.run("flight_link", FlightLinkNode)
