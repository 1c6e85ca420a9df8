# SPDX-License-Identifier: Apache-2.0
"""Views of a tag while the vehicle is moved by hand, and a first solution (robot-world hand-eye,
Shah 2013).

Two setups, one problem with unknown X (on the vehicle) and Z (in its odometry), T_odom_body = A:

    part "camera": the vehicle's camera sees a fixed tag. X = T_body_cam, Z = T_odom_tag, T_cam_tag = inv(X) inv(A) Z
    part "tag":    a fixed camera sees the vehicle's tag. X = T_body_tag, Z = T_odom_cam, T_cam_tag = inv(Z) A X
"""

from dataclasses import dataclass
from typing import List, Sequence, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_tracking.errors import ExtrinsicsRefused
from fcsv_tracking.tags import planar_poses

PARTS = ("camera", "tag")
_AXES = ("x (roll)", "y (pitch)", "z (yaw)")


@dataclass(frozen=True)
class TagView:
    """One picture with the tag: corners (4,2) undistorted x/z, y/z, and the body by its odometry
    then."""

    stamp_s: float
    corners_normalized: np.ndarray
    size_m: float
    focal_px: float
    T_odom_body: np.ndarray


def predicted_T_cam_tag(
    part: str, T_odom_body: np.ndarray, X: np.ndarray, Z: np.ndarray
) -> np.ndarray:
    """T_cam_tag (..., 4, 4) of bodies (..., 4, 4); see the module."""
    if part == "camera":
        return np.linalg.inv(T_odom_body @ X) @ Z
    return transforms.invert(Z) @ T_odom_body @ X


def require_motion(views: Sequence[TagView], least_turn_deg: float) -> None:
    """Refuse turns about a single axis (or none): they leave X open along and about that axis."""
    rotations = Rotation.from_matrix([v.T_odom_body[:3, :3] for v in views])
    turns = (rotations.mean().inv() * rotations).as_rotvec()  # in the body's axes
    _, sizes, axes = np.linalg.svd(turns - turns.mean(axis=0), full_matrices=False)
    rms_deg = np.degrees(sizes / np.sqrt(len(views)))
    if rms_deg[0] < least_turn_deg:
        raise ExtrinsicsRefused(
            f"the vehicle hardly turns ({rms_deg[0]:.1f} deg rms, {least_turn_deg:.0f} needed): turn it by 30 degrees "
            f"about two axes or more while the tag stays in view"
        )
    if rms_deg[1] < least_turn_deg:
        raise ExtrinsicsRefused(
            f"the vehicle turns about one axis alone, near its {_AXES[int(np.argmax(np.abs(axes[0])))]}; about another "
            f"only {rms_deg[1]:.1f} deg rms ({least_turn_deg:.0f} needed): tilt it the other ways too"
        )


def first_solution(part: str, views: Sequence[TagView]) -> Tuple[np.ndarray, np.ndarray]:
    """X and Z by cv2.calibrateRobotWorldHandEye; of a tag's two mirrored poses the one that fits
    the others counts."""
    candidates = [planar_poses(v.corners_normalized, v.size_m) for v in views]
    sure = [i for i, c in enumerate(candidates) if len(c) < 2 or c[1][1] > 2.0 * c[0][1]]
    chosen = [c[0][0] for c in candidates]
    use = sure if len(sure) >= 6 else list(range(len(views)))
    X, Z = _solve(part, [views[i] for i in use], [chosen[i] for i in use])
    for _ in range(5):
        before = chosen
        chosen = [
            _nearest(c, predicted_T_cam_tag(part, v.T_odom_body, X, Z))
            for v, c in zip(views, candidates)
        ]
        X, Z = _solve(part, views, chosen)
        if all(a is b for a, b in zip(before, chosen)):
            break
    return X, Z


def _nearest(candidates, T_cam_tag: np.ndarray) -> np.ndarray:
    return min((T for T, _ in candidates), key=lambda T: transforms.rotation_angle(T, T_cam_tag))


def _solve(
    part: str, views: Sequence[TagView], T_cam_tag: List[np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """OpenCV's "world" is what stands still, its "camera" what moves with the vehicle."""
    seen = T_cam_tag if part == "camera" else [transforms.invert(T) for T in T_cam_tag]
    T_body_odom = [transforms.invert(v.T_odom_body) for v in views]
    R_world, t_world, R_part, t_part = cv2.calibrateRobotWorldHandEye(
        [T[:3, :3] for T in seen],
        [T[:3, 3] for T in seen],
        [T[:3, :3] for T in T_body_odom],
        [T[:3, 3] for T in T_body_odom],
    )
    X = transforms.invert(transforms.transform(R_part, t_part.ravel()))
    Z = transforms.invert(transforms.transform(R_world, t_world.ravel()))
    return X, Z
