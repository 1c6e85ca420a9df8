# SPDX-License-Identifier: Apache-2.0
"""How well trackers know where cameras are, as they tell it."""

from typing import Callable, Sequence

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros.health import Health
from fcsv_stereo.sessions.messages import camera_covariance


def subscribe_covariances(
    vehicles: Sequence[str], receive: Callable[[str, float, np.ndarray], None], health: Health
) -> None:
    """Calls ``receive`` with a vehicle's name, stamp (s) and covariance (6,6) of each camera_pose;
    those that are none are dropped and counted."""

    def on_pose(message: PoseWithCovarianceStamped, name: str) -> None:
        try:
            stamp_s, covariance = camera_covariance(message, name)
        except FcsvError as error:
            health.drop("camera_pose", str(error))
            return
        receive(name, stamp_s, covariance)

    for name in vehicles:
        topic = f"/{name}/camera_pose"
        rospy.Subscriber(topic, PoseWithCovarianceStamped, on_pose, name, queue_size=20)
