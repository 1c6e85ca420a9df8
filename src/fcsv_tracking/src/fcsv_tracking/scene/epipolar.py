# SPDX-License-Identifier: Apache-2.0
"""Where a motion of the camera may have moved the points of a scene (Hartley and Zisserman 2004,
9.2)."""

import numpy as np

NEAREST_M = 2.0  # of the scene: nearer points would move further


class Lines:
    """Where a motion may have moved each of N points, from where it is without one to where the
    nearest scene is.

    Points (N, 2) are x/z, y/z in the optical frame of the camera then.
    """

    def __init__(self, xy_then: np.ndarray, T_now_then: np.ndarray):
        far = xy_then @ T_now_then[:3, :2].T + T_now_then[:3, 2]
        near = far + T_now_then[:3, 3] / NEAREST_M
        self._a, b = (p[:, :2] / np.maximum(p[:, 2:], 0.1) for p in (far, near))
        self._line = b - self._a
        self._length2 = np.maximum(np.einsum("ij,ij->i", self._line, self._line), 1e-18)

    def off(self, xy_now: np.ndarray) -> np.ndarray:
        """(N, 2) from the nearest such place to where each point is now; about rad near the
        middle."""
        from_a = xy_now - self._a
        along = self._line * from_a
        share = np.minimum(
            np.maximum((along[:, 0] + along[:, 1]) / self._length2, 0.0), 1.0
        )
        return from_a - share[:, None] * self._line


def from_lines(xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray) -> np.ndarray:
    """Lines.off, once.

    >>> T = np.eye(4)
    >>> T[0, 3] = 0.5
    >>> from_lines(np.zeros((2, 2)), np.array([[0.1, 0.0], [0.1, 0.03]]), T).round(9).tolist()
    [[0.0, 0.0], [0.0, 0.03]]
    """
    return Lines(xy_then, T_now_then).off(xy_now)
