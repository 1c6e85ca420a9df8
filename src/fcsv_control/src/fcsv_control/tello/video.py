# SPDX-License-Identifier: Apache-2.0
"""A Tello's video: datagrams in, pictures with stamps out.

H.264 behind two bytes, the picture's number and the packet's, whose bit 7 marks the last one of a
picture (tellopy 0.7.0, VideoData). A picture is shown where all its packets came and all those that
it builds on: after a loss nothing is shown until the next key picture, where a decoder would go on
with what is smeared; key_pictures.py asks for it.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Dict, Optional

import av
import numpy as np

_LAST = 0x80
_SLICE, _KEY, _PARAMETERS = 1, 5, 7  # NAL units
_LEAST = 3  # bytes of a datagram


@dataclass(frozen=True)
class DecodedPicture:
    """``rgb`` (H,W,3) uint8; ``arrived_s``: when its first packet came, monotonic."""

    arrived_s: float
    rgb: np.ndarray


def kinds(stream: bytes) -> Counter:
    """How many NAL units of each kind (H.264, annex B).

    >>> sorted(kinds(bytes.fromhex("00000001 67aa 000001 68bb 00000001 65cc00")).items())
    [(5, 1), (7, 1), (8, 1)]
    """
    found: Counter = Counter()
    at = stream.find(b"\x00\x00\x01")
    while 0 <= at < len(stream) - 3:
        found[stream[at + 3] & 0x1F] += 1
        at = stream.find(b"\x00\x00\x01", at + 3)
    return found


class Video:
    """``add`` each datagram. ``dropped``: what was not shown, and why."""

    def __init__(self):
        self.dropped: Counter = Counter()
        self._codec = self._opened()
        self._number: Optional[int] = None
        self._done: Optional[int] = None
        self._arrived_s = 0.0
        self._pieces: Dict[int, bytes] = {}
        self._end: Optional[int] = None
        self._parameters = b""
        self._broken = False  # something came that could not be shown
        self._whole = False  # what the next picture builds on was shown

    @property
    def broken(self) -> bool:
        """Whether what comes cannot be shown before a key picture, and none is on its way."""
        if not self._broken:
            return False
        begins = kinds(self._pieces.get(0, b"")) if self._number is not None else Counter()
        return not (begins[_PARAMETERS] or begins[_KEY])

    def add(self, now_s: float, datagram: bytes) -> Optional[DecodedPicture]:
        """A picture, with its last datagram."""
        if len(datagram) < _LEAST:
            self.dropped["datagrams that are none"] += 1
            return None
        number, piece = datagram[0], datagram[1]
        if number == self._done:  # a packet that came twice
            return None
        if number != self._number:
            self._begin(number, now_s)
        self._pieces[piece & ~_LAST] = bytes(datagram[2:])
        if piece & _LAST:
            self._end = piece & ~_LAST
        if self._end is None or len(self._pieces) <= self._end:
            return None
        stream = b"".join(self._pieces[k] for k in sorted(self._pieces))
        self._done, self._number = number, None
        return self._picture(stream)

    def _begin(self, number: int, now_s: float) -> None:
        before = self._number if self._number is not None else self._done
        if self._number is not None or (before is not None and number != (before + 1) & 0xFF):
            self._lost("pictures with lost packets")
        self._number, self._arrived_s, self._pieces, self._end = number, now_s, {}, None

    def _picture(self, stream: bytes) -> Optional[DecodedPicture]:
        found = kinds(stream)
        if not found[_SLICE] and not found[_KEY]:
            if found[_PARAMETERS]:  # they came by themselves: of the next key picture
                self._parameters = stream
            return None
        if found[_KEY]:
            stream, self._parameters = (
                (b"" if found[_PARAMETERS] else self._parameters) + stream,
                b"",
            )
        elif not self._whole:
            self._lost("pictures before a key picture")
            return None
        try:
            shown = self._codec.decode(av.Packet(stream))
        except av.error.FFmpegError:
            shown = []
        if not shown:
            self._lost("pictures that cannot be decoded")
            self._codec = self._opened()
            return None
        self._whole, self._broken = True, False
        return DecodedPicture(self._arrived_s, shown[-1].to_ndarray(format="rgb24"))

    def _lost(self, why: str) -> None:
        self.dropped[why] += 1
        self._whole, self._broken = False, True

    @staticmethod
    def _opened() -> av.CodecContext:
        """It gives each picture at once: no threads that hold some back."""
        codec = av.CodecContext.create("h264", "r")
        codec.thread_count = 1
        codec.options = {"flags": "low_delay"}
        return codec
