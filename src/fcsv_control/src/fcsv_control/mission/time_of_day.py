# SPDX-License-Identifier: Apache-2.0
"""This machine's time of day against its monotonic clock: recordings are timed by the one, and told
in the other."""

import logging
import math

_log = logging.getLogger(__name__)
_SET_S = 0.05  # moved by more at once, it was set; less is a clock that is kept right slowly


class TimeOfDay:
    """``offset_s``: the time of day minus the monotonic clock; NaN before it was read.
    ``times_set``: how often it was set while it was watched."""

    def __init__(self):
        self._least_s, self._most_s = -math.inf, math.inf
        self.times_set = 0

    def update(self, before_s: float, wall_s: float, after_s: float) -> None:
        """The time of day was read, between two looks at the monotonic clock. A process that did
        not run in between knows less, and takes nothing for a step.

        >>> day = TimeOfDay()
        >>> for before_s, wall_s, after_s in [(10.0, 110.0, 10.0), (11.0, 114.0, 15.0), (16.0, 116.4, 16.0)]:
        ...     day.update(before_s, wall_s, after_s)
        >>> day.times_set, round(day.offset_s, 3)
        (1, 100.4)
        """
        least_s, most_s = wall_s - after_s, wall_s - before_s
        apart_s = max(least_s - self._most_s, self._least_s - most_s)
        if apart_s > _SET_S:
            self.times_set += 1
            _log.warning(
                "this machine's time of day was set: what is being recorded is recorded again"
            )
        if apart_s <= 0.0:
            least_s, most_s = max(least_s, self._least_s), min(most_s, self._most_s)
        self._least_s, self._most_s = least_s, most_s

    @property
    def offset_s(self) -> float:
        return 0.5 * (self._least_s + self._most_s) if math.isfinite(self._least_s) else math.nan
