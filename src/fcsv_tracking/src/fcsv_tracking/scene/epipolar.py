# SPDX-License-Identifier: Apache-2.0
"""Where a motion of the camera may have moved the points of a scene (Hartley and Zisserman 2004,
9.2)."""

import numpy as np

NEAREST_M = 2.0  # of the scene: nearer points would move further


class Lines:
    """Where a motion may have moved each of N points, from where it is without one to where the
    nearest scene is.

    Points (2, N) are x/z, y/z in the optical frame of the camera then.
    """

    def __init__(self, xy_then: np.ndarray, T_now_then: np.ndarray):
        far = T_now_then[:3, :2] @ xy_then + T_now_then[:3, 2:3]
        near = far + T_now_then[:3, 3:] / NEAREST_M
        self._a = far[:2] / np.maximum(far[2], 0.1)
        self._line = near[:2] / np.maximum(near[2], 0.1) - self._a
        self._length2 = np.maximum((self._line * self._line).sum(axis=0), 1e-18)

    def off(self, xy_now: np.ndarray) -> np.ndarray:
        """(2, N) from the nearest such place to where each point is now; about rad near the
        middle."""
        from_a = xy_now - self._a
        x, y = self._line * from_a
        share = np.minimum(np.maximum((x + y) / self._length2, 0.0), 1.0)
        return from_a - share * self._line
