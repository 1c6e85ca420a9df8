# SPDX-License-Identifier: Apache-2.0
"""Smooth corrections: the filter corrects its pose at once, the published pose follows at a bounded
speed."""

import numpy as np

from fcsv_geometry import rotations, transforms


class Blend:
    """Holds the difference of the published pose from the filter's; small corrections pass in one
    step."""

    def __init__(self, speed_mps: float, rate_radps: float):
        self._speed_mps, self._rate_radps = speed_mps, rate_radps
        self._p_M = np.zeros(3)
        self._r_M = np.zeros(3)

    def corrected(self, before: np.ndarray, after: np.ndarray) -> None:
        """A correction moved T_M_D from one pose to another at the same moment."""
        self._p_M = self._p_M + before[:3, 3] - after[:3, 3]
        self._r_M = rotations.log(rotations.exp(self._r_M) @ before[:3, :3] @ after[:3, :3].T)

    def advance(self, dt_s: float) -> None:
        self._p_M = _shortened(self._p_M, self._speed_mps * dt_s)
        self._r_M = _shortened(self._r_M, self._rate_radps * dt_s)

    def pose(self, T_M_D: np.ndarray) -> np.ndarray:
        """The pose to give out for the filter's."""
        return transforms.transform(
            rotations.exp(self._r_M) @ T_M_D[:3, :3], T_M_D[:3, 3] + self._p_M
        )

    def covariance(self) -> np.ndarray:
        """(6,6) of what is still to come: the pose given out is known to be off by it."""
        error = np.concatenate([self._p_M, self._r_M])
        return np.outer(error, error)


def _shortened(v: np.ndarray, by: float) -> np.ndarray:
    length = float(np.sqrt(v @ v))
    return np.zeros(3) if length <= by else v * (1.0 - by / length)
