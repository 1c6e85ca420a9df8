# SPDX-License-Identifier: Apache-2.0
"""The robot's place out of a pose that somebody publishes."""

from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import frames
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.errors import PlaceError
from fcsv_guidance.messages import RobotPlace

_HEADING_RAD = 1.0  # a heading of a larger sigma leads nowhere


def robot_place(
    now_s: float,
    stamp_s: float,
    frame: str,
    T_home_robot: np.ndarray,
    covariance: Optional[Sequence[float]],
    sigma_m: Optional[float],
) -> RobotPlace:
    """The place of a pose in ``frame``. ``covariance``: 36 numbers as ROS has them; where there are
    none, or those of x and y are 0, ``sigma_m`` counts.

    Raises PlaceError where the frame is not home, the stamp lies ahead, the heading is not known,
    or nothing tells how well the place is known.
    """
    if frame != frames.HOME:
        raise PlaceError(
            f"its frame is '{frame}', not {frames.HOME}; publish the robot's pose in {frames.HOME}"
        )
    ahead = ahead_of_clock(now_s, stamp_s)
    if ahead:
        raise PlaceError(f"its stamp {ahead}")
    stated_m = None if covariance is None else _stated_sigma_m(covariance)
    sigma_m = sigma_m if stated_m is None else stated_m
    if sigma_m is None:
        raise PlaceError(
            "it has no covariance of x and y, and no sigma_m was given; say how well the robot's "
            "place is known"
        )
    yaw_rad = float(np.arctan2(T_home_robot[1, 0], T_home_robot[0, 0]))
    return RobotPlace(
        stamp_s, float(T_home_robot[0, 3]), float(T_home_robot[1, 3]), yaw_rad, sigma_m
    )


def _stated_sigma_m(covariance: Sequence[float]) -> Optional[float]:
    """What 36 numbers say of x and y together; None where they say nothing. A yaw variance of 0
    says nothing either. Raises PlaceError where they say that the place or heading is not known."""
    x, y, yaw = (float(covariance[k]) for k in (0, 7, 35))
    if not (np.isfinite([x, y]).all() and min(x, y) >= 0.0):
        raise PlaceError(f"its covariance of x and y ({x}, {y}) is none")
    if (x == 0.0) != (y == 0.0):
        raise PlaceError(f"its covariance of x and y ({x}, {y}) is only half filled in")
    if not 0.0 <= yaw <= _HEADING_RAD**2:
        raise PlaceError(
            f"its yaw variance ({yaw} rad^2) says that the heading is not known; "
            f"at most {_HEADING_RAD**2:g} rad^2 is driven by"
        )
    return float(np.sqrt(x + y)) if x > 0.0 else None
