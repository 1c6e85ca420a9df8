# SPDX-License-Identifier: Apache-2.0
"""Where a motion of the camera may have moved the points of a scene (Hartley and Zisserman 2004, 9.2)."""

import numpy as np

NEAREST_M = 2.0  # of the scene: nearer points would move further


def from_lines(xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray) -> np.ndarray:
    """(N, 2) from the nearest place to which a motion may have moved each point, to where it is; about rad near the
    middle.

    Points (N, 2) are x/z, y/z in the optical frame of the camera then and now.

    >>> T = np.eye(4)
    >>> T[0, 3] = 0.5
    >>> from_lines(np.zeros((2, 2)), np.array([[0.1, 0.0], [0.1, 0.03]]), T).round(9).tolist()
    [[0.0, 0.0], [0.0, 0.03]]
    """
    far = xy_then @ T_now_then[:3, :2].T + T_now_then[:3, 2]
    near = far + T_now_then[:3, 3] / NEAREST_M
    a, b = (p[:, :2] / np.maximum(p[:, 2:], 0.1) for p in (far, near))
    line, from_a = b - a, xy_now - a
    length2 = np.maximum(np.einsum("ij,ij->i", line, line), 1e-18)
    share = np.minimum(np.maximum(np.einsum("ij,ij->i", line, from_a) / length2, 0.0), 1.0)
    return from_a - share[:, None] * line
