# SPDX-License-Identifier: Apache-2.0
"""Similarities to begin a fit with: from all places, from few, from angles; so many that a right
one is among them."""

from itertools import combinations
from typing import Iterator, List, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_stereo.photos.evidence import GpsEvidence, Pose

_TRIPLES, _SUBSETS, _ATTITUDES, _PAIRS = 200, 40, 40, 300
# of those from places: the best, by squares up to a bound
_KEPT, _WRONG, _MODEL_SHARE = 40, 17.0, 0.01
_LINE_TURNS = np.radians(np.arange(15, 360, 15))
Start = Tuple[float, np.ndarray, np.ndarray]


def starts(e: GpsEvidence, rng: np.random.Generator) -> List[Pose]:
    """Proposes at least one wherever two places differ."""
    found = [*_from_places(e, rng), *_from_angles(e, rng)]
    return [Pose(s, R, t, np.zeros(4)) for s, R, t in found]


def about_the_line(e: GpsEvidence, pose: Pose) -> Iterator[Pose]:
    """The same, turned about the line along which the photographs lie: where they do, places do not
    tell that turn."""
    middle = np.median(e.p_model, axis=0)
    axis = pose.R @ np.linalg.svd(e.p_model - middle, full_matrices=False)[2][0]
    at_m = pose.scale * pose.R @ middle + pose.t
    for angle in _LINE_TURNS:
        R = Rotation.from_rotvec(angle * axis).as_matrix() @ pose.R
        yield Pose(pose.scale, R, at_m - pose.scale * R @ middle, pose.shared)


def closed(p_model: np.ndarray, p_enu_m: np.ndarray, sigmas_m: np.ndarray) -> Optional[Start]:
    """Scale, rotation and shift of least squares, weighted by photograph (Umeyama 1991); None where
    places are one."""
    weights = 1.0 / np.square(sigmas_m).mean(axis=1, keepdims=True)
    weights = weights / weights.sum()
    middle_a, middle_b = (weights * p_model).sum(axis=0), (weights * p_enu_m).sum(axis=0)
    a, b = p_model - middle_a, p_enu_m - middle_b
    spread = float((weights * np.square(a)).sum())
    if not (spread > 0.0 and np.square(b).sum() > 0.0):
        return None
    U, S, Vt = np.linalg.svd((weights * b).T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0])
    R, s = U @ np.diag(sign) @ Vt, float((S * sign).sum() / spread)
    return (s, R, middle_b - s * R @ middle_a) if s > 0.0 else None


def _from_places(e: GpsEvidence, rng: np.random.Generator) -> List[Start]:
    at = np.flatnonzero(e.placed)
    subsets = [
        at,
        *_subsets(at, 3, _TRIPLES, rng),
        *_subsets(at, max(4, len(at) // 2), _SUBSETS, rng),
    ]
    found = [
        closed(e.p_model[list(s)], e.p_enu_m[list(s)], e.sigmas_m[list(s)])
        for s in map(list, subsets)
    ]
    return _best([f for f in found if f is not None], e)


def _best(found: List[Start], e: GpsEvidence) -> List[Start]:
    if len(found) <= _KEPT:
        return found
    scales, rotations, shifts = (np.array(of) for of in zip(*found))
    at = (
        e.p_model[e.placed] @ (scales[:, None, None] * rotations).transpose(0, 2, 1)
        + shifts[:, None]
    )
    variances = (
        np.square(np.hypot(e.sigmas_m, e.steps_m)[e.placed])
        + np.square(_MODEL_SHARE * e.extent * scales)[:, None, None]
    )
    squares = (np.square(at - e.p_enu_m[e.placed]) / variances).sum(axis=2)
    costs = np.minimum(squares, _WRONG).sum(axis=1)
    return [found[i] for i in np.argsort(costs, kind="stable")[:_KEPT]]


def _subsets(at: np.ndarray, size: int, most: int, rng: np.random.Generator) -> List[np.ndarray]:
    if len(at) < size:
        return []
    if size == 3 and len(at) * (len(at) - 1) * (len(at) - 2) <= 6 * most:
        return [np.array(t) for t in combinations(at, 3)]
    return [rng.choice(at, size, replace=False) for _ in range(most)]


def _from_angles(e: GpsEvidence, rng: np.random.Generator) -> List[Start]:
    """Rotations by a photograph each, and by the median of all; scale and shift by medians."""
    at = np.flatnonzero(e.angled)
    if not len(at) or e.placed.sum() < 2:
        return []
    R_enu_model = e.R_enu_cam[at] @ e.R_model_cam[at].transpose(0, 2, 1)
    some = (
        R_enu_model
        if len(at) <= _ATTITUDES
        else R_enu_model[rng.choice(len(at), _ATTITUDES, replace=False)]
    )
    apart = np.arccos(np.clip((np.einsum("aij,bij->ab", some, R_enu_model) - 1.0) / 2.0, -1.0, 1.0))
    near = np.median(apart, axis=1) * 1.5 + 1e-3
    means = [
        Rotation.from_matrix(R_enu_model[row < bound]).mean().as_matrix()
        for row, bound in zip(apart, near)
    ]
    pairs = _pairs(np.flatnonzero(e.placed), rng)
    found = [_by_medians(e, R, pairs) for R in (*some, *means)]
    return [f for f in found if f is not None]


def _pairs(at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(K, 2) indices of photographs."""
    pairs = np.array(list(combinations(at, 2))) if len(at) <= 25 else rng.choice(at, (_PAIRS, 2))
    return pairs[pairs[:, 0] != pairs[:, 1]]


def _by_medians(e: GpsEvidence, R: np.ndarray, pairs: np.ndarray) -> Optional[Start]:
    turned = e.p_model @ R.T
    a, b = (p[pairs[:, 1]] - p[pairs[:, 0]] for p in (turned, e.p_enu_m))
    square = np.square(a).sum(axis=1)
    far = square >= np.median(square)
    s = float(np.median((a * b).sum(axis=1)[far] / np.maximum(square[far], 1e-12)))
    if s <= 0.0:
        return None
    return s, R, np.median((e.p_enu_m - s * turned)[e.placed], axis=0)
