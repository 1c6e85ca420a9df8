# SPDX-License-Identifier: Apache-2.0
"""Whether a gimbal sees the tags of its vehicle: near enough, inside its limits, and a tag towards
it."""

import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.gimbal.config import Gimbal

_NEAREST_M, _FARTHEST_M = 1.0, 4.2  # thesis 4.2: tags of 8 cm are seen up to around 4 m
_STEEPEST_DEG = 68.0  # of a tag's face against the line of sight


def gimbal_problem(gimbal: Gimbal, T_ground_body: np.ndarray) -> str:
    """Why a gimbal cannot see the tags of its vehicle, whose body stands at ``T_ground_body`` 4x4 in
    the robot's frame, as the end of a sentence; empty where it can."""
    centre = np.mean(
        [transforms.apply(T_ground_body, t.T_body_tag[:3, 3]) for t in gimbal.tags], axis=0
    )
    away_m = float(np.linalg.norm(centre - gimbal.geometry.base.xyz_m))
    if not _NEAREST_M <= away_m <= _FARTHEST_M:
        return f"{away_m:.1f} m from its gimbal, which sees tags from {_NEAREST_M:g} to {_FARTHEST_M:g} m"
    T_ground_cam = gimbal.geometry.T_ground_cam(gimbal.geometry.aim(centre))
    sight = transforms.apply(transforms.invert(T_ground_cam), centre)
    if np.hypot(sight[0], sight[1]) > 0.02 * away_m:
        return "where its gimbal cannot turn to"
    facing = [_oblique_deg(T_ground_body @ t.T_body_tag, T_ground_cam[:3, 3]) for t in gimbal.tags]
    if min(facing) > _STEEPEST_DEG:
        return f"so steeply above its gimbal that its tags are seen at {min(facing):.0f} degrees"
    return ""


def _oblique_deg(T_ground_tag: np.ndarray, eye_m: np.ndarray) -> float:
    """Angle (deg) between a tag's face (its frame's -z looks out of it) and the way to an eye
    (3,)."""
    to_eye = eye_m - T_ground_tag[:3, 3]
    return float(
        np.degrees(
            np.arccos(np.clip(-T_ground_tag[:3, 2] @ to_eye / np.linalg.norm(to_eye), -1.0, 1.0))
        )
    )
