# SPDX-License-Identifier: Apache-2.0
"""Where a motion of the camera may have moved the points of a scene (Hartley and Zisserman 2004,
9.2): along a line, from where they are if they are far away to where the nearest scene is.

Points (N, 2) are x/z, y/z in the optical frame of the camera then and now; what they are off their
lines is about rad near the middle. Compiled: numpy takes longer to be called than for some tens of
points.
"""

import math

import numba
import numpy as np

NEAREST_M = 2.0  # of the scene: nearer points would move further
_MOST_TURN = 3.0  # standard deviations: a way over level ground looks like a larger one
_ROUNDS, _SHARP_RAD, _PRIOR_WEIGHT = 5, 0.001, 0.05


@numba.njit(cache=True)
def _off_line(xy_then, x, y, T):
    """What a point is off its line in x and y; ``T``: T_now_then."""
    far_x = T[0, 0] * xy_then[0] + T[0, 1] * xy_then[1] + T[0, 2]
    far_y = T[1, 0] * xy_then[0] + T[1, 1] * xy_then[1] + T[1, 2]
    far_z = T[2, 0] * xy_then[0] + T[2, 1] * xy_then[1] + T[2, 2]
    near_z = max(far_z + T[2, 3] / NEAREST_M, 0.1)
    far_z = max(far_z, 0.1)
    line_x = (far_x + T[0, 3] / NEAREST_M) / near_z - far_x / far_z
    line_y = (far_y + T[1, 3] / NEAREST_M) / near_z - far_y / far_z
    x, y = x - far_x / far_z, y - far_y / far_z
    share = (line_x * x + line_y * y) / max(line_x * line_x + line_y * line_y, 1e-18)
    share = min(max(share, 0.0), 1.0)
    return x - share * line_x, y - share * line_y


@numba.njit(cache=True)
def off_lines(xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray) -> np.ndarray:
    """(N,) how far points are from the lines along which a motion moves them.

    >>> T = np.eye(4)
    >>> T[0, 3] = 0.5
    >>> off_lines(np.zeros((2, 2)), np.array([[0.1, 0.0], [0.1, 0.03]]), T).round(9).tolist()
    [0.0, 0.03]
    """
    off = np.empty(len(xy_now))
    for i in range(len(off)):
        off[i] = math.hypot(*_off_line(xy_then[i], xy_now[i, 0], xy_now[i, 1], T_now_then))
    return off


@numba.njit(cache=True)
def without_turn(
    xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray, sigma_rad: float
) -> np.ndarray:
    """(2, N) what points are off their lines once the small turn (rad, about the camera's axes) is
    taken back that leaves the least sum of distances (reweighted squares), where large ones are
    unlikely."""
    turn, off = np.zeros(3), np.empty((2, len(xy_now)))
    prior = _PRIOR_WEIGHT * len(xy_now) * _SHARP_RAD / sigma_rad**2
    for left in range(_ROUNDS, -1, -1):
        normal, right = prior * np.eye(3), -prior * turn
        for i in range(len(xy_now)):
            x, y = xy_now[i]
            # how the point moves in the picture with a turn
            by_x, by_y = (x * y, -(1.0 + x * x), y), (1.0 + y * y, -x * y, -x)
            x -= by_x[0] * turn[0] + by_x[1] * turn[1] + by_x[2] * turn[2]
            y -= by_y[0] * turn[0] + by_y[1] * turn[1] + by_y[2] * turn[2]
            x, y = off[0, i], off[1, i] = _off_line(xy_then[i], x, y, T_now_then)
            weight = 1.0 / max(math.hypot(x, y), _SHARP_RAD)
            for j in range(3):
                right[j] += weight * (by_x[j] * x + by_y[j] * y)
                for k in range(3):
                    normal[j, k] += weight * (by_x[j] * by_x[k] + by_y[j] * by_y[k])
        if left:
            turn += np.linalg.solve(normal, right)
            turn *= min(1.0, _MOST_TURN * sigma_rad / max(math.sqrt(np.sum(turn**2)), 1e-12))
    return off
