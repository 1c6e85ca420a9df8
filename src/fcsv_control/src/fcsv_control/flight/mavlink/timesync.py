# SPDX-License-Identifier: Apache-2.0
"""TIMESYNC: how the autopilot's clock stands to ours, and how long the line takes.

The stamps of the poses stay on our own clock: ArduPilot takes any monotonic clock and removes its
offset by when poses arrive (measured, and read in its sources), so that an offset that is corrected
here would only step in its view.
"""

from collections import deque
from typing import Deque, Optional, Tuple

_KEPT = 30  # answers: the quickest of them tells the offset best


class TimeSync:
    """``offset_s``: the autopilot's clock minus ours; ``round_trip_s``: of the quickest answer;
    None before."""

    def __init__(self):
        self._asked_ns: Deque[int] = deque(maxlen=_KEPT)
        self._answers: Deque[Tuple[float, float]] = deque(maxlen=_KEPT)  # round trip, offset

    def ask(self, now_s: float) -> Tuple[int, int]:
        """tc1 and ts1 of a question."""
        self._asked_ns.append(int(now_s * 1e9))
        return 0, self._asked_ns[-1]

    def receive(self, now_s: float, tc1: int, ts1: int) -> Optional[Tuple[int, int]]:
        """A TIMESYNC came: tc1 and ts1 of the answer where it is a question; answers to others are
        passed over."""
        if tc1 == 0:
            return int(now_s * 1e9), ts1
        if ts1 in self._asked_ns:
            self._asked_ns.remove(ts1)
            round_trip_s = now_s - ts1 / 1e9
            self._answers.append((round_trip_s, tc1 / 1e9 - (now_s - 0.5 * round_trip_s)))
        return None

    def begin(self) -> None:
        """The autopilot was started again: so was its clock."""
        self._answers.clear()

    @property
    def offset_s(self) -> Optional[float]:
        return min(self._answers)[1] if self._answers else None

    @property
    def round_trip_s(self) -> Optional[float]:
        return min(self._answers)[0] if self._answers else None
