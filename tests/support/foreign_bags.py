# SPDX-License-Identifier: Apache-2.0
"""Bags as other robots record them: a camera that moves, with its poses in every form, and known
truth."""

import cv2
import genpy
import numpy as np
import rosbag
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage

from fcsv_geometry import transforms
from support.scenes import CAMERA

START_S, PICTURES, POSES = 1000.0, 21, 121
SMALL = CAMERA.resized(64, 48)
T_BASE_LINK = transforms.from_xyz_rpy([0.3, 0.1, 0.2], [0.0, 0.2, 0.1])  # base_link to camera_link
T_LINK_OPTICAL = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
T_BASE_OPTICAL = T_BASE_LINK @ T_LINK_OPTICAL
T_MAP_ODOM = transforms.from_xyz_rpy([5.0, -3.0, 1.0], [0.0, 0.0, 0.7])
COVARIANCE = np.diag([0.02**2, 0.03**2, 0.04**2, 0.002**2, 0.003**2, 0.004**2])


def T_odom_base(stamp_s):
    """Sideways by 1 m/s while it turns by 0.1 rad/s about its own origin: linear and slerp are
    exact."""
    t = stamp_s - START_S
    T = transforms.from_xyz_rpy([0, 0, 0], [0.0, 0.0, 0.1 * (t - 1.0)])
    T[:3, 3] = [0.0, t, 0.2 * t]
    return T


def fill(message, T):
    """position/orientation or translation/rotation of a message."""
    p, q = (
        ("position", "orientation") if hasattr(message, "position") else ("translation", "rotation")
    )
    for name, value in zip("xyz", T[:3, 3]):
        setattr(getattr(message, p), name, value)
    for name, value in zip("xyzw", transforms.quaternion_xyzw(T)):
        setattr(getattr(message, q), name, value)
    return message


def header(message, stamp_s, frame):
    message.header.stamp, message.header.frame_id = genpy.Time.from_sec(stamp_s), frame
    return message


def odometry(stamp_s, T, covariance=COVARIANCE):
    message = header(Odometry(child_frame_id="base_link"), stamp_s, "odom")
    fill(message.pose.pose, T)
    message.pose.covariance = np.asarray(covariance).ravel().tolist()
    return message


def pose(stamp_s, T, frame="odom"):
    message = header(PoseStamped(), stamp_s, frame)
    fill(message.pose, T)
    return message


def transform(stamp_s, parent, child, T):
    message = header(TransformStamped(child_frame_id=child), stamp_s, parent)
    fill(message.transform, T)
    return message


def info(stamp_s, camera=SMALL, frame="camera_optical_frame"):
    message = header(CameraInfo(width=camera.width, height=camera.height), stamp_s, frame)
    message.distortion_model, message.D = "plumb_bob", list(camera.distortion)
    message.K, message.R = camera.K.ravel().tolist(), np.eye(3).ravel().tolist()
    message.P = np.hstack([camera.K, np.zeros((3, 1))]).ravel().tolist()
    return message


def image(stamp_s, rgb, frame="camera_optical_frame"):
    message = Image(height=rgb.shape[0], width=rgb.shape[1], encoding="rgb8", step=3 * rgb.shape[1])
    message.data = np.ascontiguousarray(rgb).tobytes()
    return header(message, stamp_s, frame)


def compressed(stamp_s, rgb, frame="camera_optical_frame"):
    data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()
    return header(CompressedImage(format="png", data=data), stamp_s, frame)


def picture_at(number):
    """Another one for each number: its first pixel tells it."""
    rgb = np.random.default_rng(7).integers(0, 255, (SMALL.height, SMALL.width, 3)).astype(np.uint8)
    rgb[0, 0] = number
    return rgb


def picture_stamps():
    return [START_S + 0.1 * i for i in range(PICTURES)]


def pose_stamps():
    """Between those of the pictures."""
    return [START_S - 0.203 + 0.02 * i for i in range(POSES)]


def messages():
    """(topic, message, stamp) of a walk: poses by Odometry, PoseStamped, PoseWithCovarianceStamped,
    tf."""
    found = []
    for k, s in enumerate(picture_stamps()):
        found += [("/cam/image_raw", image(s, picture_at(k)), s), ("/cam/camera_info", info(s), s)]
        found.append(("/jpg/image_raw/compressed", compressed(s, picture_at(k)), s))
        found.append(("/jpg/camera_info", info(s), s))
    for s in pose_stamps():
        T = T_odom_base(s)
        found += [("/odom", odometry(s, T), s), ("/pose", pose(s, T), s)]
        found.append(("/vicon", transform(s, "odom", "base_link", T), s))
        with_covariance = header(PoseWithCovarianceStamped(), s, "odom")
        fill(with_covariance.pose.pose, T)
        with_covariance.pose.covariance = COVARIANCE.ravel().tolist()
        found.append(("/pose_cov", with_covariance, s))
        moving = [transform(s, "odom", "base_link", T), transform(s, "map", "odom", T_MAP_ODOM)]
        found.append(("/tf", TFMessage(moving), s))
    mounts = [
        transform(START_S, "base_link", "camera_link", T_BASE_LINK),
        transform(START_S, "camera_link", "camera_optical_frame", T_LINK_OPTICAL),
    ]
    return [("/tf_static", TFMessage(mounts), START_S - 1.0), *found]


def write(path, entries, lag_s=None):
    """A bag of ROS 1; ``lag_s``: by topic how long after its stamp a message is recorded."""
    with rosbag.Bag(str(path), "w") as bag:
        for topic, message, stamp_s in sorted(entries, key=lambda e: e[2]):
            bag.write(topic, message, genpy.Time.from_sec(stamp_s + (lag_s or {}).get(topic, 0.01)))
    return path


def write_tum(path, T_world_body=T_odom_base, stamps=None):
    lines = ["# stamp x y z qx qy qz qw"]
    for s in pose_stamps() if stamps is None else stamps:
        T = T_world_body(s)
        lines.append(" ".join(f"{v:.9f}" for v in (s, *T[:3, 3], *transforms.quaternion_xyzw(T))))
    path.write_text("\n".join(lines) + "\n")
    return path
