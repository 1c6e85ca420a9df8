# SPDX-License-Identifier: Apache-2.0
"""What errors that all points of a picture share make of the poses: distortion left over, rows read late, a detector's
bias.

Noise averages out over thousands of points, these do not. A yaw and the depth of a narrow pair differ by the vertical
shift in the picture's corners alone (f yaw x y), so that a tenth of a pixel there is a tenth of a degree. The errors
are taken for smooth fields over each picture. Their size is what the residuals show of them; the part that looks like a
pose or a depth does not show, and is taken to be as large. The fields are considered, not estimated (Schmidt 1966:
consider parameters): the poses stay as they are, and their covariance grows by what such fields would make of them.
"""

from dataclasses import dataclass
from typing import Dict

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.focal import ANY_FOCAL
from fcsv_stereo.refinement.structure import Structure

#: Standard deviation (px per axis) of the fields, rms over a picture, before the residuals tell, and by which factor
#: (its logarithm's standard deviation) it may be off.
_USUAL_PX, _SPREAD = 0.01, 1.2
_SIZES_PX = np.geomspace(0.005, 1.0, 60)
#: Of the variance that is stated of the residuals' noise (2.5 times its spread, ``consensus``): what smooth fields see
#: of it. 0.16 would be independent noise, 1 noise that is as much alike over whole pictures as among neighbours.
_NOISE_SHARE = 0.5
_DEGREE, _TERMS = 3, 10  # as a lens's first radial term, and rows that are read while the camera turns


@dataclass(frozen=True)
class Systematic:
    """``covariance`` (6n, 6n) is to be added to ``Adjusted.covariance``, in its order and axes; ``field_px`` is how
    large the fields are (rms per axis over a picture)."""

    covariance: np.ndarray
    field_px: float


def systematic(consensus: Consensus, cameras: Dict[int, PinholeCamera]) -> Systematic:
    """One linear step from what was adjusted, as ``readout_turns``; ``cameras`` (by picture) are the features'."""
    problem, adjusted, o = consensus.problem, consensus.adjusted, consensus.observations
    structure = Structure(o, adjusted.rho, problem.focals_px, problem.noise_px)
    at = structure.linearise(adjusted.poses, adjusted.focal_scale)
    weight, _ = structure.weights(at.residual)
    n = 6 * len(adjusted.order)
    pose = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(adjusted.order)}
    held = n + int(problem.focal_sigma > 0.0)
    terms = 2 * _TERMS
    field = {k: slice(held + terms * i, held + terms * (i + 1)) for i, k in enumerate([0, *adjusted.order])}
    parts = []
    for (a, k, of), (to_a, to_k, to_focal) in zip(structure.groups, at.by_group):
        used = [(pose[p], J) for p, J in ((a, to_a), (k, to_k)) if p in pose]
        used += [(slice(n, held), to_focal)] if held > n else []
        rays = o.anchor_rays[o.point[of]]
        # a shift (x, y) on the anchor's picture moves its ray as the turn (-y, x, 0) / f does at its middle
        shifted = np.stack([to_a[:, :, 1], -to_a[:, :, 0]], axis=2) / cameras[a].fx
        used.append((field[a], shifted @ _fields(cameras[a], rays)))
        used.append((field[k], -_fields(cameras[k], o.rays[of])))
        parts.append(used)
    H, g = structure.eliminated(at, weight, parts, held + terms * len(field))
    for k in adjusted.order:
        H[pose[k], pose[k]] += np.linalg.inv(problem.priors[k].full_covariance)
    if held > n:
        H[n, n] += (problem.focal_sigma or ANY_FOCAL) ** -2
    moved = np.linalg.solve(H[:held, :held], H[:held, held:])  # of the poses by each term
    left = H[held:, held:] - H[held:, :held] @ moved
    field_px = _field_px(left, g[held:])
    return Systematic(moved[:n] @ moved[:n].T * (field_px**2 / _TERMS), field_px)


def _field_px(information: np.ndarray, gradient: np.ndarray) -> float:
    """How large the fields are by the residuals' gradient (K,), the poses being free to follow them.

    In a direction of information l that they show, the gradient has the variance c l + l^2 s^2: c l is noise, s^2 the
    variance of each term. The posterior's mean square over _SIZES_PX.
    """
    value, vector = np.linalg.eigh(information)
    shown = value > 1e-6 * value[-1]
    value, square = value[shown], np.square(vector.T @ gradient)[shown]
    variance = _NOISE_SHARE * value + np.outer(np.square(_SIZES_PX) / _TERMS, np.square(value))
    likely = -0.5 * (np.log(variance) + square / variance).sum(axis=1)
    likely -= 0.5 * np.square(np.log(_SIZES_PX / _USUAL_PX) / _SPREAD)
    weight = np.exp(likely - likely.max())
    return float(np.sqrt(weight @ np.square(_SIZES_PX) / weight.sum()))


def _fields(camera: PinholeCamera, rays: np.ndarray) -> np.ndarray:
    """(N, 2, 2T) px: the shifts of all terms at rays (N, 3)."""
    size = np.array([camera.width, camera.height])
    uv = rays[:, :2] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    basis = _basis(2.0 * (uv + 0.5) / size - 1.0)
    out = np.zeros((len(rays), 2, 2 * basis.shape[1]))
    out[:, 0, : basis.shape[1]], out[:, 1, basis.shape[1] :] = basis, basis
    return out


def _basis(xy: np.ndarray) -> np.ndarray:
    """(N, T): Legendre polynomials in two variables over the picture, (N, 2) from -1 to 1, with an rms of 1.

    >>> _basis(np.array([[0.0, 0.0]])).shape
    (1, 10)
    """
    one = [np.polynomial.legendre.legvander(a, _DEGREE) * np.sqrt(2.0 * np.arange(_DEGREE + 1) + 1.0) for a in xy.T]
    pairs = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    return np.stack([one[0][:, i] * one[1][:, j] for i, j in pairs], axis=1)
