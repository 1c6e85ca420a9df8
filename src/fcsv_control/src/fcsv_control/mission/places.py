# SPDX-License-Identifier: Apache-2.0
"""Where the vehicles go: camera places in home, body set-points in each vehicle's odometry, routes between."""

from typing import List, Sequence

import numpy as np

from fcsv_control.mission.config import StereoConfiguration, tilt_rad
from fcsv_geometry import transforms

#: Camera frame of home: position zero, level, looking along home's x.
T_HOME_CAM_AT_HOME = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def camera_place(configuration: StereoConfiguration) -> np.ndarray:
    """T_home_cam of the moving camera: right of the reference (horizontal) or above it (vertical)."""
    b = configuration.baseline_m
    p = [0.0, -b, 0.0] if configuration.axis == "horizontal" else [0.0, 0.0, b]
    return transforms.from_xyz_yaw(p, tilt_rad(configuration)) @ T_HOME_CAM_AT_HOME


def body_set_point(T_home_cam: np.ndarray, T_home_odom: np.ndarray, T_body_cam: np.ndarray) -> np.ndarray:
    """T_odom_body (level) that brings a camera to its place."""
    return transforms.level(transforms.invert(T_home_odom) @ T_home_cam @ transforms.invert(T_body_cam))


def distance_to_segment(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Smallest distance (m) of a point from the segment a to b."""
    ab = b - a
    length2 = float(ab @ ab)
    s = 0.0 if length2 < 1e-12 else float(np.clip((point - a) @ ab / length2, 0.0, 1.0))
    return float(np.linalg.norm(a + s * ab - point))


def route(start_m, goal_m, others_m: Sequence[np.ndarray], separation_m: float) -> List[np.ndarray]:
    """Way-points from start (excluded) to goal (included), every leg at least ``separation_m`` from the others.

    Straight where it can be, else through corners that step aside first: sideways, up, or both. Raises ValueError
    where start or goal itself is too near, or no such way exists.
    """
    start_m, goal_m = np.asarray(start_m, float), np.asarray(goal_m, float)
    for other in others_m:
        if np.linalg.norm(goal_m - other) < separation_m - 1e-6:
            raise ValueError(f"the goal is nearer than {separation_m} m to another vehicle")

    def free(points: Sequence[np.ndarray]) -> bool:
        legs = zip([start_m, *points[:-1]], points)
        return all(_leg_is_free(a, b, o, separation_m) for a, b in legs for o in others_m)

    sideways = np.array([start_m[0], goal_m[1], start_m[2]])
    upward = np.array([start_m[0], start_m[1], goal_m[2]])
    across = np.array([start_m[0], goal_m[1], goal_m[2]])
    candidates = [[], [sideways], [upward], [across], [sideways, across], [upward, across]]
    for lift in (1.5, 3.0):
        for side in (-1.0, 1.0):
            aside = np.array([0.0, side * lift * separation_m, lift * separation_m])
            candidates += [[start_m + aside, goal_m + aside], [across + aside, goal_m + aside]]
    for via in candidates:
        points = [*via, goal_m]
        if free(points):
            return [p for p, before in zip(points, [start_m, *points]) if np.linalg.norm(p - before) > 0.05] or [goal_m]
    raise ValueError("no way keeps the separation from the other vehicles")


def _leg_is_free(a, b, other, separation_m) -> bool:
    """A leg may start too near (the vehicle stands there) as long as it leads away at once."""
    start = float(np.linalg.norm(a - other))
    nearest = distance_to_segment(other, a, b)
    return nearest >= separation_m - 1e-6 or (start < separation_m and nearest >= start - 1e-3)
