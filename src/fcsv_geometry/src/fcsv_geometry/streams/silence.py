# SPDX-License-Identifier: Apache-2.0
"""Measures for how long nothing of a flow came that is wanted. Time is an argument."""

import math
from typing import Optional

_STEPS = (1.0, 2.0, 5.0)


class Silence:
    """``came`` with each message; a silence longer than ``longest_s`` is told and counted. It
    counts from ``want``.

    ``times``: silences that ended or were given up; ``worst_s``: the longest of them. One thread
    may say what came while another asks.

    >>> pictures = Silence(1.0)
    >>> pictures.lasts_s(99.0)
    0.0
    >>> pictures.want(100.0)
    >>> [pictures.lasts_s(now_s) for now_s in (101.0, 103.5)]
    [0.0, 3.5]
    >>> pictures.came(104.0)
    >>> pictures.lasts_s(104.5), pictures.times, pictures.worst_s
    (0.0, 1, 4.0)
    """

    def __init__(self, longest_s: float):
        if not longest_s > 0.0:
            raise ValueError(f"longest_s: {longest_s} must be positive")
        self._longest_s = longest_s
        self._since_s: Optional[float] = None
        self.times, self.worst_s = 0, 0.0

    def want(self, now_s: float, wanted: bool = True) -> None:
        """Whether the flow is wanted from now on; said again it changes nothing."""
        if not wanted:
            self._ended(now_s)
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s

    def came(self, now_s: float) -> None:
        """A message came; nothing where the flow is not wanted."""
        if self._since_s is not None:
            self._ended(now_s)
            self._since_s = now_s

    def lasts_s(self, now_s: float) -> float:
        """How long nothing has come; 0 where that is no longer than ``longest_s``, or nothing is
        wanted."""
        since_s = self._since_s
        return now_s - since_s if since_s is not None and now_s - since_s > self._longest_s else 0.0

    def _ended(self, now_s: float) -> None:
        lasted_s = self.lasts_s(now_s)
        if lasted_s:
            self.times += 1
            self.worst_s = max(self.worst_s, lasted_s)


def in_steps(seconds: float) -> int:
    """1, 2, 5, 10, 20, 50, ... s, the largest that is not above; 0 below 1 s. So what is said
    changes seldom.

    >>> [in_steps(s) for s in (0.0, 0.9, 1.0, 4.9, 5.0, 19.0, 73.0)]
    [0, 0, 1, 2, 5, 10, 50]
    """
    if seconds < 1.0:
        return 0
    ten = 10.0 ** math.floor(math.log10(seconds))
    return int(max(step for step in _STEPS if step * ten <= seconds) * ten)
