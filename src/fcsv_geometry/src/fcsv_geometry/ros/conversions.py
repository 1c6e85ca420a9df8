# SPDX-License-Identifier: Apache-2.0
"""Messages to arrays and back: the only place where it is done."""

import math
from functools import lru_cache

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import BatteryState, CameraInfo, Image
from std_msgs.msg import Header

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError


@lru_cache(maxsize=1)
def _bridge():
    """Imported with OpenCV when first used: who flies takes no pictures, and waits for no import."""
    from cv_bridge import CvBridge

    return CvBridge()


def header(stamp_s: float, frame_id: str) -> Header:
    return Header(stamp=rospy.Time.from_sec(stamp_s), frame_id=frame_id)


def pose_to_transform(pose: Pose) -> np.ndarray:
    """T from geometry_msgs/Pose. Raises GeometryError on NaN or a quaternion that is not one."""
    p, q = pose.position, pose.orientation
    return transforms.from_xyz_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def transform_to_pose(T_a_b: np.ndarray) -> Pose:
    return Pose(Point(*T_a_b[:3, 3]), Quaternion(*transforms.fast_quaternion_xyzw(T_a_b)))


def pose_stamped(T_a_b: np.ndarray, stamp_s: float, frame_a: str) -> PoseStamped:
    return PoseStamped(header(stamp_s, frame_a), transform_to_pose(T_a_b))


def transform_stamped(T_a_b: np.ndarray, stamp_s: float, frame_a: str, frame_b: str) -> TransformStamped:
    q = Quaternion(*transforms.fast_quaternion_xyzw(T_a_b))
    return TransformStamped(header(stamp_s, frame_a), frame_b, Transform(Vector3(*T_a_b[:3, 3]), q))


def transform_from_msg(message: Transform) -> np.ndarray:
    """T from geometry_msgs/Transform. Raises GeometryError like pose_to_transform."""
    p, q = message.translation, message.rotation
    return transforms.from_xyz_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def camera_from_info(info: CameraInfo) -> PinholeCamera:
    """Intrinsics from sensor_msgs/CameraInfo. Raises GeometryError where it is not calibrated plumb_bob."""
    if info.distortion_model not in ("plumb_bob", "") or (not info.distortion_model and any(info.D)):
        raise GeometryError(f"camera_info has distortion model '{info.distortion_model}'; only plumb_bob is known")
    if info.K[0] == 0:
        raise GeometryError("camera_info is not calibrated (K is zero)")
    distortion = tuple(info.D) if info.D else (0.0,) * 5
    return PinholeCamera(info.width, info.height, info.K[0], info.K[4], info.K[2], info.K[5], distortion)


def info_from_camera(camera: PinholeCamera, stamp_s: float, frame_id: str) -> CameraInfo:
    info = CameraInfo(header=header(stamp_s, frame_id), height=camera.height, width=camera.width)
    info.distortion_model, info.D = "plumb_bob", list(camera.distortion)
    info.K = camera.K.ravel().tolist()
    info.R = np.eye(3).ravel().tolist()
    info.P = np.hstack([camera.K, np.zeros((3, 1))]).ravel().tolist()
    return info


def battery_share(message: BatteryState) -> float:
    """Share of the charge that is left, 0..1; NaN: not known, which MAVROS says with a negative number."""
    return message.percentage if message.percentage >= 0.0 else math.nan


def image_to_array(message: Image, encoding: str = "passthrough") -> np.ndarray:
    """Picture as an array in ``encoding`` ("bgr8", "mono8", "passthrough"). Raises GeometryError where it cannot."""
    expected = message.step * message.height
    if len(message.data) != expected or message.step < message.width:
        raise GeometryError(f"image has {len(message.data)} bytes where height x step is {expected}")
    from cv_bridge import CvBridgeError

    try:
        return _bridge().imgmsg_to_cv2(message, encoding)
    except (CvBridgeError, KeyError, TypeError, ValueError) as error:
        raise GeometryError(f"image encoding '{message.encoding}' cannot be read as {encoding}: {error}") from error


def array_to_image(image: np.ndarray, encoding: str, stamp_s: float, frame_id: str) -> Image:
    return _bridge().cv2_to_imgmsg(image, encoding, header(stamp_s, frame_id))
