# SPDX-License-Identifier: Apache-2.0
"""Prior positions that contradict each other: a minority loses its say in the scale; a draw widens
its sigma."""

from dataclasses import replace
from typing import Dict, Tuple

import numpy as np

from fcsv_geometry import chi_squared
from fcsv_stereo.refinement.adjust import AdjustedPoses, Problem, adjust
from fcsv_stereo.refinement.geometry import PairPrior

_WRONG = 4.0  # standard deviations of a prior's position, as the surprise that is told
_IMPROBABLE = 0.999  # of the priors' scales: that they differ by less, where all are right


def settled(problem: Problem, adjusted: AdjustedPoses) -> Tuple[Problem, AdjustedPoses]:
    """The adjustment again without the positions of priors that a majority contradicts; where no
    majority agrees, as it was, with the contradiction in the covariance."""
    loose, last = problem, adjusted
    wrong: Dict[int, float] = {}
    while True:
        away = {k: _away(p, last.poses[k]) for k, p in problem.priors.items() if k not in wrong}
        worst = max(away, key=away.get, default=None)
        if worst is None or away[worst] <= _WRONG:
            break
        wrong[worst] = away[worst]
        if 2 * len(wrong) >= len(problem.priors):  # no majority
            return problem, _doubted(problem.priors, adjusted)
        priors = {
            k: _loosened(p, adjusted.poses[k]) if k in wrong else p
            for k, p in problem.priors.items()
        }
        loose = replace(problem, priors=priors)
        last = adjust(loose, last.poses, last.rho)
    kept = {k: p for k, p in problem.priors.items() if k not in wrong}
    return loose, _doubted(kept, last)


def _away(prior: PairPrior, T_ref_cam: np.ndarray) -> float:
    """How far the position is from its prior, in standard deviations."""
    off_m = prior.T_a_b[:3, :3].T @ (T_ref_cam[:3, 3] - prior.T_a_b[:3, 3])
    return float(np.sqrt(off_m @ np.linalg.solve(prior.full_covariance[3:, 3:], off_m)))


def _loosened(prior: PairPrior, T_ref_cam: np.ndarray) -> PairPrior:
    """Gives the prior with a position that is known to the whole baseline only."""
    wide_m = max(float(np.linalg.norm(T_ref_cam[:3, 3])), prior.position_m)
    covariance = prior.covariance
    if covariance is not None:
        covariance = covariance.copy()
        covariance[:3, 3:] = covariance[3:, :3] = 0.0
        covariance[3:, 3:] = wide_m**2 * np.eye(3)
    return replace(prior, position_m=wide_m, covariance=covariance)


def _doubted(priors: Dict[int, PairPrior], adjusted: AdjustedPoses) -> AdjustedPoses:
    """Adds with what the priors' lengths say against one common scale, where that is more than
    their errors explain."""
    scales, weights = [], []
    for k, prior in priors.items():
        p_m = adjusted.poses[k][:3, 3]
        length_m = float(np.linalg.norm(p_m))
        along = prior.T_a_b[:3, :3].T @ p_m / max(length_m, 1e-9)
        scales.append(float(np.linalg.norm(prior.T_a_b[:3, 3])) / max(length_m, 1e-9))
        weights.append(length_m**2 / float(along @ prior.full_covariance[3:, 3:] @ along))
    if len(scales) < 2:
        return adjusted
    freedom, w = len(scales) - 1, np.array(weights)
    mean = float(np.average(scales, weights=w))
    misfit = float((w * np.square(np.array(scales) - mean)).sum())
    if misfit <= chi_squared.quantile(_IMPROBABLE, freedom):
        return adjusted
    share = np.sqrt((misfit / freedom - 1.0) / w.sum())  # Birge's ratio
    moved = np.concatenate(
        [[0, 0, 0, *adjusted.poses[k][:3, :3].T @ adjusted.poses[k][:3, 3]] for k in adjusted.order]
    )
    return replace(adjusted, covariance=adjusted.covariance + share**2 * np.outer(moved, moved))
