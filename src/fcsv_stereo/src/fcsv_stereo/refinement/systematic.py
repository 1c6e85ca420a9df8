# SPDX-License-Identifier: Apache-2.0
"""What errors that all points of a picture share make of the poses: distortion left over, rows read
late, a detector's bias.

Noise averages out over thousands of points, these do not. A yaw and the depth of a narrow pair
differ by the vertical shift in the picture's corners alone (f yaw x y), so that a tenth of a pixel
there is a tenth of a degree. The errors are taken for smooth fields over each picture. Their size
is what the residuals show of them; the part that looks like a pose or a depth does not show, and is
taken to be as large. The fields are considered, not estimated (Schmidt 1966: consider parameters):
the poses stay as they are, and their covariance grows by what such fields would make of them.
"""

from dataclasses import dataclass
from typing import Dict

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.refinement import fields
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.structure import Structure


@dataclass(frozen=True)
class Systematic:
    """``covariance`` (6n, 6n) is to be added to ``Adjusted.covariance``, in its order and axes;
    ``field_px`` is how large the fields are (rms per axis over a picture), ``focal_sigma`` what
    they make of a free focal length (a share)."""

    covariance: np.ndarray
    field_px: float
    focal_sigma: float = 0.0


def systematic(consensus: Consensus, cameras: Dict[int, PinholeCamera]) -> Systematic:
    """One linear step from what was adjusted, as ``readout_turns``; ``cameras`` (by picture) are
    the features'."""
    problem, adjusted, o = consensus.problem, consensus.adjusted, consensus.observations
    structure = Structure(o, adjusted.rho, problem.focals_px, problem.noise_px)
    at = structure.linearise(adjusted.poses, adjusted.focal_scale)
    weight, _ = structure.weights(at.residual)
    n = 6 * len(adjusted.order)
    pose = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(adjusted.order)}
    held = n + int(problem.focal_sigma > 0.0)
    terms = 2 * fields.TERMS
    field = {
        k: slice(held + terms * i, held + terms * (i + 1))
        for i, k in enumerate([0, *adjusted.order])
    }
    parts = []
    for (a, k, of), (to_a, to_k, to_focal) in zip(structure.groups, at.by_group):
        used = [(pose[p], J) for p, J in ((a, to_a), (k, to_k)) if p in pose]
        used += [(slice(n, held), to_focal)] if held > n else []
        rays = o.anchor_rays[o.point[of]]
        used.append((field[a], fields.of_anchor(cameras[a], rays, to_a)))
        used.append((field[k], -fields.of_picture(cameras[k], o.rays[of])))
        parts.append(used)
    H, g = structure.eliminated(at, weight, parts, held + terms * len(field))
    for k in adjusted.order:
        H[pose[k], pose[k]] += np.linalg.inv(problem.priors[k].full_covariance)
    if held > n:
        H[n, n] += problem.focal_sigma**-2
    moved = np.linalg.solve(H[:held, :held], H[:held, held:])  # of the poses by each term
    left = H[held:, held:] - H[held:, :held] @ moved
    field_px = _field_px(left, g[held:])
    moved *= field_px / fields.TERMS**0.5
    return Systematic(moved[:n] @ moved[:n].T, field_px, float(np.linalg.norm(moved[n:held])))


def _field_px(information: np.ndarray, gradient: np.ndarray) -> float:
    """How large the fields are by the residuals' gradient (K,), the poses being free to follow
    them.

    In a direction of information l that they show, the gradient has the variance c l + l^2 s^2: c l
    is noise, s^2 the variance of each term. The posterior's mean square over SIZES_PX.
    """
    value, vector = np.linalg.eigh(information)
    shown = value > 1e-6 * value[-1]
    value, square = value[shown], np.square(vector.T @ gradient)[shown]
    variance = fields.NOISE_SHARE * value + np.outer(
        np.square(fields.SIZES_PX) / fields.TERMS, np.square(value)
    )
    likely = fields.log_prior() - 0.5 * (np.log(variance) + square / variance).sum(axis=1)
    weight = np.exp(likely - likely.max())
    return float(np.sqrt(weight @ np.square(fields.SIZES_PX) / weight.sum()))
