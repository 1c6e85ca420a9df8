# SPDX-License-Identifier: Apache-2.0
"""How far the maps of a survey are, in words."""

import threading
import time
from typing import Callable, Dict, Sequence

Begin = Callable[[str, float], None]
_LEAST_SHARE = 0.1  # of all maps; by less the remaining time is a guess


class MapsProgress:
    """Tells ``begin`` how far several maps are; they tell their own from any thread.

    ``names``: of the maps. ``share``: of the survey's time that is theirs.
    """

    def __init__(
        self,
        names: Sequence[str],
        begin: Begin,
        share: float,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._names, self._begin, self._share, self._clock = names, begin, share, clock
        self._began_s, self._lock = clock(), threading.Lock()
        self._under_way: Dict[int, str] = {}
        self._shares = [0.0] * len(names)
        self._ended = 0

    def begin(self, by_workers: bool) -> None:
        """Says what comes first."""
        if not self._names:
            self._begin("reading maps", 0.0)
            return
        starting = ", starting workers" if by_workers else ""
        self._begin(f"0 of {len(self._names)} maps{starting}", 0.0)

    def advance(self, number: int, step: str, share: float) -> None:
        """Hears that a map begins a ``step``, with ``share`` of it (0 to 1) done."""
        with self._lock:
            if share >= self._shares[number] and self._shares[number] < 1.0:
                self._shares[number] = share
                self._under_way[number] = step
                self._show()

    def ended(self, number: int) -> None:
        """Hears that a map is ready, or cannot be made."""
        with self._lock:
            self._shares[number] = 1.0
            self._under_way.pop(number, None)
            self._ended += 1
            self._show()

    def _show(self) -> None:
        share = sum(self._shares) / len(self._shares)
        words = [f"{self._ended} of {len(self._names)} maps"]
        if _LEAST_SHARE <= share < 1.0:
            left_s = (self._clock() - self._began_s) * (1.0 - share) / share
            words.append(f"about {left_s:.0f} s for the others")
        words += [f"{self._names[i]}: {step}" for i, step in sorted(self._under_way.items())]
        self._begin(", ".join(words), self._share * share)
