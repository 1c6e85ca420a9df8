# SPDX-License-Identifier: Apache-2.0
"""Messages from peers: the sender's rights, repetitions, age, order, and the acknowledgement."""

import logging
import time
from typing import Callable, Dict, Iterable

from fcsv_multimaster.errors import RelayError, WireError
from fcsv_multimaster.network import wire
from fcsv_multimaster.relay.measure import SignOfLife
from fcsv_multimaster.relay.parcel import Parcel
from fcsv_multimaster.relay.peer import Peer

_LOG = logging.getLogger(__name__)


class Inbound:
    """Runs in Zenoh's threads. ``note(target, payload, link)`` answers; ``wake(urgent)`` says that
    there is work."""

    def __init__(
        self,
        name: str,
        boot: int,
        peers: Dict[str, Peer],
        deliver: Callable[[Parcel], None],
        drop: Callable[[str, str], None],
        note: Callable[[str, bytes, str], None],
        wake: Callable[[bool], None],
    ):
        self._name, self._boot, self._peers = name, boot, peers
        self._deliver, self._drop, self._note, self._wake = deliver, drop, note, wake

    def on_parcel(self, link: str, source: str, type_name: str, topic: str, payload: bytes) -> None:
        """A message of a topic."""
        peer, now_s = self._peers[source], time.monotonic()
        rule = peer.imports.get(topic)
        if rule is None:
            self._drop("message that no rule lets in", f"{topic} of {source}")
            return
        try:
            head, data = wire.unpack(payload)
        except WireError as error:
            self._drop("malformed message", f"{topic} of {source}: {error}")
            return
        if not self._known(peer, head.boot, now_s):
            return
        if head.to != self._boot:
            if head.to:  # else its sender has not heard us yet, and repeats what must arrive
                self._drop("message for another relay of this name", f"{topic} of {source}")
            return
        if len(data) > rule.traffic.max_bytes:
            self._drop("oversized message", f"{topic} of {source}: {len(data)} bytes")
            return
        with peer.lock:
            again = (head.number and not peer.received.first_time(head.number)) or (
                not rule.traffic.reliable and peer.measure.overtaken(topic, head.sequence)
            )
            poor = peer.measure.poor
            age_s, unsure_s = (
                peer.measure.clocks.age_s(head.sent_s, now_s),
                peer.measure.clocks.unsure_s,
            )
            if not again:
                peer.measure.came(topic, head.sequence, len(payload), age_s, now_s)
        keyframe = False
        if not again:
            parcel = Parcel(
                source,
                topic,
                type_name,
                head.md5,
                head.sequence,
                head.packing,
                data,
                rule,
                age_s,
                now_s,
                unsure_s,
            )
            keyframe = self._accept(peer, parcel, head)
        if head.number:
            self._acknowledge(source, head, keyframe, link, poor)

    def deliver_overdue(self) -> None:
        """Delivers messages whose predecessors did not come in time."""
        for peer in self._peers.values():
            with peer.handing_over:
                self._hand_over_all(peer.order.overdue(time.monotonic()))

    def _accept(self, peer: Peer, parcel: Parcel, head: wire.Head) -> bool:
        """Deliver it, or keep it until what comes before it is here; whether its decoder needs a
        whole picture."""
        traffic = parcel.rule.traffic
        if not traffic.reliable or traffic.link == "bulk":  # newest wins, or a stream that is paced
            return self._hand_over(parcel)
        with peer.handing_over:
            now_s = time.monotonic()
            ready = peer.order.came(
                head.boot, parcel.topic, head.sequence, head.first, parcel, now_s
            )
            self._hand_over_all(ready)
        return False

    def _hand_over_all(self, parcels: Iterable[Parcel]) -> None:
        for parcel in parcels:
            self._hand_over(parcel)

    def _hand_over(self, parcel: Parcel) -> bool:
        if parcel.late(time.monotonic()):
            self._drop("late message", f"{parcel.topic} of {parcel.source}")
            return False
        try:
            return bool(self._deliver(parcel))
        except RelayError as error:
            self._drop("message that cannot be read", f"{parcel.topic} of {parcel.source}: {error}")
            return False

    def _acknowledge(
        self, source: str, head: wire.Head, keyframe: bool, link: str, poor: bool
    ) -> None:
        ack = wire.pack_note(wire.Acknowledgement(head.boot, head.number, keyframe))
        if link == "datagram":
            self._note(source, ack, "datagram")
        if link != "datagram" or poor:
            self._note(source, ack, "urgent")

    def on_note(self, source: str, payload: bytes) -> None:
        """A ping, an answer to ours, or an acknowledgement."""
        peer, now_s = self._peers[source], time.monotonic()
        try:
            note = wire.unpack_note(payload)
        except WireError as error:
            self._drop("malformed message", f"{source}: {error}")
            return
        if isinstance(note, wire.Ping):
            if self._known(peer, note.boot, now_s, note.where):
                with peer.lock:
                    peer.measure.addressed(note.to, self._boot, now_s)
                pong = wire.Pong(self._boot, note.sent_s, time.monotonic(), time.time())
                self._note(source, wire.pack_note(pong), "datagram")
        elif isinstance(note, wire.Pong):
            if self._known(peer, note.boot, now_s) and 0.0 <= now_s - note.sent_s < 60.0:
                with peer.lock:
                    wall_offset_s = note.wall_s + (now_s - note.sent_s) / 2 - time.time()
                    peer.measure.clocks.answered(note.sent_s, now_s, note.here_s, wall_offset_s)
                    peer.measure.ponged()
        elif note.boot == self._boot:
            with peer.lock:
                if peer.rescue.acknowledged(note.number, now_s):
                    self._wake(True)
                elif not peer.repeater.acknowledged(note.number):
                    peer.pacer.acknowledged(note.number, now_s)
                    peer.keyframe |= note.keyframe
            self._wake(False)

    def _known(self, peer: Peer, boot: int, now_s: float, where: str = "") -> bool:
        """Whether it is the relay that bears the peer's name; a second one of the same name is
        reported and ignored."""
        with peer.lock:
            heard = peer.on_sign_of_life(boot, now_s, where)
        if heard is SignOfLife.DOUBLE:
            self._drop(
                "a second machine of the same name",
                f"another relay calls itself {peer.name}; give it its own name",
            )
            return False
        if heard is SignOfLife.NEW:
            _LOG.info("%s: the relay of %s is there", self._name, peer.name)
            self._wake(True)
        return True
