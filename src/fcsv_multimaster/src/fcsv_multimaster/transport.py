# SPDX-License-Identifier: Apache-2.0
"""Bytes between machines over Zenoh: one session for what is urgent, one for what is bulky, static addresses only."""

import json
import logging
import struct
import time
from dataclasses import dataclass
from typing import Callable, Dict, Optional

import zenoh

from fcsv_multimaster.endpoints import Endpoint
from fcsv_multimaster.errors import EndpointError
from fcsv_multimaster.links import LINKS, Rule

_LOG = logging.getLogger(__name__)
_HEAD = struct.Struct("<d32s")  # time of sending (s), md5 sum of the type
_BULK_SEND_BUFFER = 60000  # old pictures must not pile up in the kernel


@dataclass(frozen=True)
class Parcel:
    """A serialised message on its way."""

    source: str
    topic: str
    type: str
    md5: str
    sent_s: float
    data: bytes


class Transport:
    """Sends parcels of topics and hands over those of others. Callbacks run in Zenoh's threads.

    ``on_parcel(Parcel)``; ``on_peer(name, alive)`` when a peer's relay appears or goes.
    """

    def __init__(self, name: str, listen: Endpoint, peers: Dict[str, Endpoint],
                 on_parcel: Callable[[Parcel], None], on_peer: Callable[[str, bool], None]):  # fmt: skip
        self._name = name
        self._on_parcel, self._on_peer = on_parcel, on_peer
        self._publishers: Dict[str, object] = {}
        self._definitions: Dict[str, str] = {}
        self._sessions = {link: _open(link, listen, peers) for link in LINKS}
        self._held = []
        for session in self._sessions.values():
            self._held += [session.declare_subscriber(f"fcsv/{p}/t/**", self._received) for p in peers]
        urgent = self._sessions["urgent"]
        self._held.append(urgent.declare_queryable(f"fcsv/{name}/d/**", self._asked_for_definition))
        self._held.append(urgent.liveliness().declare_token(f"fcsv/{name}/alive"))
        for peer in peers:
            key = f"fcsv/{peer}/alive"
            self._held.append(urgent.liveliness().declare_subscriber(key, self._liveliness(peer), history=True))

    def send(self, topic: str, rule: Rule, type_name: str, md5: str, definition: str, data: bytes) -> None:
        """One message; where the link is full a message of an unreliable class is dropped."""
        publisher = self._publishers.get(topic)
        if publisher is None:
            self._definitions[type_name] = definition
            publisher = self._declare(topic, rule, type_name)
            self._publishers[topic] = publisher
        publisher.put(_HEAD.pack(time.time(), md5.encode()) + data)

    def _declare(self, topic: str, rule: Rule, type_name: str):
        drop = zenoh.CongestionControl.DROP
        return self._sessions[rule.traffic.link].declare_publisher(
            f"fcsv/{self._name}/t/{type_name}{topic}",
            priority=getattr(zenoh.Priority, rule.traffic.priority.upper()),
            congestion_control=zenoh.CongestionControl.BLOCK if rule.traffic.reliable else drop,
            express=rule.traffic.link == "urgent",
        )

    def definition(self, source: str, type_name: str, timeout_s: float = 2.0) -> Optional[str]:
        """The full text of a message type, asked of a peer; None where it does not answer."""
        for reply in self._sessions["urgent"].get(f"fcsv/{source}/d/{type_name}", timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_string()
        return None

    def close(self) -> None:
        for session in self._sessions.values():
            session.close()

    def _received(self, sample) -> None:
        payload = sample.payload.to_bytes()
        _, source, _, package, name, *topic = str(sample.key_expr).split("/")
        if len(payload) < _HEAD.size or not topic:
            _LOG.warning("a malformed message of %d bytes from %s", len(payload), source)
            return
        sent_s, md5 = _HEAD.unpack_from(payload)
        parcel = Parcel(source, "/" + "/".join(topic), f"{package}/{name}", md5.decode(errors="replace"), sent_s,
                        payload[_HEAD.size :])  # fmt: skip
        self._on_parcel(parcel)

    def _asked_for_definition(self, query) -> None:
        type_name = str(query.key_expr).split("/d/", 1)[1]
        if type_name in self._definitions:
            query.reply(query.key_expr, self._definitions[type_name])

    def _liveliness(self, peer: str):
        return lambda sample: self._on_peer(peer, sample.kind == zenoh.SampleKind.PUT)


def _open(link: str, listen: Endpoint, peers: Dict[str, Endpoint]):
    locator = listen.locator(link)
    if link == "bulk":
        locator += f"#so_sndbuf={_BULK_SEND_BUFFER}"
    connect = [p.locator(link) + (f"#so_sndbuf={_BULK_SEND_BUFFER}" if link == "bulk" else "") for p in peers.values()]
    settings = {
        "mode": "peer",
        "listen/endpoints": [locator],
        "connect/endpoints": connect,
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 1000, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": 2000,
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise EndpointError(f"the relay cannot listen on {locator}: {str(error).splitlines()[0]}") from error
