# SPDX-License-Identifier: Apache-2.0
"""Live and recorded pictures and cameras' places to the epipolar error, once a second, by a thread
of its own."""

import threading
from typing import Callable, List, Sequence, Tuple

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, CompressedImage

from fcsv_console.model import facts as f
from fcsv_console.model.epipolar import EpipolarWatch
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import CapturedPicture

_PERIOD_S = 1.0


class EpipolarHearing:
    """``pair`` (reference, moving) is set by who knows it; ``put`` is told what was measured."""

    def __init__(self, vehicles: Sequence[str], put: Callable[[f.Fact], None]):
        self.pair: Tuple[str, str] = ("", "")
        self._vehicles, self._put, self._watch = list(vehicles), put, EpipolarWatch(vehicles)
        self._subscribers: List[rospy.Subscriber] = []
        self._over = threading.Event()

    def subscribe(self) -> None:
        """Once rospy knows its master."""
        for name in self._vehicles:
            for topic, kind, heard in (
                ("camera_pose", PoseWithCovarianceStamped, self._on_pose),
                ("camera/color/camera_info", CameraInfo, self._on_camera),
                ("camera/color/image_raw/compressed", CompressedImage, self._on_live),
                ("capture/picture", CapturedPicture, self._on_picture),
            ):
                self._subscribers.append(
                    rospy.Subscriber(f"/{name}/{topic}", kind, heard, name, queue_size=20)
                )
        threading.Thread(target=self._measure, name="epipolar error", daemon=True).start()

    def _on_pose(self, m: PoseWithCovarianceStamped, name: str) -> None:
        try:
            T_home_cam = conversions.pose_to_transform(m.pose.pose)
        except FcsvError:
            return  # Hearing tells of it
        self._watch.tell_pose(name, m.header.stamp.to_sec(), T_home_cam)

    def _on_picture(self, m: CapturedPicture, name: str) -> None:
        try:
            camera = conversions.camera_from_info(m.camera)
        except FcsvError as error:
            self._put(f.Unusable(name, "capture/picture", str(error)))
            return
        self._watch.tell_picture(name, m.header.stamp.to_sec(), bytes(m.data), camera)

    def _on_camera(self, m: CameraInfo, name: str) -> None:
        try:
            camera = conversions.camera_from_info(m)
        except FcsvError as error:
            self._put(f.Unusable(name, "camera/color/camera_info", str(error)))
            return
        self._watch.tell_camera(name, camera)
        self._put(f.CameraKnown(name, camera.width, camera.height, camera.fx, camera.fy))

    def _on_live(self, m: CompressedImage, name: str) -> None:
        self._watch.tell_live(name, m.header.stamp.to_sec(), bytes(m.data))

    def _measure(self) -> None:
        while not self._over.wait(_PERIOD_S):
            pair = self.pair
            try:
                told = self._watch.measure(pair)
            except ValueError as error:
                self._put(f.Unusable(pair[1], "pictures of the pair", str(error)))
                continue
            if told is not None:
                self._put(told)

    def close(self) -> None:
        """End the thread and the subscriptions."""
        self._over.set()
        for subscriber in self._subscribers:
            subscriber.unregister()
