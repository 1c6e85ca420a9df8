# SPDX-License-Identifier: Apache-2.0
"""Scale, turn and place of a model whose scale is its own, from GPS; places that contradict the others do not count."""

from dataclasses import dataclass
from itertools import combinations
from typing import Optional, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fcsv_stereo.errors import InputError

_TRIPLES = 300  # tried as a start; all of them up to 13 places
_LEVEL_SIGMA = np.sin(np.radians(5.0))  # people and gimbals hold a camera's long side level to that, sky above ground
_GIMBAL_SIGMA_RAD = np.radians(5.0)  # its yaw is the vehicle's compass
_TRIED = 2  # of the starts
_OUTLIER = 4.0  # standard deviations
_BELIEF = 6  # so many residuals would it take to outweigh what is said of GPS
FEWEST, MOST_SCALE_SIGMA = 3, 0.3


@dataclass(frozen=True)
class Similarity:
    """p_enu = scale * R_enu_model @ p_model + t_enu; residuals (N, 3) m (GPS less model); which places have no say.

    ``scale_sigma`` is a share of the scale, ``turn_sigma_rad`` about the axis that is known worst.
    ``gps_factor``: how large residuals are against what was said of GPS.
    """

    scale: float
    R_enu_model: np.ndarray
    t_enu: np.ndarray
    residuals_m: np.ndarray
    outliers: np.ndarray
    scale_sigma: float
    turn_sigma_rad: float
    gps_factor: float

    def pose(self, T_model_cam: np.ndarray) -> np.ndarray:
        """T_enu_cam."""
        T = np.eye(4)
        T[:3, :3] = self.R_enu_model @ T_model_cam[:3, :3]
        T[:3, 3] = self.scale * self.R_enu_model @ T_model_cam[:3, 3] + self.t_enu
        return T


def fit(
    p_model: np.ndarray, p_enu_m: np.ndarray, sigmas_m: np.ndarray, R_model_cam: np.ndarray,
    R_enu_cam: Sequence[Optional[np.ndarray]],
) -> Similarity:  # fmt: skip
    """From places (N, 3) in both, GPS's standard deviations (N, 3), and the cameras' rotations (N, 3, 3).

    ``R_enu_cam`` are the gimbals', None where there is none: then the picture's long side is taken to be level.
    Raises InputError where the places do not fix the scale.
    """
    if len(p_model) < FEWEST:
        raise InputError(f"{len(p_model)} photographs have both GPS and a pose; scale and turn need {FEWEST}")
    spread_m = float(np.linalg.svd(p_enu_m - p_enu_m.mean(axis=0), compute_uv=False)[0])
    if spread_m < 2.0 * float(np.median(sigmas_m)):
        raise InputError(f"the photographs were taken within {spread_m:.1f} m, which GPS cannot tell apart")

    middle = p_model.mean(axis=0)  # about it scale and turn do not move the places as one
    problem = _Problem(p_model - middle, p_enu_m, sigmas_m, R_model_cam, R_enu_cam)
    starts = sorted(_starts(problem.p_model, p_enu_m, sigmas_m), key=problem.misfit)[:_TRIED]
    robust = [problem.solve(*start, "cauchy") for start in starts]
    x, R, _ = min(robust, key=lambda f: f[2].cost)
    outliers = np.linalg.norm(problem.away_m(x, R) / sigmas_m, axis=1) > _OUTLIER
    if (~outliers).sum() < FEWEST:
        raise InputError(f"GPS contradicts the poses: {int(outliers.sum())} of {len(p_model)} places are elsewhere")
    x, R, last = problem.solve(np.exp(x[0]), R, x[4:], "linear", ~outliers)
    away_m = problem.away_m(x, R)
    kept = (away_m / sigmas_m)[~outliers]
    factor = float(np.sqrt((_BELIEF + np.square(kept).sum()) / (_BELIEF + max(kept.size - 7, 0))))
    covariance = np.linalg.pinv(last.jac.T @ last.jac) * factor**2
    scale_sigma = float(np.sqrt(covariance[0, 0]))
    if not scale_sigma < MOST_SCALE_SIGMA:
        raise InputError(
            f"GPS does not fix the scale: it is known to {scale_sigma:.0%} only; photographs further apart would fix it"
        )
    turn = float(np.sqrt(np.linalg.eigvalsh(covariance[1:4, 1:4])[-1]))
    scale = float(np.exp(x[0]))
    return Similarity(scale, R, x[4:] - scale * R @ middle, away_m, outliers, scale_sigma, turn, factor)


@dataclass(frozen=True)
class _Problem:
    """What is to be fitted; unknowns are the logarithm of the scale, a small turn, the shift."""

    p_model: np.ndarray
    p_enu_m: np.ndarray
    sigmas_m: np.ndarray
    R_model_cam: np.ndarray
    R_enu_cam: Sequence[Optional[np.ndarray]]

    def solve(self, scale: float, R: np.ndarray, t: np.ndarray, loss: str, of=slice(None)):
        """(x, R_enu_model, scipy's result) from a start and the places ``of`` it."""

        def residuals(x: np.ndarray) -> np.ndarray:
            turned = Rotation.from_rotvec(x[1:4]).as_matrix() @ R
            return np.concatenate([(self.away_m(x, turned) / self.sigmas_m)[of].ravel(), self.attitudes(turned)])

        found = least_squares(residuals, np.concatenate([[np.log(scale), 0, 0, 0], t]), loss=loss, x_scale="jac")
        return found.x, Rotation.from_rotvec(found.x[1:4]).as_matrix() @ R, found

    def misfit(self, start) -> float:
        """Robust cost of a start (scale, R, t)."""
        scale, R, t = start
        away = self.away_m(np.concatenate([[np.log(scale), 0, 0, 0], t]), R) / self.sigmas_m
        return float(np.log1p(np.square(away)).sum() + np.log1p(np.square(self.attitudes(R))).sum())

    def away_m(self, x: np.ndarray, R: np.ndarray) -> np.ndarray:
        """(N, 3): GPS less the model."""
        return self.p_enu_m - (np.exp(x[0]) * self.p_model @ R.T + x[4:])

    def attitudes(self, R: np.ndarray) -> np.ndarray:
        """In standard deviations: from the gimbals'; of the others' rows from level, and of their down from above."""
        R_enu_cam = R @ self.R_model_cam
        told = np.array([g is not None for g in self.R_enu_cam])
        rows, down = R_enu_cam[~told, 2, 0], np.maximum(R_enu_cam[~told, 2, 1] - _LEVEL_SIGMA, 0.0)
        gimbals = np.array([g for g in self.R_enu_cam if g is not None]).reshape(-1, 3, 3)
        turns = gimbals.transpose(0, 2, 1) @ R_enu_cam[told]
        turns = Rotation.from_matrix(turns).as_rotvec() if told.any() else turns
        return np.concatenate([rows / _LEVEL_SIGMA, down / _LEVEL_SIGMA, turns.ravel() / _GIMBAL_SIGMA_RAD])


def _starts(p_model: np.ndarray, p_enu_m: np.ndarray, sigmas_m: np.ndarray):
    """Of triples' similarities the one with the least median residual, turned about the line along which the places
    lie: GPS tells little of that turn where they lie on one."""
    triples = list(combinations(range(len(p_model)), 3))
    if len(triples) > _TRIPLES:
        rng = np.random.default_rng(0)
        triples = [rng.choice(len(p_model), 3, replace=False) for _ in range(_TRIPLES)]
    candidates = [_closed(p_model[list(t)], p_enu_m[list(t)]) for t in triples] + [_closed(p_model, p_enu_m)]

    def median(candidate) -> float:
        s, R, t = candidate
        return float(np.median(np.linalg.norm((s * p_model @ R.T + t - p_enu_m) / sigmas_m, axis=1)))

    s, R, _ = min((c for c in candidates if c is not None), key=median)
    middle_model, middle_enu = np.median(p_model, axis=0), np.median(p_enu_m, axis=0)
    line = np.linalg.svd(p_enu_m - p_enu_m.mean(axis=0))[2][0]
    for angle in np.radians([0, 60, 120, 180, 240, 300]):
        turned = Rotation.from_rotvec(angle * line).as_matrix() @ R
        yield s, turned, middle_enu - s * turned @ middle_model


def _closed(p_model: np.ndarray, p_enu_m: np.ndarray):
    """Scale, rotation and shift of least squares (Umeyama 1991); None where the places are one."""
    a, b = p_model - p_model.mean(axis=0), p_enu_m - p_enu_m.mean(axis=0)
    if not (np.square(a).sum() > 0.0 and np.square(b).sum() > 0.0):
        return None
    U, S, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0])
    R, s = U @ np.diag(sign) @ Vt, float((S * sign).sum() / np.square(a).sum())
    if s <= 0.0:
        return None
    return s, R, p_enu_m.mean(axis=0) - s * R @ p_model.mean(axis=0)
