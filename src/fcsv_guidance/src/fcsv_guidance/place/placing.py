# SPDX-License-Identifier: Apache-2.0
"""The robot's place out of a pose that somebody publishes."""

from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import frames
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.errors import PlaceError
from fcsv_guidance.messages import RobotPlace


def robot_place(
    now_s: float,
    stamp_s: float,
    frame: str,
    T_home_robot: np.ndarray,
    covariance: Optional[Sequence[float]],
    sigma_m: Optional[float],
) -> RobotPlace:
    """The place of a pose in ``frame``. ``covariance``: 36 numbers as ROS has them; where there are
    none, or all are 0, ``sigma_m`` counts.

    Raises PlaceError where the frame is not home, the stamp lies ahead, or nothing tells how well
    the place is known.
    """
    if frame != frames.HOME:
        raise PlaceError(
            f"its frame is '{frame}', not {frames.HOME}; publish the robot's pose in {frames.HOME}"
        )
    ahead = ahead_of_clock(now_s, stamp_s)
    if ahead:
        raise PlaceError(f"its stamp {ahead}")
    if covariance is not None and np.any(covariance):
        of_xy = np.array([covariance[0], covariance[7]], float)
        if not np.isfinite(of_xy).all() or (of_xy < 0).any():
            raise PlaceError(f"its covariance of x and y ({of_xy[0]}, {of_xy[1]}) is none")
        sigma_m = float(np.sqrt(of_xy.sum()))
    if sigma_m is None:
        raise PlaceError(
            "it has no covariance, and no sigma_m was given; say how well the robot's place is known"
        )
    yaw_rad = float(np.arctan2(T_home_robot[1, 0], T_home_robot[0, 0]))
    return RobotPlace(
        stamp_s, float(T_home_robot[0, 3]), float(T_home_robot[1, 3]), yaw_rad, sigma_m
    )
