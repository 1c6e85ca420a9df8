# SPDX-License-Identifier: Apache-2.0
"""Set-points that glide along a way in steps of time: as fast as bounds allow, and waiting for who
is behind."""

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

_END = 1e-3  # of the way


@dataclass(frozen=True)
class GlideRate:
    """``most``: shares of the way per second at most; ``ramp``: how fast that rises and falls
    (1/s^2)."""

    most: float
    ramp: float

    def advanced(self, share: float, rate: float, dt_s: float, wait: bool) -> Tuple[float, float]:
        """Share and rate after ``dt_s``; ``wait``: somebody is behind."""
        brakes_in_time = float(np.sqrt(2.0 * self.ramp * max(1.0 - share, 0.0)))
        wanted = 0.0 if wait else min(self.most, brakes_in_time)
        rate = float(np.clip(wanted, rate - self.ramp * dt_s, rate + self.ramp * dt_s))
        share = min(1.0, share + rate * dt_s)
        return (1.0, 0.0) if 1.0 - share < _END else (share, rate)

    @property
    def takes_s(self) -> float:
        """Time (s) of the whole way from standing to standing.

        >>> GlideRate(0.5, 0.5).takes_s, GlideRate(9.0, 1.0).takes_s
        (3.0, 2.0)
        """
        if self.most**2 >= self.ramp:
            return 2.0 / math.sqrt(self.ramp)
        return 1.0 / self.most + self.most / self.ramp
