# SPDX-License-Identifier: Apache-2.0
"""How far an estimated trajectory is from a reference: ATE and RPE (Sturm et al., IROS 2012), drift
per metre."""

from dataclasses import asdict, dataclass
from typing import Dict, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_tracking.errors import EvaluationError
from fcsv_tracking.evaluation.tracks import Track, at_stamps

ALIGNMENTS = ("none", "first", "yaw", "se3")
_LEAST_POSES = 3


@dataclass(frozen=True)
class Statistics:
    """Holds statistics of one kind of error."""

    rmse: float
    mean: float
    median: float
    max: float


@dataclass(frozen=True)
class TrackEvaluation:
    """ATE after alignment, RPE over ``delta_m`` of the reference's path, and what drifts per metre
    flown."""

    poses: int
    path_m: float
    alignment: str
    delta_m: float
    ate_m: Statistics
    ate_deg: Statistics
    rpe_m: Statistics
    rpe_deg: Statistics
    drift_m_per_m: float
    drift_deg_per_m: float

    def as_dict(self) -> Dict:
        return asdict(self)


def evaluate(
    estimate: Track,
    reference: Track,
    alignment: str = "yaw",
    delta_m: float = 1.0,
    gap_s: float = 0.25,
) -> TrackEvaluation:
    """The estimate against the reference, which is interpolated to the estimate's stamps over gaps
    of ``gap_s``.

    Raises EvaluationError where they share too little.
    """
    estimated, true = matched(estimate, reference, gap_s)
    aligned = align(estimated, true, alignment) @ estimated
    path_m = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1))]
    )
    pairs = pairs_by_path(path_m, delta_m)
    moves_m, turns_deg = relative_errors(estimated, true, pairs)
    lengths_m = path_m[pairs[:, 1]] - path_m[pairs[:, 0]]
    off_m, off_deg = absolute_errors(aligned, true)
    return TrackEvaluation(
        len(true),
        float(path_m[-1]),
        alignment,
        delta_m,
        statistics(off_m),
        statistics(off_deg),
        statistics(moves_m),
        statistics(turns_deg),
        float(np.mean(moves_m / lengths_m)),
        float(np.mean(turns_deg / lengths_m)),
    )


def matched(estimate: Track, reference: Track, gap_s: float) -> Tuple[np.ndarray, np.ndarray]:
    """Poses (M,4,4) of the estimate inside the reference, and the reference's at the same
    stamps."""
    inside, true = at_stamps(reference, estimate.stamps_s, gap_s)
    if inside.sum() < _LEAST_POSES:
        spans = [f"{t.stamps_s[0]:.3f} to {t.stamps_s[-1]:.3f} s" for t in (estimate, reference)]
        raise EvaluationError(
            f"only {inside.sum()} poses of the estimate ({spans[0]}) lie inside the reference ({spans[1]}): are they "
            f"of one flight and by one clock?"
        )
    return estimate.T_a_b[inside], true


def align(estimated: np.ndarray, true: np.ndarray, alignment: str) -> np.ndarray:
    """T_true_estimated: the identity, first pose onto first pose, or least squares over positions
    (Umeyama 1991).

    "yaw" turns about the vertical alone, as two gravity-aligned odometries differ; "se3" in all
    ways, without scale.
    """
    if alignment == "none":
        return np.eye(4)
    if alignment == "first":
        return true[0] @ transforms.invert(estimated[0])
    p, q = estimated[:, :3, 3], true[:, :3, 3]
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    S = (q - q_mean).T @ (p - p_mean)
    if alignment == "yaw":
        yaw = np.arctan2(S[1, 0] - S[0, 1], S[0, 0] + S[1, 1])
        R = transforms.from_xyz_yaw(np.zeros(3), yaw)[:3, :3]
    elif alignment == "se3":
        U, singular, Vt = np.linalg.svd(S)
        if singular[1] < 1e-9 * max(singular[0], 1e-12):
            raise EvaluationError(
                "positions lie on a line: 'se3' cannot align them; use --align yaw or first"
            )
        R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    else:
        raise EvaluationError(f"alignment '{alignment}' is not one of {', '.join(ALIGNMENTS)}")
    return transforms.transform(R, q_mean - R @ p_mean)


def pairs_by_path(path_m: np.ndarray, delta_m: float) -> np.ndarray:
    """Indices (K,2): from every pose to the first that is ``delta_m`` further along. Raises
    EvaluationError."""
    if not delta_m > 0:
        raise EvaluationError(f"delta {delta_m} m must be positive")
    ends = np.searchsorted(path_m, path_m + delta_m - 1e-9)
    pairs = np.array([(i, j) for i, j in enumerate(ends) if j < len(path_m)]).reshape(-1, 2)
    if not len(pairs):
        raise EvaluationError(
            f"the reference moves {path_m[-1]:.2f} m, less than the {delta_m:g} m asked for: --delta-m"
        )
    return pairs


def absolute_errors(aligned: np.ndarray, true: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """(N,) m and deg between poses (N,4,4)."""
    turned = Rotation.from_matrix(true[:, :3, :3]).inv() * Rotation.from_matrix(aligned[:, :3, :3])
    return np.linalg.norm(aligned[:, :3, 3] - true[:, :3, 3], axis=1), np.degrees(
        turned.magnitude()
    )


def relative_errors(
    estimated: np.ndarray, true: np.ndarray, pairs: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """(K,) m and deg: inv(true step) @ estimated step of each pair of indices (K,2)."""
    steps = [np.linalg.inv(T[pairs[:, 0]]) @ T[pairs[:, 1]] for T in (true, estimated)]
    E = np.linalg.inv(steps[0]) @ steps[1]
    return np.linalg.norm(E[:, :3, 3], axis=1), np.degrees(
        Rotation.from_matrix(E[:, :3, :3]).magnitude()
    )


def statistics(errors: np.ndarray) -> Statistics:
    rmse = float(np.sqrt(np.mean(np.square(errors))))
    return Statistics(rmse, float(np.mean(errors)), float(np.median(errors)), float(np.max(errors)))
