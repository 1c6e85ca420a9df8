# SPDX-License-Identifier: Apache-2.0
"""Where the vehicles go: camera places in home, body set-points in each vehicle's odometry."""

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.mission import StereoConfiguration

#: T_home_cam of the reference: position zero, level, looking along home's x.
T_HOME_CAM_AT_HOME = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def camera_place(configuration: StereoConfiguration) -> np.ndarray:
    """T_home_cam of the moving camera: right of the reference (horizontal) or above it (vertical); of a sweep where it
    begins.

    >>> from fcsv_geometry.mission import StereoConfiguration
    >>> camera_place(StereoConfiguration("horizontal", 4.0))[:3, 3].tolist()
    [0.0, -4.0, 0.0]
    >>> camera_place(StereoConfiguration("vertical", 5.0))[:3, 3].tolist()
    [0.0, 0.0, 5.0]
    """
    if configuration.sweep is not None:
        return sweep_place(configuration, 0.0)
    b = configuration.baseline_m
    p = [0.0, -b, 0.0] if configuration.axis == "horizontal" else [0.0, 0.0, b]
    return transforms.from_xyz_yaw(p, configuration.tilt_rad) @ T_HOME_CAM_AT_HOME


def sweep_place(configuration: StereoConfiguration, share: float) -> np.ndarray:
    """T_home_cam of the moving camera after a share 0..1 of a configuration's sweep."""
    place_m = configuration.sweep.place_m(share)
    return transforms.from_xyz_yaw(place_m, configuration.tilt_rad) @ T_HOME_CAM_AT_HOME


def last_place(configuration: StereoConfiguration) -> np.ndarray:
    """T_home_cam of the moving camera when the configuration is done."""
    return camera_place(configuration) if configuration.sweep is None else sweep_place(configuration, 1.0)


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


def body_set_point(T_home_cam: np.ndarray, T_home_odom: np.ndarray, T_body_cam: np.ndarray) -> np.ndarray:
    """T_odom_body, level, that brings a camera to its place.

    T_odom_body = inv(T_home_odom) T_home_cam inv(T_body_cam) with roll and pitch removed: a hovering body is level.
    The camera then stands where it should only if it is mounted level too; what a mount's roll and pitch would turn
    is left, what its lever arm would shift is put right.
    """
    T_odom_cam = transforms.invert(T_home_odom) @ T_home_cam
    T_odom_body = transforms.level(T_odom_cam @ transforms.invert(T_body_cam))
    T_odom_body[:3, 3] += T_odom_cam[:3, 3] - (T_odom_body @ T_body_cam)[:3, 3]
    return T_odom_body
