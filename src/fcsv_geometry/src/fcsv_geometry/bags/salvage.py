# SPDX-License-Identifier: Apache-2.0
"""What a bag still holds that was cut anywhere or damaged, as a new bag with an index.

A recorder that dies leaves chunks with their index, then an open chunk whose size is not written
yet, then half a record; connections and chunk table are missing. A damaged place is passed over up
to the next chunk.
"""

import bz2
import functools
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import BinaryIO, Callable, Dict, Iterator, List, Optional, Tuple

from fcsv_geometry.bags.records import (
    MAGIC,
    U32,
    U64,
    Op,
    Record,
    next_chunk,
    packed,
    record_at,
    walk,
)

_BAG_HEADER_BYTES = 4096
_MOST_OPEN_BYTES = 16 << 20  # of records outside a chunk that are written as one
_NONE, _BZ2, _LZ4 = b"none", b"bz2", b"lz4"


@dataclass
class Salvaged:
    """What was found: messages per topic, first and last time (s), bytes that were no whole record,
    and why."""

    topics: Dict[str, int] = field(default_factory=Counter)
    first_s: float = float("inf")
    last_s: float = float("-inf")
    lost_bytes: int = 0
    problems: List[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        return sum(self.topics.values())

    def __str__(self) -> str:
        span_s = self.last_s - self.first_s if self.messages else 0.0
        lost = f", {self.lost_bytes} bytes lost" if self.lost_bytes else ""
        return f"{self.messages} messages on {len(self.topics)} topics over {span_s:.1f} s{lost}"


@dataclass(frozen=True)
class _Part:
    """Records that belong into one chunk: a stretch of a buffer that holds whole records alone."""

    buffer: object
    start: int
    end: int
    compression: bytes = _NONE


def is_whole(buffer) -> bool:
    """Whether a bag was closed and no record of it is broken: the index is where the header says,
    chunks are full."""
    size, at, index_at = len(buffer), len(MAGIC), -1
    counts: Counter = Counter()
    for record in walk(buffer, at, size):
        at = record.end
        if record.op is Op.BAG:
            index_at = record.number(b"index_pos", U64)
            wanted = (record.number(b"conn_count"), record.number(b"chunk_count"))
        elif record.op is Op.CHUNK and not _is_full(buffer, record):
            return False
        counts[record.op, record.start >= index_at > 0] += 1
    if at != size or not 0 < index_at <= size or counts[Op.BAG, False] + counts[Op.BAG, True] != 1:
        return False
    return (counts[Op.CONNECTION, True], counts[Op.CHUNK_INFO, True]) == wanted and not counts[
        Op.CHUNK, True
    ]


def _is_full(buffer, chunk: Record) -> bool:
    """Whether an uncompressed chunk consists of whole records; others are not looked into."""
    at = chunk.data
    if chunk.fields.get(b"compression", _NONE) != _NONE:
        return True
    for record in walk(buffer, at, chunk.end):
        at = record.end
    return at == chunk.end


def salvage(
    buffer, out: BinaryIO, progress: Callable[[int], None] = lambda _bytes: None
) -> Salvaged:
    """Copy every whole message of a bag of version 2.0 to ``out``, a new seekable file.
    ``progress``: bytes read.

    Raises OSError where ``out`` cannot be written.
    """
    found = Salvaged()
    connections = _connections(buffer)
    writer = _Writer(out, connections)
    for part in _parts(buffer, found, progress):
        writer.write(part, found)
    writer.close()
    return found


def _connections(buffer) -> Dict[int, Tuple[bytes, bytes]]:
    """Topic and header of every connection, from chunks or from what is left of the index."""
    known: Dict[int, Tuple[bytes, bytes]] = {}
    for part in _parts(buffer, Salvaged(), lambda _bytes: None):
        for r in walk(part.buffer, part.start, part.end):
            if r.op is Op.CONNECTION:
                known.setdefault(
                    r.number(b"conn"),
                    (r.fields.get(b"topic", b""), bytes(part.buffer[r.data : r.end])),
                )
    return known


def _parts(buffer, found: Salvaged, progress) -> Iterator[_Part]:
    """Stretches of whole records, chunk by chunk; counts what is lost between them."""
    at, end = len(MAGIC), len(buffer)
    while at < end:
        progress(at)
        record = record_at(buffer, at, end)
        if record is None or (record.end > end and record.op is not Op.CHUNK):
            following = next_chunk(buffer, at + 1, end)
            beyond = end if following is None else following.start
            found.lost_bytes += beyond - at
            at = beyond
        elif record.op is Op.CHUNK:
            part = _of_chunk(buffer, record, end, found)
            at = min(record.end, end)
            if part is not None:
                yield part
        elif record.op in (Op.MESSAGE, Op.CONNECTION):
            part = _outside(buffer, record, end)
            at = part.end
            yield part
        else:
            at = record.end
    progress(end)


def _outside(buffer, first: Record, end: int) -> _Part:
    """Messages and connections that follow each other: those of a chunk that was never closed."""
    at = first.start
    for record in walk(buffer, first.start, end):
        if record.op not in (Op.MESSAGE, Op.CONNECTION):
            break
        at = record.end
        if at - first.start > _MOST_OPEN_BYTES:
            break
    return _Part(buffer, first.start, at)


def _of_chunk(buffer, record: Record, end: int, found: Salvaged) -> Optional[_Part]:
    compression, stop = record.fields.get(b"compression", _NONE), min(record.end, end)
    if compression == _NONE:
        inside, start = buffer, record.data
    elif compression in (_BZ2, _LZ4):
        inside, start = _unpacked(bytes(buffer[record.data : stop]), compression), 0
        stop = len(inside)
    else:
        kind = compression.decode(errors="replace")
        found.problems.append(f"a chunk compressed as {kind} at byte {record.start} is passed over")
        found.lost_bytes += stop - record.data
        return None
    at = start
    for inner in walk(inside, start, stop):
        at = inner.end
    found.lost_bytes += stop - at
    return _Part(inside, start, at, compression) if at > start else None


def _unpacked(packed_bytes: bytes, compression: bytes) -> bytes:
    """Unpacks as much as can be unpacked."""
    unpack, out = (
        (bz2.BZ2Decompressor if compression == _BZ2 else _lz4().LZ4FrameDecompressor)(),
        [],
    )
    try:
        for i in range(0, len(packed_bytes), 4096):
            out.append(unpack.decompress(packed_bytes[i : i + 4096]))
    except (OSError, EOFError, RuntimeError):
        pass  # what came before is kept
    return b"".join(out)


def _packed(body: bytes, compression: bytes) -> bytes:
    """ROS reads only LZ4 frames of independent blocks with a checksum and without their size
    (tried: roslz4 1.15)."""
    if compression == _BZ2:
        return bz2.compress(body)
    if compression == _LZ4:
        return _lz4().compress(body, block_linked=False, content_checksum=True, store_size=False)
    return body


@functools.lru_cache(maxsize=None)
def _lz4():
    """Imported when first used; it comes with rosbags."""
    import lz4.frame

    return lz4.frame


class _Writer:
    """A bag of version 2.0: chunks with their index, then connections and chunk table."""

    def __init__(self, out: BinaryIO, connections: Dict[int, Tuple[bytes, bytes]]):
        self._out, self._connections = out, connections
        self._chunks: List[bytes] = []
        out.write(MAGIC)
        self._write_header(0)

    def _write_header(self, index_at: int) -> None:
        fields = {
            b"op": bytes([Op.BAG]),
            b"index_pos": U64.pack(index_at),
            b"conn_count": U32.pack(len(self._connections)),
            b"chunk_count": U32.pack(len(self._chunks)),
        }
        padding = _BAG_HEADER_BYTES - len(packed(fields, b""))
        self._out.write(packed(fields, b" " * padding))

    def write(self, part: _Part, found: Salvaged) -> None:
        """The messages whose connection is known; those of others could not be read by anybody."""
        kept, at = [], 0
        index: Dict[int, List[bytes]] = defaultdict(list)
        stamps: List[Tuple[int, int]] = []
        for r in walk(part.buffer, part.start, part.end):
            if r.op is Op.MESSAGE:
                conn, stamp = r.number(b"conn"), r.fields[b"time"]
                if conn not in self._connections:
                    found.lost_bytes += r.end - r.start
                    continue
                index[conn].append(stamp + U32.pack(at))
                stamps.append((U32.unpack_from(stamp)[0], U32.unpack_from(stamp, 4)[0]))
                found.topics[self._connections[conn][0].decode(errors="replace")] += 1
            elif r.op is not Op.CONNECTION:
                continue
            kept.append(bytes(part.buffer[r.start : r.end]))
            at += r.end - r.start
        if not stamps:
            return
        first, last = min(stamps), max(stamps)
        found.first_s = min(found.first_s, first[0] + first[1] * 1e-9)
        found.last_s = max(found.last_s, last[0] + last[1] * 1e-9)
        self._write_chunk(b"".join(kept), part.compression, index, (first, last))

    def _write_chunk(
        self, body: bytes, compression: bytes, index: Dict[int, List[bytes]], span
    ) -> None:
        start = self._out.tell()
        fields = {
            b"op": bytes([Op.CHUNK]),
            b"compression": compression,
            b"size": U32.pack(len(body)),
        }
        self._out.write(packed(fields, _packed(body, compression)))
        for conn, entries in index.items():
            fields = {b"op": bytes([Op.INDEX]), b"ver": U32.pack(1), b"conn": U32.pack(conn)}
            self._out.write(packed({**fields, b"count": U32.pack(len(entries))}, b"".join(entries)))
        fields = {b"op": bytes([Op.CHUNK_INFO]), b"ver": U32.pack(1), b"chunk_pos": U64.pack(start)}
        for name, (s, ns) in zip((b"start_time", b"end_time"), span):
            fields[name] = U32.pack(s) + U32.pack(ns)
        counts = b"".join(
            U32.pack(conn) + U32.pack(len(entries)) for conn, entries in index.items()
        )
        self._chunks.append(packed({**fields, b"count": U32.pack(len(index))}, counts))

    def close(self) -> None:
        """The index, and the header that says where it is."""
        index_at = self._out.tell()
        for conn, (topic, header) in self._connections.items():
            self._out.write(
                packed(
                    {b"op": bytes([Op.CONNECTION]), b"topic": topic, b"conn": U32.pack(conn)},
                    header,
                )
            )
        for chunk in self._chunks:
            self._out.write(chunk)
        self._out.seek(len(MAGIC))
        self._write_header(index_at)
