# SPDX-License-Identifier: Apache-2.0
"""How old a value is, how often it comes, and whether it still counts. Time is an argument."""

import math
import statistics
from collections import deque
from dataclasses import dataclass
from typing import Callable, Deque, Generic, Optional, TypeVar

from fcsv_geometry.streams.stream import Stream
from fcsv_geometry.vehicles.thresholds import OFTEN_AGE_S, SLOW_AGE_S

T = TypeVar("T")
STALE_S = OFTEN_AGE_S.console.red
_MISSED = 2.4  # of the time between two messages: one that is lost or late is no alarm
_INTERVALS = 5
_WINDOW_S = 3.0
# what came within less does not tell a rate yet: messages may have been held up on their way
_BURST_S = 0.5


@dataclass(frozen=True)
class Aged(Generic[T]):
    """A value as shown: ``age_s`` infinite where none was ever heard."""

    value: Optional[T] = None
    age_s: float = math.inf
    rate_hz: float = 0.0
    stale: bool = True

    @property
    def words(self) -> str:
        """The age for people: "now", "2.4 s", "3 min", "never".

        >>> [Aged(1, s).words for s in (0.2, 2.44, 200.0, math.inf)]
        ['now', '2.4 s', '3 min', 'never']
        """
        return age_words(self.age_s)


class AgingFact(Stream[T]):
    """The newest value of a stream. It is stale ``stale_s`` after it was heard; infinite: it holds
    until replaced. With ``least_s`` it is sooner where the stream comes often: after 2.4 times its
    usual interval, but not under that.

    >>> h = AgingFact(1.0)
    >>> h.tell(10.0, "GUIDED"); h.at(10.9).stale, h.at(11.1).stale, h.at(11.1).value
    (False, True, 'GUIDED')
    >>> h = slow()
    >>> for k in range(6): h.tell(10.0 + 0.4 * k, "GUIDED")
    >>> h.at(12.9).stale, h.at(13.1).stale
    (False, True)
    """

    def __init__(self, stale_s: float = STALE_S, least_s: Optional[float] = None):
        super().__init__(_WINDOW_S)
        self._stale_s, self._least_s = stale_s, least_s
        self._last: Deque[float] = deque(maxlen=_INTERVALS + 1)

    def tell(self, now_s: float, value: T, age_s: float = 0.0) -> None:
        """``age_s``: how old it was when heard."""
        super().tell(now_s, value)
        self.at_s -= age_s
        self._last.append(now_s)

    def forget(self) -> None:
        """Forgets it as if it had never been heard."""
        super().__init__(_WINDOW_S)
        self._last.clear()

    @property
    def _patience_s(self) -> float:
        if self._least_s is None or len(self._last) <= _INTERVALS:
            return self._stale_s
        times = list(self._last)
        usual_s = statistics.median(b - a for a, b in zip(times, times[1:]))
        return min(self._stale_s, max(self._least_s, _MISSED * usual_s))

    def at(
        self, now_s: float, since_s: Callable[[float], float] = lambda came_s: came_s
    ) -> Aged[T]:
        """Gives the value as it is to be shown now. ``since_s``: from when what came at some time
        counts."""
        self._forget(now_s)
        times = self._times_s
        span_s = self.span_s(now_s)
        rate_hz = (len(times) - 1) / max(times[-1] - times[0], _BURST_S) if times else 0.0
        rate_hz = min(rate_hz, len(times) / max(span_s, _BURST_S))
        age_s = max(0.0, now_s - since_s(self.at_s))
        return Aged(self.value, age_s, rate_hz, age_s > self._patience_s)


def slow() -> AgingFact:
    """Makes an entry for what may come once a second only: an operator waits for it so long only
    while it comes so seldom."""
    return AgingFact(SLOW_AGE_S.console.red, STALE_S)


def age_words(age_s: float) -> str:
    """Says the age as Aged.words."""
    if not math.isfinite(age_s):
        return "never"
    if age_s < 1.0:
        return "now"
    if age_s < 60.0:
        return f"{age_s:.1f} s"
    return f"{age_s / 60.0:.0f} min" if age_s < 5400.0 else f"{age_s / 3600.0:.1f} h"
