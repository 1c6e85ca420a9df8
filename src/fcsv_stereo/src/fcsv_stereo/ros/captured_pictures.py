# SPDX-License-Identifier: Apache-2.0
"""What a map or a check in flight is made of, as it comes over the link: pictures with poses,
calibration and home."""

from typing import Callable, Dict, Sequence

import numpy as np
import rospy

from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles import home_messages
from fcsv_msgs.msg import Calibration, CapturedPicture, Home
from fcsv_stereo.model import LivePicture


class CapturedPictures:
    """Subscribes; ``on_picture`` is told each picture, ``on_frames`` T_home_odom by vehicle once it
    is known. What is wrong is dropped and said by ``health``. Callbacks come from ROS's threads."""

    def __init__(
        self,
        vehicles: Sequence[str],
        health: Health,
        on_picture: Callable[[LivePicture], None],
        on_frames: Callable[[Dict[str, np.ndarray]], None],
    ):
        self._health, self._on_picture, self._on_frames = health, on_picture, on_frames
        self._in_home = HomeFrames()
        rospy.Subscriber(
            "/calibration", Calibration, self._apply, home_messages.apply_calibration, queue_size=1
        )
        rospy.Subscriber("/home", Home, self._apply, home_messages.apply_home, queue_size=1)
        for name in vehicles:
            topic = f"/{name}/capture/picture"
            rospy.Subscriber(
                topic, CapturedPicture, self._captured, name, queue_size=20, buff_size=8 << 20
            )

    def _apply(self, message, apply) -> None:
        try:
            apply(self._in_home, message)
        except GeometryError as error:
            self._health.drop("calibration or home", str(error))
            return
        if self._in_home.places:
            self._on_frames(self._in_home.T_home_odom)

    def _captured(self, message: CapturedPicture, name: str) -> None:
        try:
            if message.vehicle != name:
                raise GeometryError(f"{name} sends pictures of '{message.vehicle}'")
            picture = LivePicture(
                name,
                message.header.stamp.to_sec(),
                message.data,
                conversions.camera_from_info(message.camera),
                conversions.pose_to_transform(message.camera_in_odom),
            )
        except FcsvError as error:
            self._health.drop("picture", str(error))
            return
        self._health.tick("pictures")
        self._on_picture(picture)
