# SPDX-License-Identifier: Apache-2.0
"""The link between two level odometry frames from many detections of one tag (thesis 6.1, jointly,
robustly).

One small tag seen square-on gives yaw to several degrees, with two solutions mirrored about the
line of sight. All detections together give a tenth of that, more so when the vehicle in front sways
sideways.
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from fcsv_geometry import transforms
from fcsv_geometry.rotations import wrap
from fcsv_tracking.column.detection import Detection, single_link
from fcsv_tracking.column.link_model import LinkModel, LinkNoise
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tags import planar_poses

# 8 degrees of freedom; the limit is exceeded by one in a thousand
_CHI2_8_MEDIAN, _CHI2_8_LIMIT = 7.34, 26.1
_RIVAL_CHI2 = 9.0  # a second minimum within three sigma of the best is a rival
_RIVAL_TURN_RAD = np.radians(0.3)


@dataclass(frozen=True)
class LinkSolution:
    """T_Op_Oc, covariance (4, 4) of x, y, z, yaw; ``used`` (N,) tells which detections it stands
    on.

    Spreads are of the single detections about the result: of the tag's position, and of the yaw of
    the better fitting of the two planar solutions.
    """

    T_Op_Oc: np.ndarray
    covariance: np.ndarray
    used: np.ndarray
    reprojection_rms_px: float
    position_spread_m: float
    yaw_spread_rad: float


def solve_link(detections: Sequence[Detection], noise: LinkNoise) -> LinkSolution:
    """The link that explains the detections best, at the last of them; they come in order of time.

    Raises CalibrationRefused where fewer than half agree on one.
    """
    poses = [[T for T, _ in planar_poses(d.corners_normalized, d.size_m)] for d in detections]
    model = LinkModel(detections, noise)
    x, rival_yaw = _robust(model, _starts(model, detections, poses))
    used = _inliers(model, x)
    if used.sum() < len(detections) / 2:
        raise CalibrationRefused(f"only {used.sum()} of {len(detections)} detections agree")
    kept = model.subset(used).with_measured_corners(x)
    x, covariance = _weighted(kept, x)
    if rival_yaw is not None:
        covariance[3, 3] += (0.5 * wrap(rival_yaw - x[3])) ** 2
    T_Op_Oc, covariance = model.link(x, covariance + kept.drift_covariance(x))
    rms_px = float(np.sqrt((kept.residuals(x) ** 2).sum(axis=1).mean() / 4.0))
    spread = _spread([(d, p) for d, p, u in zip(detections, poses, used) if u], T_Op_Oc)
    return LinkSolution(T_Op_Oc, covariance, used, rms_px, *spread)


def _starts(
    model: LinkModel, detections: Sequence[Detection], poses: List[List[np.ndarray]]
) -> List[np.ndarray]:
    """Up to three starting points: minima of the clipped error over a turn of yaw.

    The distance to a tag is sure even where its normal is not, so for any yaw the position follows
    from the tag's centres; the median of single-detection yaws would mix the mirrored solutions.
    """
    p_Oc_A = np.stack(
        [transforms.apply(d.T_odom_cam, T[0][:3, 3]) for d, T in zip(detections, poses)]
    )
    starts, costs = [], []
    for yaw in np.radians(np.arange(0.0, 360.0, 4.0)):
        rotated = transforms.apply(
            transforms.from_xyz_yaw(np.zeros(3), yaw), p_Oc_A - model.mean_Oc_C
        )
        x = np.array([*np.median(model.p_Op_A - rotated, axis=0), yaw])
        error = np.nan_to_num((model.residuals(x) ** 2).mean(axis=1), nan=1e9)
        starts.append(x)
        costs.append(np.minimum(error, 1e4).mean())
    costs = np.array(costs)
    minima = np.flatnonzero((costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1)))
    return [starts[i] for i in minima[np.argsort(costs[minima])][:3]]


def _robust(model: LinkModel, starts: List[np.ndarray]) -> Tuple[np.ndarray, Optional[float]]:
    """The best of the minima under a robust loss, and the yaw of a rival where one fits nearly as
    well."""
    results = []
    for x in starts:
        for _ in range(2):  # the weights depend on the distance, which the first round finds
            result = _fit_blocks(model, x)
            x = result.x
        results.append((2.0 * float(result.cost), x))
    results.sort(key=lambda r: r[0])
    best_cost, best = results[0]
    for cost, x in results[1:]:
        if cost - best_cost < _RIVAL_CHI2 and abs(wrap(x[3] - best[3])) > _RIVAL_TURN_RAD:
            return best, float(x[3])
    return best, None


def _fit_blocks(model: LinkModel, x0: np.ndarray) -> OptimizeResult:
    """Each detection whitened by its own covariance, soft L1 against outliers."""
    L = np.linalg.cholesky(model.blocks(x0))
    return least_squares(
        lambda x: np.linalg.solve(L, model.residuals(x)[..., None]).ravel(),
        x0,
        jac=lambda x: np.linalg.solve(L, model.jacobian(x)).reshape(-1, 4),
        loss="soft_l1",
        f_scale=2.0,
        max_nfev=60,
    )


def _inliers(model: LinkModel, x: np.ndarray) -> np.ndarray:
    """(N,) which detections lie within their own covariance, scaled up where all are worse than
    assumed."""
    L = np.linalg.cholesky(model.blocks(x))
    chi2 = (np.linalg.solve(L, model.residuals(x)[..., None]) ** 2).sum(axis=(1, 2))
    scale = np.clip(np.median(chi2) / _CHI2_8_MEDIAN, 1.0, 25.0)
    return (chi2 < _CHI2_8_LIMIT * scale) & np.isfinite(chi2)


def _weighted(model: LinkModel, x0: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Generalised least squares with the walk of both odometries; covariance never better than the
    residuals say."""
    L = np.linalg.cholesky(model.covariance(x0))
    result = least_squares(
        lambda x: np.linalg.solve(L, model.residuals(x).ravel()),
        x0,
        jac=lambda x: np.linalg.solve(L, model.jacobian(x).reshape(-1, 4)),
        max_nfev=30,
    )
    chi2_per_dof = 2.0 * result.cost / (8 * len(model) - 4)
    return result.x, np.linalg.inv(result.jac.T @ result.jac) * max(1.0, chi2_per_dof)


def _spread(
    kept: Sequence[Tuple[Detection, List[np.ndarray]]], T_Op_Oc: np.ndarray
) -> Tuple[float, float]:
    """rms of the single detections about the result: tag position (m), yaw (rad)."""
    misses_m, turns_rad = [], []
    for d, poses in kept:
        seen = transforms.apply(T_Op_Oc @ d.T_odom_cam, poses[0][:3, 3])
        misses_m.append(np.linalg.norm(seen - d.T_odom_tag[:3, 3]))
        turns_rad.append(
            min(abs(transforms.yaw(single_link(d, T) @ transforms.invert(T_Op_Oc))) for T in poses)
        )
    return float(np.sqrt(np.mean(np.square(misses_m)))), float(
        np.sqrt(np.mean(np.square(turns_rad)))
    )
