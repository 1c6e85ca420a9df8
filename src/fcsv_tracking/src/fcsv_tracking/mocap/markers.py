# SPDX-License-Identifier: Apache-2.0
"""How well a pose is known that was fitted to markers which two parallel cameras triangulate.

A marker's error lies nearly all along the ray to it. The fit turns it into errors of position and
rotation that belong together: where the body is taken to lean back, its origin is taken to be
higher or lower, too.
"""

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.config import require_positive

Marker = Tuple[float, float, float]


@dataclass(frozen=True)
class MarkerRules:
    """``layout_m``: the markers in the body, as Motive shows them. Camera: a V120 Duo (thesis table
    5.1: 640 pixels across 47 degrees); ``centroid_px`` is one marker's standard deviation in one
    picture."""

    layout_m: Tuple[Marker, ...] = (
        (0.065, 0.0, 0.03),
        (-0.05, 0.055, 0.05),
        (-0.02, -0.065, 0.03),
        (-0.075, -0.02, 0.045),
    )
    centroid_px: float = 0.03
    focal_px: float = 736.0
    lens_distance_m: float = 0.24

    def __post_init__(self):
        require_positive(self)
        if len(self.layout_m) < 3 or np.linalg.matrix_rank(_arms(self.layout_m), tol=0.005) < 2:
            raise ValueError(
                "layout_m: a rigid body needs three markers or more, not all on one line"
            )


class MarkerNoise:
    """pose_covariance() of rigid fits to one layout of markers."""

    def __init__(self, rules: MarkerRules):
        self._rules, self._layout = rules, np.asarray(rules.layout_m, float)
        arms = _arms(rules.layout_m)
        spread = arms.T @ arms
        inertia = np.trace(spread) * np.eye(3) - spread
        # errors n_i of the markers turn the fit by inertia^-1 sum arm_i x n_i and move its middle
        # by their mean; the body's origin goes along with both
        turns = np.stack([np.linalg.solve(inertia, rotations.skew(arm)) for arm in arms])
        moves = np.eye(3) / len(arms) + rotations.skew(self._layout.mean(axis=0)) @ turns
        self._fit = np.concatenate([moves, turns], axis=1)  # (N,6,3), body's axes

    def pose_covariance(self, R_M_D: np.ndarray, p_M_D: np.ndarray) -> np.ndarray:
        """(6,6) of a pose in M (x out of the lenses): position (m, M's axes), rotation (rad, body's
        axes)."""
        r = self._rules
        p_M = self._layout @ R_M_D.T + p_M_D
        depth_m = np.maximum(p_M[:, 0], 0.1)
        aside_m = depth_m * (r.centroid_px / (np.sqrt(2.0) * r.focal_px))
        errors = np.zeros((len(p_M), 3, 3))  # of each marker: along its ray, across, up
        errors[:, :, 0] = (
            p_M
            * (depth_m * np.sqrt(2.0) * r.centroid_px / (r.focal_px * r.lens_distance_m))[:, None]
        )
        errors[:, 1, 1] = errors[:, 2, 2] = aside_m
        G = np.concatenate(self._fit @ (R_M_D.T @ errors), axis=1)
        G[:3] = R_M_D @ G[:3]
        return G @ G.T


def _arms(layout_m: Tuple[Marker, ...]) -> np.ndarray:
    """(N,3) about the markers' middle."""
    return np.asarray(layout_m, float) - np.mean(layout_m, axis=0)
