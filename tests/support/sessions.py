# SPDX-License-Identifier: Apache-2.0
"""A small session of two vehicles as bags, whole or with something missing."""

from dataclasses import dataclass
from typing import Callable

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Calibration, CalibrationLink, Capture, Configuration, Home
from fcsv_stereo.sessions.depth import DEPTH, DEPTH_INFO
from support.scenes import CAMERA, camera_pose, photograph

T0 = 1000.0
T_BODY_CAM = transforms.from_xyz_rpy([0.1, 0.0, 0.02], [0, 0, 0]) @ transforms.transform(
    transforms.R_FLU_OPTICAL, np.zeros(3)
)
T_O1_HOME = transforms.from_xyz_yaw([2.0, -1.0, 5.0], 0.6)
T_O1_O2 = transforms.from_xyz_yaw([-3.0, 4.0, 0.5], -1.1)
T_HOME_CAM = {
    "uav1": camera_pose([0, 0, 0], (0.2, 0.1, -0.3)),
    "uav2": camera_pose([0, -0.8, 0], (-0.2, 0.2, 0.3)),
}


@dataclass(frozen=True)
class Moving:
    """Vehicles that move: T_home_cam of one at a time after T0, pictures ``hz`` times a second for
    so long, and by how much its tracker's stamps are late against its camera's."""

    pose: Callable[[str, float], np.ndarray]
    seconds: float
    hz: float
    tracker_late_s: float = 0.0


def odom_home(vehicle):
    return T_O1_HOME if vehicle == "uav1" else transforms.invert(T_O1_O2) @ T_O1_HOME


def odom_cam(vehicle):
    return odom_home(vehicle) @ T_HOME_CAM[vehicle]


def write_session(
    folder,
    drop=(),
    encoding="rgb8",
    window=(T0, T0 + 1.0),
    stamp_offset_s=0.0,
    encode=None,
    windows=None,
    covariance=None,
    odometry_s=0.05,
    moving=None,
    depth=None,
    heard=None,
):
    """A session of one configuration, or of as many as ``windows`` (start_s, stop_s, and where there
    are stations name and heading_rad); ``drop`` leaves topics out (by
    their end).

    ``odometry_s``: from one pose to the next.

    ``encode`` makes what a picture holds of its RGB; without it ``encoding`` is only what it says.
    ``depth`` gives the depth (H,W uint16 mm) that a camera at T_home_cam sees: both vehicles then
    record it once a second. ``heard``: what of the control PC's words a vehicle records too, its
    windows by vehicle.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for vehicle in T_HOME_CAM:
        with rosbag.Bag(str(folder / f"{vehicle}.bag"), "w") as bag:
            if moving is None:
                write_vehicle(bag, vehicle, drop, encoding, stamp_offset_s, encode, odometry_s)
            else:
                write_moving(bag, vehicle, moving)
            if depth is not None:
                write_depth(bag, vehicle, depth(T_HOME_CAM[vehicle]), drop)
            if heard is not None and vehicle in heard:
                write_control(bag, (), heard[vehicle])
    with rosbag.Bag(str(folder / "control.bag"), "w") as bag:
        write_control(bag, drop, windows or [window])
        if covariance is not None:
            write_camera_poses(bag, drop, covariance)
    (folder / "session.yaml").write_text(
        "version: 1\nbags: {uav1: uav1.bag, uav2: uav2.bag, control: control.bag}\n"
    )
    return folder


def put(bag, topic, message, stamp_s, drop):
    if not any(topic.endswith(d) for d in drop):
        bag.write(topic, message, rospy.Time.from_sec(stamp_s))


def write_vehicle(bag, vehicle, drop, encoding, stamp_offset_s, encode, odometry_s=0.05):
    fixed = conversions.transform_stamped(
        T_BODY_CAM, T0, frames.base_link(vehicle), frames.camera_optical(vehicle)
    )
    put(bag, "/tf_static", TFMessage([fixed]), T0, drop)
    T_odom_body = odom_cam(vehicle) @ transforms.invert(T_BODY_CAM)
    for t in np.arange(T0 - 0.5, T0 + 2.5, odometry_s):
        odometry = Odometry(header=conversions.header(t, frames.odom(vehicle)))
        odometry.pose = PoseWithCovariance(pose=conversions.transform_to_pose(T_odom_body))
        put(bag, f"/{vehicle}/odometry/body", odometry, t, drop)
    picture = photograph(T_HOME_CAM[vehicle])
    for i in range(4):
        t = T0 + 0.1 + 0.25 * i + stamp_offset_s
        frame_id = f"{vehicle}/camera_color_optical_frame"
        if encode is None:
            image = conversions.array_to_image(picture, "rgb8", t, frame_id)
            image.encoding = encoding
        else:
            image = conversions.array_to_image(encode(picture), encoding, t, frame_id)
        put(bag, f"/{vehicle}/camera/color/image_raw", image, t, drop)
        info = conversions.info_from_camera(CAMERA, t, image.header.frame_id)
        put(bag, f"/{vehicle}/camera/color/camera_info", info, t, drop)


def write_moving(bag, vehicle, moving):
    """All that ``write_vehicle`` writes, of a vehicle that moves."""
    fixed = conversions.transform_stamped(
        T_BODY_CAM, T0, frames.base_link(vehicle), frames.camera_optical(vehicle)
    )
    put(bag, "/tf_static", TFMessage([fixed]), T0, ())
    for t in np.arange(-0.3, moving.seconds + 0.3, 0.005).tolist():
        stamp_s = T0 + t + moving.tracker_late_s
        odometry = Odometry(header=conversions.header(stamp_s, frames.odom(vehicle)))
        T_odom_body = odom_home(vehicle) @ moving.pose(vehicle, t) @ transforms.invert(T_BODY_CAM)
        odometry.pose = PoseWithCovariance(pose=conversions.transform_to_pose(T_odom_body))
        put(bag, f"/{vehicle}/odometry/body", odometry, stamp_s, ())
    for t in np.arange(0.0, moving.seconds, 1.0 / moving.hz).tolist():
        frame_id = f"{vehicle}/camera_color_optical_frame"
        picture = photograph(moving.pose(vehicle, t))
        image = conversions.array_to_image(picture, "rgb8", T0 + t, frame_id)
        put(bag, f"/{vehicle}/camera/color/image_raw", image, T0 + t, ())
        info = conversions.info_from_camera(CAMERA, T0 + t, frame_id)
        put(bag, f"/{vehicle}/camera/color/camera_info", info, T0 + t, ())


def write_depth(bag, vehicle, millimetres, drop):
    """Six frames as realsense2_camera aligns them with the colour camera, one a second; the last
    has no odometry."""
    for i in range(6):
        t = T0 - 0.4 + 1.0 * i
        frame_id = f"{vehicle}/camera_color_optical_frame"
        encoding = "16UC1" if millimetres.dtype == np.uint16 else "32FC1"
        image = conversions.array_to_image(millimetres, encoding, t, frame_id)
        put(bag, f"/{vehicle}/{DEPTH}", image, t, drop)
        put(
            bag,
            f"/{vehicle}/{DEPTH_INFO}",
            conversions.info_from_camera(CAMERA, t, frame_id),
            t,
            drop,
        )


def write_camera_poses(bag, drop, covariance):
    """Poses of both cameras at 15 Hz, whose covariance grows from ``covariance`` (6, 6) on."""
    for i in range(40):
        t = T0 - 0.5 + i / 15.0
        for vehicle, T_home_cam in T_HOME_CAM.items():
            message = PoseWithCovarianceStamped(header=conversions.header(t, frames.HOME))
            message.pose.pose = conversions.transform_to_pose(T_home_cam)
            message.pose.covariance = (covariance * (1 + i)).ravel().tolist()
            put(bag, f"/{vehicle}/camera_pose", message, t, drop)


def write_control(bag, drop, windows, stamp_s=T0):
    link = CalibrationLink(
        parent="uav1",
        child="uav2",
        child_odom_in_parent_odom=conversions.transform_to_pose(T_O1_O2),
    )
    put(
        bag,
        "/calibration",
        Calibration(conversions.header(stamp_s, "uav1/odom"), [link]),
        stamp_s,
        drop,
    )
    home = Home(
        conversions.header(stamp_s, "uav1/odom"), "uav1", conversions.transform_to_pose(T_O1_HOME)
    )
    put(bag, "/home", home, stamp_s, drop)
    for index, window in enumerate(windows):
        capture = Capture(
            header=conversions.header(stamp_s, ""), index=index, reference="uav1", vehicle="uav2"
        )
        name = f"horizontal 0.8 m{f' ({index})' if index else ''}"
        capture.configuration = Configuration(name, Configuration.HORIZONTAL, 0.8, 0.0, 1.0)
        capture.start, capture.stop = (rospy.Time.from_sec(t) for t in window[:2])
        if len(window) > 2:
            capture.station, capture.heading_rad = window[2:]
        put(bag, "/mission/capture", capture, stamp_s, drop)
