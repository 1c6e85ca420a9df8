# SPDX-License-Identifier: Apache-2.0
"""Whether two vehicles' pictures show them where their trackers say: for the mission, as they
record."""

import threading
import time
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np
import rospy

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import PairLook
from fcsv_stereo.in_flight import pair_check
from fcsv_stereo.model import LivePicture, Picture
from fcsv_stereo.refinement import KnownFeatures
from fcsv_stereo.ros.captured_pictures import CapturedPictures


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
    """Callbacks file what comes in; ``spin`` looks."""

    def __init__(self):
        p = node.parameters(PairCheckParameters)
        self._rests = 1.0 / p.most_share - 1.0  # times as long as it looked
        self._pairs = pair_check.PairsToLookAt(p.vehicles, 0.9 / p.rate_hz)
        self._known = KnownFeatures()
        self._T_home_odom: Dict[str, np.ndarray] = {}
        self._changed = threading.Condition()
        self._health = Health("pair_check", {"pictures": 0.0})
        self._looks = rospy.Publisher("/pair_check", PairLook, queue_size=10)
        CapturedPictures(p.vehicles, self._health, self._on_picture, self._on_frames)

    def _on_frames(self, T_home_odom: Dict[str, np.ndarray]) -> None:
        with self._changed:
            self._T_home_odom = T_home_odom

    def _on_picture(self, picture: LivePicture) -> None:
        with self._changed:
            self._pairs.add(picture)
            self._changed.notify()

    def spin(self) -> None:
        """Looks at what comes until ROS shuts the node down."""
        while not rospy.is_shutdown():
            started_s = time.monotonic()
            posed = self._next()
            if posed is not None:
                self._publish(*posed, pair_check.look(*posed, self._known))
                time.sleep(self._rests * (time.monotonic() - started_s))

    def _next(self) -> Optional[Tuple[Picture, Picture]]:
        with self._changed:
            pair = self._pairs.next_pair() if self._T_home_odom else None
            if pair is None:
                self._changed.wait(0.2)
                return None
            T_home_odom = self._T_home_odom
        unknown = [p.vehicle for p in pair if p.vehicle not in T_home_odom]
        if unknown:
            self._health.drop(
                "picture", f"where {unknown[0]} is in home is not known: calibrate, then set home"
            )
            return None
        try:
            a, b = (p.picture(T_home_odom[p.vehicle]) for p in pair)
        except FcsvError as error:
            self._health.drop("picture", str(error))
            return None
        return a, b

    def _publish(self, a: Picture, b: Picture, seen: pair_check.PairLook) -> None:
        said = f"the pictures of {a.vehicle} and {b.vehicle} show another place than their trackers"
        self._health.problem(f"pair {b.vehicle}", said if seen.off else "")
        header = conversions.header(b.stamp_s, "")
        figures = (seen.matches, seen.agree, seen.off_m, seen.surprise, seen.off)
        self._looks.publish(PairLook(header, a.vehicle, b.vehicle, *figures))


def main() -> int:
    """Run the node."""
    return node.run("pair_check", PairCheckNode)
