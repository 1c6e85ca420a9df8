# SPDX-License-Identifier: Apache-2.0
"""A vehicle's odometry as it comes, and its body's pose at a picture's stamp."""

import threading
import time

import numpy as np
import rospy
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import TrackingError

_KEPT_S = 3.0


class BodyAtStamp:
    """odometry/body of ``vehicle``. ``gap_s``: longest silence that is bridged; odometry that is
    still under way is waited for ``wait_s``."""

    def __init__(self, vehicle: str, health: Health, gap_s: float, wait_s: float):
        self._expected = frames.odom(vehicle), frames.base_link(vehicle)
        self._health, self._wait_s = health, wait_s
        self._track = Trajectory(gap_s=gap_s, keep_s=_KEPT_S)
        self._grew = threading.Condition()
        rospy.Subscriber(
            "odometry/body", Odometry, self._on_odometry, queue_size=50, tcp_nodelay=True
        )

    def _on_odometry(self, message: Odometry) -> None:
        got = message.header.frame_id, message.child_frame_id
        try:
            if got != self._expected:
                raise TrackingError(f"has frames {got[0]}, {got[1]}, not {self._expected}")
            T_odom_body = conversions.pose_to_transform(message.pose.pose)
        except FcsvError as error:
            self._health.drop("odometry", str(error))
            return
        with self._grew:
            newer = self._track.add(message.header.stamp.to_sec(), T_odom_body)
            self._grew.notify_all()
        if not newer:
            self._health.drop("odometry", "stamp goes back")

    def at(self, stamp_s: float) -> np.ndarray:
        """T_odom_body 4x4 at a stamp. Raises PoseUnavailable where no odometry came that is as new,
        or was silent then."""
        deadline = time.monotonic() + self._wait_s
        with self._grew:
            while len(self._track) == 0 or self._track.span_s[1] < stamp_s:
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    raise PoseUnavailable("no odometry at the picture's stamp")
                self._grew.wait(left_s)
            return self._track.at(stamp_s)
