# SPDX-License-Identifier: Apache-2.0
"""What anybody may send to the simulated Tello's port: it answers who speaks its protocol, and
nothing ends it."""

import random
import socket
import struct
import time

import pytest

from fcsv_geometry.errors import FcsvError
from fcsv_sim.tello import messages
from fcsv_sim.tello.messages import MessageId
from fcsv_sim.tello.packets import Packet, PacketError, decode, encode
from fcsv_sim.tello.program import ProgramParameters, switched_on
from fcsv_sim.tello.radio import WifiParameters

HERE = "127.0.0.1"
CLEAR = WifiParameters(least_delay_s=0.0, mean_delay_s=0.0, loss=0.0)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HERE, 0))
        return sock.getsockname()[1]


class Wire:
    """A switched-on Tello on loopback in time that the test gives, and a socket of who flies it."""

    def __init__(self, shell, port):
        self.shell, self._to, self.now_s = shell, (HERE, port), time.time()
        self.sock = self.another()

    @property
    def not_understood(self):
        return sum(count for _, count in self.shell.drone.link.counts.items())

    def another(self):
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind((HERE, 0))
        sock.setblocking(False)
        return sock

    def send(self, data, sock=None):
        (sock or self.sock).sendto(data, self._to)

    def heard(self, seconds=0.05, sock=None):
        """Datagrams that came while so much time passes."""
        for _ in range(int(seconds / 0.01)):
            self.now_s += 0.01
            self.shell.step(self.now_s)
        found = []
        while True:
            try:
                found.append((sock or self.sock).recv(4096))
            except BlockingIOError:
                return found

    def packets(self, seconds=0.05, sock=None):
        return [
            decode(d) for d in self.heard(seconds, sock) if not d.startswith(messages.CONNECTED)
        ]

    def ask(self, message, payload=b"", sequence=7, kind=0x68):
        """The payload of its answer, None where there is none."""
        self.send(encode(Packet(message, sequence, payload, kind)))
        answers = [
            p.payload for p in self.packets() if p.message == message and p.sequence == sequence
        ]
        return answers[0] if answers else None


@pytest.fixture
def wire(tmp_path):
    port = free_port()
    parameters = ProgramParameters("tello1", str(tmp_path), address=HERE, port=port, radio=CLEAR)
    with switched_on(parameters) as shell:
        wire = Wire(shell, port)
        yield wire
        wire.sock.close()


def connect(wire, sock=None):
    wire.send(messages.CONNECT + struct.pack("<H", 6038), sock)
    return messages.encode_connected(6038) in wire.heard(0.05, sock)


def test_it_answers_nobody_who_did_not_ask_for_a_connection(wire):
    assert wire.ask(MessageId.GET_SSID) is None
    assert connect(wire) and wire.ask(MessageId.GET_SSID) == b"\x00\x0cTELLO-FC5000"


def test_one_client_at_a_time_and_room_for_another_after_silence(wire):
    other = wire.another()
    assert connect(wire) and not connect(wire, other)
    wire.heard(5.5)
    assert connect(wire, other)
    other.close()


@pytest.mark.parametrize(
    "message, payload, answer",
    [
        (MessageId.SET_HEIGHT_LIMIT, b"\x14\x00", b"\x00"),
        (MessageId.SET_HEIGHT_LIMIT, b"", b"\x01"),
        (MessageId.SET_TILT_LIMIT, struct.pack("<f", 15.0), b"\x00"),
        (MessageId.SET_TILT_LIMIT, struct.pack("<f", float("nan")), b"\x01"),
        (MessageId.SET_TILT_LIMIT, b"\x00", b"\x01"),
        (MessageId.SET_LOW_BATTERY, b"\x65", b"\x01"),
        (MessageId.SET_ENCODER_RATE, b"\x09", b"\x01"),
        (0x0FFF, b"", None),
    ],
)
def test_what_it_cannot_do_is_refused(wire, message, payload, answer):
    connect(wire)
    assert wire.ask(message, payload) == answer


def test_a_battery_that_is_low_refuses_take_off(wire):
    connect(wire)
    assert (
        wire.ask(MessageId.SET_LOW_BATTERY, b"\x63") == b"\x00"
        and wire.ask(MessageId.TAKE_OFF) == b"\x01"
    )
    assert (
        wire.ask(MessageId.SET_LOW_BATTERY, b"\x0a") == b"\x00"
        and wire.ask(MessageId.TAKE_OFF) == b"\x00"
    )


def test_wrong_checksums_and_lengths_are_counted_and_change_nothing(wire):
    connect(wire)
    good = encode(Packet(MessageId.TAKE_OFF, 7, b"", 0x68))
    for k in range(len(good)):
        wire.send(good[:k] + bytes([good[k] ^ 1]) + good[k + 1 :])
        wire.send(good[:k])
    wire.heard(0.1)
    assert not wire.shell.drone.flight.flying and wire.not_understood >= 2 * len(good)


def some(random_, count):
    return bytes(random_.getrandbits(8) for _ in range(count))


def garbage(random_, k):
    """Bytes; good packets of any number with any payload; good packets that one bit or the end is
    missing of."""
    payload = some(random_, random_.choice([0, 1, 2, 3, 4, 6, 11, 40]))
    numbers = [*MessageId, random_.randrange(1 << 16)]
    packet = encode(Packet(random_.choice(numbers), k & 0xFFFF, payload, random_.randrange(256)))
    at = random_.randrange(len(packet))
    return random_.choice(
        [
            some(random_, random_.randrange(0, 1500)),
            packet,
            packet,
            packet,
            packet[:at],
            packet[:at] + bytes([packet[at] ^ 1 << random_.randrange(8)]) + packet[at + 1 :],
            messages.CONNECT + some(random_, random_.randrange(4)),
            messages.EMERGENCY,
            b"command",
        ]
    )


def test_ten_thousand_random_inputs_on_its_port(wire):
    """From the client and from a stranger, on the ground and in the air; afterwards it still
    flies."""
    random_, stranger = random.Random(1), wire.another()
    connect(wire)
    for k in range(10_000):
        wire.send(garbage(random_, k), stranger if random_.random() < 0.2 else wire.sock)
        if k % 50 == 49:
            wire.heard(0.02)
    stranger.close()
    assert wire.not_understood > 3_000  # they did arrive
    flight = wire.shell.drone.flight
    wire.heard(6.0)
    assert connect(wire)
    wire.send(messages.EMERGENCY)
    flight.battery.low_percent = 10.0
    for _ in range(20):  # falls, and lies
        wire.heard(0.5)
        connect(wire)
    assert wire.ask(MessageId.TAKE_OFF) == b"\x00" and flight.flying
    T = wire.shell.drone.body.T_world_body
    assert (T == T).all() and abs(T[:3, 3]).max() < 1e4


def test_an_address_that_is_not_here_is_named(tmp_path):
    parameters = ProgramParameters("tello1", str(tmp_path), address="192.0.2.7")
    with pytest.raises(FcsvError, match="192.0.2.7:8889.*network namespace"):
        with switched_on(parameters):
            pass


def test_sticks_and_packets_survive_their_way():
    packet = Packet(MessageId.STICKS, 0x1E5, bytes(range(11)), 0x60)
    assert decode(encode(packet)) == packet
    with pytest.raises(PacketError):
        decode(encode(packet)[:-1])
    packed = 1024 + 660 | (1024 - 660) << 11 | 1024 << 22 | (1024 + 330) << 33 | 1 << 44
    sticks = messages.decode_sticks(packed.to_bytes(6, "little"))
    assert (sticks.roll, sticks.pitch, sticks.throttle, sticks.yaw, sticks.fast) == (
        1.0,
        -1.0,
        0.0,
        0.5,
        True,
    )
