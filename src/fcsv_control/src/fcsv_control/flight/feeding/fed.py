# SPDX-License-Identifier: Apache-2.0
"""What went to the autopilot as external navigation: how often, when last, and with which
stamps."""

import math
from collections import deque
from typing import Deque

_SPAN_S = 2.0


class Fed:
    """Told of each pose that is sent."""

    def __init__(self):
        self._sent_s: Deque[float] = deque()
        self._last_s = -math.inf
        self._usec = -1

    def sent(self, now_s: float, stamp_s: float) -> int:
        """A pose goes on now; its stamp (us), which only rises."""
        if self._sent_s and now_s < self._sent_s[-1]:
            self._sent_s.clear()
        self._sent_s.append(now_s)
        self._last_s = now_s
        self._usec = max(self._usec + 1, int(stamp_s * 1e6))
        return self._usec

    def rate_hz(self, now_s: float) -> float:
        """Gives the rate over the last two seconds."""
        while self._sent_s and self._sent_s[0] < now_s - _SPAN_S:
            self._sent_s.popleft()
        return len(self._sent_s) / _SPAN_S

    def age_s(self, now_s: float) -> float:
        """Gives the age of the newest; infinite before the first."""
        return now_s - self._last_s
