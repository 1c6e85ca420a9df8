# SPDX-License-Identifier: Apache-2.0
"""ENU/FLU (ROS, REP 103) to NED/FRD (MAVLink) and back; both maps are their own inverse."""

import math
from typing import Tuple

import numpy as np

from fcsv_geometry import rotations, transforms


def swap_ned_enu(p) -> Tuple[float, float, float]:
    """North-east-down to east-north-up, or back.

    >>> swap_ned_enu(swap_ned_enu((1.0, 2.0, 3.0)))
    (1.0, 2.0, 3.0)
    """
    return float(p[1]), float(p[0]), -float(p[2])


def swap_yaw(yaw_rad: float) -> float:
    """Yaw counter-clockwise from east to clockwise from north, or back (rad, -pi..pi).

    >>> round(swap_yaw(swap_yaw(0.3)), 12)
    0.3
    """
    return rotations.wrap(math.pi / 2.0 - yaw_rad)


def ned_from_pose(T_odom_body: np.ndarray):
    """Position (N, E, D) and roll, pitch, yaw (FRD in NED, rad) of a body pose in an ENU frame."""
    roll, pitch, yaw = rotations.rpy_of_matrix(T_odom_body[:3, :3])
    return swap_ned_enu(T_odom_body[:3, 3].tolist()), (roll, -pitch, swap_yaw(yaw))


def pose_from_ned(p_ned, rpy_ned_rad) -> np.ndarray:
    """The inverse of ned_from_pose: T_odom_body."""
    roll, pitch, yaw = rpy_ned_rad
    return transforms.of_rows(
        rotations.rows_of_rpy(roll, -pitch, swap_yaw(yaw)), swap_ned_enu(p_ned)
    )
