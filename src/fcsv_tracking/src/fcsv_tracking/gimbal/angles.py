# SPDX-License-Identifier: Apache-2.0
"""Angles of a gimbal over time, and those at a picture's stamp."""

from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.geometry import Angles

_RATE_OVER_S = 0.01


class AngleTrack:
    """Readings in order of time (s), interpolated, never extrapolated; ``gap_s`` is the longest
    silence bridged."""

    def __init__(self, gap_s: float = 0.1, keep_s: float = 3.0, back_s: float = 1.0):
        self._gap_s, self._keep_s, self._back_s = gap_s, keep_s, back_s
        self._track = self._empty()

    def _empty(self) -> Trajectory:
        return Trajectory(gap_s=self._gap_s, keep_s=self._keep_s)

    def add(self, stamp_s: float, angles: Angles) -> None:
        """Append a reading. Raises SampleRejected where it is none or not newer; far back is a
        clock that was set."""
        if not np.isfinite([stamp_s, *angles]).all():
            raise SampleRejected(
                "not angles", f"gimbal: reading {tuple(angles)} at {stamp_s} is not finite"
            )
        if len(self._track) and stamp_s < self._track.span_s[1] - self._back_s:
            self._track = self._empty()
        # a straight line in angles: they travel as a translation
        if not self._track.add(stamp_s, transforms.transform(np.eye(3), [*angles, 0.0])):
            raise SampleRejected(
                "angles: stamp goes back", f"gimbal: reading at {stamp_s:.3f} s is not newer"
            )

    @property
    def newest_s(self) -> float:
        """Stamp of the newest reading; minus infinity before the first."""
        return self._track.span_s[1] if len(self._track) else -np.inf

    def latest(self) -> Angles:
        """The newest reading. Raises PoseUnavailable before the first."""
        return _angles(self._track.latest()[1])

    def at(self, stamp_s: float) -> Tuple[Angles, np.ndarray]:
        """Angles at a stamp, and their rates (2,) rad/s about it. Raises PoseUnavailable as
        Trajectory.at()."""
        first_s, last_s = self._track.span_s
        now = self._track.at(stamp_s)
        before_s, after_s = (
            max(first_s, stamp_s - _RATE_OVER_S),
            min(last_s, stamp_s + _RATE_OVER_S),
        )
        if after_s - before_s < 1e-6:
            return _angles(now), np.zeros(2)
        moved = self._track.at(after_s)[:2, 3] - self._track.at(before_s)[:2, 3]
        return _angles(now), moved / (after_s - before_s)


def _angles(T: np.ndarray) -> Angles:
    return Angles(float(T[0, 3]), float(T[1, 3]))
