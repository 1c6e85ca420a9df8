# SPDX-License-Identifier: Apache-2.0
"""Where the robot itself is in a picture that watches it."""

from typing import Optional

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.robot import Robot

# beside the robot: its edge, and depth that is matched wider than it
_BESIDE_M, _BESIDE_PX = 0.15, 3
_CORNERS = 12


def robot_pixels(
    view: DepthView, place: RobotPlace, robot: Robot, ground_z_m: float
) -> Optional[np.ndarray]:
    """(H,W) bool: pixels in which the robot at ``place``, on ground at ``ground_z_m`` (home), may be
    seen, to two sigma of its place; None where it is not before the camera."""
    radius_m = robot.radius_m + _BESIDE_M + 2.0 * place.sigma_m
    angles = np.arange(_CORNERS) * 2.0 * np.pi / _CORNERS
    ring = np.column_stack(
        [place.x_m + radius_m * np.cos(angles), place.y_m + radius_m * np.sin(angles)]
    )
    heights_m = (ground_z_m - _BESIDE_M, ground_z_m + robot.height_m + _BESIDE_M)
    points_m = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in heights_m])
    p_cam = transforms.apply(transforms.invert(view.T_home_cam), points_m)
    if (p_cam[:, 2] < 1.0).any():
        return None
    corners = np.rint(view.camera.project(p_cam)).astype(np.int32)
    own = np.zeros(view.depth.shape, np.uint8)
    cv2.fillConvexPoly(own, cv2.convexHull(corners), 1)
    return cv2.dilate(own, np.ones((2 * _BESIDE_PX + 1,) * 2, np.uint8)) > 0
