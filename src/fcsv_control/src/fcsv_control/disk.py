# SPDX-License-Identifier: Apache-2.0
"""How long a disk lasts: from what is free and how fast a recorder writes."""

from collections import deque
from typing import Deque, Tuple

_WINDOW_S = 10.0


class DiskWatch:
    """``minutes_left`` is by the highest rate of this flight: between recordings little is written,
    which promises too much."""

    def __init__(self, least_free_bytes: int):
        self._least_free_bytes = least_free_bytes
        self._seen: Deque[Tuple[float, int]] = deque()
        self._highest_bytes_per_s = 0.0
        self._room_bytes = 0

    def update(self, now_s: float, written_bytes: int, free_bytes: int) -> None:
        """Takes the counts at least every few seconds: bytes written since the start, bytes that
        are free."""
        self._room_bytes = max(free_bytes - self._least_free_bytes, 0)
        self._seen.append((now_s, written_bytes))
        while len(self._seen) > 2 and now_s - self._seen[1][0] >= _WINDOW_S:
            self._seen.popleft()
        first_s, first_bytes = self._seen[0]
        if now_s - first_s >= _WINDOW_S:
            rate = (written_bytes - first_bytes) / (now_s - first_s)
            self._highest_bytes_per_s = max(self._highest_bytes_per_s, rate)

    @property
    def full(self) -> bool:
        """Whether less is free than has to stay free."""
        return bool(self._seen) and not self._room_bytes

    @property
    def minutes_left(self) -> float:
        """Says how long it is until the disk is full; infinite where no rate is known yet.

        >>> watch = DiskWatch(least_free_bytes=100)
        >>> watch.update(0.0, 0, 10_000); watch.update(10.0, 1000, 9100); watch.update(20.0, 1000, 9100)
        >>> watch.minutes_left
        1.5
        """
        if not self._highest_bytes_per_s:
            return 0.0 if self.full else float("inf")
        return self._room_bytes / self._highest_bytes_per_s / 60.0


def disk_words(minutes: float) -> str:
    """How long a disk lasts, as exactly as an operator needs it.

    >>> disk_words(96.0), disk_words(7582.0)
    ('96 min', 'over 99 h')
    """
    if minutes < 120.0:
        return f"{minutes:.0f} min"
    return f"{minutes / 60.0:.0f} h" if minutes < 6000.0 else "over 99 h"
