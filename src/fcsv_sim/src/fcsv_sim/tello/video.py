# SPDX-License-Identifier: Apache-2.0
"""How the Tello cuts its video into datagrams: H.264 behind two bytes, the picture's and the
packet's number.

Source: tellopy 0.7.0 (VideoData), which waits for a packet 0 after a loss; lengths and the
parameter sets' own packets as drivers for ROS note them of a real one. The last packet of a picture
has bit 7 of its number set. Where the parameter sets' packets are numbered is not known: here they
are the first of the picture that they stand before.
"""

from typing import Iterator, List

MOST_PACKETS = 128  # of a picture: 7 bits
_PAYLOAD = 1458
_SEI, _SPS, _PPS = 6, 7, 8
#: bit/s by the number that a client asks for (message 0x20); 0 leaves it to the Tello
BIT_RATES = (2e6, 1e6, 1.5e6, 2e6, 3e6, 4e6)


def units(stream: bytes) -> Iterator[bytes]:
    """The NAL units of a byte stream (H.264, annex B), each with a start code of four bytes.

    >>> [u.hex() for u in units(bytes.fromhex("00000001 67aa 000001 68bb 00000001 65cc00"))]
    ['0000000167aa', '0000000168bb', '0000000165cc00']
    """
    starts, at = [], stream.find(b"\x00\x00\x01")
    while at >= 0:
        starts.append(at + 3)
        at = stream.find(b"\x00\x00\x01", at + 3)
    for start, following in zip(starts, [*starts[1:], None]):
        unit = stream[start:] if following is None else stream[start : following - 3]
        yield b"\x00\x00\x00\x01" + (unit if following is None else unit.rstrip(b"\x00"))


class Packets:
    """cut() gives the datagrams of one picture after another."""

    def __init__(self):
        self._picture = 0

    def cut(self, stream: bytes) -> List[bytes]:
        """Datagrams of a picture; none where it is too large to be numbered."""
        pieces: List[bytes] = []
        rest = b""
        for unit in units(stream):
            kind = unit[4] & 0x1F
            if kind in (_SPS, _PPS):
                pieces.append(unit)
            elif kind != _SEI:
                rest += unit
        pieces += [rest[k : k + _PAYLOAD] for k in range(0, len(rest), _PAYLOAD)]
        if not pieces or len(pieces) > MOST_PACKETS:
            return []
        number, self._picture = self._picture, (self._picture + 1) & 0xFF
        last = len(pieces) - 1
        return [bytes([number, k | 0x80 * (k == last)]) + piece for k, piece in enumerate(pieces)]
