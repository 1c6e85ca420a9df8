# SPDX-License-Identifier: Apache-2.0
"""Holds a message until the earlier ones of its topic have come, for a second at most. Time is an
argument."""

from typing import Any, Dict, List, Optional, Tuple

_LONGEST_S = 1.0  # a command must not wait for ever for one that is older


class DeliveryOrder:
    """Keeps the order of the messages of one peer, which counts anew in every ``boot``. ``first``
    of a message is the oldest of its topic that must be delivered before it.

    >>> order = DeliveryOrder()
    >>> order.came(7, "/t", 3, 1, "c", 0.0), order.came(7, "/t", 1, 1, "a", 0.1), order.came(7, "/t", 2, 1, "b", 0.2)
    ([], ['a'], ['b', 'c'])
    """

    def __init__(self):
        self._boot: Optional[int] = None
        self._next: Dict[str, int] = {}  # nothing older of the topic is waited for
        # sequence to (what waits, until when)
        self._held: Dict[str, Dict[int, Tuple[Any, float]]] = {}

    def came(
        self, boot: int, topic: str, sequence: int, first: int, item: Any, now_s: float
    ) -> List[Any]:
        """What is to be delivered now, in order; ``item`` is among it, or waits."""
        left: List[Any] = []
        if boot != self._boot:
            left, self._boot = self.overdue(float("inf")), boot
            self._next.clear()
        if sequence < self._next.get(topic, 0):
            return [*left, item]  # it was waited for in vain
        held = self._held.setdefault(topic, {})
        held[sequence] = (item, now_s + _LONGEST_S)
        return left + self._release(topic, first)

    def overdue(self, now_s: float) -> List[Any]:
        """Messages that have waited long enough, with all older ones."""
        ready: List[Any] = []
        for topic, held in self._held.items():
            late = [sequence for sequence, (_, until_s) in held.items() if until_s <= now_s]
            if late:
                ready += self._release(topic, max(late) + 1)
        return ready

    def _release(self, topic: str, first: int) -> List[Any]:
        held, following = self._held[topic], max(first, self._next.get(topic, 0))
        ready = []
        for sequence in sorted(held):
            if sequence > following:
                break
            ready.append(held.pop(sequence)[0])
            following = max(following, sequence + 1)
        self._next[topic] = following
        return ready
