# SPDX-License-Identifier: Apache-2.0
"""Bytes between machines over Zenoh: one session per link, known or discovered addresses, and only
peers with keys.

Small and urgent never shares a queue with large: datagrams (QUIC), an urgent stream (TLS) and a
bulk stream (TLS with a small send buffer) are three sessions. Certificates say who a machine is,
and an access list by certificate says under which names it may speak. Without keys only loopback
addresses are allowed.
"""

import json
import logging
import os
import threading
import time
from dataclasses import replace
from typing import Callable, Dict, Iterable, List, Optional, Sequence, Tuple

# Closing a TLS link to a machine that vanished blocks one of Zenoh's receiving threads for ten
# seconds (SO_LINGER): with its two threads one vanished vehicle would silence all others. Read when
# zenoh is loaded.
os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 16))")

import zenoh

from fcsv_multimaster.errors import EndpointError
from fcsv_multimaster.keys.keyring import Keyring
from fcsv_multimaster.links import LINKS, TrafficClass
from fcsv_multimaster.network import wire
from fcsv_multimaster.network.addresses import local_addresses
from fcsv_multimaster.network.endpoints import Endpoint, refuse_open_networks

_LOG = logging.getLogger(__name__)
_CLOSE_S = 3.0  # what takes longer closes in the background
_LARGEST = 16_000_000  # of one message (octets), whatever a rule says
# of the greeting: what is lost of it may be lost for good, so try anew soon; QUIC repeats after 1 s
_OPEN_MS = 1200
_WAITS_OCTETS = 30000
_BULK_SEND_BUFFER = 60000  # (octets) old pictures must not pile up in the kernel
# not Zenoh's own
_SCOUT_ADDRESS, _SCOUT_PORTS = "224.0.0.224", {"datagram": 17446, "urgent": 17447, "bulk": 17448}
# of the access list
_MESSAGES = ("put", "delete", "declare_subscriber", "query", "declare_queryable", "reply")


class ZenohTransport:
    """Sends to peers and hands over what they send. Callbacks run in Zenoh's threads.

    ``on_parcel(link, source, type, topic, payload)``, ``on_note(source, payload)``. A peer without
    an address is looked for by multicast where ``discovery`` is on; what answers must still show
    the certificate of a peer's name. Raises EndpointError where it cannot listen.
    """

    def __init__(
        self,
        name: str,
        listen: Endpoint,
        peers: Dict[str, Optional[Endpoint]],
        keys: Optional[Keyring],
        on_parcel: Callable[[str, str, str, str, bytes], None],
        on_note: Callable[[str, bytes], None],
        discovery: bool = False,
    ):
        self._name, self._peers = name, tuple(peers)
        self._changing, self._over = threading.Lock(), False
        self._on_parcel, self._on_note = on_parcel, on_note
        self.on_malformed: Callable[[str, str], None] = lambda source, text: _LOG.warning(
            "%s: %s", source, text
        )
        self.on_lost: Callable[[str, str], None] = self.on_malformed
        self._publishers: Dict[tuple, object] = {}
        self._definitions: Dict[str, str] = {}
        addresses = [p for p in peers.values() if p is not None]
        refuse_open_networks((listen, *addresses), keys is not None, discovery)
        access = _access(name, peers, keys)
        self._opening = (listen, addresses, access, discovery)
        self._sessions: Dict[str, object] = {}
        self._held: Dict[str, List[object]] = {}
        self._datagrams: Dict[str, object] = {}
        with self._changing:
            self._open_links(LINKS)

    def _open_links(self, links: Sequence[str]) -> None:
        for known in [k for k in list(self._publishers) if k[1] in links]:
            self._publishers.pop(known, None)
        try:
            for link in links:
                self._sessions[link] = _open(link, *self._opening)
                self._held[link] = []
        except EndpointError:
            self._close_links(links)
            raise
        for peer in self._peers:
            for link in links:
                if link == "datagram":
                    self._datagrams.pop(peer, None)
                    self._listen(peer)
                    continue
                key = wire.everything_key(peer, self._name)
                self._held[link].append(
                    self._sessions[link].declare_subscriber(key, self._receiver(link))
                )
            if "urgent" in links:
                key = wire.definition_key(self._name, peer, "**")
                asked = self._sessions["urgent"].declare_queryable(key, self._asked_for_definition)
                self._held["urgent"].append(asked)

    def reopen(self, links: Sequence[str] = LINKS) -> None:
        """Leave the network and join it again: looking for peers goes on from the addresses that
        there are now.

        What is sent meanwhile is lost. Raises EndpointError where it cannot listen any more.
        """
        with self._changing:
            if not self._over:
                self._close_links(links)
                self._open_links(links)

    def listening(self, link: str) -> Tuple[int, int]:
        """How many peers listen on a link, and with how many machines its session has contact: see
        ``HalfOpen``."""
        try:
            return sum(self.reaches(p, link) for p in self._peers), len(
                self._sessions[link].info.peers_zid()
            )
        except zenoh.ZError:
            return 0, 0  # it is closed

    def send(
        self,
        target: str,
        topic: str,
        traffic: TrafficClass,
        link: str,
        type_name: str,
        payload: bytes,
    ) -> None:
        """One packed message over a link; where the link is full a small one is dropped, a large
        one waits."""
        # large ones would always find the link busy
        wait = link == "bulk" or len(payload) > _WAITS_OCTETS

        def declare():
            return self._sessions[link].declare_publisher(
                wire.topic_key(self._name, target, type_name, topic),
                priority=getattr(zenoh.Priority, traffic.priority.upper()),
                congestion_control=zenoh.CongestionControl.BLOCK
                if wait
                else zenoh.CongestionControl.DROP,
                express=link != "bulk",
            )

        self._by(
            (target, link, topic, type_name, wait),
            declare,
            lambda publisher: publisher.put(payload),
        )

    def note(self, target: str, payload: bytes, link: str) -> None:
        """A few bytes, at once, perhaps lost."""
        self._by_note(target, link, lambda publisher: publisher.put(payload))

    def reaches(self, target: str, link: str) -> bool:
        """Whether the peer listens on this link now."""
        return bool(
            self._by_note(target, link, lambda publisher: publisher.matching_status.matching)
        )

    def _by_note(self, target: str, link: str, use: Callable):
        def declare():
            return self._sessions[link].declare_publisher(
                wire.note_key(self._name, target),
                priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )

        return self._by((target, link), declare, use)

    def _by(self, known: tuple, declare: Callable, use: Callable):
        """``use(publisher)``, which is declared the first time; None where its session was closed
        meanwhile."""
        try:
            publisher = self._publishers.get(known)
            if publisher is None:
                publisher = self._publishers[known] = declare()
            return use(publisher)
        except zenoh.ZError as error:
            self._publishers.pop(known, None)
            if not self._changing.locked():
                self.on_lost(known[0], str(error).splitlines()[0])
            return None

    def listen_again(self, peer: str) -> None:
        """Tell a silent peer again that we listen: a declaration that was lost as a datagram is not
        repeated."""
        if self._changing.acquire(blocking=False):
            try:
                self._listen(peer)
            finally:
                self._changing.release()

    def _listen(self, peer: str) -> None:
        known = self._datagrams.pop(peer, None)
        if known is not None:
            known.undeclare()
        key = wire.everything_key(peer, self._name)
        self._datagrams[peer] = self._sessions["datagram"].declare_subscriber(
            key, self._receiver("datagram")
        )

    def define(self, type_name: str, text: str) -> None:
        """The full text of a message type, for peers that ask."""
        self._definitions[type_name] = text

    def definition(self, source: str, type_name: str, timeout_s: float = 2.0) -> Optional[str]:
        """The full text of a message type, asked of a peer; None where it does not answer."""
        key = wire.definition_key(source, self._name, type_name)
        try:
            replies = self._sessions["urgent"].get(key, timeout=timeout_s)
        except zenoh.ZError:
            return None  # the links are being opened anew
        return next(
            (reply.ok.payload.to_string() for reply in replies if reply.ok is not None), None
        )

    def close(self) -> None:
        """Leave the network."""
        with self._changing:
            self._over = True
            self._close_links(LINKS)

    def _close_links(self, links: Sequence[str]) -> None:
        """Closes all at once, as each may wait for a machine that vanished."""
        sessions = [self._sessions[link] for link in links if link in self._sessions]
        closing = [threading.Thread(target=_close, args=(s,), daemon=True) for s in sessions]
        for thread in closing:
            thread.start()
        until_s = time.monotonic() + _CLOSE_S
        for thread in closing:
            thread.join(max(0.0, until_s - time.monotonic()))

    def _receiver(self, link: str):
        def received(sample) -> None:
            key, payload = str(sample.key_expr), sample.payload.to_bytes()
            try:
                if key.count("/") == 3:
                    self._on_note(key.split("/", 2)[1], payload)
                else:
                    self._on_parcel(link, *wire.split_topic_key(key), payload)
            except wire.WireError as error:
                self.on_malformed(key.split("/")[1], str(error))

        return received

    def _asked_for_definition(self, query) -> None:
        type_name = str(query.key_expr).split("/d/", 1)[1]
        if type_name in self._definitions:
            query.reply(query.key_expr, self._definitions[type_name])


def _open(
    link: str, listen: Endpoint, peers: List[Endpoint], access: Dict[str, object], discovery: bool
):
    encrypted = bool(access)
    # Zenoh reads this machine's addresses once in a process: for those of now it has to be told
    # them
    here = sorted(local_addresses()) if discovery else []
    hosts = here if here and listen.is_any else [listen.host]
    locators = [replace(listen, host=host).locator(link, encrypted) for host in hosts]
    settings = {
        "mode": "peer",
        "listen/endpoints": locators,
        "connect/endpoints": [p.locator(link, encrypted) for p in peers],
        "connect/timeout_ms": -1,  # for ever, and in the background
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2},
        "scouting/multicast/enabled": discovery,
        "scouting/multicast/interface": ",".join(here) or "auto",
        "scouting/multicast/address": f"{_SCOUT_ADDRESS}:{_SCOUT_PORTS[link]}",
        "scouting/gossip/enabled": False,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
        "transport/link/tx/lease": 2000,
        "transport/link/rx/max_message_size": _LARGEST,
        "transport/unicast/open_timeout": _OPEN_MS,
        "transport/unicast/accept_timeout": _OPEN_MS,
        "transport/shared_memory/enabled": False,
        **access,
    }
    if link == "bulk":
        settings[f"transport/link/{'tls' if encrypted else 'tcp'}/so_sndbuf"] = _BULK_SEND_BUFFER
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise EndpointError(
            f"the relay cannot listen on {locators[0]}: {str(error).splitlines()[0]}"
        ) from error


def _close(session) -> None:
    try:
        session.close()
    except zenoh.ZError as error:
        # it lingers for a machine that vanished
        _LOG.debug("a session that closes slowly: %s", error)


def _access(name: str, peers: Iterable[str], keys: Optional[Keyring]) -> Dict[str, object]:
    """Access list: who may send what to whom. Without keys (on loopback) there is none."""
    if keys is None:
        return {}
    return {"transport/link/tls": _tls(keys), "access_control": _access_list(name, peers, keys)}


def _tls(keys: Keyring) -> Dict[str, object]:
    """Both sides show a certificate; its name is a machine's, not an address, so that addresses may
    change."""
    return {
        "root_ca_certificate": str(keys.authority),
        "listen_private_key": str(keys.key),
        "listen_certificate": str(keys.certificate),
        "connect_private_key": str(keys.key),
        "connect_certificate": str(keys.certificate),
        "enable_mtls": True,
        "verify_name_on_connect": False,
    }


def _access_list(name: str, peers: Iterable[str], keys: Keyring) -> Dict[str, object]:
    """Allows this machine and the holder of a peer's unrevoked certificate the topics between the
    two, no others."""
    rules = [
        {
            "id": f"with-{p}",
            "messages": list(_MESSAGES),
            "flows": ["ingress", "egress"],
            "permission": "allow",
            "key_exprs": [f"fcsv/{p}/{name}/**", f"fcsv/{name}/{p}/**"],
        }
        for p in peers
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": p, "cert_common_names": [keys.revoked.good_name(p)]} for p in peers],
        "policies": [{"rules": [f"with-{p}"], "subjects": [p]} for p in peers],
    }
