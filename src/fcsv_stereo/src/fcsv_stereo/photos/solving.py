# SPDX-License-Identifier: Apache-2.0
"""A similarity improved until it agrees best with the evidence about it, and its covariance
there."""

from typing import NamedTuple, Tuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtr, stdtrit

from fcsv_geometry.rotations import skews
from fcsv_stereo.photos import evidence
from fcsv_stereo.photos.evidence import GpsEvidence, Noise, Pose, Weights

_ROUNDS, _CONVERGED = 60, 1e-4
_MOST_TURN_RAD, _MOST_LOG_SCALE = 0.5, 0.5  # of one step
#: Standard deviations of what nothing tells: logarithm of the scale, turn (rad), shift (m).
_UNKNOWN = np.array([10.0, *[np.pi / np.sqrt(3.0)] * 3, *[1e7] * 3])
_BELIEF = 3.0  # so many residuals is it worth what is said of GPS
_SHARED_SIGMAS = np.array([*evidence.SHARED_ANGLE_SIGMAS, evidence.SHARED_LEVEL_SIGMA])


class Fitted(NamedTuple):
    """A local optimum."""

    cost: float
    noise: Noise
    weights: Weights
    pose: Pose


def solve(e: GpsEvidence, pose: Pose) -> Fitted:
    """The optimum near ``pose``, by Gauss-Newton; weights and noise are those of the last step's
    residuals (expectation-maximisation)."""
    best = now = Fitted(*evidence.agreement(e, pose), pose)
    for _ in range(_ROUNDS):
        pose = _step(e, now)
        now = Fitted(*evidence.agreement(e, pose), pose)
        gain = best.cost - now.cost
        best = now if gain > 0.0 else best
        if abs(gain) < _CONVERGED:
            break
    return best


def covariance(e: GpsEvidence, at: Fitted) -> np.ndarray:
    """(7, 7) of the logarithm of the scale, the turn (rad) and the shift (m), in east, north,
    up."""
    J, _, w = _linear(e, at)
    H = J.T @ (w[:, None] * J)
    H[:7, :7] += np.diag(1.0 / np.square(_UNKNOWN))
    said = 2.0 * at.weights.place.sum() + at.weights.height.sum()
    # the noise is estimated, too: three standard deviations are to hold as much of Student's
    # distribution as of Gauss's
    student = stdtrit(_BELIEF + max(said - 7.0, 0.0), ndtr(3.0)) / 3.0
    return np.linalg.inv(H)[:7, :7] * student**2


def _step(e: GpsEvidence, at: Fitted) -> Pose:
    J, r, w = _linear(e, at)
    H = J.T @ (w[:, None] * J)
    x = np.linalg.solve(H + 1e-9 * np.diag(np.diag(H)) + 1e-12 * np.eye(len(H)), J.T @ (w * r))
    turn = x[1:4] * min(1.0, _MOST_TURN_RAD / max(float(np.linalg.norm(x[1:4])), 1e-12))
    scale = at.pose.scale * float(np.exp(np.clip(x[0], -_MOST_LOG_SCALE, _MOST_LOG_SCALE)))
    R = Rotation.from_rotvec(turn).as_matrix() @ at.pose.R
    return Pose(scale, R, at.pose.t + x[4:7], at.pose.shared + x[7:])


def _linear(e: GpsEvidence, at: Fitted) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K, 11) by (logarithm of scale, turn, shift, shared turn of angles, shared tilt of rows),
    residuals, weights."""
    parts = [_linear_places(e, at), _linear_turns(e, at), _linear_tilts(e, at)]
    J_shared = np.zeros((4, 11))
    J_shared[:, 7:] = np.eye(4)
    parts.append((J_shared, -at.pose.shared, 1.0 / np.square(_SHARED_SIGMAS)))
    return tuple(np.concatenate(of) for of in zip(*parts))


def _linear_places(e: GpsEvidence, at: Fitted):
    moved = at.pose.scale * e.p_model[e.placed] @ at.pose.R.T
    J = np.zeros((len(moved), 3, 11))
    J[:, :, 0], J[:, :, 1:4], J[:, :, 4:7] = moved, -skews(moved), np.eye(3)
    right = np.stack([at.weights.place, at.weights.place, at.weights.height], axis=1)
    weights = right / evidence.place_variances(e, at.noise)
    return J.reshape(-1, 11), evidence.away_m(e, at.pose).ravel(), weights.ravel()


def _linear_turns(e: GpsEvidence, at: Fitted):
    turned = evidence.turns(e, at.pose)
    J = np.zeros((len(turned), 3, 11))
    J[:, :, 1:4], J[:, :, 7:10] = np.eye(3), -np.eye(3)
    weights = at.weights.angles[:, None] / np.square(at.noise.angles * evidence.ANGLE_SIGMAS)
    return J.reshape(-1, 11), -turned.ravel(), weights.ravel()


def _linear_tilts(e: GpsEvidence, at: Fitted):
    rows, down = evidence.tilts(e, at.pose)
    axes = at.pose.R @ e.R_model_cam[~e.angled]
    J_rows, J_down = np.zeros((2, len(rows), 11))
    J_rows[:, 1], J_rows[:, 2], J_rows[:, 10] = axes[:, 1, 0], -axes[:, 0, 0], -1.0
    J_down[:, 1], J_down[:, 2] = axes[:, 1, 1] * (down > 0.0), -axes[:, 0, 1] * (down > 0.0)
    weights = np.tile(at.weights.level / evidence.LEVEL_SIGMA**2, 2)
    return np.concatenate([J_rows, J_down]), -np.concatenate([rows, down]), weights
