# SPDX-License-Identifier: Apache-2.0
"""/set_home of a tracker on the ground: home is told on /home and tied to the tracker's own frame
on tf2."""

from typing import Callable, List, Sequence, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Home
from fcsv_msgs.srv import SetHome, SetHomeResponse
from fcsv_tracking.errors import HomeRefused


class HomeService:
    """``set_home(reference, now_s)`` gives T_odom_home of the reference and T_home_tracker, or
    raises FcsvError.

    ``fixed`` are the vehicles' own frames, sent from the start and again with home: of static
    transforms some tf2 broadcasters keep the last message only.
    """

    def __init__(
        self,
        names: Sequence[str],
        tracker_frame: str,
        fixed: List[TransformStamped],
        set_home: Callable[[str, float], Tuple[np.ndarray, np.ndarray]],
    ):
        self._names, self._tracker_frame, self._fixed, self._set_home = (
            list(names),
            tracker_frame,
            fixed,
            set_home,
        )
        self._static = tf2_ros.StaticTransformBroadcaster()
        self._static.sendTransform(fixed)
        self._home = rospy.Publisher("/home", Home, queue_size=1, latch=True)
        rospy.Service("/set_home", SetHome, self._on_set_home)

    def _on_set_home(self, request) -> SetHomeResponse:
        reference, now_s = request.reference or self._names[0], rospy.get_time()
        try:
            if reference not in self._names:
                raise HomeRefused(
                    f"'{reference}' is not a vehicle here; known: {', '.join(self._names)}"
                )
            T_odom_home, T_home_tracker = self._set_home(reference, now_s)
        except FcsvError as error:
            return SetHomeResponse(False, str(error), Home())
        pose = conversions.transform_to_pose(T_odom_home)
        home = Home(conversions.header(now_s, frames.odom(reference)), reference, pose)
        self._home.publish(home)
        tied = conversions.transform_stamped(
            T_home_tracker, now_s, frames.HOME, self._tracker_frame
        )
        self._static.sendTransform([*self._fixed, tied])
        text = f"home is where the camera of {reference} is now"
        rospy.loginfo("%s", text)
        return SetHomeResponse(True, text, home)
