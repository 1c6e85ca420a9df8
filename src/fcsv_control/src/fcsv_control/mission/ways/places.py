# SPDX-License-Identifier: Apache-2.0
"""Where the vehicles go: level cameras, their headings, body set-points in each vehicle's
odometry."""

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME


def level_camera(T_home_cam: np.ndarray) -> np.ndarray:
    """T_home_cam with the camera level: same position, same heading of the view."""
    return transforms.from_xyz_yaw(T_home_cam[:3, 3], heading_rad(T_home_cam)) @ T_HOME_CAM_AT_HOME


def heading_rad(T_home_cam: np.ndarray) -> float:
    """Heading (rad, counter-clockwise from home's x) of the camera's view."""
    forward = T_home_cam[:3, 2]
    return float(np.arctan2(forward[1], forward[0]))


def heading_error_rad(T_home_cam: np.ndarray, T_home_target: np.ndarray) -> float:
    """Unsigned difference (rad) of two cameras' headings."""
    return abs(rotations.wrap(heading_rad(T_home_cam) - heading_rad(T_home_target)))


def body_set_point(
    T_home_cam: np.ndarray, T_home_odom: np.ndarray, T_body_cam: np.ndarray
) -> np.ndarray:
    """T_odom_body, level, that brings a camera to its place.

    T_odom_body = inv(T_home_odom) T_home_cam inv(T_body_cam) with roll and pitch removed: a
    hovering body is level. The camera then stands where it should only if it is mounted level too;
    what a mount's roll and pitch would turn is left, what its lever arm would shift is put right.
    """
    T_odom_cam = transforms.invert(T_home_odom) @ T_home_cam
    T_odom_body = transforms.level(T_odom_cam @ transforms.invert(T_body_cam))
    T_odom_body[:3, 3] += T_odom_cam[:3, 3] - (T_odom_body @ T_body_cam)[:3, 3]
    return T_odom_body
