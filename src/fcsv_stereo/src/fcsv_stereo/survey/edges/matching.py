# SPDX-License-Identifier: Apache-2.0
"""Which features of two views are alike, and where one view sees what another measured."""

from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.edges.features import Features
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import View


def inside(uv: np.ndarray, radius: np.ndarray, view: View) -> np.ndarray:
    """(N,) bool: whether pixels (N,2) are in a view's picture or within ``radius`` (N,) px of
    it."""
    size = np.array([view.camera.width, view.camera.height])
    with np.errstate(invalid="ignore"):
        return ((uv > -radius[:, None]) & (uv < size + radius[:, None])).all(axis=1)


def predicted(
    points_a: np.ndarray, prior_a: Prior, prior_b: Prior, b: View
) -> Tuple[np.ndarray, np.ndarray]:
    """Where points (N,3) of a's camera lie in b's picture by the priors: (N,2) px, NaN behind it,
    and the radius (N,) px within which they do."""
    in_b = transforms.apply(transforms.invert(prior_b.T_site_cam) @ prior_a.T_site_cam, points_a)
    z = np.where(in_b[:, 2] > 0.1, in_b[:, 2], np.nan)
    c = b.camera
    uv = in_b[:, :2] / z[:, None] * [c.fx, c.fy] + [c.cx, c.cy]
    away_m = np.linalg.norm(points_a, axis=1)
    off_m = np.hypot(np.hypot(prior_a.place_m, prior_b.place_m), prior_a.yaw_rad * away_m)
    off_m = np.hypot(off_m, np.hypot(prior_a.scale, prior_b.scale) * away_m)
    return uv, tuning.GATE_SIGMAS * c.fx * np.hypot(off_m / z, prior_b.yaw_rad) + tuning.GATE_PX


def match(
    a: Features, b: Features, gate: Optional[Tuple[np.ndarray, np.ndarray]] = None
) -> np.ndarray:
    """(M,2) indices of features that are each other's best and distinctly better than the second
    best.

    ``gate``: where a's features lie in b's picture (N,2) px, and within which radius (N,) px; None:
    anywhere.
    """
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), int)
    likeness = a.descriptors @ b.descriptors.T
    ratio = tuning.RATIO_FREE
    if gate is not None:
        uv, radius = gate
        from_u, from_v = (
            np.subtract.outer(uv[:, i], b.uv[:, i]).astype(np.float32) for i in (0, 1)
        )
        with np.errstate(invalid="ignore"):
            likeness[~(from_u**2 + from_v**2 < np.square(radius)[:, None])] = -1.0
        ratio = tuning.RATIO_GATED
    rows = np.arange(len(a))
    best = likeness.argmax(1)
    top = likeness[rows, best]
    mutual = likeness.argmax(0)[best] == rows
    likeness[rows, best] = -1.0
    second = likeness.max(1)
    nearest, next_one = (np.sqrt(np.maximum(2.0 - 2.0 * s, 0.0)) for s in (top, second))
    good = mutual & (top > 0.0) & (nearest < ratio * next_one)
    return np.column_stack([rows[good], best[good]])
