# SPDX-License-Identifier: Apache-2.0
"""The Tello's video encoder: pictures to H.264 without delay, parameter sets and a key picture only
when asked for."""

from fractions import Fraction

import av
import numpy as np

# constant rate factor of x264: the size of pictures is then nearest to a real one's, 35 kB and 10
# kB
_QUALITY = 33
_KEY, _ANY = 1, 0  # picture types, as libavutil numbers them


class Encoder:
    """One stream; ``rate_hz`` is what its rate control expects."""

    def __init__(self, width: int, height: int, rate_hz: float):
        self._size, self._rate_hz = (width, height), rate_hz
        self._bit_per_s = 0.0
        self._codec = None
        self._count = 0

    def encode(self, rgb: np.ndarray, bit_per_s: float, key: bool) -> bytes:
        """One picture (H,W,3) uint8 as a byte stream; a new bit rate begins the stream anew."""
        if bit_per_s != self._bit_per_s:
            self._codec, self._bit_per_s, self._count = self._opened(bit_per_s), bit_per_s, 0
        frame = av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format="yuv420p")
        frame.pts = self._count
        frame.pict_type = _KEY if key or not self._count else _ANY
        self._count += 1
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))

    def _opened(self, bit_per_s: float):
        codec = av.CodecContext.create("libx264", "w")
        codec.width, codec.height = self._size
        codec.pix_fmt = "yuv420p"
        codec.framerate = Fraction(self._rate_hz).limit_denominator(1000)
        codec.time_base = 1 / codec.framerate
        codec.thread_count = 1
        most = int(bit_per_s / 1000.0)
        codec.options = {
            "preset": "veryfast",
            "tune": "zerolatency",
            "forced-idr": "1",
            "crf": str(_QUALITY),
            "profile": "main",
            "x264-params": f"keyint=infinite:scenecut=0:vbv-maxrate={most}:vbv-bufsize={most}",
        }
        return codec
