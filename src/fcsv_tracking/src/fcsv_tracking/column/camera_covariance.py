# SPDX-License-Identifier: Apache-2.0
"""How well a camera's place in home is known (calibration chain, drift, tracker), and when to
calibrate again."""

from dataclasses import dataclass, fields
from typing import Optional

import numpy as np

from fcsv_geometry.home import Place
from fcsv_tracking.column.drift import Drift

_XYZ_YAW = [0, 1, 2, 5]


@dataclass(frozen=True)
class AgeRules:
    """Beyond which the operator is told to calibrate again: one degree of yaw is ten pixels of
    disparity."""

    most_position_std_m: float = 0.25
    most_yaw_std_deg: float = 1.0
    most_age_s: float = 1800.0

    def __post_init__(self):
        for f in fields(self):
            if not getattr(self, f.name) > 0:
                raise ValueError(f"{f.name}: {getattr(self, f.name)} must be positive")


def camera_covariance(
    T_home_odom: Place,
    T_odom_body: np.ndarray,
    T_body_cam: np.ndarray,
    drift: Drift,
    tracker: np.ndarray,
) -> np.ndarray:
    """(6, 6) of the camera's position (m) and small rotation (rad), both about home's axes (REP 103
    order).

    ``tracker`` (6, 6) is the odometry's own, of its pose in the odometry frame, as
    nav_msgs/Odometry has it.
    """
    R_home_odom = T_home_odom.T_a_b[:3, :3]
    p_odom_cam = (T_odom_body @ T_body_cam)[:3, 3]
    turn = np.kron(np.eye(2), R_home_odom)
    arm_home = R_home_odom @ (p_odom_cam - T_odom_body[:3, 3])
    # a rotation of the body about home's axes moves the camera by its arm: d = w x arm
    J = np.eye(6)
    J[:3, 3:] = -np.array(
        [
            [0, -arm_home[2], arm_home[1]],
            [arm_home[2], 0, -arm_home[0]],
            [-arm_home[1], arm_home[0], 0],
        ]
    )
    body = turn @ np.asarray(tracker, float) @ turn.T
    since = np.eye(4)
    since[:3, :3] = R_home_odom
    body[np.ix_(_XYZ_YAW, _XYZ_YAW)] += since @ drift.covariance @ since.T
    covariance = J @ body @ J.T
    covariance[np.ix_(_XYZ_YAW, _XYZ_YAW)] += T_home_odom.at(p_odom_cam)
    return covariance


def stale_reason(
    vehicle: str, covariance: np.ndarray, drift: Drift, age_s: Optional[float], rules: AgeRules
) -> str:
    """Why the vehicle should be calibrated again, in one line; empty where there is no need."""
    std_m = float(np.sqrt(np.trace(covariance[:3, :3])))
    yaw_deg = float(np.degrees(np.sqrt(covariance[5, 5])))
    flown = f"{drift.path_m:.0f} m flown since the calibration"
    if std_m > rules.most_position_std_m:
        return f"calibrate again: {vehicle} is only known to {std_m:.2f} m ({flown})"
    if yaw_deg > rules.most_yaw_std_deg:
        return f"calibrate again: the yaw of {vehicle} is only known to {yaw_deg:.1f} deg ({flown})"
    if age_s is not None and age_s > rules.most_age_s:
        return f"calibrate again: the calibration of {vehicle} is {age_s / 60:.0f} minutes old"
    return ""
