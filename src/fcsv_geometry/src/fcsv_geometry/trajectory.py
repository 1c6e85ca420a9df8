# SPDX-License-Identifier: Apache-2.0
"""Stamped poses of one body, and the pose at a stamp between them."""

import bisect
from typing import List, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable

_JUMP_S = 1.0  # ahead of the pose before: a wrong stamp, if the next pose is of the time in between


class Trajectory:
    """Poses T_a_b in order of time (s), interpolated at a stamp, never beyond ``extrapolation_s``.

    ``gap_s`` is the longest silence that is bridged; ``keep_s`` bounds the memory of a live buffer.
    """

    def __init__(
        self, gap_s: float = 0.1, extrapolation_s: float = 0.0, keep_s: Optional[float] = None
    ):
        self._gap_s = gap_s
        self._extrapolation_s = extrapolation_s
        self._keep_s = keep_s
        self._stamps_s: List[float] = []
        self._poses: List[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._stamps_s)

    @property
    def span_s(self) -> Tuple[float, float]:
        """First and last stamp (s). Raises PoseUnavailable when empty."""
        if not self._stamps_s:
            raise PoseUnavailable("no pose yet")
        return self._stamps_s[0], self._stamps_s[-1]

    @property
    def spacing_s(self) -> float:
        """Median time (s) from one pose to the next; nought where there are fewer than two."""
        return float(np.median(np.diff(self._stamps_s))) if len(self) > 1 else 0.0

    def bridging(self, gap_s: float) -> "Trajectory":
        """The same poses with another longest silence."""
        other = Trajectory(gap_s, self._extrapolation_s, self._keep_s)
        other._stamps_s, other._poses = self._stamps_s, self._poses
        return other

    def latest(self) -> Tuple[float, np.ndarray]:
        """Newest stamp (s) and T_a_b. Raises PoseUnavailable when empty."""
        return self.span_s[1], self._poses[-1]

    def add(self, stamp_s: float, T_a_b: np.ndarray) -> bool:
        """Append a pose; one that does not come after the newest is refused (False).

        Where the newest alone jumped ahead and the new one follows those before it, the newest was
        wrong: it goes.
        """
        if self._stamps_s and stamp_s <= self._stamps_s[-1]:
            if not self._newest_jumped_before(stamp_s):
                return False
            self._stamps_s.pop()
            self._poses.pop()
        before_s = self._stamps_s[-1] if self._stamps_s else stamp_s
        self._stamps_s.append(stamp_s)
        self._poses.append(T_a_b)
        if self._keep_s is not None and self._stamps_s[0] < before_s - 2 * self._keep_s:
            cut = bisect.bisect_left(self._stamps_s, before_s - self._keep_s)
            del self._stamps_s[:cut], self._poses[:cut]
        return True

    def _newest_jumped_before(self, stamp_s: float) -> bool:
        if len(self) < 2:
            return False
        before_s, newest_s = self._stamps_s[-2:]
        return before_s < stamp_s <= before_s + _JUMP_S < newest_s

    def at(self, stamp_s: float) -> np.ndarray:
        """T_a_b at a stamp (s). Raises PoseUnavailable beyond the ends or inside too long a
        silence; a pose's own stamp is in none."""
        first_s, last_s = self.span_s
        if stamp_s < first_s:
            raise PoseUnavailable(f"stamp is {first_s - stamp_s:.3f} s before the first pose")
        if stamp_s > last_s:
            if stamp_s - last_s > self._extrapolation_s or len(self) < 2:
                raise PoseUnavailable(f"stamp is {stamp_s - last_s:.3f} s after the newest pose")
            return self._between(len(self) - 2, stamp_s)
        return self._between(max(bisect.bisect_left(self._stamps_s, stamp_s) - 1, 0), stamp_s)

    def within(self, first_s: float, last_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """Stamps (N,) and poses (N, 4, 4) from one time to another, as they were added; N may be
        0."""
        of = slice(
            bisect.bisect_left(self._stamps_s, first_s), bisect.bisect_right(self._stamps_s, last_s)
        )
        return np.array(self._stamps_s[of]), np.array(self._poses[of]).reshape(-1, 4, 4)

    def _between(self, index: int, stamp_s: float) -> np.ndarray:
        if len(self) == 1:
            return self._poses[0]
        before_s, after_s = self._stamps_s[index : index + 2]
        for k, own_s in ((index, before_s), (index + 1, after_s)):
            if stamp_s == own_s:
                return self._poses[k]
        if after_s - before_s > self._gap_s:
            raise PoseUnavailable(
                f"poses are silent for {after_s - before_s:.3f} s around the stamp"
            )
        alpha = (stamp_s - before_s) / (after_s - before_s)
        if 0.0 <= alpha <= 1.0:
            return transforms.interpolate(self._poses[index], self._poses[index + 1], alpha)
        return self._extrapolated(index, alpha)

    def _extrapolated(self, index: int, alpha: float) -> np.ndarray:
        step = transforms.invert(self._poses[index]) @ self._poses[index + 1]
        turn = Rotation.from_matrix(step[:3, :3]).as_rotvec() * (alpha - 1.0)
        R = self._poses[index + 1][:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
        p0, p1 = self._poses[index][:3, 3], self._poses[index + 1][:3, 3]
        return transforms.transform(R, p1 + (p1 - p0) * (alpha - 1.0))
