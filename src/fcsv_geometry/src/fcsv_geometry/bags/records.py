# SPDX-License-Identifier: Apache-2.0
"""Records of a bag of version 2.0: a header of named fields, then data. Source: "Bag format 2.0" of
the ROS wiki."""

import re
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Dict, Iterator, Optional, Union

from fcsv_geometry.errors import BagError

MAGIC = b"#ROSBAG V2.0\n"
_ANY_VERSION = re.compile(rb"#ROS(?:BAG|RECORD|LOG) V(\d+\.\d+)")
_MOST_HEADER_BYTES = 1 << 20  # a connection's header holds its topic; nothing comes near this
_CHUNK_OP = b"\x04\x00\x00\x00op=\x05"
_MOST_CHUNK_HEADER_BYTES = 128  # op, compression, size
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")


class Op(IntEnum):
    """What a record is."""

    MESSAGE = 2
    BAG = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


@dataclass(frozen=True)
class Record:
    """Where a record stands; ``end`` lies beyond the file's where its data was cut."""

    op: Op
    fields: Dict[bytes, bytes]
    start: int
    data: int
    end: int

    def number(self, name: bytes, kind: struct.Struct = U32) -> int:
        """A field as a number. Raises KeyError or struct.error where it is not one."""
        return kind.unpack(self.fields[name])[0]


def require_version(start: bytes, name: str) -> None:
    """Raises BagError where a file's first bytes are not those of a bag of version 2.0."""
    if start.startswith(MAGIC):
        return
    other = _ANY_VERSION.match(start)
    if other is None:
        raise BagError(f"{name}: is not a bag: it does not begin with {MAGIC.decode().strip()}")
    version = other.group(1).decode()
    raise BagError(
        f"{name}: is a bag of version {version}, only 2.0 is read; convert it: rosbag filter OLD.bag NEW.bag True"
    )


def record_at(buffer, start: int, end: int) -> Optional[Record]:
    """The record that begins at ``start``; None where there is none, or not its whole header."""
    if start + 4 > end:
        return None
    (size,) = U32.unpack_from(buffer, start)
    data = start + 4 + size + 4
    if not 0 < size <= _MOST_HEADER_BYTES or data > end:
        return None
    fields = fields_of(buffer[start + 4 : start + 4 + size])
    try:
        op = Op(fields[b"op"][0])
        _REQUIRED[op](fields)
    except (KeyError, IndexError, TypeError, ValueError, struct.error):
        return None
    (data_size,) = U32.unpack_from(buffer, data - 4)
    return Record(op, fields, start, data, data + data_size)


def fields_of(header: bytes) -> Optional[Dict[bytes, bytes]]:
    """Names and values of a header; None where it is none."""
    fields, at = {}, 0
    while at < len(header):
        if at + 4 > len(header):
            return None
        (size,) = U32.unpack_from(header, at)
        field = header[at + 4 : at + 4 + size]
        name, equals, value = field.partition(b"=")
        if len(field) < size or not equals or not name:
            return None
        fields[name] = value
        at += 4 + size
    return fields


def _needs(**sizes: int):
    def check(fields: Dict[bytes, bytes]) -> None:
        wrong = [n for n, size in sizes.items() if len(fields[n.encode()]) != size]
        if wrong:
            raise ValueError(wrong)

    return check


_REQUIRED = {
    Op.MESSAGE: _needs(conn=4, time=8),
    Op.BAG: _needs(index_pos=8, conn_count=4, chunk_count=4),
    Op.INDEX: _needs(ver=4, conn=4, count=4),
    Op.CHUNK: _needs(size=4),
    Op.CHUNK_INFO: _needs(ver=4, chunk_pos=8, count=4),
    Op.CONNECTION: _needs(conn=4),
}


def walk(buffer, start: int, end: int) -> Iterator[Record]:
    """Records one after the other, up to the first that is not whole."""
    while True:
        record = record_at(buffer, start, end)
        if record is None or record.end > end:
            return
        yield record
        start = record.end


def next_chunk(buffer, start: int, end: int) -> Optional[Record]:
    """The first chunk that begins at ``start`` or after it, whatever stands before it."""
    at = buffer.find(_CHUNK_OP, start, end)
    while at >= 0:
        for begin in range(at - 4, max(start, at - _MOST_CHUNK_HEADER_BYTES) - 1, -1):
            record = record_at(buffer, begin, end)
            if record is not None and record.op is Op.CHUNK:
                return record
        at = buffer.find(_CHUNK_OP, at + 1, end)
    return None


def packed(fields: Dict[bytes, bytes], data: Union[bytes, bytearray, memoryview]) -> bytes:
    """A record as it stands in a file."""
    header = b"".join(U32.pack(len(n) + 1 + len(v)) + n + b"=" + v for n, v in fields.items())
    return b"".join((U32.pack(len(header)), header, U32.pack(len(data)), data))
