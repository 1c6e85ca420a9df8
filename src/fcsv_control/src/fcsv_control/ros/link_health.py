# SPDX-License-Identifier: Apache-2.0
"""What the flight link tells of itself: its health five times a second, the pilot's sticks, and slow diagnostics."""

import math
import os
import time
from typing import Optional

import rospy
from geometry_msgs.msg import Vector3Stamped

from fcsv_control.flight.link import FlightLink
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.flow import RateGate
from fcsv_msgs.msg import LinkHealth, ParameterReport
from mavros_msgs.msg import RCIn

_RATE_HZ = 5.0
_LIMITS = tuple(FlightBounds().autopilot_parameters)
_PREARM = {None: LinkHealth.PREARM_UNKNOWN, True: LinkHealth.PREARM_READY, False: LinkHealth.PREARM_NOT_READY}


class LinkHealthReport:
    """Publishes flight_link/health, /parameters, /estimate_moved and, where it is to tell of the ``transmitter``,
    mavros/rc/in of one vehicle."""

    def __init__(self, name: str, odom: str, health: Health, transmitter: bool = True):
        self._name, self._odom, self._health = name, odom, health
        self._gate, self._urgent = RateGate(_RATE_HZ), ()
        self._publisher = rospy.Publisher("flight_link/health", LinkHealth, queue_size=5)
        self._moved = rospy.Publisher("flight_link/estimate_moved", Vector3Stamped, queue_size=20)
        self._parameters = rospy.Publisher("flight_link/parameters", ParameterReport, queue_size=2, latch=True)
        self._reported = ParameterReport()
        self._rc = rospy.Publisher("mavros/rc/in", RCIn, queue_size=5) if transmitter else None

    def publish(self, now_s: float, link: FlightLink, doubt: str) -> None:
        """At 5 Hz, and at once where there is another ``doubt`` of the poses, or where it is no longer known whether
        the autopilot may be flown, however often it is called."""
        connected, s = link.snapshot()
        urgent = (doubt, connected, link.origin_set, link.parameters.known, s.booting)
        if urgent == self._urgent and not self._gate.passes(now_s):
            return
        self._urgent = urgent
        rate_hz, age_s, apart_m = link.feed_figures()
        wrong = link.parameters.wrong()
        self._publisher.publish(
            header=conversions.header(rospy.get_time(), ""), connected=connected, ekf_flags=s.ekf_flags,
            ekf_variance=s.ekf_variance, ekf_age_s=now_s - s.ekf_heard_s, throttle=s.throttle,
            throttle_age_s=now_s - s.throttle_heard_s, system_status=s.system_status, origin_set=link.origin_set,
            parameters_ok=link.parameters.known and not wrong, parameter=wrong[0] if wrong else "",
            feed_rate_hz=rate_hz, feed_age_s=age_s, estimate_apart_m=apart_m, doubt=doubt, pid=os.getpid(),
            in_the_air=-1 if s.in_the_air is None else int(s.in_the_air), prearm=_PREARM[s.prearm_ok],
        )  # fmt: skip

    def parameters(self, link: FlightLink) -> None:
        """What the autopilot's parameters are against the profile, where that is news."""
        check = link.parameters
        report = ParameterReport(
            profile=check.profile.name, firmware=link.firmware, complete=check.complete,
            blocks=check.problems(), advises=check.warnings(), unknown=check.unknown(),
            limits=list(_LIMITS), limit_values=[check.value(name) for name in _LIMITS],
        )  # fmt: skip
        if report != self._reported:
            self._reported = report
            stamped = ParameterReport(*(getattr(report, field) for field in report.__slots__))
            stamped.header = conversions.header(rospy.get_time(), "")
            self._parameters.publish(stamped)

    def rc(self, link: FlightLink) -> None:
        """The transmitter was reported."""
        s = link.state
        self._rc.publish(conversions.header(rospy.get_time(), ""), s.rc_rssi, s.rc_channels)

    def estimate_moved(self, step_m) -> None:
        """The autopilot adopted a jump of its navigation: targets have to move along."""
        message = Vector3Stamped(header=conversions.header(rospy.get_time(), self._odom))
        message.vector.x, message.vector.y, message.vector.z = map(float, step_m)
        rospy.logwarn("%s: the autopilot's estimate moved by %.2f m", self._name, math.hypot(*step_m))
        self._moved.publish(message)

    def diagnose(self, link: FlightLink) -> None:
        """Diagnostics that change slowly."""
        s, name, health = link.state, self._name, self._health
        self.parameters(link)
        wrong, weak = "; ".join(link.parameters.problems()), "; ".join(link.parameters.warnings())
        others, zero = link.strangers, link.origin_at_zero
        silent = link.foreigner or "no heartbeat of the autopilot"
        health.problem("link", "" if link.connected else f"{name}: {silent}")
        health.problem("parameters", f"{name}: autopilot's parameters: {wrong}" if wrong else "")
        health.problem("advised", f"{name}: advised parameters: {weak}" if weak else "")
        health.problem("autopilots", f"{name}: a second autopilot, {others}, is on the line" if others else "")
        health.problem("heartbeats", f"{name}: {link.imitated}" if link.imitated else "")
        restart = f"{name}: origin's altitude is 0, height runs away: restart the autopilot"
        health.problem("origin", restart if zero and not s.armed else "")
        for key, value in (
            ("firmware", link.firmware), ("line's round trip (ms)", _milliseconds(link.timesync.round_trip_s)),
            ("autopilot's clock (s)", "" if link.timesync.offset_s is None else f"{link.timesync.offset_s:.4f}"),
            ("mode", s.mode), ("armed", s.armed), ("ready to arm", s.prearm_ok), ("origin", link.origin_set),
            ("EKF flags", hex(s.ekf_flags)), ("EKF variance", f"{s.ekf_variance:.2f}"),
            ("throttle stick", f"{s.throttle:.2f}"),
            ("stick heard (s ago)", f"{time.monotonic() - s.throttle_heard_s:.1f}"),
        ):  # fmt: skip
            health.value(key, value)


def _milliseconds(seconds: Optional[float]) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.1f}"
