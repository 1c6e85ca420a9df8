# SPDX-License-Identifier: Apache-2.0
"""Points of a scene that moved as if the camera flew one way that its tracker does not tell of.

A drift that is followed moves the points of a picture along one way, near ones further than far
ones. People and leaves move too, but not all one way; clouds do, but they are above the horizon.
Vibration, a rolling shutter and late stamps turn the whole picture: the turn that explains most
points best is taken back first. What is left then of a tracker that tells the truth are the errors
of following points, which are as large across any way as along it.
"""

import math

import numpy as np
from scipy.linalg.lapack import dposv

from fcsv_tracking.scene.epipolar import Lines

# of a followed point, half a pixel of 320 in either picture; in an axis
_NOISE_RAD, _NOISE_PER_TURN = 0.0024, 0.025
_MOST_RAD = 0.008  # what is further off counts as if it were so far: people, leaves
_TURN_RAD, _TURN_PER_TURN = 0.004, 0.05  # of a whole picture, standard deviation
_MOST_TURN = 3.0  # of these: a way over level ground looks like a larger one
_HORIZON = 0.02  # sine of the elevation up to which points count
_LEAST_POINTS = 10
_LITTLE = 2.0  # variances in all: then no way has more, and none is looked for
_ROUNDS, _SHARP_RAD, _PRIOR_WEIGHT = 5, 0.001, 0.05


def _ways() -> np.ndarray:
    """(K, 3) unit vectors: 16 level ways, as many 40 degrees up and down, up and down."""
    around = np.arange(16) * np.pi / 8.0
    level = np.column_stack([np.cos(around), np.sin(around), np.zeros(16)])
    c, s = np.cos(np.radians(40.0)), np.sin(np.radians(40.0))
    leant = [level * [c, c, 1.0] + [0.0, 0.0, k * s] for k in (1.0, -1.0)]
    return np.concatenate([level, *leant, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


_WAYS = _ways()


def one_way_ratio(
    xy_then: np.ndarray,
    xy_now: np.ndarray,
    T_now_then: np.ndarray,
    R_odom_now: np.ndarray,
    turn_rad: float,
) -> float:
    """How many times as large (mean squares) what points below the horizon are off their epipolar
    lines is along a way of the camera as across it, or as the errors of following them; of the way
    for which this is most. About 1 to 2 where the poses are right; 0.0 where too few points are
    seen.

    Points (N, 2) are x/z, y/z in the optical frame of the camera then and now; ``R_odom_now`` (3,
    3) turns from the camera now into the level odometry frame; ``turn_rad`` is the camera's turn
    between both.
    """
    rays = xy_now @ R_odom_now[2, :2] + R_odom_now[2, 2]
    below = rays < _HORIZON * np.sqrt(1.0 + np.einsum("ij,ij->i", xy_now, xy_now))
    if int(np.count_nonzero(below)) < _LEAST_POINTS:
        return 0.0
    xy_then, xy_now = xy_then[below], xy_now[below]
    off = _without_turn(Lines(xy_then, T_now_then), xy_now, _TURN_RAD + _TURN_PER_TURN * turn_rad)
    off2 = np.einsum("ij,ij->i", off, off)
    off *= np.minimum(1.0, _MOST_RAD / np.sqrt(np.maximum(off2, 1e-12)))[:, None]
    noise2 = (_NOISE_RAD + _NOISE_PER_TURN * turn_rad) ** 2
    in_all = float(np.einsum("ij,ij->", off, off)) / len(off) / noise2
    return in_all if in_all < _LITTLE else _most_along(xy_now, off, R_odom_now, noise2)


def _most_along(xy: np.ndarray, off: np.ndarray, R_odom_now: np.ndarray, noise2: float) -> float:
    """Says, of points (N, 2) and what they are off (N, 2): the mean square along the best way over
    that across it, or over ``noise2`` where that is more."""
    ways = _WAYS @ R_odom_now  # in the camera
    # where a camera that goes this way sees them move
    e = xy[None] * ways[:, None, 2:] - ways[:, None, :2]
    e /= np.maximum(np.sqrt(np.einsum("kij,kij->ki", e, e)), 1e-6)[..., None]
    along = np.einsum("kij,ij->ki", e, off)
    across = e[..., 0] * off[:, 1] - e[..., 1] * off[:, 0]
    return float(((along**2).mean(axis=1) / np.maximum((across**2).mean(axis=1), noise2)).max())


def _turns(xy: np.ndarray) -> np.ndarray:
    """(N, 2, 3) how points move in the picture with a small turn (rad) of all about the camera's
    axes."""
    x, y = xy[:, 0], xy[:, 1]
    out = np.empty((len(xy), 2, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = x * y, -(1.0 + x * x), y
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 1.0 + y * y, -x * y, -x
    return out


def _without_turn(lines: Lines, xy_now: np.ndarray, sigma_rad: float) -> np.ndarray:
    """(N, 2) what points (N, 2) are off their lines once the small turn is taken back that leaves
    the least sum of distances (reweighted squares), where large ones are unlikely."""
    A, turn, off = _turns(xy_now), np.zeros(3), lines.off(xy_now)
    flat = A.reshape(-1, 3)
    prior = _PRIOR_WEIGHT * len(xy_now) * _SHARP_RAD / sigma_rad**2
    priors = prior * np.eye(3)
    for _ in range(_ROUNDS):
        weight = 1.0 / np.maximum(np.hypot(off[:, 0], off[:, 1]), _SHARP_RAD)
        weighted = (A * weight[:, None, None]).reshape(-1, 3)
        normal = weighted.T @ flat + priors
        turn = turn + dposv(normal, off.ravel() @ weighted - prior * turn)[1]
        turn *= min(1.0, _MOST_TURN * sigma_rad / max(math.sqrt(turn @ turn), 1e-12))
        off = lines.off(xy_now - (flat @ turn).reshape(-1, 2))
    return off
