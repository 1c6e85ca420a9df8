# SPDX-License-Identifier: Apache-2.0
"""The newest of what comes again and again, and for how long something has been true. Times (s) are
monotonic and arguments."""

import math
from collections import deque
from typing import Deque, Generic, Optional, TypeVar

T = TypeVar("T")


class Stream(Generic[T]):
    """The newest value, when it came, and how many came in the last ``window_s``.

    >>> poses = Stream(2.0)
    >>> for k in range(60):
    ...     poses.tell(k / 30.0)
    >>> poses.rate_hz(1.99), poses.rate_hz(9.0), round(poses.age_s(3.0), 2), poses.fresh(3.0, 1.0)
    (30.0, 0.0, 1.03, False)
    """

    def __init__(self, window_s: float = 1.0):
        self.value: Optional[T] = None
        self.at_s = -math.inf
        self._window_s = window_s
        self._times_s: Deque[float] = deque()

    def tell(self, now_s: float, value: Optional[T] = None) -> None:
        """It came now. A time before the last one begins anew."""
        if self._times_s and now_s < self._times_s[-1]:
            self._times_s.clear()
        self.value, self.at_s = value, now_s
        self._times_s.append(now_s)
        self._forget(now_s)

    @property
    def known(self) -> bool:
        """Whether it ever came."""
        return self.at_s > -math.inf

    def age_s(self, now_s: float) -> float:
        """Since it came last; infinite before the first."""
        return now_s - self.at_s

    def fresh(self, now_s: float, most_s: float) -> bool:
        """Whether it came within the last ``most_s``."""
        return now_s - self.at_s <= most_s

    def rate_hz(self, now_s: float) -> float:
        """How many came a second, over the window."""
        self._forget(now_s)
        return len(self._times_s) / self._window_s

    def span_s(self, now_s: float) -> float:
        """Since the oldest in the window came; 0 where none is in it."""
        return now_s - self._times_s[0] if self._times_s else 0.0

    def _forget(self, now_s: float) -> None:
        while self._times_s and self._times_s[0] < now_s - self._window_s:
            self._times_s.popleft()


class Since:
    """Counts for how long something has been true, from the first moment at which it was.

    >>> calm = Since()
    >>> calm.lasts_s(10.0), calm.lasts_s(12.5), calm.lasts_s(13.0, False), calm.lasts_s(14.0)
    (0.0, 2.5, -inf, 0.0)
    """

    def __init__(self) -> None:
        self._since_s: Optional[float] = None

    def lasts_s(self, now_s: float, true: bool = True) -> float:
        """Tells for how long it has been ``true`` by now; minus infinity where it is not."""
        if not true:
            self._since_s = None
            return -math.inf
        self._since_s = now_s if self._since_s is None else self._since_s
        return now_s - self._since_s

    def end(self) -> None:
        """It is not true any more."""
        self._since_s = None
