# SPDX-License-Identifier: Apache-2.0
"""A Tello's pictures on the topics that a camera on board has, stamped with when they were
taken."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable

import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_control.tello.key_pictures import KeyPictures
from fcsv_control.tello.video import Video
from fcsv_geometry import frames
from fcsv_geometry.camera_file import read_camera
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.streams.silence import Silence, in_steps


@dataclass(frozen=True)
class VideoParameters:
    """``calibration``: file of ``calibrate_camera``; pictures are published where it is given.

    ``delay_s``: from the exposure to the first packet. A Tello tells no time, and this is a guess:
    measure yours. ``silent_s``: without a picture for longer is said in diagnostics.
    """

    calibration: str = ""
    delay_s: float = 0.1
    silent_s: float = 1.0

    def __post_init__(self):
        if not 0.0 <= self.delay_s < 2.0:
            raise ValueError(f"delay_s: {self.delay_s} must be 0 to 2")
        if not 0.0 < self.silent_s <= 60.0:
            raise ValueError(f"silent_s: {self.silent_s} must be above 0 and at most 60")


class TelloVideo:
    """``datagram`` in tellopy's thread, which decodes; ``report`` once a second. ``ask`` is called
    where a key picture is needed at once. Raises ConfigError where the calibration cannot be
    read."""

    def __init__(
        self, name: str, parameters: VideoParameters, health: Health, ask: Callable[[], None]
    ):
        self._name, self._delay_s, self._health = name, parameters.delay_s, health
        self._frame, self._video = frames.camera_optical(name), Video()
        self._keys, self._silence, self._ask = KeyPictures(), Silence(parameters.silent_s), ask
        self._silence.want(time.monotonic())
        self._camera, self._wrong_size = read_camera(Path(parameters.calibration))[1], ""
        self._pictures = rospy.Publisher("camera/color/image_raw", Image, queue_size=2)
        self._infos = rospy.Publisher("camera/color/camera_info", CameraInfo, queue_size=2)

    def datagram(self, now_s: float, data: bytes) -> None:
        """A picture goes out with its last packet."""
        picture = self._video.add(now_s, data)
        if self._keys.due(now_s, self._video.broken):
            self._ask()
        if picture is None:
            return
        self._silence.came(now_s)
        height, width = picture.rgb.shape[:2]
        expected = self._camera.width, self._camera.height
        if (width, height) != expected:
            self._wrong_size = f"{self._name}: pictures of {width} x {height}, calibrated {expected[0]} x {expected[1]}"
            return
        self._wrong_size = ""
        age_s = time.monotonic() - picture.arrived_s + self._delay_s
        stamp_s = rospy.get_time() - age_s
        self._infos.publish(conversions.info_from_camera(self._camera, stamp_s, self._frame))
        self._pictures.publish(
            conversions.array_to_image(picture.rgb, "rgb8", stamp_s, self._frame)
        )
        self._health.tick("pictures")

    def report(self, now_s: float) -> None:
        """What was not shown, and for how long nothing was, for diagnostics."""
        lasts_s = in_steps(self._silence.lasts_s(now_s))
        gone = f"{self._name}: no picture for {lasts_s} s; look at its Wi-Fi" if lasts_s else ""
        self._health.problem("no picture", gone)
        self._health.value("key pictures asked for at once", self._keys.asked)
        self._health.value("times without a picture", self._silence.times)
        self._health.value("longest without a picture (s)", f"{self._silence.worst_s:.1f}")
        self._health.problem("picture size", self._wrong_size)
        for why, count in self._video.dropped.copy().items():
            self._health.value(why, count)
