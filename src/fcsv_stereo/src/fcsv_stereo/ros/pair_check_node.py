# SPDX-License-Identifier: Apache-2.0
"""Whether two vehicles' pictures show them where their trackers say: for the mission, as they
record."""

import threading
import time
from dataclasses import dataclass
from typing import List

import rospy

from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import PairLook
from fcsv_stereo.in_flight import pair_check
from fcsv_stereo.in_flight.pair_check_port import LookAt, PairCheckPort, PairSeen
from fcsv_stereo.refinement import KnownFeatures
from fcsv_stereo.ros.captured_pictures import subscribe_pictures

_WAIT_S = 0.1  # at most, for what comes, or for the end of a rest


@dataclass(frozen=True)
class PairCheckParameters:
    """Parameters of the node; ``vehicles`` with the reference first. At most ``rate_hz`` looks a
    second at a pair, and fewer where looking would take more than ``most_share`` of the time."""

    vehicles: List[str]
    rate_hz: float = 2.0
    most_share: float = 0.25

    def __post_init__(self):
        if len(self.vehicles) < 2:
            raise ValueError(
                f"vehicles: {self.vehicles} are not two or more; name them, the reference first"
            )
        if not 0.1 <= self.rate_hz <= 10.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 0.1..10")
        if not 0.01 <= self.most_share <= 1.0:
            raise ValueError(f"most_share: {self.most_share} is not in 0.01..1")


class PairCheckNode:
    """Callbacks tell the port; ``spin`` looks."""

    def __init__(self):
        p = node.parameters(PairCheckParameters)
        self._port = PairCheckPort(p.vehicles, p.rate_hz, p.most_share)
        self._changed, self._known = threading.Condition(), KnownFeatures()
        self._health = Health("pair_check", {"pictures": 0.0})
        self._looks = rospy.Publisher("/pair_check", PairLook, queue_size=10)
        subscribe_pictures(p.vehicles, self._receive, self._health)

    def _receive(self, data: object) -> None:
        with self._changed:
            self._port.receive(time.monotonic(), data)
            self._changed.notify()

    def spin(self) -> None:
        """Looks at what comes until ROS shuts the node down."""
        while not rospy.is_shutdown():
            with self._changed:
                outputs = self._port.step(time.monotonic())
                if not outputs:
                    self._changed.wait(_WAIT_S)
            for output in outputs:
                self._do(output)

    def _do(self, output: object) -> None:
        if isinstance(output, LookAt):
            a, b = output.a, output.b
            seen = pair_check.look(a, b, self._known)
            self._receive(PairSeen(a.vehicle, b.vehicle, b.stamp_s, seen))
        elif isinstance(output, PairSeen):
            self._publish(output)
        else:
            self._health.drop(output.what, output.why)

    def _publish(self, m: PairSeen) -> None:
        self._health.problem(f"pair {m.vehicle}", m.problem)
        header = conversions.header(m.stamp_s, "")
        figures = (m.look.matches, m.look.agree, m.look.off_m, m.look.surprise, m.look.off)
        self._looks.publish(PairLook(header, m.reference, m.vehicle, *figures))


def main() -> int:
    """Run the node."""
    return node.run("pair_check", PairCheckNode)
