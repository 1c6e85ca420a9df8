# SPDX-License-Identifier: Apache-2.0
"""Correspondences between two views: in the band that the prior leaves, or anywhere for a prior
that is wrong."""

from dataclasses import dataclass
from typing import Optional

import cv2
import numpy as np

from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.geometry import PairPrior

_RATIO = 0.85  # of distances to the best and the second best descriptor
_NEAREST_SHARE = 0.5  # nothing nearer than this share of the baseline is matched


@dataclass(frozen=True)
class Matches:
    """Indices (N,) into two views' features."""

    a: np.ndarray
    b: np.ndarray

    def __len__(self) -> int:
        return len(self.a)


def band_px(prior: PairPrior, focal_px: float, near_m: float) -> float:
    """Half-width of the band about an epipolar line: three standard deviations of the prior, and
    the feature's own."""
    sigma_rad = np.hypot(prior.rotation_rad * 1.2, prior.position_m / near_m)
    return float(3.0 * sigma_rad * focal_px + 2.0)


def match_in_band(
    a: FeatureView, b: FeatureView, prior: PairPrior, half_width_px: float
) -> Matches:
    """Mutual best descriptors among those within the band, in front of both cameras."""
    if len(a.uv) < 2 or len(b.uv) < 2:
        return Matches(np.empty(0, int), np.empty(0, int))
    likeness = a.descriptors @ b.descriptors.T
    likeness[~_allowed(a, b, prior, half_width_px)] = -1.0
    return _mutual(likeness)


def match_anywhere(a: FeatureView, b: FeatureView) -> Matches:
    """Mutual best descriptors without regard to the prior."""
    if len(a.uv) < 2 or len(b.uv) < 2:
        return Matches(np.empty(0, int), np.empty(0, int))
    return _mutual(a.descriptors @ b.descriptors.T)


def rotation_anywhere(
    a: FeatureView, b: FeatureView, matches: Matches, focal_px: float
) -> Optional[np.ndarray]:
    """R_a_b from the essential matrix of matches (MAGSAC++), None where there is none."""
    if len(matches) < 15:
        return None
    xy_a, xy_b = a.rays[matches.a, :2], b.rays[matches.b, :2]
    E, inliers = cv2.findEssentialMat(
        xy_a, xy_b, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.999, threshold=1.5 / focal_px
    )
    if E is None or E.shape != (3, 3) or int(inliers.sum()) < 15:
        return None
    _, R_b_a, _, _ = cv2.recoverPose(E, xy_a, xy_b, np.eye(3), mask=inliers.copy())
    return R_b_a.T


def _allowed(a: FeatureView, b: FeatureView, prior: PairPrior, half_width_px: float) -> np.ndarray:
    """Which features (Na, Nb) can be the same point, as far as the prior knows."""
    R, t = prior.T_a_b[:3, :3], prior.T_a_b[:3, 3]
    lines = (np.cross(a.rays, t) @ R).astype(np.float32)
    lines /= np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-9)[:, None]
    half_width = np.float32(half_width_px / b.camera.fx)
    allowed = np.abs(lines @ b.rays.T.astype(np.float32)) < half_width
    # along the line: between infinity and the nearest depth, and the band's width more at either
    # end
    far = a.rays @ R
    near = (a.rays - t / (_NEAREST_SHARE * np.linalg.norm(t))) @ R
    far_ok, near_ok = far[:, 2] > 0.05, near[:, 2] > 0.05
    direction = np.column_stack([-lines[:, 1], lines[:, 0]])
    s_far = (far[:, :2] / np.where(far_ok, far[:, 2], 1.0)[:, None] * direction).sum(1)
    s_near = (near[:, :2] / np.where(near_ok, near[:, 2], 1.0)[:, None] * direction).sum(1)
    lower = np.where(far_ok & near_ok, np.minimum(s_far, s_near) - half_width, -np.inf).astype(
        np.float32
    )
    upper = np.where(far_ok & near_ok, np.maximum(s_far, s_near) + half_width, np.inf).astype(
        np.float32
    )
    s = direction.astype(np.float32) @ b.rays[:, :2].T.astype(np.float32)
    return allowed & (s > lower[:, None]) & (s < upper[:, None])


def _mutual(likeness: np.ndarray) -> Matches:
    """Best of row and of column, distinctly better than the row's second best; descriptors have
    unit length."""
    rows = np.arange(len(likeness))
    best = likeness.argmax(1)
    top = likeness[rows, best]
    mutual = likeness.argmax(0)[best] == rows
    likeness[rows, best] = -1.0
    second = likeness.max(1)
    distance, other = np.sqrt(np.maximum(2 - 2 * top, 0)), np.sqrt(np.maximum(2 - 2 * second, 0))
    good = mutual & (top > 0.5) & (distance < _RATIO * other)
    return Matches(rows[good], best[good])
