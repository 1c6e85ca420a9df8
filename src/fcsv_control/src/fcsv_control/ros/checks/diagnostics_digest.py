# SPDX-License-Identifier: Apache-2.0
"""/diagnostics of this machine to `diagnostics/worst`, which crosses the radio."""

import io
import threading
import time
from typing import Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from fcsv_control.flight_check.digest import Digest, Status
from fcsv_geometry.ros import conversions

ON_THE_WAY_BYTES = 80  # headers of the relay, UDP and IP


class DiagnosticsDigest:
    """``step`` often besides: what fell silent tells nothing. ``own`` as Digest's."""

    def __init__(self, own: str = ""):
        self._digest, self._lock = Digest(own), threading.Lock()
        self._publisher = rospy.Publisher(
            "diagnostics/worst", DiagnosticArray, queue_size=2, latch=True
        )
        rospy.Subscriber("/diagnostics", rospy.AnyMsg, self._on_diagnostics, queue_size=50)

    def _on_diagnostics(self, message: rospy.AnyMsg) -> None:
        """Takes the message as AnyMsg: a second subscriber of this topic in one process must have
        the first one's type."""
        heard = DiagnosticArray().deserialize(message._buff)
        with self._lock:
            self._digest.tell(time.monotonic(), statuses_of(heard))
        self.step()

    def step(self) -> None:
        """Publish what is due."""
        with self._lock:
            lines = self._digest.due(time.monotonic(), on_the_way_bytes)
            if lines is not None:
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
