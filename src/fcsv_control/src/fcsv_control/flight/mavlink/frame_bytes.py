# SPDX-License-Identifier: Apache-2.0
"""A MAVLink 2 message as bytes on the line, and as the fields in which MAVROS's topics carry it."""

import struct
from typing import Dict, List, Sequence

# magic, len, two flags, seq, system, component, message id (16 + 8 bits)
_HEAD = struct.Struct("<BBBBBBBHB")
_CRC = struct.Struct("<H")
MAGIC = 253


def to_fields(frame: bytes) -> Dict[str, object]:
    """Fields of mavros_msgs/Mavlink, but for header and framing_status, of a whole frame. Raises
    ValueError."""
    if len(frame) < _HEAD.size + _CRC.size or frame[0] != MAGIC:
        raise ValueError(f"{len(frame)} bytes are no MAVLink 2 message")
    magic, size, incompatible, compatible, seq, system, component, low, high = _HEAD.unpack_from(
        frame
    )
    end = _HEAD.size + size
    if len(frame) not in (end + _CRC.size, end + _CRC.size + 13):
        raise ValueError(f"a message of {size} bytes in a frame of {len(frame)}")
    payload = frame[_HEAD.size : end]
    words = len(payload) + 7 >> 3
    return {
        "magic": magic,
        "len": size,
        "incompat_flags": incompatible,
        "compat_flags": compatible,
        "seq": seq,
        "sysid": system,
        "compid": component,
        "msgid": high << 16 | low,
        "checksum": _CRC.unpack_from(frame, end)[0],
        "payload64": list(struct.unpack(f"<{words}Q", payload.ljust(8 * words, bytes(1)))),
        "signature": list(frame[end + _CRC.size :]),
    }


def to_frame(
    size: int,
    incompatible: int,
    compatible: int,
    seq: int,
    system: int,
    component: int,
    number: int,
    checksum: int,
    payload64: Sequence[int],
    signature: Sequence[int] = (),
) -> bytes:
    """The frame of these fields. Raises ValueError where they are none."""
    words: List[int] = list(payload64)
    try:
        payload = struct.pack(f"<{len(words)}Q", *words)
        head = _HEAD.pack(
            MAGIC,
            size,
            incompatible,
            compatible,
            seq,
            system,
            component,
            number & 0xFFFF,
            number >> 16,
        )
        tail = _CRC.pack(checksum) + bytes(signature)
    except struct.error as error:
        raise ValueError(str(error)) from error
    if size > len(payload):
        raise ValueError(f"a message of {size} bytes has {len(payload)}")
    return head + payload[:size] + tail
