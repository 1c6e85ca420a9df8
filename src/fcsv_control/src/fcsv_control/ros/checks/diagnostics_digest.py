# SPDX-License-Identifier: Apache-2.0
"""/diagnostics of this machine to `diagnostics/worst`, which crosses the radio."""

import io
from typing import Callable, Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from fcsv_control.flight_check.digest import Status
from fcsv_control.flight_check.messages import DiagnosticsCame
from fcsv_geometry.ros import conversions

ON_THE_WAY_BYTES = 80  # headers of the relay, UDP and IP


class DiagnosticsTopics:
    """``receive`` gets DiagnosticsCame with each message."""

    def __init__(self, receive: Callable[[DiagnosticsCame], None]):
        self._receive = receive
        self._publisher = rospy.Publisher(
            "diagnostics/worst", DiagnosticArray, queue_size=2, latch=True
        )
        rospy.Subscriber("/diagnostics", rospy.AnyMsg, self._on_diagnostics, queue_size=50)

    def _on_diagnostics(self, message: rospy.AnyMsg) -> None:
        """Takes the message as AnyMsg: a second subscriber of this topic in one process must have
        the first one's type."""
        self._receive(DiagnosticsCame(statuses_of(DiagnosticArray().deserialize(message._buff))))

    def publish(self, lines: Sequence[Status]) -> None:
        """What goes over the radio."""
        self._publisher.publish(array(lines, rospy.get_time()))


def statuses_of(message: DiagnosticArray) -> Sequence[Status]:
    return [Status(s.name, s.level, s.message) for s in message.status]


def array(lines: Sequence[Status], stamp_s: float) -> DiagnosticArray:
    """Packs the lines as a message, without values."""
    told = [DiagnosticStatus(level=li.level, name=li.name, message=li.text) for li in lines]
    return DiagnosticArray(conversions.header(stamp_s, ""), told)


def on_the_way_bytes(lines: Sequence[Status]) -> int:
    """Counts octets of its content and all headers around it."""
    buffer = io.BytesIO()
    array(lines, 0.0).serialize(buffer)
    return len(buffer.getvalue()) + ON_THE_WAY_BYTES
