# SPDX-License-Identifier: Apache-2.0
"""Points of a scene that moved as if the camera flew one way that its tracker does not tell of.

A drift that is followed moves the points of a picture along one way, near ones further than far
ones. People and leaves move too, but not all one way; clouds do, but they are above the horizon.
Vibration, a rolling shutter and late stamps turn the whole picture: the turn that explains most
points best is taken back first. What is left then of a tracker that tells the truth are the errors
of following points, which are as large across any way as along it.
"""

import numpy as np

from fcsv_tracking.scene.epipolar import without_turn

# of a followed point, half a pixel of 320 in either picture; in an axis
_NOISE_RAD, _NOISE_PER_TURN = 0.0024, 0.025
_MOST_RAD = 0.008  # what is further off counts as if it were so far: people, leaves
_TURN_RAD, _TURN_PER_TURN = 0.004, 0.05  # of a whole picture, standard deviation
_HORIZON = 0.02  # sine of the elevation up to which points count
_LEAST_POINTS = 10
_LITTLE = 2.0  # variances in all: then no way has more, and none is looked for


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
    below = rays < _HORIZON * np.hypot(1.0, np.hypot(xy_now[:, 0], xy_now[:, 1]))
    if int(np.count_nonzero(below)) < _LEAST_POINTS:
        return 0.0
    now, sigma_rad = xy_now[below], _TURN_RAD + _TURN_PER_TURN * turn_rad
    off = without_turn(xy_then[below], now, T_now_then, sigma_rad)
    off *= np.minimum(1.0, _MOST_RAD / np.maximum(np.hypot(*off), 1e-6))
    noise2 = (_NOISE_RAD + _NOISE_PER_TURN * turn_rad) ** 2
    in_all = float(np.vdot(off, off)) / off.shape[1] / noise2
    return in_all if in_all < _LITTLE else _most_along(now.T, off, R_odom_now, noise2)


def _most_along(xy: np.ndarray, off: np.ndarray, R_odom_now: np.ndarray, noise2: float) -> float:
    """Says, of points (2, N) and what they are off (2, N): the mean square along the best way over
    that across it, or over ``noise2`` where that is more."""
    ways = _WAYS @ R_odom_now  # in the camera
    # where a camera that goes this way sees them move
    x, y = np.moveaxis(xy * ways[:, 2:, None] - ways[:, :2, None], 1, 0)
    length = np.maximum(np.hypot(x, y), 1e-6)
    along, across = (x * off[0] + y * off[1]) / length, (x * off[1] - y * off[0]) / length
    return float(((along**2).mean(axis=1) / np.maximum((across**2).mean(axis=1), noise2)).max())
