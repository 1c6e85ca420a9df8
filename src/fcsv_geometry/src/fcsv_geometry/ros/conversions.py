# SPDX-License-Identifier: Apache-2.0
"""Messages to arrays and back, with fcsv_geometry.messages, which needs no ROS: the only places
where it is done."""

import math
from functools import lru_cache
from typing import Dict

import numpy as np
import rospy
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from sensor_msgs.msg import BatteryState, CameraInfo, Image
from std_msgs.msg import Header

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.intrinsics import model_of
from fcsv_geometry.messages import camera_from_info, pose_to_transform, transform_from_msg
from fcsv_msgs.msg import Epochs

__all__ = [
    "array_to_image",
    "battery_share",
    "camera_from_info",
    "header",
    "image_to_array",
    "info_from_camera",
    "pose_stamped",
    "pose_to_transform",
    "transform_from_msg",
    "transform_stamped",
    "transform_to_pose",
]


@lru_cache(maxsize=1)
def _bridge():
    """Imported with OpenCV when first used: who flies takes no pictures, and waits for no
    import."""
    from cv_bridge import CvBridge

    return CvBridge()


def header(stamp_s: float, frame_id: str) -> Header:
    return Header(stamp=rospy.Time.from_sec(stamp_s), frame_id=frame_id)


def transform_to_pose(T_a_b: np.ndarray) -> Pose:
    return Pose(Point(*T_a_b[:3, 3]), Quaternion(*transforms.fast_quaternion_xyzw(T_a_b)))


def pose_stamped(T_a_b: np.ndarray, stamp_s: float, frame_a: str) -> PoseStamped:
    return PoseStamped(header(stamp_s, frame_a), transform_to_pose(T_a_b))


def transform_stamped(
    T_a_b: np.ndarray, stamp_s: float, frame_a: str, frame_b: str
) -> TransformStamped:
    q = Quaternion(*transforms.fast_quaternion_xyzw(T_a_b))
    return TransformStamped(header(stamp_s, frame_a), frame_b, Transform(Vector3(*T_a_b[:3, 3]), q))


def info_from_camera(camera: PinholeCamera, stamp_s: float, frame_id: str) -> CameraInfo:
    info = CameraInfo(header=header(stamp_s, frame_id), height=camera.height, width=camera.width)
    info.distortion_model, info.D = model_of(camera.distortion), list(camera.distortion)
    info.K = camera.K.ravel().tolist()
    info.R = np.eye(3).ravel().tolist()
    info.P = np.hstack([camera.K, np.zeros((3, 1))]).ravel().tolist()
    return info


def epochs_of(message: Epochs) -> Dict[str, int]:
    """Gives the epochs by vehicle."""
    return dict(zip(message.vehicles, message.epochs))


def battery_share(message: BatteryState) -> float:
    """Share of the charge that is left, 0..1; NaN: not known, which MAVROS says with a negative
    number."""
    return message.percentage if message.percentage >= 0.0 else math.nan


def image_to_array(message: Image, encoding: str = "passthrough") -> np.ndarray:
    """Picture as an array in ``encoding`` ("bgr8", "mono8", "passthrough"). Raises GeometryError
    where it cannot."""
    expected = message.step * message.height
    if len(message.data) != expected or message.step < message.width:
        raise GeometryError(
            f"image has {len(message.data)} bytes where height x step is {expected}"
        )
    from cv_bridge import CvBridgeError

    try:
        return _bridge().imgmsg_to_cv2(message, encoding)
    except (CvBridgeError, KeyError, TypeError, ValueError) as error:
        raise GeometryError(
            f"image encoding '{message.encoding}' cannot be read as {encoding}: {error}"
        ) from error


def array_to_image(image: np.ndarray, encoding: str, stamp_s: float, frame_id: str) -> Image:
    return _bridge().cv2_to_imgmsg(image, encoding, header(stamp_s, frame_id))
