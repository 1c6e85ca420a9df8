# SPDX-License-Identifier: Apache-2.0
"""The Tello's packets: header, two checksums, sequence number; bytes in, bytes out.

Layout (little-endian): 0xCC, length << 3 (16 bit), CRC-8 of these three, kind, message (16 bit),
sequence (16 bit), payload, CRC-16 of all before it. Source: the protocol page of tellopilots.com;
the checksums are reflected CRC-8 (0x8C, from 0x77) and CRC-16 (0x8408, from 0x3692), which
reproduce tellopy's tables.
"""

import struct
from dataclasses import dataclass
from typing import List

from fcsv_sim.errors import SimulationError

START = 0xCC
LEAST_LENGTH = 11
MOST_LENGTH = 0x1FFF  # 13 bits
FROM_DRONE, TO_DRONE = 0x80, 0x40
_HEADER = struct.Struct("<BHBBHH")


class PacketError(SimulationError):
    """Bytes that are no whole packet; the message says why."""


@dataclass(frozen=True)
class Packet:
    """One packet. ``kind`` is the type byte: direction bits and a 3-bit type."""

    message: int
    sequence: int = 0
    payload: bytes = b""
    kind: int = 0x88


def _table(polynomial: int) -> List[int]:
    """What each byte does to a reflected checksum."""
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (polynomial if value & 1 else 0)
        table.append(value)
    return table


_CRC8, _CRC16 = _table(0x8C), _table(0x8408)


def crc8(data: bytes, crc: int = 0x77) -> int:
    """Checksum of the first three bytes of a packet.

    >>> hex(crc8(bytes([0xCC, 0xB0, 0x00])))
    '0x7f'
    """
    for byte in data:
        crc = _CRC8[(crc ^ byte) & 0xFF]
    return crc


def crc16(data: bytes, crc: int = 0x3692) -> int:
    """Checksum of a whole packet before its last two bytes."""
    for byte in data:
        crc = _CRC16[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc


def encode(packet: Packet) -> bytes:
    """Bytes of a packet. Raises PacketError where it is too long for its 13-bit length."""
    length = len(packet.payload) + LEAST_LENGTH
    if length > MOST_LENGTH:
        raise PacketError(
            f"packet 0x{packet.message:04x}: {length} bytes; a packet has {MOST_LENGTH} at most"
        )
    start = struct.pack("<BH", START, length << 3)
    head = start + struct.pack("<BBHH", crc8(start), packet.kind, packet.message, packet.sequence)
    return head + packet.payload + struct.pack("<H", crc16(head + packet.payload))


def decode(data: bytes) -> Packet:
    """The packet in a datagram. Raises PacketError: no start byte, wrong length, wrong checksum."""
    if len(data) < LEAST_LENGTH or data[0] != START:
        raise PacketError(
            f"no packet: {len(data)} bytes that begin with {bytes(data[:1]).hex() or 'nothing'}"
        )
    _, length, crc, kind, message, sequence = _HEADER.unpack_from(data)
    if crc != crc8(data[:3]):
        raise PacketError("wrong CRC-8")
    if length >> 3 != len(data):
        raise PacketError(f"says {length >> 3} bytes, has {len(data)}")
    if struct.unpack_from("<H", data, len(data) - 2)[0] != crc16(data[:-2]):
        raise PacketError("wrong CRC-16")
    return Packet(message, sequence, bytes(data[_HEADER.size : -2]), kind)
