# SPDX-License-Identifier: Apache-2.0
"""Bytes that no relay would send, in what comes in from a peer: nothing dies, and what is right
afterwards is heard."""

import contextlib
import random
import socket
import struct

import pytest
from support.waiting import within

from fcsv_multimaster.errors import WireError
from fcsv_multimaster.links import LINKS, LinkRule, TrafficClass
from fcsv_multimaster.network import wire
from fcsv_multimaster.network.endpoints import Endpoint
from fcsv_multimaster.network.transport import ZenohTransport
from fcsv_multimaster.relay.inbound import Inbound
from fcsv_multimaster.relay.peer import Peer
from fcsv_sim.machines.machines import free_port

until = within(15.0)

ROUNDS = 10_000
HERE, THERE = 7, 9  # boots
RULES = {
    "/t": LinkRule("/t", TrafficClass("datagram", "real_time", True, max_age_s=5.0)),
    "/s": LinkRule("/s", TrafficClass("datagram", "interactive_high", False, max_age_s=1.0)),
}
EDGES = (
    b"\x00" * 4,
    b"\xff" * 4,
    struct.pack("<d", float("nan")),
    struct.pack("<d", float("inf")),
    struct.pack("<d", -1e308),
)


class Bench:
    """What comes in at control from uav1, with everything around it written down."""

    def __init__(self):
        self.peer, self.heard, self.drops, self.notes = Peer("uav1", {}, RULES), [], [], []
        self.inbound = Inbound(
            "control",
            HERE,
            {"uav1": self.peer},
            lambda p: self.heard.append(p.data),
            lambda why, _: self.drops.append(why),
            lambda *n: self.notes.append(n),
            lambda _: None,
        )

    def parcel(self, topic, payload):
        self.inbound.on_parcel("datagram", "uav1", "std_msgs/String", topic, payload)


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), -1.0])
def test_a_note_without_a_time_is_refused(time_s):
    for note in (
        wire.Ping(1, 2, time_s, 1.0),
        wire.Ping(1, 2, 1.0, time_s),
        wire.Pong(1, 1.0, time_s, 1.0),
    ):
        with pytest.raises(WireError, match="malformed times"):
            wire.unpack_note(wire.pack_note(note))


def noise(rng, most):
    return bytes(rng.getrandbits(8) for _ in range(rng.randrange(most)))


def mangled(payload, rng):
    """A payload that was cut, lengthened, or overwritten in places, or that is nothing but
    noise."""
    payload, kind = bytearray(payload), rng.randrange(5)
    if kind == 0:
        return bytes(payload[: rng.randrange(len(payload) + 1)])
    if kind == 1:
        return bytes(payload) + noise(rng, 200)
    if kind == 2:
        return noise(rng, 100)
    for _ in range(rng.randrange(1, 5)):
        piece = rng.choice(EDGES) if kind == 3 else bytes([rng.getrandbits(8)])
        at = rng.randrange(2, len(payload))
        payload[at : at + len(piece)] = piece
    return bytes(payload)


def right(sequence, sent_s, boot=THERE, number=0):
    return wire.pack(
        wire.Head(wire.RAW, boot, HERE, sequence, sequence, number, sent_s, "0" * 32), b"good"
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_ten_thousand_mangled_messages_and_notes_end_nothing(seed, monkeypatch):
    rng, now = random.Random(seed), [1000.0]
    monkeypatch.setattr("fcsv_multimaster.relay.inbound.time.monotonic", lambda: now[0])
    bench = Bench()
    notes = [
        wire.Ping(THERE, HERE, 1.0, 2.0, "host a"),
        wire.Pong(THERE, 999.9, 5.0, 6.0),
        wire.Acknowledgement(HERE, 3),
    ]
    for i in range(ROUNDS):
        now[0] += 1e-3
        if i % 2:
            bench.inbound.on_note("uav1", mangled(wire.pack_note(rng.choice(notes)), rng))
        else:
            bench.parcel(
                rng.choice(["/t", "/s", "/absent"]), mangled(right(i + 1, now[0], number=i), rng)
            )
        if i % 100 == 0:
            bench.inbound.deliver_overdue()
    assert "malformed message" in bench.drops and "message that no rule lets in" in bench.drops
    now[0] += 100.0  # whoever was believed to be another relay is silent
    bench.heard.clear()
    boot = 12345
    for k in range(3):
        bench.inbound.on_note("uav1", wire.pack_note(wire.Ping(boot, HERE, now[0], 2.0)))
        bench.inbound.on_note(
            "uav1", wire.pack_note(wire.Pong(boot, now[0] - 0.01, now[0] - 0.005, 6.0))
        )
        bench.parcel("/t", right(k + 1, now[0], boot, number=k + 1))
        bench.parcel("/s", right(k + 1, now[0], boot))
        now[0] += 0.1
    bench.inbound.deliver_overdue()
    assert bench.heard == [b"good"] * 6
    assert bench.peer.report(now[0])["link"]["round_trip_s"] == pytest.approx(0.01)


# ---- the relay's own ports -----------------------------------------------------------------------


def first_words(port):
    """What a relay says first to a peer, at its UDP and TCP ports: Zenoh's own frames, to be
    mangled."""
    heard = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, socket.create_server(
        ("127.0.0.1", port)
    ) as tcp:
        udp.bind(("127.0.0.1", port))
        udp.settimeout(5.0)
        tcp.settimeout(5.0)
        relay = transport(
            free_endpoint(), {"control": Endpoint("127.0.0.1", port, port + 1)}, "uav1", []
        )
        try:
            heard.append(udp.recv(2048))
            connection, _ = tcp.accept()
            with connection:
                connection.settimeout(5.0)
                heard.append(connection.recv(2048))
        finally:
            relay.close()
    return heard


def free_endpoint():
    return Endpoint("127.0.0.1", free_port(), free_port())


def transport(listen, peers, name, heard):
    return ZenohTransport(
        name, listen, peers, None, lambda *parcel: None, lambda *note: heard.append(note)
    )


def shouted(endpoint, words, rng):
    """Ten thousand inputs: datagrams, and pieces on a hundred connections that end in the midst."""
    inputs = [mangled(rng.choice(words), rng)[:1400] for _ in range(ROUNDS)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        for data in inputs[: ROUNDS // 2]:
            udp.sendto(data, ("127.0.0.1", endpoint.urgent_port))
    rest = inputs[ROUNDS // 2 :]
    for k in range(100):
        port = endpoint.urgent_port if k % 2 else endpoint.bulk_port
        with socket.create_connection(("127.0.0.1", port), 5.0) as tcp, contextlib.suppress(
            ConnectionError
        ):
            for data in rest[k::100]:
                tcp.sendall(data)


def test_ten_thousand_raw_inputs_at_a_relays_ports_end_nothing():
    """A peer that is joined is heard after it on all links, and so is one that joins then."""
    rng, heard = random.Random(1), []
    words = first_words(free_port())
    here, there = free_endpoint(), free_endpoint()
    control = transport(here, {"uav1": there}, "control", heard)
    uav1 = transport(there, {"control": here}, "uav1", [])

    def is_heard():
        for link in LINKS:
            said = f"{link} {len(heard)}".encode()

            def arrived(link=link, said=said):
                uav1.note("control", said, link)
                return ("uav1", said) in heard

            until(arrived, what=f"a note on {link}")

    try:
        is_heard()
        shouted(here, words, rng)
        is_heard()
        uav1.close()
        uav1 = transport(there, {"control": here}, "uav1", [])
        is_heard()
    finally:
        uav1.close()
        control.close()
