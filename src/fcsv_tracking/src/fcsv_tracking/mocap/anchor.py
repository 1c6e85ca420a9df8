# SPDX-License-Identifier: Apache-2.0
"""Where the odometry stands in the mocap's frame, from the poses of half a second: the offset of
equation 5.2.

T_M_O = T_M_D inv(T_O_D) must be one and the same for all of them, or one of the two is not what it
says.
"""

from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import rotations, transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory

# a body that is turned over is off by far more, an odometry that goes on by less
_SAME_RAD = np.radians(20.0)


def lies_as_before(proven_R_M_O: Optional[np.ndarray], R_M_O: np.ndarray) -> bool:
    """Whether the odometry lies in the mocap's frame as it did when its heading was proven (None:
    it never was).

    Only a body turned over and an odometry that began anew, turned just as much, could deceive it
    together.
    """
    if proven_R_M_O is None:
        return False
    return float(np.linalg.norm(rotations.log(proven_R_M_O.T @ R_M_O))) < _SAME_RAD


class Anchor:
    """Collects pairs of poses; the middle of them once they agree."""

    def __init__(
        self,
        window_s: float = 0.5,
        least: int = 25,
        spread_m: float = 0.05,
        spread_deg: float = 6.0,
    ):
        self._window_s, self._least = window_s, least
        self._spread_m, self._spread_rad = spread_m, np.radians(spread_deg)
        self._pairs: Deque[Tuple[float, np.ndarray, np.ndarray]] = deque()

    def clear(self) -> None:
        self._pairs.clear()

    def add(self, stamp_s: float, T_M_D: np.ndarray, odometry: Trajectory) -> Optional[np.ndarray]:
        """T_M_D of this moment, freed of noise, where the last poses agree; else None."""
        try:
            T_O_D = odometry.at(stamp_s)
        except PoseUnavailable:
            return None
        self._pairs.append((stamp_s, T_M_D, T_O_D))
        while stamp_s - self._pairs[0][0] > self._window_s:
            self._pairs.popleft()
        if len(self._pairs) < self._least or stamp_s - self._pairs[0][0] < 0.8 * self._window_s:
            return None
        R_M_O = np.stack([M[:3, :3] @ O[:3, :3].T for _, M, O in self._pairs])
        mean = Rotation.from_matrix(R_M_O).mean().as_matrix()
        turned = np.array([rotations.log(mean.T @ R) for R in R_M_O])
        p_M_O = np.stack([M[:3, 3] - mean @ O[:3, 3] for _, M, O in self._pairs])
        middle = np.median(p_M_O, axis=0)
        # frames are noisy one by one; what must not be is a body that turns over or hops within the
        # window
        if (np.linalg.norm(turned, axis=1) > self._spread_rad).any():
            return None
        if (np.linalg.norm(p_M_O - middle, axis=1) > self._spread_m).any():
            return None
        return transforms.transform(mean @ T_O_D[:3, :3], middle + mean @ T_O_D[:3, 3])
