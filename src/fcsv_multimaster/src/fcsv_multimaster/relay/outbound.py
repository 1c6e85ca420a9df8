# SPDX-License-Identifier: Apache-2.0
"""What waits to be sent to one peer: repeated until acknowledged, or paced so that pictures never
pile up."""

from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Deque, Dict, List, Optional, Set, Tuple

from fcsv_multimaster.links import LinkRule

_FIRST_REPEAT_S, _LAST_REPEAT_S = 0.03, 0.12
_STREAM_REPEAT_S = 1.0  # TCP repeats by itself: this is for what fell into a cut
_EARLY_REPEAT_S = 0.2  # until the peer listens
_MOST_WAITING = 500
_QUEUE_S = 0.25  # pictures under way are at most what the link carries in this time
_MOST_PICTURES_WAITING = 64
_LONGEST_PATIENCE_S = 20.0


@dataclass
class Message:
    """A serialised message on its way out."""

    topic: str
    rule: LinkRule
    type: str
    md5: str
    data: bytes
    born_s: float
    sequence: int = 0
    number: int = 0
    streamed: bool = False
    # from before the peer was there, or was well there: what comes after it is delivered after it
    early: bool = False

    def late(self, now_s: float) -> bool:
        max_age_s = self.rule.traffic.max_age_s
        return max_age_s is not None and now_s - self.born_s > max_age_s


@dataclass
class _Repeated:
    message: Message
    next_s: float
    interval_s: float


class Repeater:
    """Messages that are sent again until the peer has acknowledged them, or they are too old to
    matter."""

    def __init__(self):
        self._open: OrderedDict[int, _Repeated] = OrderedDict()
        # sequences of a topic's early messages, in their order
        self._early: Dict[str, Dict[int, None]] = {}
        self.expired = 0

    def __len__(self) -> int:
        return len(self._open)

    def add(self, message: Message, now_s: float) -> None:
        """Sent now, perhaps again. A latched one replaces the older one of its topic."""
        if message.rule.traffic.latched:
            for number in [n for n, r in self._open.items() if r.message.topic == message.topic]:
                self.acknowledged(number)
        if len(self._open) >= _MOST_WAITING:
            self.acknowledged(next(iter(self._open)))
            self.expired += 1
        if message.early:
            self._early.setdefault(message.topic, {})[message.sequence] = None
        stream_s = _EARLY_REPEAT_S if message.early else _STREAM_REPEAT_S
        interval_s = _FIRST_REPEAT_S if message.rule.traffic.link == "datagram" else stream_s
        self._open[message.number] = _Repeated(message, now_s + interval_s, interval_s)

    def acknowledged(self, number: int) -> bool:
        """Forget a message; whether it was waiting."""
        known = self._open.pop(number, None)
        if known is not None and known.message.early:
            del self._early[known.message.topic][known.message.sequence]
        return known is not None

    def all_early(self) -> None:
        """The peer is gone: everything that still waits is from before it is there again."""
        self._early.clear()
        for r in self._open.values():
            if not r.message.rule.traffic.latched:
                r.message.early = True
                self._early.setdefault(r.message.topic, {})[r.message.sequence] = None

    def first(self, message: Message) -> int:
        """The oldest early message of its topic that is still on its way; its own sequence where
        none is before it."""
        return min(
            message.sequence, next(iter(self._early.get(message.topic, ())), message.sequence)
        )

    def due(self, now_s: float, round_trip_s: Optional[float]) -> List[Message]:
        """What to send again now; what is too old is forgotten."""
        for number in [n for n, r in self._open.items() if r.message.late(now_s)]:
            self.acknowledged(number)
            self.expired += 1
        due = [r for r in self._open.values() if r.next_s <= now_s]
        for r in due:
            if r.message.rule.traffic.link == "datagram":
                r.interval_s = min(
                    _LAST_REPEAT_S, max(1.5 * r.interval_s, 1.5 * (round_trip_s or 0.0))
                )
            r.next_s = now_s + r.interval_s
        return [r.message for r in due]

    def next_s(self) -> Optional[float]:
        return min((r.next_s for r in self._open.values()), default=None)


class Pacer:
    """Bulky messages for one peer: newest wins per topic, reliable ones in order, few under way at
    a time.

    The peer acknowledges every one; what it acknowledges per second is what the link carries, and
    what is under way is bounded by it, so that a slow link makes pictures rarer instead of older.
    What is under way counts as lost once nothing at all was acknowledged for ``lost_after_s``;
    where that was too early, for longer (as RFC 6298 does), else a link that is merely slow would
    carry the same pictures again and again.
    """

    def __init__(self, lost_after_s: float = 2.5, most_in_flight: int = 3):
        self._most_in_flight = most_in_flight
        self._lost_after_s = self._patience_s = lost_after_s
        self._heard_s = float("-inf")  # the last acknowledgement
        self._repeated: Set[int] = set()
        self._latest: OrderedDict[str, Message] = OrderedDict()
        self._waiting: Deque[Message] = deque()
        # message, octets, since
        self._flying: OrderedDict[int, Tuple[Message, int, float]] = OrderedDict()
        self._acked: Deque[Tuple[float, int]] = deque()
        self._carries_octets_s: Optional[float] = None
        self._limited_s = float("-inf")
        self._turn = False
        self.dropped = 0
        # age of the last acknowledged one when its acknowledgement came
        self.queue_s: Optional[float] = None

    def __len__(self) -> int:
        return len(self._latest) + len(self._waiting)

    def offer(self, message: Message) -> None:
        """Take a message in; an unreliable one replaces the one of its topic that still waits."""
        if message.rule.traffic.reliable:
            if len(self._waiting) >= _MOST_PICTURES_WAITING:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(message)
            return
        self.dropped += message.topic in self._latest
        self._latest[message.topic] = message

    def next_message(self, now_s: float) -> Optional[Message]:
        """The next to send, or None while the link is full or nothing waits."""
        self._forget_lost(now_s)
        if not self._waiting and not self._latest:
            return None
        if not self._room():
            self._limited_s = now_s
            return None
        while self._waiting or self._latest:
            # by turns: neither kind starves the other
            self._turn = not self._turn or not self._latest
            by_turn = self._turn and self._waiting
            message = (
                self._waiting.popleft()
                if by_turn or not self._latest
                else self._latest.popitem(last=False)[1]
            )
            if not message.late(now_s):
                return message
            self.dropped += 1
        return None

    def sent(self, message: Message, octets: int, now_s: float) -> None:
        self._flying[message.number] = (message, octets, now_s)

    def acknowledged(self, number: int, now_s: float) -> bool:
        known = self._flying.pop(number, None)
        if known is None:
            return False
        _, octets, sent_s = known
        self.queue_s, self._heard_s = now_s - sent_s, now_s
        if number in self._repeated:
            self._repeated.remove(number)  # of which sending it speaks is not known
        else:
            self._patience_s = max(self._lost_after_s, 2.0 * self.queue_s)
        self._acked.append((now_s, octets))
        while self._acked and now_s - self._acked[0][0] > 2.0:
            self._acked.popleft()
        if self.limited(now_s) and len(self._acked) > 2:
            span_s = max(now_s - self._acked[0][0], 0.05)
            rate = sum(o for _, o in list(self._acked)[1:]) / span_s
            self._carries_octets_s = (
                rate
                if self._carries_octets_s is None
                else 0.7 * self._carries_octets_s + 0.3 * rate
            )
        elif self._carries_octets_s is not None:
            self._carries_octets_s *= 1.05  # it carried what there was: perhaps more
        return True

    def cut(self) -> None:
        """The peer is gone or restarted: reliable ones that were under way wait again, in their
        order."""
        again = [m for m, _, _ in self._flying.values() if m.rule.traffic.reliable]
        self._flying.clear()
        self._repeated.clear()
        self._turn, self._patience_s = False, self._lost_after_s
        self._waiting.extendleft(reversed(again))

    def limited(self, now_s: float) -> bool:
        """Whether something had to wait for the link lately: pictures are then made smaller."""
        return now_s - self._limited_s < 1.0

    def budget_octets_s(self, now_s: float) -> Optional[float]:
        """What pictures may use; None: no bound is known, all that was asked for went through."""
        return (
            self._carries_octets_s
            if self.limited(now_s) or self._carries_octets_s is not None
            else None
        )

    def flying(self) -> Tuple[int, int]:
        """(messages, octets) under way."""
        return len(self._flying), sum(o for _, o, _ in self._flying.values())

    def _room(self) -> bool:
        messages, octets = self.flying()
        if messages == 0:
            return True
        most = (
            _QUEUE_S * self._carries_octets_s
            if self._carries_octets_s is not None
            else float("inf")
        )
        return messages < self._most_in_flight and octets < max(most, 1.0)

    def _forget_lost(self, now_s: float) -> None:
        lost = [
            n
            for n, (_, _, s) in self._flying.items()
            if now_s - max(s, self._heard_s) > self._patience_s
        ]
        for number in reversed(lost):  # the oldest to the front last
            message = self._flying.pop(number)[0]
            if message.rule.traffic.reliable and not message.late(now_s):
                self._waiting.appendleft(message)
                self._repeated.add(number)
            else:
                self._repeated.discard(number)
                self.dropped += 1
        if lost:
            self._patience_s = min(2.0 * self._patience_s, _LONGEST_PATIENCE_S)


class Remembered:
    """Numbers that were received lately, so that a repetition is not delivered twice."""

    def __init__(self, most: int = 2000):
        self._most = most
        self._numbers: Dict[int, None] = OrderedDict()

    def first_time(self, number: int) -> bool:
        if number in self._numbers:
            return False
        self._numbers[number] = None
        if len(self._numbers) > self._most:
            self._numbers.popitem(last=False)
        return True
