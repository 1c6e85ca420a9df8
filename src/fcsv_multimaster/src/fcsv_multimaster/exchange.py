# SPDX-License-Identifier: Apache-2.0
"""One machine's side of the exchange: what leaves under which rule, what may come in, what is repeated and measured.

Knows nothing of ROS: messages are bytes with a type's name and md5 sum.
"""

import logging
import os
import threading
import time
from typing import Callable, Dict, Optional

from fcsv_multimaster import wire
from fcsv_multimaster.endpoints import Endpoint
from fcsv_multimaster.errors import RelayError, WireError
from fcsv_multimaster.keyring import Keyring
from fcsv_multimaster.links import Links
from fcsv_multimaster.outbound import Message
from fcsv_multimaster.parcel import Parcel, as_it_is
from fcsv_multimaster.peer import Peer
from fcsv_multimaster.transport import Transport

_LOG = logging.getLogger(__name__)
_PING_S = 0.25
_LONGEST_SLEEP_S = 0.1
_DATAGRAM_OCTETS = 16000  # beyond, what must arrive goes by the stream: too many fragments would have to
_CLOCKS_APART_S = 0.1


class Exchange:
    """``deliver(Parcel)`` is called in Zenoh's threads; True asks for a keyframe, RelayError is a drop.

    ``drop(reason, detail)`` counts and tells, throttled; ``problem(name, text)`` stands until its text is empty;
    ``pack`` packs a bulky message for a target when its turn comes (see ``as_it_is``).
    """

    def __init__(self, name: str, links: Links, listen: Endpoint, peers: Dict[str, Optional[Endpoint]],
                 keys: Optional[Keyring], deliver: Callable[[Parcel], None], drop: Callable[[str, str], None],
                 problem: Callable[[str, str], None], pack=as_it_is, discovery: bool = False):  # fmt: skip
        if name in peers:
            raise RelayError(f"'{name}' is this machine and among its peers; every machine has a name of its own")
        self._name, self._boot = name, int.from_bytes(os.urandom(4), "little")
        self._deliver, self._drop, self._problem, self._pack = deliver, drop, problem, pack
        self.peers = {p: Peer(p, links.crossing(name, p), links.crossing(p, name)) for p in peers}
        self.exports = sorted({t for p in self.peers.values() for t in p.exports})
        self._closed = False
        self._urgent_work, self._bulk_work = threading.Event(), threading.Event()
        self._transport = Transport(name, listen, peers, keys, self._on_parcel, self._on_note, discovery)
        self._transport.on_malformed = lambda source, text: self._drop("malformed message", f"{source}: {text}")
        self._threads = [
            threading.Thread(target=work, name=work.__name__, daemon=True) for work in (self._work, self._work_bulk)
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop the threads and leave the network. Safe to call again."""
        if self._closed:
            return
        self._closed = True
        self._urgent_work.set()
        self._bulk_work.set()
        self._transport.close()
        for thread in self._threads:
            thread.join(3.0)

    def definition(self, source: str, type_name: str) -> Optional[str]:
        """The text of a type, asked of a peer; waits up to two seconds."""
        return self._transport.definition(source, type_name)

    # ---- out -----------------------------------------------------------------------------------------------

    def send(self, topic: str, type_name: str, md5: str, definition: str, data: bytes, only: str = "") -> int:
        """A local message: to every peer (or ``only`` one) that a rule names, at its rate; how many it goes to."""
        self._transport.define(type_name, definition)
        now_s, taken = time.monotonic(), 0
        for peer in self.peers.values():
            rule = peer.exports.get(topic)
            if rule is None or (only and peer.name != only):
                continue
            if len(data) > rule.traffic.max_bytes and rule.codec is None:
                self._drop(
                    "oversized message", f"{topic}: {len(data)} bytes, its class allows {rule.traffic.max_bytes}"
                )
                continue
            message = Message(topic, rule, type_name, md5, data, now_s)
            if peer.admits(message, now_s):
                self._forward(peer, message, now_s)
                taken += 1
        return taken

    def _forward(self, peer: Peer, message: Message, now_s: float) -> None:
        if message.rule.traffic.link == "bulk":
            if message.rule.traffic.reliable or peer.measure.alive(now_s):
                with peer.lock:
                    peer.number(message)
                    peer.pacer.offer(message)
                self._bulk_work.set()
            return
        with peer.lock:
            peer.number(message)
            if message.rule.traffic.latched:
                peer.last[message.topic] = message
            if message.rule.traffic.reliable:
                peer.repeater.add(message, now_s)
            rescued = message.number and not message.rule.traffic.reliable
            if rescued:
                peer.rescue.offer(message)
        if not rescued:
            self._put(peer, message)
        self._urgent_work.set()

    def _put(self, peer: Peer, message: Message, packing: int = wire.RAW, data: Optional[bytes] = None,
             link: str = "") -> None:  # fmt: skip
        traffic, data = message.rule.traffic, message.data if data is None else data
        link = link or traffic.link
        if link == "datagram" and traffic.reliable and len(data) > _DATAGRAM_OCTETS:
            link = "urgent"
        head = wire.Head(packing, self._boot, message.sequence, message.number, message.born_s, message.md5)
        try:
            payload = wire.pack(head, data)
        except WireError as error:
            self._drop("malformed message", f"{message.topic}: {error}")
            return
        self._transport.send(peer.name, message.topic, traffic, link, message.type, payload)

    # ---- in ------------------------------------------------------------------------------------------------

    def _on_parcel(self, link: str, source: str, type_name: str, topic: str, payload: bytes) -> None:
        peer, now_s = self.peers[source], time.monotonic()
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
        if len(data) > rule.traffic.max_bytes:
            self._drop("oversized message", f"{topic} of {source}: {len(data)} bytes")
            return
        with peer.lock:
            again = (head.number and not peer.received.first_time(head.number)) or (
                not rule.traffic.reliable and peer.measure.overtaken(topic, head.sequence)
            )
            poor = peer.measure.poor
            age_s = peer.measure.clocks.age_s(head.sent_s, now_s)
            if not again:
                peer.measure.came(topic, head.sequence, len(payload), age_s, now_s)
        keyframe = False
        if not again and (rule.traffic.max_age_s is None or age_s is None or age_s <= rule.traffic.max_age_s):
            parcel = Parcel(source, topic, type_name, head.md5, head.sequence, head.packing, data, rule, age_s)
            try:
                keyframe = bool(self._deliver(parcel))
            except RelayError as error:
                self._drop("message that cannot be read", f"{topic} of {source}: {error}")
        elif not again:
            self._drop("late message", f"{topic} of {source}")
        if head.number:
            ack = wire.pack_note(wire.Ack(head.boot, head.number, keyframe))
            if link == "datagram":
                self._transport.note(source, ack)
            if link != "datagram" or poor:
                self._transport.note(source, ack, "urgent")

    def _on_note(self, source: str, payload: bytes) -> None:
        peer, now_s = self.peers[source], time.monotonic()
        try:
            note = wire.unpack_note(payload)
        except WireError as error:
            self._drop("malformed message", f"{source}: {error}")
            return
        if isinstance(note, wire.Ping):
            if self._known(peer, note.boot, now_s):
                pong = wire.Pong(self._boot, note.sent_s, time.monotonic(), time.time())
                self._transport.note(source, wire.pack_note(pong))
        elif isinstance(note, wire.Pong):
            if self._known(peer, note.boot, now_s) and 0.0 <= now_s - note.sent_s < 60.0:
                with peer.lock:
                    wall_offset_s = note.wall_s + (now_s - note.sent_s) / 2 - time.time()
                    peer.measure.clocks.answered(note.sent_s, now_s, note.here_s, wall_offset_s)
                    peer.measure.ponged()
        elif note.boot == self._boot:
            with peer.lock:
                if peer.rescue.acknowledged(note.number, now_s):
                    self._urgent_work.set()
                elif not peer.repeater.acknowledged(note.number):
                    peer.pacer.acknowledged(note.number, now_s)
                    peer.keyframe |= note.keyframe
            self._bulk_work.set()

    def _known(self, peer: Peer, boot: int, now_s: float) -> bool:
        """Whether it is the relay that bears the peer's name; a second one of the same name is named and not heard."""
        with peer.lock:
            verdict = peer.measure.heard(boot, now_s)
            if verdict == "new":
                peer.restarted(now_s)
        if verdict == "double":
            self._drop(
                "a second machine of the same name", f"another relay calls itself {peer.name}; give it its own name"
            )
            return False
        if verdict == "new":
            _LOG.info("%s: the relay of %s is there", self._name, peer.name)
            self._urgent_work.set()
        return True

    # ---- what goes on by itself ----------------------------------------------------------------------------

    def _work(self) -> None:
        next_ping_s = 0.0
        while not self._closed:
            now_s = time.monotonic()
            wake_s = next_ping_s
            if now_s >= next_ping_s:
                next_ping_s = wake_s = now_s + _PING_S
                self._ping(now_s)
            for peer in self.peers.values():
                due, peer_wake_s = peer.due(now_s)
                for message, new in due:
                    if new:
                        self._forward(peer, message, now_s)
                    else:
                        self._repeat(peer, message)
                self._rescue(peer)
                wake_s = min(wake_s, peer_wake_s)
            self._urgent_work.wait(min(_LONGEST_SLEEP_S, max(0.002, wake_s - time.monotonic())))
            self._urgent_work.clear()

    def _repeat(self, peer: Peer, message: Message) -> None:
        self._put(peer, message)
        if peer.measure.poor and not message.streamed:
            message.streamed = True
            self._put(peer, message, link="urgent")

    def _rescue(self, peer: Peer) -> None:
        """State by the stream, no more than it carries."""
        while True:
            with peer.lock:
                message = peer.rescue.take(time.monotonic())
                if message is None:
                    return
                peer.rescue.sent(message, len(message.data), time.monotonic())
            self._put(peer, message, link="urgent")

    def _ping(self, now_s: float) -> None:
        for peer in self.peers.values():
            self._transport.note(peer.name, wire.pack_note(wire.Ping(self._boot, now_s, time.time())))
            if peer.to_be_called(now_s):
                self._transport.listen_again(peer.name)
            with peer.lock:
                peer.measure.pinged()
                gone = peer.noticed_gone(now_s)
                offset_s = peer.measure.clocks.wall_offset_s
            if gone:
                _LOG.warning("%s: the relay of %s is gone", self._name, peer.name)
            apart = offset_s is not None and abs(offset_s) > _CLOCKS_APART_S
            text = f"the clock of {peer.name} is {offset_s:+.2f} s off this one's; synchronise them" if apart else ""
            self._problem(f"clock {peer.name}", text)

    def _work_bulk(self) -> None:
        while not self._closed:
            sent = False
            for peer in self.peers.values():
                if not self._transport.reaches(peer.name, "bulk"):
                    continue
                with peer.lock:
                    message = peer.pacer.take(time.monotonic()) if peer.measure.alive(time.monotonic()) else None
                    budget, keyframe = peer.pacer.budget_octets_s(time.monotonic()), peer.keyframe
                    peer.keyframe = keyframe and (message is None or message.rule.codec is None)
                if message is not None:
                    sent = True
                    self._send_bulk(peer, message, budget, keyframe)
            if not sent:
                self._bulk_work.wait(_LONGEST_SLEEP_S if any(len(p.pacer) for p in self.peers.values()) else 1.0)
                self._bulk_work.clear()

    def _send_bulk(self, peer: Peer, message: Message, budget: Optional[float], keyframe: bool) -> None:
        try:
            packing, data = (self._pack if message.rule.codec else as_it_is)(peer.name, message, budget, keyframe)
        except RelayError as error:
            self._drop("picture that cannot be packed", f"{message.topic}: {error}")
            return
        if len(data) > message.rule.traffic.max_bytes:
            self._drop("oversized message", f"{message.topic}: {len(data)} bytes")
            return
        with peer.lock:
            peer.pacer.sent(message, len(data), time.monotonic())
        self._put(peer, message, packing, data)
