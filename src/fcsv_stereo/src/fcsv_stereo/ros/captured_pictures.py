# SPDX-License-Identifier: Apache-2.0
"""What a map or a check in flight is made of, as it comes over the link: pictures with poses,
calibration and home."""

from typing import Callable, Sequence

import rospy

from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions, telemetry_messages
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import Calibration, CapturedPicture, Home
from fcsv_stereo.model import LivePicture


def subscribe_pictures(
    vehicles: Sequence[str], receive: Callable[[object], None], health: Health
) -> None:
    """Subscribes; ``receive`` gets each LivePicture, CalibrationFound and HomeFound, from ROS's
    threads. What is wrong is dropped, and said by ``health``."""

    def listen(topic, kind, take, what, **sizes):
        def came(message) -> None:
            try:
                data = take(message)
            except FcsvError as error:
                health.drop(what, str(error))
                return
            if isinstance(data, LivePicture):
                health.tick("pictures")
            receive(data)

        rospy.Subscriber(topic, kind, came, **sizes)

    known = "calibration or home"
    listen("/calibration", Calibration, telemetry_messages.calibration_of, known, queue_size=1)
    listen("/home", Home, telemetry_messages.home_of, known, queue_size=1)
    for name in vehicles:
        take = lambda m, name=name: picture_of(name, m)  # noqa: E731
        sizes = {"queue_size": 20, "buff_size": 8 << 20}
        listen(f"/{name}/capture/picture", CapturedPicture, take, "picture", **sizes)


def picture_of(name: str, m: CapturedPicture) -> LivePicture:
    """Raises FcsvError where it is another vehicle's, or camera or pose are none."""
    if m.vehicle != name:
        raise GeometryError(f"{name} sends pictures of '{m.vehicle}'")
    camera = conversions.camera_from_info(m.camera)
    T_odom_cam = conversions.pose_to_transform(m.camera_in_odom)
    return LivePicture(name, m.header.stamp.to_sec(), m.data, camera, T_odom_cam)
