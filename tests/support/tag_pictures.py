# SPDX-License-Identifier: Apache-2.0
"""Pictures of a tag as an ideal camera takes them."""

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera

CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0))
SUPER = 8


def render(T_cam_tag, size_m=0.16, tag_id=1, camera=CAMERA):
    """A tag36h11 in front of grey, area-sampled: the ideal camera."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    # OpenCV draws the family upside down against its authors' pictures
    bits = cv2.rotate(cv2.aruco.generateImageMarker(dictionary, tag_id, 80), cv2.ROTATE_180)
    board = np.full((100, 100), 255, np.uint8)
    board[10:90, 10:90] = bits
    pixel_m = size_m / 80
    # board pixel (u, v), centres at whole numbers, to the tag's plane
    A = np.array([[pixel_m, 0, -49.5 * pixel_m], [0, pixel_m, -49.5 * pixel_m], [0, 0, 1.0]])
    H = camera.K @ T_cam_tag[:3, [0, 1, 3]] @ A
    S = np.array([[SUPER, 0, (SUPER - 1) / 2], [0, SUPER, (SUPER - 1) / 2], [0, 0, 1.0]])
    big = np.full((camera.height * SUPER, camera.width * SUPER), 120, np.uint8)
    cv2.warpPerspective(
        board,
        S @ H,
        big.shape[::-1],
        dst=big,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_TRANSPARENT,
    )
    return cv2.resize(big, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def pose(distance_m, yaw_deg=0.0, x=0.1, y=-0.05, roll_deg=0.0):
    return transforms.from_xyz_rpy([x, y, distance_m], np.radians([0.0, yaw_deg, roll_deg]))
