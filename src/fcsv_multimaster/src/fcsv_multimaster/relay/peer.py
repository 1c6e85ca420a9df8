# SPDX-License-Identifier: Apache-2.0
"""What this machine keeps about one peer: rules, messages to send, measurements."""

import threading
from typing import Dict, List, Tuple

from fcsv_geometry.streams.flow import RateGate
from fcsv_multimaster.links import LinkRule
from fcsv_multimaster.relay.measure import PeerMeasure, SignOfLife
from fcsv_multimaster.relay.order import DeliveryOrder
from fcsv_multimaster.relay.outbound import Message, Pacer, Remembered, Repeater

_CALL_S = 0.7
_CONTACT_S = 1.0  # after the first sign of life: by then the peer listens on every link
_POOR_HZ = 12.0  # of each state by datagram, where many are lost


class Peer:
    """Hold ``lock`` for everything but the rules; time is an argument."""

    def __init__(self, name: str, exports: Dict[str, LinkRule], imports: Dict[str, LinkRule]):
        self.name, self.exports, self.imports = name, exports, imports
        self.lock = threading.RLock()
        self.measure = PeerMeasure()
        self.repeater, self.pacer, self.received = Repeater(), Pacer(), Remembered()
        # state by the urgent stream, where datagrams fail
        self.rescue = Pacer(lost_after_s=0.6, most_in_flight=8)
        self.last: Dict[str, Message] = {}  # of every latched topic
        # hold it while what is in order is delivered
        self.order, self.handing_over = DeliveryOrder(), threading.RLock()
        self.keyframe = False  # its decoder asked for a whole picture
        self._limits = {
            t: RateGate.bursting(r.most_hz) for t, r in exports.items() if r.most_hz is not None
        }
        self._poor_limits: Dict[str, RateGate] = {}
        self._held_back: Dict[str, Message] = {}
        self._sequences: Dict[str, int] = {}
        self._numbers = 0
        self._there = False
        self._called_s = 0.0
        self._contact_s = float("-inf")

    def on_sign_of_life(self, boot: int, now_s: float, where: str = "") -> SignOfLife:
        """A sign of life of a relay that bears this name."""
        was_there = self.measure.alive(now_s)
        heard = self.measure.on_sign_of_life(boot, now_s, where)
        if not was_there:
            self._contact_s = now_s
        if heard is SignOfLife.NEW:
            self._restarted(now_s)
        return heard

    def admits(self, message: Message, now_s: float) -> bool:
        """Whether the rule's rate lets it pass; the last value of a latched topic is only held
        back."""
        limit = self._limits.get(message.topic)
        if limit is None:
            return True
        with self.lock:
            if limit.passes(now_s):
                self._held_back.pop(message.topic, None)
                return True
            if message.rule.traffic.latched:
                self._held_back[message.topic] = message
        return False

    def number(self, message: Message) -> None:
        """Its place in the topic, and a number of its own where it is to be acknowledged."""
        message.sequence = self._sequences[message.topic] = (
            self._sequences.get(message.topic, 0) + 1
        )
        traffic = message.rule.traffic
        there = self.measure.alive(message.born_s) and message.born_s - self._contact_s > _CONTACT_S
        message.early = traffic.reliable and not traffic.latched and not there
        if (
            traffic.reliable
            or traffic.link == "bulk"
            or (traffic.link == "datagram" and self._spare(message))
        ):
            self._numbers += 1
            message.number = self._numbers

    def _spare(self, message: Message) -> bool:
        """Whether a state goes by the stream: all but a few, as long as QUIC's congestion control
        starves datagrams."""
        if not self.measure.poor:
            return False
        limit = self._poor_limits.setdefault(message.topic, RateGate.bursting(_POOR_HZ))
        return not limit.passes(message.born_s)

    def _restarted(self, now_s: float) -> None:
        """A relay that knows nothing of us: the last value of every latched topic waits for it
        again."""
        self._there = True
        self.received = Remembered()
        self._cut()
        for message in self.last.values():
            self.repeater.add(message, now_s - 1.0)

    def noticed_gone(self, now_s: float) -> bool:
        """True once when it has fallen silent. What is under way on the bulk link is taken for
        lost."""
        was, self._there = self._there, self.measure.alive(now_s)
        if was and not self._there:
            self._cut()
            return True
        return False

    def _cut(self) -> None:
        self.pacer.cut()
        self.rescue.cut()
        self.repeater.all_early()

    def to_be_called(self, now_s: float) -> bool:
        """Once in a while, as long as nothing is heard of it."""
        with self.lock:
            if self.measure.alive(now_s) or now_s - self._called_s < _CALL_S:
                return False
            self._called_s = now_s
            return True

    def first(self, message: Message) -> int:
        """The oldest of its topic that must be delivered before it; its own sequence where none
        must."""
        if not message.rule.traffic.reliable or message.rule.traffic.latched:
            return message.sequence
        with self.lock:
            return self.repeater.first(message)

    def due(self, now_s: float) -> Tuple[List[Tuple[Message, bool]], float]:
        """((message, whether it is new), ...) to send now, and when to look again. Nothing to who
        is not there."""
        with self.lock:
            if not self.measure.alive(now_s):
                return [], now_s + 1.0
            again = self.repeater.due(now_s, self.measure.clocks.round_trip_s)
            held = [t for t in self._held_back if self._limits[t].passes(now_s)]
            new = [self._held_back.pop(t) for t in held]
            waits = [self._limits[t].next_s for t in self._held_back]
            next_s = self.repeater.next_s()
        wake_s = min([*waits, now_s + 1.0 if next_s is None else next_s])
        due = [(m, False) for m in again] + [(m, True) for m in new]
        return due, wake_s

    def report(self, now_s: float) -> Dict[str, Dict]:
        """Figures since the last report: of the link, and per topic that comes in."""
        with self.lock:
            report = self.measure.report(now_s)
            flying, octets = self.pacer.flying()
            budget = self.pacer.budget_octets_s(now_s)
            report["link"].update(
                waiting=len(self.repeater) + len(self.rescue),
                expired=self.repeater.expired,
                pictures_waiting=len(self.pacer),
                pictures_flying=flying,
                flying_kb=octets / 1e3,
                pictures_dropped=self.pacer.dropped,
                pictures_give_way=self.pacer.limited(now_s),
                picture_round_trip_s=self.pacer.queue_s,
                carries_kbit_s=None if budget is None else budget * 8e-3,
            )
        return report
