# SPDX-License-Identifier: Apache-2.0
"""Where the vehicles go: level cameras, their headings, body set-points in each vehicle's
odometry."""

from dataclasses import astuple, dataclass
from typing import Optional

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


@dataclass(frozen=True)
class FollowPlace:
    """Where a vehicle is asked to: of its camera in home, m; the heading of its view to the left of
    home's x. None: its height, its heading stay as they are."""

    x_m: float
    y_m: float
    z_m: Optional[float] = None
    yaw_rad: Optional[float] = None

    @property
    def is_finite(self) -> bool:
        """Whether all of it is finite."""
        return bool(np.isfinite([v for v in astuple(self) if v is not None]).all())

    @classmethod
    def of(cls, T_home_cam: np.ndarray) -> "FollowPlace":
        """That of a level camera at ``T_home_cam``."""
        return cls(*map(float, T_home_cam[:3, 3]), heading_rad(T_home_cam))

    def from_here(self, T_home_cam: np.ndarray) -> np.ndarray:
        """T_home_cam there, of a level camera that is at ``T_home_cam``.

        >>> here = transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.0) @ T_HOME_CAM_AT_HOME
        >>> FollowPlace(5.0, 6.0).from_here(here)[:3, 3].tolist()
        [5.0, 6.0, 3.0]
        """
        z_m = float(T_home_cam[2, 3]) if self.z_m is None else self.z_m
        yaw_rad = heading_rad(T_home_cam) if self.yaw_rad is None else self.yaw_rad
        return transforms.from_xyz_yaw([self.x_m, self.y_m, z_m], yaw_rad) @ T_HOME_CAM_AT_HOME
