# SPDX-License-Identifier: Apache-2.0
"""What photographs say of their model's scale, turn and place, and how well a similarity agrees
with it.

Each statement (place, height, gimbal's angles, level rows) is either right, with its standard
deviation, or wrong: then it says nothing. The cost is the negative logarithm (times two) of that
mixture's density.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

#: A gimbal's angles: of each photograph, and what all share (mounting; the compass). East, north,
#: up (rad).
ANGLE_SIGMAS = np.radians([2.0, 2.0, 3.0])
SHARED_ANGLE_SIGMAS = np.radians([1.5, 1.5, 5.0])
#: Where no angles are known: people and gimbals hold a camera's rows level to that, each and all
#: alike.
LEVEL_SIGMA, SHARED_LEVEL_SIGMA = np.sin(np.radians(5.0)), np.sin(np.radians(2.0))
#: Cost at which a statement counts as wrong, above that of the usual scatter: place (2), height
#: (1), angles (3), level.
_WRONG_PLACE, _WRONG_HEIGHT, _WRONG_ANGLES, _WRONG_LEVEL = 17.0, 14.0, 12.0, 9.0
# further cost of a height that is wrong where the rest of the place is right: seldom
_HEIGHT_ALONE = 3.0
#: Cameras without known angles seldom look up: cost of one that looks at the zenith; from 30
#: degrees on.
_ZENITH_COST, _LOOKS_UP = 6.0, 0.5
# of the model's extent: how good structure from motion is (docs/lab/photographs.md)
MODEL_SHARE = 0.003

#: Noise that is tried: logarithms of times as much as GPS says, and of times MODEL_SHARE; then
#: finer about the best.
_LOG_K, _LOG_M, _FINER = (
    np.linspace(-2.4, 2.4, 7),
    np.linspace(-5.6, 2.4, 6),
    np.linspace(-0.5, 0.5, 5),
)
_K_ANGLE = np.exp(np.linspace(-1.6, 1.6, 17))
_LOG_K_SIGMA, _LOG_M_SIGMA, _LOG_K_ANGLE_SIGMA = 0.7, 1.5, 0.6


@dataclass(frozen=True)
class GpsEvidence:
    """Holds what is known of N photographs, all float64: places in the model and by GPS (m; NaN
    where there is none).

    ``sigmas_m`` and ``steps_m``: GPS's standard deviations per axis, and the steps in which places
    are written. ``R_model_cam`` and ``R_enu_cam``: of the upright pictures, by the model and by
    angles (NaN where not known). ``extent``: of the model, in its own unit: about the median
    distance of two photographs.
    """

    p_model: np.ndarray
    p_enu_m: np.ndarray
    sigmas_m: np.ndarray
    steps_m: np.ndarray
    R_model_cam: np.ndarray
    R_enu_cam: np.ndarray
    placed: np.ndarray = field(init=False)
    angled: np.ndarray = field(init=False)
    extent: float = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "placed", np.isfinite(self.p_enu_m).all(axis=1))
        object.__setattr__(self, "angled", np.isfinite(self.R_enu_cam).all(axis=(1, 2)))
        away = np.linalg.norm(self.p_model - np.median(self.p_model, axis=0), axis=1)
        object.__setattr__(self, "extent", float(np.sqrt(2.0) * max(np.median(away), 1e-9)))

    def of(self, chosen: np.ndarray) -> "GpsEvidence":
        """That of the photographs at these indices alone."""
        arrays = (
            self.p_model,
            self.p_enu_m,
            self.sigmas_m,
            self.steps_m,
            self.R_model_cam,
            self.R_enu_cam,
        )
        return GpsEvidence(*(a[chosen] for a in arrays))


class Pose(NamedTuple):
    """p_enu = scale * R @ p_model + t; ``shared`` (4,): turn that all angles share (rad), tilt of
    all rows."""

    scale: float
    R: np.ndarray
    t: np.ndarray
    shared: np.ndarray


class Noise(NamedTuple):
    """``gps``: times as much as is said of places; ``model_m``: the model's own error; ``angles``:
    times as usual."""

    gps: float
    model_m: float
    angles: float


class Weights(NamedTuple):
    """Holds weights of each photograph, 0 to 1: how surely its place (east and north), height,
    angles and level rows are right."""

    place: np.ndarray
    height: np.ndarray
    angles: np.ndarray
    level: np.ndarray


def away_m(e: GpsEvidence, pose: Pose) -> np.ndarray:
    """(P, 3): GPS less the model, of those that have GPS."""
    return e.p_enu_m[e.placed] - (pose.scale * e.p_model[e.placed] @ pose.R.T + pose.t)


def turns(e: GpsEvidence, pose: Pose) -> np.ndarray:
    """(A, 3) rotation vectors in east, north, up from the gimbals' to the model's, of those that
    have angles."""
    if not e.angled.any():
        return np.zeros((0, 3))
    between = pose.R @ e.R_model_cam[e.angled] @ e.R_enu_cam[e.angled].transpose(0, 2, 1)
    return Rotation.from_matrix(between).as_rotvec() - pose.shared[:3]


def tilts(e: GpsEvidence, pose: Pose) -> Tuple[np.ndarray, np.ndarray]:
    """Gives the tilts of those without angles: how far rows are from level, and how far the
    pictures' down is above it (sines)."""
    rows, down = (pose.R @ e.R_model_cam[~e.angled])[:, 2, :2].T
    return rows - pose.shared[3], np.maximum(down - LEVEL_SIGMA, 0.0)


def agreement(e: GpsEvidence, pose: Pose, fine: bool = True) -> Tuple[float, Noise, Weights]:
    """The cost of a similarity with the noise that makes it least, and what is right then. Not
    ``fine``: roughly."""
    gps, model_m, place_cost, place, height = _places(e, pose, fine)
    factor, angle_cost, angles = _angles(turns(e, pose))
    rows, down = tilts(e, pose)
    q = (np.square(rows) + np.square(down)) / LEVEL_SIGMA**2
    level_cost = _mixed(np.array([q, np.full_like(q, _WRONG_LEVEL)]))
    level = np.exp(-0.5 * (q - level_cost))
    up = np.clip((pose.R @ e.R_model_cam[~e.angled])[:, 2, 2], _LOOKS_UP, 1.0) - _LOOKS_UP
    shared = pose.shared / np.array([*SHARED_ANGLE_SIGMAS, SHARED_LEVEL_SIGMA])
    cost = (
        place_cost
        + angle_cost
        + level_cost.sum()
        + _ZENITH_COST * up.sum() / (1 - _LOOKS_UP)
        + shared @ shared
    )
    return float(cost), Noise(gps, model_m, factor), Weights(place, height, angles, level)


def place_variances(e: GpsEvidence, noise: Noise) -> np.ndarray:
    """(P, 3) m2."""
    return (
        np.square(noise.gps * e.sigmas_m[e.placed])
        + np.square(e.steps_m[e.placed])
        + noise.model_m**2
    )


class _Places(NamedTuple):
    """Holds the places of the noise that makes the cost least."""

    gps: float
    model_m: float
    cost: float
    place: np.ndarray
    height: np.ndarray


def _places(e: GpsEvidence, pose: Pose, fine: bool) -> _Places:
    usual_m = MODEL_SHARE * pose.scale * e.extent
    square, said, steps = (
        np.square(away_m(e, pose)),
        np.square(e.sigmas_m[e.placed]),
        np.square(e.steps_m[e.placed]),
    )
    found = _best_noise(square, said, steps, usual_m, _LOG_K, _LOG_M)
    if fine:
        k, m = np.log(found.gps) + 0.8 * _FINER, np.log(found.model_m / usual_m) + 1.6 * _FINER
        found = _best_noise(square, said, steps, usual_m, k, m)
    return found


def _best_noise(
    square, said, steps, usual_m: float, log_k: np.ndarray, log_m: np.ndarray
) -> _Places:
    """Chooses the noise from squares of residuals, of what is said of them and of steps (P, 3), m2,
    of all pairs of the two factors."""
    k, m = (np.exp(g).reshape(-1, 1, 1) for g in np.meshgrid(log_k, log_m, indexing="ij"))
    prior = (np.square(np.log(k) / _LOG_K_SIGMA) + np.square(np.log(m) / _LOG_M_SIGMA))[:, 0, 0]
    variances = np.square(k) * said + steps + np.square(m * usual_m)  # (pairs, P, 3)
    logs = np.log(variances)
    costs = square / variances + logs
    wrong = np.log(said + steps + usual_m**2)
    level, up = costs[..., 0] + costs[..., 1], costs[..., 2]
    wrong_level, wrong_up = wrong[:, 0] + wrong[:, 1] + _WRONG_PLACE, wrong[:, 2] + _WRONG_HEIGHT
    cases = np.array(
        np.broadcast_arrays(level + up, level + wrong_up + _HEIGHT_ALONE, wrong_level + wrong_up)
    )
    each = _mixed(cases)
    right = np.exp(-0.5 * (cases[:2] - each))  # all of the place; all but the height
    # seven unknowns take their part of the scatter (restricted likelihood)
    typical = (right[0] * logs.mean(axis=2)).sum(axis=1) / np.maximum(right[0].sum(axis=1), 1.0)
    costs = each.sum(axis=1) + prior
    best = int(np.argmin(costs - 7.0 * typical))
    at = right[:, best]
    return _Places(
        float(k[best, 0, 0]),
        float(m[best, 0, 0]) * usual_m,
        float(costs[best]),
        at.sum(axis=0),
        at[0],
    )


def _angles(turned: np.ndarray):
    """(factor, cost, weights) of (A, 3) turns."""
    if not len(turned):
        return 1.0, 0.0, np.zeros(0)
    k = _K_ANGLE[:, None]
    q = np.square(turned / ANGLE_SIGMAS).sum(axis=1)
    right = q / np.square(k) + 6.0 * np.log(k)
    each = _mixed(np.array([right, np.full_like(right, _WRONG_ANGLES)]))
    total = each.sum(axis=1) + np.square(np.log(_K_ANGLE) / _LOG_K_ANGLE_SIGMA)
    best = int(np.argmin(total))
    return float(_K_ANGLE[best]), float(total[best]), np.exp(-0.5 * (right[best] - each[best]))


def _mixed(cases: np.ndarray) -> np.ndarray:
    """Cost of a statement that is one of these cases (first axis)."""
    least = cases.min(axis=0)
    return least - 2.0 * np.log(np.exp(-0.5 * (cases - least)).sum(axis=0))
