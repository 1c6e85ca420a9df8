# SPDX-License-Identifier: Apache-2.0
"""Pictures with their poses for the map in flight, of a vehicle whose tracker stands on the ground;
on board of others the node of tags sends them."""

import queue
from dataclasses import dataclass, field
from typing import Optional

import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_tracking.ros.body_odometry import BodyAtStamp
from fcsv_tracking.ros.picture_sender import PictureSender, SendingParameters

_WAITING = 20  # pictures
#: As many pictures as come.
_SENDING = SendingParameters(preview_rate_hz=0.0, capture_rate_hz=30.0)


@dataclass(frozen=True)
class GroundPicturesParameters:
    """Parameters of the node. ``gap_s``: longest silence of the tracker that is bridged; gimbals on
    a slow machine see their vehicles a few times a second. ``wait_s``: for its poses."""

    vehicle: str
    vehicles_dir: str
    gap_s: float = 0.6
    wait_s: float = 1.0
    sending: SendingParameters = field(default_factory=lambda: _SENDING)

    def __post_init__(self):
        for name in ("gap_s", "wait_s"):
            if not 0.0 < getattr(self, name) <= 5.0:
                raise ValueError(f"{name}: {getattr(self, name)} is not in (0, 5]")


class GroundPicturesNode:
    """camera/color, odometry/body -> capture/picture, while the recorder takes pictures."""

    def __init__(self):
        p = node.parameters(GroundPicturesParameters)
        self._T_body_cam = node.vehicles(p.vehicles_dir, [p.vehicle])[p.vehicle].T_body_cam
        self._health = Health(p.vehicle, {"pictures": 0.0})
        self._sender = PictureSender(p.vehicle, p.sending, self._health)
        self._track = BodyAtStamp(p.vehicle, self._health, p.gap_s, p.wait_s)
        self._info: Optional[CameraInfo] = None
        self._pictures: queue.Queue[Image] = queue.Queue(_WAITING)
        rospy.Subscriber("camera/color/camera_info", CameraInfo, self._on_info, queue_size=1)
        rospy.Subscriber(
            "camera/color/image_raw", Image, self._on_picture, queue_size=5, buff_size=8 << 20
        )

    def _on_info(self, message: CameraInfo) -> None:
        self._info = message

    def _on_picture(self, message: Image) -> None:
        if self._info is None or not self._sender.wants_capture(message):
            return
        try:
            self._pictures.put_nowait(message)
        except queue.Full:
            self._health.drop("picture for the map", "poses come too slowly")

    def spin(self) -> None:
        """Sends one picture after the other until ROS shuts the node down."""
        while not rospy.is_shutdown():
            try:
                message = self._pictures.get(timeout=0.2)
            except queue.Empty:
                continue
            try:
                T_odom_cam = self._track.at(message.header.stamp.to_sec()) @ self._T_body_cam
                picture = conversions.image_to_array(message, "bgr8")
            except FcsvError as error:
                self._health.drop("picture for the map", str(error))
                continue
            self._sender.capture(message, picture, self._info, T_odom_cam)
            self._health.tick("pictures")


def main() -> int:
    """Run the node."""
    return node.run("ground_pictures", GroundPicturesNode)
