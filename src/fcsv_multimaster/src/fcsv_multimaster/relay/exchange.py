# SPDX-License-Identifier: Apache-2.0
"""One machine's side of the exchange: what leaves under which rule, what is repeated, what is
measured.

Knows nothing of ROS: messages are bytes with a type's name and md5 sum.
"""

import logging
import os
import threading
import time
from typing import Callable, Dict, Optional

from fcsv_multimaster.errors import EndpointError, RelayError, WireError
from fcsv_multimaster.keys.keyring import Keyring
from fcsv_multimaster.links import Links
from fcsv_multimaster.network import wire
from fcsv_multimaster.network.addresses import whereabouts
from fcsv_multimaster.network.endpoints import Endpoint
from fcsv_multimaster.network.joining import HalfOpen
from fcsv_multimaster.network.transport import ZenohTransport
from fcsv_multimaster.relay.inbound import Inbound
from fcsv_multimaster.relay.measure import CLOCKS_APART_S
from fcsv_multimaster.relay.outbound import Message
from fcsv_multimaster.relay.parcel import Parcel, as_it_is
from fcsv_multimaster.relay.peer import Peer

_LOG = logging.getLogger(__name__)
_PING_S = 0.25
_LOOK_S = 0.5  # whether streams have contact
_LONGEST_SLEEP_S = 0.1
# beyond, what must arrive goes by the stream: too many fragments would have to
_DATAGRAM_OCTETS = 16000


class Exchange:
    """``deliver(Parcel)`` is called in Zenoh's threads; True asks for a keyframe, RelayError is a
    drop.

    ``drop(reason, detail)`` counts and tells, throttled; ``problem(name, text)`` stands until its
    text is empty; ``pack`` packs a bulky message for a target when its turn comes (see
    ``as_it_is``).
    """

    def __init__(
        self,
        name: str,
        links: Links,
        listen: Endpoint,
        peers: Dict[str, Optional[Endpoint]],
        keys: Optional[Keyring],
        deliver: Callable[[Parcel], None],
        drop: Callable[[str, str], None],
        problem: Callable[[str, str], None],
        pack=as_it_is,
        discovery: bool = False,
    ):
        if name in peers:
            raise RelayError(
                f"'{name}' is this machine and among its peers; every machine has a name of its own"
            )
        self._name, self._boot = name, int.from_bytes(os.urandom(4), "little")
        self._drop, self._problem, self._pack = drop, problem, pack
        self.peers = {p: Peer(p, links.crossing(name, p), links.crossing(p, name)) for p in peers}
        self.exports = sorted({t for p in self.peers.values() for t in p.exports})
        self._closed = False
        # datagrams are called again by themselves
        self._half_open = {link: HalfOpen() for link in ("urgent", "bulk")}
        self._urgent_work, self._bulk_work = threading.Event(), threading.Event()
        self._inbound = Inbound(name, self._boot, self.peers, deliver, drop, self._note, self._wake)
        self._transport: Optional[ZenohTransport] = None
        self._transport = ZenohTransport(
            name, listen, peers, keys, self._inbound.on_parcel, self._inbound.on_note, discovery
        )
        self._transport.on_malformed = lambda source, text: self._drop(
            "malformed message", f"{source}: {text}"
        )
        self._transport.on_lost = lambda peer, text: self._drop(
            "message that cannot be sent", f"to {peer}: {text}"
        )
        self._threads = [
            threading.Thread(target=work, name=work.__name__, daemon=True)
            for work in (self._work, self._work_bulk)
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

    def reopen(self) -> None:
        """Join the network anew, from the addresses that this machine has now. Raises
        EndpointError."""
        self._transport.reopen()

    def definition(self, source: str, type_name: str) -> Optional[str]:
        """The text of a type, asked of a peer; waits up to two seconds."""
        return self._transport.definition(source, type_name)

    # ---- out -------------------------------------------------------------------------------------

    def send(
        self, topic: str, type_name: str, md5: str, definition: str, data: bytes, only: str = ""
    ) -> int:
        """A local message: to every peer (or ``only`` one) that a rule names, at its rate; how many
        it goes to."""
        self._transport.define(type_name, definition)
        now_s, taken = time.monotonic(), 0
        for peer in self.peers.values():
            rule = peer.exports.get(topic)
            if rule is None or (only and peer.name != only):
                continue
            if len(data) > rule.traffic.max_bytes and rule.codec is None:
                self._drop(
                    "oversized message",
                    f"{topic}: {len(data)} bytes, its class allows {rule.traffic.max_bytes}",
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

    def _put(
        self,
        peer: Peer,
        message: Message,
        packing: int = wire.RAW,
        data: Optional[bytes] = None,
        link: str = "",
    ) -> None:
        traffic, data = message.rule.traffic, message.data if data is None else data
        link = link or traffic.link
        if link == "datagram" and traffic.reliable and len(data) > _DATAGRAM_OCTETS:
            link = "urgent"
        first = peer.first(message)
        boots = (self._boot, peer.measure.boot or 0)
        head = wire.Head(
            packing, *boots, message.sequence, first, message.number, message.born_s, message.md5
        )
        try:
            payload = wire.pack(head, data)
        except WireError as error:
            self._drop("malformed message", f"{message.topic}: {error}")
            return
        self._transport.send(peer.name, message.topic, traffic, link, message.type, payload)

    def _note(self, target: str, payload: bytes, link: str) -> None:
        # an answer while the links are still being opened: it will be asked again
        if self._transport is not None:
            self._transport.note(target, payload, link)

    def _wake(self, urgent: bool) -> None:
        (self._urgent_work if urgent else self._bulk_work).set()

    # ---- what goes on by itself ------------------------------------------------------------------

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
            self._inbound.deliver_overdue()
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
                message = peer.rescue.next_message(time.monotonic())
                if message is None:
                    return
                peer.rescue.sent(message, len(message.data), time.monotonic())
            self._put(peer, message, link="urgent")

    def _ping(self, now_s: float) -> None:
        where = whereabouts()
        for peer in self.peers.values():
            ping = wire.Ping(self._boot, peer.measure.boot or 0, now_s, time.time(), where)
            self._transport.note(peer.name, wire.pack_note(ping), "datagram")
            if peer.to_be_called(now_s):
                self._transport.listen_again(peer.name)
            with peer.lock:
                peer.measure.pinged()
                gone = peer.noticed_gone(now_s)
                offset_s = peer.measure.clocks.wall_offset_s
                twin, displaced = peer.measure.twin(now_s), peer.measure.displaced(now_s)
            if gone:
                _LOG.warning("%s: the relay of %s is gone", self._name, peer.name)
            apart = offset_s is not None and abs(offset_s) > CLOCKS_APART_S
            text = (
                f"the clock of {peer.name} is {offset_s:+.1f} s off this one's; synchronise them"
                if apart
                else ""
            )
            self._problem(f"clock {peer.name}", text)
            text = f"two machines call themselves {peer.name}; refused: {twin or 'the second'}; give it its own name"
            self._problem(f"twin {peer.name}", "" if twin is None else text)
            text = f"{peer.name} refuses this machine: another one is {self._name} there; give one a name of its own"
            self._problem(f"displaced {peer.name}", text if displaced else "")

    def _work_bulk(self) -> None:
        next_look_s = 0.0
        while not self._closed:
            sent = False
            if time.monotonic() >= next_look_s:
                self._mend_links()
                next_look_s = time.monotonic() + _LOOK_S
            for peer in self.peers.values():
                if not self._transport.reaches(peer.name, "bulk"):
                    continue
                with peer.lock:
                    message = (
                        peer.pacer.next_message(time.monotonic())
                        if peer.measure.alive(time.monotonic())
                        else None
                    )
                    budget, keyframe = peer.pacer.budget_octets_s(time.monotonic()), peer.keyframe
                    peer.keyframe = keyframe and (message is None or message.rule.codec is None)
                if message is not None:
                    sent = True
                    self._send_bulk(peer, message, budget, keyframe)
            if not sent:
                self._bulk_work.wait(
                    _LONGEST_SLEEP_S if any(len(p.pacer) for p in self.peers.values()) else 1.0
                )
                self._bulk_work.clear()

    def _mend_links(self) -> None:
        """Open a stream anew that lost a peer who listens; what was under way goes again."""
        for link, half_open in self._half_open.items():
            if not half_open.due(*self._transport.listening(link), time.monotonic()):
                continue
            _LOG.warning(
                "%s: its %s link lost a peer that listens; opening it anew", self._name, link
            )
            try:
                self._transport.reopen((link,))
            except EndpointError as error:
                half_open.failed()
                self._problem(f"{link} link", str(error))
                continue
            self._problem(f"{link} link", "")
            for peer in self.peers.values():
                with peer.lock:
                    (peer.pacer if link == "bulk" else peer.rescue).cut()

    def _send_bulk(
        self, peer: Peer, message: Message, budget: Optional[float], keyframe: bool
    ) -> None:
        try:
            packing, data = (self._pack if message.rule.codec else as_it_is)(
                peer.name, message, budget, keyframe
            )
        except RelayError as error:
            self._drop("picture that cannot be packed", f"{message.topic}: {error}")
            return
        if len(data) > message.rule.traffic.max_bytes:
            self._drop("oversized message", f"{message.topic}: {len(data)} bytes")
            return
        with peer.lock:
            peer.pacer.sent(message, len(data), time.monotonic())
        self._put(peer, message, packing, data)
