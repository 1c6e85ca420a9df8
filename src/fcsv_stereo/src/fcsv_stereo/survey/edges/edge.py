# SPDX-License-Identifier: Apache-2.0
"""An edge: the similarity between two views' cameras, from features whose depth both views
measured.

RANSAC (Fischler and Bolles 1981) of three matches at a time finds it; what counts as agreement
follows the covariances of both points. Then a weighted least-squares fit, with its covariance. GICP
registers rigid bodies: it would leave out the scale, which is what views differ by.
"""

from dataclasses import dataclass, field
from typing import List, Optional, Tuple

import gtsam
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges.features import Features
from fcsv_stereo.survey.edges.matching import match, predicted
from fcsv_stereo.survey.edges.warping import tracked
from fcsv_stereo.survey.views.view import View

_ITERATIONS = 6
_STEP = 1e-6  # of numerical derivatives along the tangent


@dataclass(frozen=True)
class Edge:
    """Views ``a`` and ``b`` by name. ``S_a_b`` takes points of b's camera to a's, in the metres of
    each map.

    ``covariance`` (7,7) of its tangent; ``residual_m`` rms over the matches. ``reason`` says why
    there is no edge, or why it does not count; empty where it does.
    """

    a: str
    b: str
    S_a_b: Optional[gtsam.Similarity3] = None
    covariance: Optional[np.ndarray] = field(default=None, repr=False)
    residual_m: Optional[float] = None
    matches: int = 0
    reason: str = ""

    @property
    def kept(self) -> bool:
        return not self.reason


def find_edge(a: View, b: View, features_a: Features, features_b: Features, alike: bool) -> Edge:
    """The edge between two views. Where there is none its ``reason`` says why. ``alike``: whether
    they look alike (``ViewPair``); then they are loaded, and places are tracked, too."""
    gate = None
    if a.prior.placed and b.prior.placed:
        gate = predicted(features_a.points, a.prior, b.prior, b)
    pairs = match(features_a, features_b, gate)
    in_a, in_b = features_a[pairs[:, 0]], features_b[pairs[:, 1]]
    if alike:
        here, there = a.load(), b.load()
        for found in (tracked(here, there), (tracked(there, here) or ())[::-1]):
            if found:
                in_a, in_b = in_a.joined_with(found[0]), in_b.joined_with(found[1])
    return edge_of(a.name, b.name, in_a, in_b)


def edge_of(a: str, b: str, in_a: Features, in_b: Features, seed: int = 0) -> Edge:
    """The edge that matched features (N each) give."""
    count = len(in_a)
    if count < tuning.LEAST_MATCHES:
        return Edge(
            a,
            b,
            matches=count,
            reason=f"{count} features are alike; {tuning.LEAST_MATCHES} are needed",
        )
    found = _consensus(in_a, in_b, np.random.default_rng([seed, count]))
    inliers = 0 if found is None else int(found[1].sum())
    least = max(tuning.LEAST_MATCHES, int(np.ceil(tuning.LEAST_SHARE * count)))
    if found is None or inliers < least:
        said = f"{inliers} of {count} matches agree on one similarity; {least} are needed"
        return Edge(a, b, matches=inliers, reason=said)
    S, inside = found
    S, covariance, residual_m = _settled(S, in_a[inside], in_b[inside])
    edge = Edge(a, b, S, covariance, residual_m, inliers)
    return Edge(a, b, S, covariance, residual_m, inliers, _too_loose(edge))


def _too_loose(edge: Edge) -> str:
    """Why an edge says too little; empty where it does not."""
    scale, rad = (
        edge.covariance[6, 6] ** 0.5,
        np.linalg.eigvalsh(edge.covariance[:3, :3])[-1] ** 0.5,
    )
    ratio = edge.S_a_b.scale()
    if not 1.0 / tuning.MOST_RATIO < ratio < tuning.MOST_RATIO:
        return f"lengths would differ {ratio:.2f} times between the two views: not one unit of length, or a wrong match"
    if scale > tuning.MOST_EDGE_SCALE or rad > tuning.MOST_EDGE_RAD:
        known = (
            f"its scale is known to {scale:.1%} and its turn to {np.degrees(rad):.1f} degrees only"
        )
        return f"{known}: too little overlap"
    return ""


def _consensus(
    in_a: Features, in_b: Features, random
) -> Optional[Tuple[gtsam.Similarity3, np.ndarray]]:
    """The similarity that most matches agree with, and which (N,) bool; None where three never
    do."""
    count = len(in_a)
    triples = np.stack([random.choice(count, 3, replace=False) for _ in range(tuning.DRAWS)])
    starts = similarity.fit(in_a.points[triples], in_b.points[triples])
    scales = np.cbrt(np.maximum(np.linalg.det(starts[:, :3, :3]), 0.0))
    starts = starts[(scales > 1.0 / tuning.MOST_RATIO) & (scales < tuning.MOST_RATIO)]
    some = random.permutation(count)[: tuning.SCORED]
    some_a, some_b = in_a[some], in_b[some]
    scored = sorted(
        starts, key=lambda M: -_agreeing(M, some_a, some_b, tuning.TOLERANCES_PX[0]).sum()
    )
    best: Optional[Tuple[gtsam.Similarity3, np.ndarray]] = None
    for M in scored[: tuning.REFINED_DRAWS]:
        S = similarity.of_matrix(M)
        for tolerance_px in tuning.TOLERANCES_PX:
            inside = _agreeing(similarity.matrix(S), in_a, in_b, tolerance_px)
            if inside.sum() < 4:
                break
            S = _fitted(S, in_a[inside], in_b[inside], 2)[0]
            if not 1.0 / tuning.MOST_RATIO < S.scale() < tuning.MOST_RATIO:
                break  # few places in a line let it shrink to a point
        inside = _agreeing(similarity.matrix(S), in_a, in_b, 0.0)
        if best is None or inside.sum() > best[1].sum():
            best = S, inside
    return best


def _residuals(M_a_b: np.ndarray, in_a: Features, in_b: Features) -> Tuple[np.ndarray, np.ndarray]:
    """(N,3) m in a, and their covariances (N,3,3)."""
    A = M_a_b[:3, :3]
    away = in_a.points - (in_b.points @ A.T + M_a_b[:3, 3])
    return away, in_a.covariances + A @ in_b.covariances @ A.T


def _agreeing(M_a_b: np.ndarray, in_a: Features, in_b: Features, tolerance_px: float) -> np.ndarray:
    """(N,) bool; ``tolerance_px``: what the similarity itself may be off."""
    away, covariances = _residuals(M_a_b, in_a, in_b)
    off_m = tolerance_px * in_a.points[:, 2] / in_a.camera.fx
    covariances = covariances + np.square(off_m)[:, None, None] * np.eye(3)
    chi2 = np.einsum("ni,ni->n", away, np.linalg.solve(covariances, away[..., None])[..., 0])
    return chi2 < tuning.MOST_CHI2


def _fitted(
    S: gtsam.Similarity3, in_a: Features, in_b: Features, iterations: int = _ITERATIONS
) -> Tuple[gtsam.Similarity3, np.ndarray]:
    """Gauss-Newton over the tangent with the points' covariances; the similarity and its normal
    matrix (7,7)."""
    for _ in range(iterations):
        away, covariances = _residuals(similarity.matrix(S), in_a, in_b)
        moved = similarity.apply(S, in_b.points)
        J = np.stack(
            [
                (similarity.apply(S.retract(d), in_b.points) - moved) / _STEP
                for d in _STEP * np.eye(7)
            ],
            -1,
        )
        weighed = np.linalg.solve(covariances, J)
        H = np.einsum("nik,nil->kl", J, weighed)
        step = np.linalg.lstsq(H, np.einsum("nik,ni->k", weighed, away), rcond=1e-12)[0]
        S = S.retract(step)
        if np.abs(step).max() < 1e-7:
            break
    return S, H


def _settled(
    S: gtsam.Similarity3, in_a: Features, in_b: Features
) -> Tuple[gtsam.Similarity3, np.ndarray, float]:
    """The last fit with its covariance and rms residual (m).

    Depths of one picture share a part of their errors, so that N matches are worth N / (1 + c N)
    independent ones.
    """
    S, H = _fitted(S, in_a, in_b)
    away, covariances = _residuals(similarity.matrix(S), in_a, in_b)
    count = len(away)
    chi2 = np.einsum("ni,ni->n", away, np.linalg.solve(covariances, away[..., None])[..., 0]).sum()
    worse = max(1.0, chi2 / max(3 * count - similarity.TANGENT, 1)) * (
        1.0 + tuning.COMMON_SHARE * count
    )
    return S, worse * np.linalg.pinv(H), float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def posed_edge(a: View, b: View) -> Edge:
    """The edge that one model of poses states between two of its photographs: as well as ``map``
    takes such poses to be known."""
    T_a_b = transforms.invert(a.T_home_cam) @ b.T_home_cam
    away = max(float(np.linalg.norm(T_a_b[:3, 3])), 1e-6)
    sigmas = [*[tuning.POSED_RAD] * 3, *[tuning.POSED_SHARE * away] * 3, tuning.POSED_SCALE]
    return Edge(a.name, b.name, similarity.of_pose(T_a_b), np.diag(np.square(sigmas)))


def with_reasons(edges: List[Edge], reasons: dict) -> List[Edge]:
    """Edges with a reason where ``reasons`` has one by (a, b)."""
    return [
        Edge(
            e.a,
            e.b,
            e.S_a_b,
            e.covariance,
            e.residual_m,
            e.matches,
            reasons.get((e.a, e.b), e.reason),
        )
        for e in edges
    ]
