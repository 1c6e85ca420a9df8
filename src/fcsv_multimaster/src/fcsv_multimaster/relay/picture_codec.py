# SPDX-License-Identifier: Apache-2.0
"""Pictures as bytes for the link: JPEG whose quality and size follow what it carries, or H.264."""

import logging
from fractions import Fraction
from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_multimaster.errors import PictureError

_LOG = logging.getLogger(__name__)
# scale, JPEG quality
_LADDER = ((1.0, 90), (1.0, 75), (1.0, 60), (1.0, 40), (0.5, 60), (0.5, 35), (0.25, 40))
_SHARE = 0.8  # of the budget: the rest is for other pictures and what surrounds them
_H264_START_BIT_S = 2_000_000
_H264_BIT_S = (100_000, 8_000_000)
_LARGEST_PX = 64_000_000  # what a peer may make us decode


class OfferedRate:
    """How often pictures are offered, from the counter and the time of those whose turn comes."""

    def __init__(self):
        self._last: Optional[Tuple[int, float]] = None
        self.hz = 1.0

    def seen(self, sequence: int, now_s: float) -> None:
        if self._last is not None and sequence > self._last[0] and now_s > self._last[1]:
            hz = (sequence - self._last[0]) / (now_s - self._last[1])
            self.hz += 0.2 * (min(hz, 120.0) - self.hz)
        self._last = (sequence, now_s)


class AdaptiveJpeg:
    """One stream: the step of the ladder that fits the budget, one step at a time."""

    def __init__(self):
        self.step = 0

    def fits(self, octets: int, budget_octets_s: Optional[float], rate_hz: float) -> bool:
        """Whether a picture of this size may go as it is."""
        return self.step == 0 and (
            budget_octets_s is None or octets * rate_hz <= _SHARE * budget_octets_s
        )

    def encode(self, bgr: np.ndarray, budget_octets_s: Optional[float], rate_hz: float) -> bytes:
        """A JPEG of a HxW or HxWx3 uint8 picture. Raises PictureError."""
        scale, quality = _LADDER[self.step]
        if scale != 1.0:
            bgr = cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if not done:
            raise PictureError("it cannot be written as JPEG")
        self._follow(len(data), budget_octets_s, rate_hz)
        return data.tobytes()

    def _follow(self, octets: int, budget_octets_s: Optional[float], rate_hz: float) -> None:
        share = (
            0.0
            if budget_octets_s is None
            else octets * rate_hz / max(_SHARE * budget_octets_s, 1.0)
        )
        if share > 1.0:
            self.step = min(self.step + 1, len(_LADDER) - 1)
        elif share < 0.3:  # the next better step may be three times the size
            self.step = max(self.step - 1, 0)


def decode_jpeg(data: bytes, shape: Optional[Tuple[int, int]] = None) -> np.ndarray:
    """A JPEG as it was, HxW or HxWx3 (BGR), back at ``shape`` (H, W) where it was sent smaller.
    Raises PictureError."""
    if shape is not None and shape[0] * shape[1] > _LARGEST_PX:
        raise PictureError(f"a picture of {shape[1]} by {shape[0]} pixels")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise PictureError(f"not a picture: {error.err}") from error
    if picture is None:
        raise PictureError("it is not a JPEG that can be read")
    if shape is not None and picture.shape[:2] != tuple(shape):
        picture = cv2.resize(picture, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return picture


def h264_available() -> bool:
    """Whether PyAV with an H.264 encoder is installed."""
    try:
        import av
    except ImportError:
        return False
    return "libx264" in av.codecs_available


class H264Encoder:
    """One stream with no picture held back; a new one begins where size or budget change much."""

    def __init__(self):
        self._context = None
        self._bit_s = 0
        self._shape: Tuple[int, int] = (0, 0)

    def encode(
        self, bgr: np.ndarray, budget_octets_s: Optional[float], rate_hz: float, keyframe: bool
    ) -> bytes:
        """The picture (HxWx3 uint8, even size) as one access unit. Raises PictureError."""
        import av

        if bgr.ndim != 3 or bgr.shape[0] % 2 or bgr.shape[1] % 2:
            raise PictureError(f"H.264 needs a colour picture of even size, not {bgr.shape}")
        wanted = _H264_START_BIT_S if budget_octets_s is None else int(8 * _SHARE * budget_octets_s)
        wanted = min(max(wanted, _H264_BIT_S[0]), _H264_BIT_S[1])
        if (
            self._context is None
            or bgr.shape[:2] != self._shape
            or not 0.6 < wanted / self._bit_s < 1.7
        ):
            self._open(bgr.shape[:2], wanted, rate_hz)
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(bgr), format="bgr24")
        if keyframe:
            frame.pict_type = int(av.video.frame.PictureType.I)
        try:
            return b"".join(bytes(p) for p in self._context.encode(frame))
        except av.FFmpegError as error:
            self._context = None
            raise PictureError(f"H.264: {error}") from error

    def _open(self, shape: Tuple[int, int], bit_s: int, rate_hz: float) -> None:
        import av

        context = av.CodecContext.create("libx264", "w")
        context.height, context.width = shape
        context.pix_fmt = "yuv420p"
        context.bit_rate = bit_s
        context.framerate = Fraction(max(1, round(rate_hz)))
        context.time_base = 1 / context.framerate
        buffer = str(max(bit_s // 2, 1))
        context.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "maxrate": str(bit_s),
            "bufsize": buffer,
            "forced-idr": "1",
            "g": str(10 * max(1, round(rate_hz))),
        }
        self._context, self._bit_s, self._shape = context, bit_s, shape


class H264Decoder:
    """One stream; after a gap nothing comes out before a whole picture."""

    def __init__(self):
        self._context = None
        self._next: Optional[int] = None

    def decode(self, data: bytes, sequence: int) -> Optional[np.ndarray]:
        """HxWx3 (BGR), or None while it waits for a whole picture (then ask for one). Raises
        PictureError."""
        import av

        follows = self._context is not None and sequence == self._next
        self._next = sequence + 1
        if not follows:
            if not _is_whole(data):
                self._context = None
                return None
            self._context = av.CodecContext.create("h264", "r")
            self._context.thread_count = 1
            self._context.flags |= av.codec.context.Flags.low_delay
        try:
            frames = self._context.decode(av.Packet(data))
        except av.FFmpegError as error:
            self._context = None
            raise PictureError(f"H.264: {error}") from error
        return frames[-1].to_ndarray(format="bgr24") if frames else None


def _is_whole(data: bytes) -> bool:
    """Whether an access unit in Annex B form holds an IDR slice (ITU-T H.264, 7.4.1: nal_unit_type
    5)."""
    at = data.find(b"\x00\x00\x01")
    while 0 <= at < len(data) - 3:
        if data[at + 3] & 0x1F == 5:
            return True
        at = data.find(b"\x00\x00\x01", at + 3)
    return False
