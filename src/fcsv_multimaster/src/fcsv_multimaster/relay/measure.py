# SPDX-License-Identifier: Apache-2.0
"""What is known of the link to one peer: round trip, clocks, loss, throughput, age per topic. Time
is an argument."""

from collections import deque
from dataclasses import dataclass
from enum import Enum, auto
from typing import Deque, Dict, Optional, Tuple

SILENT_S = 1.0  # four pings unanswered: the peer is taken for gone
# after the last word of the first of two machines with one name, the second may take its place
TWIN_S = 60.0
# a peer that speaks to another one of our name for so long does not mean our former self
_DISPLACED_S = 3.0
CLOCKS_APART_S = 0.1  # of two machines' time of day, beyond which it is said
_KEPT_PINGS = 40
_MOST_RIVALS = 16
_POOR_OF, _POOR_SHARE = 12, 0.75  # of the last three seconds' pings


class Clocks:
    """The peer's clocks against ours, from pings and their answers; a step of a wall clock changes
    no age."""

    def __init__(self):
        # round trip, offsets
        self._samples: Deque[Tuple[float, float, float]] = deque(maxlen=_KEPT_PINGS)

    def answered(self, sent_s: float, now_s: float, peer_s: float, wall_offset_s: float) -> None:
        """A pong: our monotonic clock at ping and now, the peer's in between, its wall clock minus
        ours."""
        self._samples.append((now_s - sent_s, peer_s - (sent_s + now_s) / 2, wall_offset_s))

    def forget(self) -> None:
        """The peer restarted: its monotonic clock may be another one."""
        self._samples.clear()

    @property
    def round_trip_s(self) -> Optional[float]:
        """The median of the last ten."""
        last = sorted(s[0] for s in list(self._samples)[-10:])
        return last[len(last) // 2] if last else None

    @property
    def wall_offset_s(self) -> Optional[float]:
        """The peer's time of day minus ours, from the quickest of the last five pings, so that a
        step shows."""
        last = list(self._samples)[-5:]
        return min(last)[2] if last else None

    def age_s(self, sent_s: float, now_s: float) -> Optional[float]:
        """Age of what the peer sent at its ``sent_s``; None before the first pong."""
        if not self._samples:
            return None
        return max(0.0, now_s + min(self._samples)[1] - sent_s)

    @property
    def unsure_s(self) -> float:
        """Says by how much an age may be wrong: the answer to the quickest ping was under way both
        ways together so long."""
        return min(self._samples)[0] / 2 if self._samples else 0.0


@dataclass
class TopicCount:
    """What came of one topic since the last look."""

    received: int = 0
    lost: int = 0
    octets: int = 0
    late: int = 0
    newest_sequence: int = 0
    age_s: Optional[float] = None
    last_s: Optional[float] = None


class SignOfLife(Enum):
    """Whose sign of life it is."""

    SAME = auto()  # the relay's that we know
    NEW = auto()  # the first, or of one that was started again
    DOUBLE = auto()  # another relay's, while the one we know still speaks


class PeerMeasure:
    """All figures of one peer."""

    def __init__(self):
        self.clocks = Clocks()
        self.topics: Dict[str, TopicCount] = {}
        self.boot: Optional[int] = None
        self._heard_s: Optional[float] = None
        self._pings = self._pongs = 0
        self._ping_loss = 0.0
        self._since_s: Optional[float] = None
        self._answered: Deque[bool] = deque(maxlen=_POOR_OF)
        self._pong_since_ping = False
        # boot of others of this name to when they were first heard
        self._rivals: Dict[int, float] = {}
        # of these, those that are no restart of the first, and when last heard
        self._twins: Dict[int, float] = {}
        self._twin_where = ""
        self._displaced_since_s: Optional[float] = None

    def on_sign_of_life(self, boot: int, now_s: float, where: str = "") -> SignOfLife:
        """A sign of life of a relay that bears the peer's name; every start of a relay has a
        ``boot`` of its own.

        Two that speak at the same time are two machines: the second is refused while the first was
        heard in the last minute, so that a cut of the first does not put the second in its place.
        """
        if self.boot == boot:
            self._heard_s = now_s
            self._twins.update(
                (b, now_s) for b, first_s in self._rivals.items() if now_s - first_s > SILENT_S
            )
            self._rivals = {b: s for b, s in self._rivals.items() if b not in self._twins}
            return SignOfLife.SAME
        patience_s = TWIN_S if boot in self._twins else SILENT_S
        if self.boot is not None and now_s - self._heard_s < patience_s:
            self._on_double(boot, now_s, where)
            return SignOfLife.DOUBLE
        self.boot, self._heard_s = boot, now_s
        self._rivals.clear()
        self._twins.pop(boot, None)
        self.clocks.forget()
        for count in self.topics.values():
            count.newest_sequence = 0
        return SignOfLife.NEW

    def _on_double(self, boot: int, now_s: float, where: str) -> None:
        self._twin_where = where or self._twin_where
        if boot in self._twins:
            self._twins[boot] = now_s
        elif len(self._rivals) < _MOST_RIVALS:
            self._rivals.setdefault(boot, now_s)

    def twin(self, now_s: float) -> Optional[str]:
        """Where the second machine of this name is, in its own words; None where there is none."""
        self._twins = {b: s for b, s in self._twins.items() if now_s - s < TWIN_S}
        return self._twin_where if self._twins else None

    def addressed(self, to: int, own: int, now_s: float) -> None:
        """Whom of our name a ping of the peer is meant for."""
        if to in (0, own):
            self._displaced_since_s = None
        elif self._displaced_since_s is None:
            self._displaced_since_s = now_s

    def displaced(self, now_s: float) -> bool:
        """Whether the peer holds another machine for the one of our name."""
        since_s = self._displaced_since_s
        return since_s is not None and self.alive(now_s) and now_s - since_s > _DISPLACED_S

    def alive(self, now_s: float) -> bool:
        return self._heard_s is not None and now_s - self._heard_s < SILENT_S

    def pinged(self) -> None:
        if self._pings or self._answered:
            self._answered.append(self._pong_since_ping)
        self._pong_since_ping = False
        self._pings += 1

    def ponged(self) -> None:
        self._pong_since_ping = True
        self._pongs += 1

    @property
    def poor(self) -> bool:
        """Whether so many datagrams are lost that QUIC hardly sends any: state then goes by the
        stream."""
        return len(self._answered) == _POOR_OF and sum(self._answered) < _POOR_SHARE * _POOR_OF

    def overtaken(self, topic: str, sequence: int) -> bool:
        """Whether this one, or a later one of its topic, has come already."""
        count = self.topics.get(topic)
        return count is not None and sequence <= count.newest_sequence

    def came(
        self, topic: str, sequence: int, octets: int, age_s: Optional[float], now_s: float
    ) -> None:
        """One message of a topic; gaps in its sequence are losses until what was lost comes
        late."""
        count = self.topics.setdefault(topic, TopicCount())
        gap = sequence - count.newest_sequence - 1
        if gap < 0:
            count.lost = max(0, count.lost - 1)
        elif count.newest_sequence:
            count.lost += gap
        count.newest_sequence = max(count.newest_sequence, sequence)
        count.received += 1
        count.octets += octets
        count.age_s, count.last_s = age_s, now_s

    def report(self, now_s: float) -> Dict[str, Dict]:
        """Figures since the last report, and a new beginning: "link" and "topics", for
        diagnostics."""
        elapsed_s = max(now_s - self._since_s, 1e-3) if self._since_s is not None else 1.0
        topics, octets, received, lost = {}, 0, 0, 0
        for name, c in self.topics.items():
            topics[name] = {
                "rate_hz": c.received / elapsed_s,
                "loss": c.lost / max(1, c.lost + c.received),
                "age_s": c.age_s,
                "silent_s": None if c.last_s is None else now_s - c.last_s,
                "kbit_s": c.octets * 8e-3 / elapsed_s,
            }
            octets, received, lost = octets + c.octets, received + c.received, lost + c.lost
            c.received = c.lost = c.octets = 0
        if self._pings:
            self._ping_loss = max(0.0, 1.0 - self._pongs / self._pings)
        link = {
            "alive": self.alive(now_s),
            "round_trip_s": self.clocks.round_trip_s,
            "in_loss": lost / max(1, lost + received),
            "poor": self.poor,
            "ping_loss": self._ping_loss,
            "in_kbit_s": octets * 8e-3 / elapsed_s,
            "clock_offset_s": self.clocks.wall_offset_s,
        }
        self._pings = self._pongs = 0
        self._since_s = now_s
        return {"link": link, "topics": topics}
