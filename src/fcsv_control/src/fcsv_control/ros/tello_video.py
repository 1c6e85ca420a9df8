# SPDX-License-Identifier: Apache-2.0
"""A Tello's pictures on the topics that a camera on board has, stamped with when they were taken."""

import time
from dataclasses import dataclass
from pathlib import Path

import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_control.tello.video import Video
from fcsv_geometry import frames
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_tracking.cameras.camera_yaml import read_camera


@dataclass(frozen=True)
class VideoParameters:
    """``calibration``: file of ``calibrate_camera``; pictures are published where it is given.

    ``delay_s``: from the exposure to the first packet. A Tello tells no time, and this is a guess: measure yours.
    """

    calibration: str = ""
    delay_s: float = 0.1

    def __post_init__(self):
        if not 0.0 <= self.delay_s < 2.0:
            raise ValueError(f"delay_s: {self.delay_s} must be 0 to 2")


class TelloVideo:
    """``datagram`` in tellopy's thread, which decodes; ``report`` once a second. Raises ConfigError where the
    calibration cannot be read."""

    def __init__(self, name: str, parameters: VideoParameters, health: Health):
        self._name, self._delay_s, self._health = name, parameters.delay_s, health
        self._frame, self._video = frames.camera_optical(name), Video()
        self._camera, self._wrong_size = read_camera(Path(parameters.calibration))[1], ""
        self._pictures = rospy.Publisher("camera/color/image_raw", Image, queue_size=2)
        self._infos = rospy.Publisher("camera/color/camera_info", CameraInfo, queue_size=2)

    def datagram(self, now_s: float, data: bytes) -> None:
        """A picture goes out with its last packet."""
        picture = self._video.add(now_s, data)
        if picture is None:
            return
        height, width = picture.rgb.shape[:2]
        expected = self._camera.width, self._camera.height
        if (width, height) != expected:
            self._wrong_size = f"{self._name}: pictures of {width} x {height}, calibrated {expected[0]} x {expected[1]}"
            return
        self._wrong_size = ""
        age_s = time.monotonic() - picture.arrived_s + self._delay_s
        stamp_s = rospy.get_time() - age_s
        self._infos.publish(conversions.info_from_camera(self._camera, stamp_s, self._frame))
        self._pictures.publish(conversions.array_to_image(picture.rgb, "rgb8", stamp_s, self._frame))
        self._health.tick("pictures")

    def report(self) -> None:
        """What was not shown, for diagnostics."""
        self._health.problem("picture size", self._wrong_size)
        for why, count in self._video.dropped.copy().items():
            self._health.value(why, count)
