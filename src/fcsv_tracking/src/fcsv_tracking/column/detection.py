# SPDX-License-Identifier: Apache-2.0
"""One sight of the tag of the vehicle in front, with the place of both by their own odometry.

Frames: O odometry, D body, C camera, A tag; p is the parent (in front, carries the tag), c the
child (behind, sees it).
"""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry import transforms


@dataclass(frozen=True)
class Detection:
    """One picture of the child's camera with the parent's tag.

    ``T_odom_cam`` is the child's camera in its odometry frame, ``T_odom_tag`` the parent's tag in
    the parent's, both at ``stamp_s``; corners (4,2) undistorted x/z, y/z in the detector's order.
    """

    stamp_s: float
    corners_normalized: np.ndarray
    size_m: float
    focal_px: float
    T_odom_cam: np.ndarray
    T_odom_tag: np.ndarray

    @property
    def edge_px(self) -> float:
        """Longest edge of the tag in the picture."""
        edges = np.linalg.norm(
            self.corners_normalized - np.roll(self.corners_normalized, 1, axis=0), axis=1
        )
        return float(np.max(edges) * self.focal_px)


def single_link(detection: Detection, T_cam_tag: np.ndarray) -> np.ndarray:
    """T_parent_child by equation 6.1 (corrected) from one detection's tag pose; six degrees of
    freedom."""
    return (
        detection.T_odom_tag
        @ transforms.invert(T_cam_tag)
        @ transforms.invert(detection.T_odom_cam)
    )
