# SPDX-License-Identifier: Apache-2.0
"""Points of a scene that all moved as if the camera flew one way that its tracker does not tell of.

A drift that is followed moves the near points of a picture, all of them by one translation; the far ones hardly. People
and leaves move too, but not all one way; clouds do, but they are above the horizon. Vibration, a rolling shutter and
late stamps turn the whole picture: the turn that explains most points best is taken back first.
"""

import numpy as np

from fcsv_tracking.epipolar import from_lines

_OFF_RAD, _OFF_RAD_PER_M, _OFF_PER_TURN = 0.006, 0.003, 0.05  # so far a point must be off; of the way and turn between
_TURN_RAD, _TURN_PER_TURN = 0.004, 0.05  # of a whole picture, standard deviation
_MOST_TURN = 3.0  # of these: a way over level ground looks like a larger one
_ALONG, _AGAINST = 0.8, 0.3  # cosine between a point's motion and a way's: along it; not along it
_NEAR_FOCUS = 0.15  # nearer than this to where a way leads, points hardly move
_HORIZON = 0.02  # sine of the elevation up to which points count
_LEAST_POINTS, _MORE_POINTS = 10, 10  # the second: added to those seen, because a few say little
_ROUNDS, _SHARP_RAD, _PRIOR_WEIGHT = 5, 0.001, 0.05


def _ways() -> np.ndarray:
    """(K, 3) unit vectors: 16 level ways, as many 40 degrees up and down, up and down."""
    around = np.arange(16) * np.pi / 8.0
    level = np.column_stack([np.cos(around), np.sin(around), np.zeros(16)])
    c, s = np.cos(np.radians(40.0)), np.sin(np.radians(40.0))
    leant = [level * [c, c, 1.0] + [0.0, 0.0, k * s] for k in (1.0, -1.0)]
    return np.concatenate([level, *leant, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


_WAYS = _ways()


def one_way_share(
    xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray, R_odom_now: np.ndarray, turn_rad: float
) -> float:
    """Share of the points below the horizon that are off their epipolar lines along one way, less those that are off
    another way; ten more than are seen are the whole. 0.0 where too few are seen.

    Points (N, 2) are x/z, y/z in the optical frame of the camera then and now; ``R_odom_now`` (3, 3) turns from the
    camera now into the level odometry frame; ``turn_rad`` is the camera's turn between both.
    """
    rays = xy_now @ R_odom_now[2, :2] + R_odom_now[2, 2]
    below = rays < _HORIZON * np.sqrt(1.0 + np.einsum("ij,ij->i", xy_now, xy_now))
    count = int(np.count_nonzero(below))
    if count < _LEAST_POINTS:
        return 0.0
    xy_then, xy_now = xy_then[below], xy_now[below]
    x, y, z = T_now_then[:3, 3].tolist()
    bound_rad = _OFF_RAD + _OFF_RAD_PER_M * (x * x + y * y + z * z) ** 0.5 + _OFF_PER_TURN * turn_rad
    off = from_lines(xy_then, xy_now, T_now_then)
    if np.count_nonzero(np.einsum("ij,ij->i", off, off) > bound_rad**2) < 2:
        return 0.0
    turn = _turn_of_all(xy_then, xy_now, T_now_then, off, _TURN_RAD + _TURN_PER_TURN * turn_rad)
    off = from_lines(xy_then, xy_now - _turns(xy_now) @ turn, T_now_then)
    off_rad = np.hypot(off[:, 0], off[:, 1])
    far = off_rad > bound_rad
    return max(0.0, _most_along(xy_now[far], off[far] / off_rad[far, None], R_odom_now) / (count + _MORE_POINTS))


def _most_along(xy: np.ndarray, heading: np.ndarray, R_odom_now: np.ndarray) -> int:
    """Of points (N, 2) that are off, with their unit ``heading`` (N, 2) in the picture: how many go along the best
    way, less those that do not."""
    ways = _WAYS @ R_odom_now  # in the camera
    e = xy[None] * ways[:, None, 2:] - ways[:, None, :2]  # where a camera that goes this way sees them move
    e2 = np.einsum("kij,kij->ki", e, e)
    along = np.einsum("kij,ij->ki", e, heading) / np.sqrt(np.maximum(e2, 1e-12))
    score = ((along > _ALONG) & (e2 > _NEAR_FOCUS**2)).sum(axis=1) - (along < _AGAINST).sum(axis=1)
    return int(score.max(initial=0))


def _turns(xy: np.ndarray) -> np.ndarray:
    """(N, 2, 3) how points move in the picture with a small turn (rad) of all about the camera's axes."""
    x, y = xy[:, 0], xy[:, 1]
    out = np.empty((len(xy), 2, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = x * y, -(1.0 + x * x), y
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 1.0 + y * y, -x * y, -x
    return out


def _turn_of_all(xy_then, xy_now, T_now_then, off, sigma_rad: float) -> np.ndarray:
    """(3,) the small turn that leaves the least sum of distances to the lines (reweighted squares), where large ones
    are unlikely."""
    A, turn = _turns(xy_now), np.zeros(3)
    prior = _PRIOR_WEIGHT * len(xy_now) * _SHARP_RAD / sigma_rad**2
    for _ in range(_ROUNDS):
        weighted = A / np.maximum(np.hypot(off[:, 0], off[:, 1]), _SHARP_RAD)[:, None, None]
        normal = np.tensordot(weighted, A, axes=([0, 1], [0, 1])) + prior * np.eye(3)
        turn = turn + np.linalg.solve(normal, np.tensordot(weighted, off, axes=([0, 1], [0, 1])) - prior * turn)
        turn *= min(1.0, _MOST_TURN * sigma_rad / max(float(np.linalg.norm(turn)), 1e-12))
        off = from_lines(xy_then, xy_now - A @ turn, T_now_then)
    return turn
