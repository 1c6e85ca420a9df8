# SPDX-License-Identifier: Apache-2.0
"""How long messages were under way, from monotonic clocks alone: no step of anybody's time of day changes it."""

from collections import deque
from typing import Deque, Dict, Tuple

_WINDOW_S = 10.0
_MOST_SENDERS = 20


class SenderClocks:
    """Each sender's monotonic clock against ours, by the quickest of its messages of the last ten seconds.

    What the quickest needed is not known and counts as nothing: a few milliseconds. A message that was held up is
    known by how much later it came than the quickest.

    >>> clocks = SenderClocks()
    >>> clocks.sent_here_s(100.0, "mission", 7000.0)
    100.0
    >>> clocks.sent_here_s(104.0, "mission", 7001.0)  # it was under way for 3 s longer than the first
    101.0
    """

    def __init__(self):
        self._offsets: Dict[str, Deque[Tuple[float, float]]] = {}  # (when it came, came minus sent)

    def sent_here_s(self, now_s: float, sender: str, sent_s: float) -> float:
        """A message came now that was sent at ``sent_s`` by its sender's clock: when that was by ours."""
        known = self._offsets.setdefault(sender, deque())
        while known and now_s - known[0][0] > _WINDOW_S:
            known.popleft()
        offset_s = now_s - sent_s
        while known and known[-1][1] >= offset_s:
            known.pop()  # slower and older: never the quickest again
        known.append((now_s, offset_s))
        if len(self._offsets) > _MOST_SENDERS:
            self._offsets.pop(next(n for n in self._offsets if n != sender))
        return sent_s + known[0][1]
