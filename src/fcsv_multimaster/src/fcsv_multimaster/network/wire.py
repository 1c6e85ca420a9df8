# SPDX-License-Identifier: Apache-2.0
"""What relays say to each other, as bytes: parcels of topics, and small notes (ping, pong,
acknowledgement)."""

import struct
from dataclasses import dataclass
from typing import List, Tuple

from fcsv_multimaster.errors import WireError

VERSION = 4
RAW, JPEG, H264 = 0, 1, 2
PACKINGS = (RAW, JPEG, H264)
_HEAD = struct.Struct("<BBIIIIId16s")
_PING = struct.Struct("<BBIIdd")
_PONG = struct.Struct("<BBIddd")
_ACK = struct.Struct("<BBIIB")
_LONGEST_S = 1e12  # of any clock
_WHERE_OCTETS = 120
_PING_KIND, _PONG_KIND, _ACK_KIND = 1, 2, 3


@dataclass(frozen=True)
class Head:
    """Stands in front of every message of a topic.

    ``boot`` changes when a relay restarts; ``to`` is the boot of whom it is meant for, as two may
    bear his name, or 0 where the sender has not heard him yet; ``sequence`` counts the topic's
    messages to this target; ``first`` is the oldest of them that must be delivered before this one,
    or its own sequence; ``number`` is not 0 where an acknowledgement is wanted; ``sent_s`` is the
    sender's monotonic clock; ``md5`` the type's sum.
    """

    packing: int
    boot: int
    to: int
    sequence: int
    first: int
    number: int
    sent_s: float
    md5: str


@dataclass(frozen=True)
class Ping:
    """``sent_s``: monotonic, ``wall_s``: the time of day, both the sender's; ``to``: as in Head;
    ``where`` it is."""

    boot: int
    to: int
    sent_s: float
    wall_s: float
    where: str = ""


@dataclass(frozen=True)
class Pong:
    """An answer: the ping's ``sent_s``, and both clocks of who answers."""

    boot: int
    sent_s: float
    here_s: float
    wall_s: float


@dataclass(frozen=True)
class Acknowledgement:
    """The message ``number`` that ``boot`` sent has come. ``keyframe``: the decoder needs a whole
    picture."""

    boot: int
    number: int
    keyframe: bool = False


def pack(head: Head, data: bytes) -> bytes:
    """A parcel. Raises WireError where the md5 sum is none."""
    try:
        md5 = bytes.fromhex(head.md5)
    except ValueError:
        md5 = b""
    if len(md5) != 16:
        raise WireError(f"'{head.md5}' is not the md5 sum of a message type")
    numbers = (head.boot, head.to, head.sequence, head.first, head.number)
    return _HEAD.pack(VERSION, head.packing, *numbers, head.sent_s, md5) + data


def unpack(payload: bytes) -> Tuple[Head, bytes]:
    """Head and message. Raises WireError."""
    if len(payload) < _HEAD.size:
        raise WireError(f"a message of {len(payload)} bytes is shorter than its head")
    version, packing, boot, to, sequence, first, number, sent_s, md5 = _HEAD.unpack_from(payload)
    _check_version(version)
    if packing not in PACKINGS or first > sequence or not 0.0 <= sent_s < _LONGEST_S:
        raise WireError("a message with a malformed head")
    return Head(packing, boot, to, sequence, first, number, sent_s, md5.hex()), payload[
        _HEAD.size :
    ]


def pack_note(note) -> bytes:
    """A ping, pong or acknowledgement."""
    if isinstance(note, Ping):
        ping = _PING.pack(VERSION, _PING_KIND, note.boot, note.to, note.sent_s, note.wall_s)
        return ping + note.where.encode()[:_WHERE_OCTETS]
    if isinstance(note, Pong):
        return _PONG.pack(VERSION, _PONG_KIND, note.boot, note.sent_s, note.here_s, note.wall_s)
    return _ACK.pack(VERSION, _ACK_KIND, note.boot, note.number, note.keyframe)


def unpack_note(payload: bytes):
    """Ping, Pong or Ack. Raises WireError."""
    if len(payload) < 2:
        raise WireError(f"a note of {len(payload)} bytes")
    _check_version(payload[0])
    try:
        if payload[1] == _PING_KIND:
            said = payload[_PING.size : _PING.size + _WHERE_OCTETS].decode(errors="replace")
            # it goes into logs and tables
            where = "".join(c if c.isprintable() else "?" for c in said)
            return _timed(Ping(*_PING.unpack_from(payload)[2:], where))
        if payload[1] == _PONG_KIND:
            return _timed(Pong(*_PONG.unpack(payload)[2:]))
        if payload[1] == _ACK_KIND:
            boot, number, keyframe = _ACK.unpack(payload)[2:]
            return Acknowledgement(boot, number, bool(keyframe))
    except struct.error as error:
        raise WireError(f"a malformed note of {len(payload)} bytes") from error
    raise WireError(f"a note of unknown kind {payload[1]}")


def _timed(note):
    """A note whose times are times. Raises WireError: NaN would stay in every later figure."""
    times = (note.sent_s, note.wall_s, getattr(note, "here_s", 0.0))
    if not all(0.0 <= t < _LONGEST_S for t in times):
        raise WireError("a note with malformed times")
    return note


def topic_key(source: str, target: str, type_name: str, topic: str) -> str:
    """Where a topic's messages from one machine to another stand."""
    return f"fcsv/{source}/{target}/t/{type_name}{topic}"


def everything_key(source: str, target: str) -> str:
    """All that one machine says to another."""
    return f"fcsv/{source}/{target}/**"


def note_key(source: str, target: str) -> str:
    return f"fcsv/{source}/{target}/n"


def definition_key(source: str, target: str, type_name: str) -> str:
    """Where ``target`` asks ``source`` for the text of a type."""
    return f"fcsv/{source}/{target}/d/{type_name}"


def split_topic_key(key: str) -> Tuple[str, str, str]:
    """(source, type, topic). Raises WireError."""
    parts: List[str] = key.split("/")
    if len(parts) < 7:
        raise WireError(f"a message under '{key[:80]}'")
    return parts[1], f"{parts[4]}/{parts[5]}", "/" + "/".join(parts[6:])


def _check_version(version: int) -> None:
    if version != VERSION:
        raise WireError(
            f"it speaks version {version} of the relay's language, this relay {VERSION}"
        )
