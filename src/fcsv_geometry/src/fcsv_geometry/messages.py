# SPDX-License-Identifier: Apache-2.0
"""What messages say, as arrays: messages of ROS 1 and of bags read without ROS alike. No ROS is
needed."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.intrinsics import camera_of_matrix


def seconds(stamp) -> float:
    """A time of ROS 1 (secs, nsecs) or of ROS 2 (sec, nanosec) in seconds."""
    return stamp.to_sec() if hasattr(stamp, "to_sec") else stamp.sec + stamp.nanosec / 1e9


def pose_to_transform(pose) -> np.ndarray:
    """T from geometry_msgs/Pose. Raises GeometryError on NaN or a quaternion that is not one."""
    p, q = pose.position, pose.orientation
    return transforms.from_xyz_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def transform_from_msg(message) -> np.ndarray:
    """T from geometry_msgs/Transform. Raises GeometryError like pose_to_transform."""
    p, q = message.translation, message.rotation
    return transforms.from_xyz_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def camera_from_info(info) -> PinholeCamera:
    """Intrinsics from sensor_msgs/CameraInfo. Raises GeometryError where they are none
    (``intrinsics``)."""
    K, D = (info_field(info, name) for name in "KD")
    return camera_of_matrix(info.width, info.height, K, D, info.distortion_model)


def info_field(info, name: str):
    """D, K, R or P of camera_info; ROS 2 writes them in lower case."""
    return getattr(info, name) if hasattr(info, name) else getattr(info, name.lower())
