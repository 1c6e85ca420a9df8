# SPDX-License-Identifier: Apache-2.0
"""Picture messages packed for the link and unpacked again; the type that goes in is the type that
comes out."""

import io
import struct
import time
from typing import Dict, Optional, Tuple

import genpy
import numpy as np
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from fcsv_multimaster.errors import PictureError
from fcsv_multimaster.network import wire
from fcsv_multimaster.relay.outbound import Message
from fcsv_multimaster.relay.parcel import Parcel
from fcsv_multimaster.relay.picture_codec import (
    AdaptiveJpeg,
    H264Decoder,
    H264Encoder,
    OfferedRate,
    decode_jpeg,
    h264_available,
)

_CHANNELS = {"rgb8": 3, "bgr8": 3, "mono8": 1}
_CODES = ("rgb8", "bgr8", "mono8", "compressed")
_FRONT = struct.Struct("<BHHH")  # encoding, width, height, octets of the header
_TYPES = {c._type: c for c in (Image, CompressedImage)}


class PicturePacker:
    """Sending side: one codec state per target and topic. Called by one thread."""

    def __init__(self):
        self._streams: Dict[Tuple[str, str], Tuple[OfferedRate, AdaptiveJpeg, H264Encoder]] = {}
        self._h264 = h264_available()

    def steps(self) -> Dict[str, int]:
        """How far each JPEG stream has given way, 0: not at all."""
        return {
            f"{topic} to {target}": jpeg.step
            for (target, topic), (_, jpeg, _) in list(self._streams.items())
        }

    def pack(self, target: str, message: Message, budget_octets_s: Optional[float], keyframe: bool):
        """(packing, data) of a message whose rule has a codec. Raises PictureError."""
        cls = _TYPES.get(message.type)
        if cls is None or cls._md5sum != message.md5:
            raise PictureError(
                f"a codec takes {' and '.join(_TYPES)}, not {message.type} {message.md5}"
            )
        known = (target, message.topic)
        rate, jpeg, h264 = self._streams.setdefault(
            known, (OfferedRate(), AdaptiveJpeg(), H264Encoder())
        )
        rate.seen(message.sequence, time.monotonic())
        if cls is CompressedImage and jpeg.fits(len(message.data), budget_octets_s, rate.hz):
            return wire.RAW, message.data
        picture = _deserialize(cls, message.data)
        array, encoding = _array(picture)
        front = _front(picture.header, encoding, array)
        if (
            message.rule.codec == "h264"
            and self._h264
            and array.ndim == 3
            and not (array.shape[0] | array.shape[1]) & 1
        ):
            return wire.H264, front + h264.encode(array, budget_octets_s, rate.hz, keyframe)
        return wire.JPEG, front + jpeg.encode(array, budget_octets_s, rate.hz)


class PictureUnpacker:
    """Receiving side."""

    def __init__(self):
        self._decoders: Dict[Tuple[str, str], H264Decoder] = {}

    def unpack(self, parcel: Parcel) -> Optional[bytes]:
        """The serialised message, or None while H.264 waits for a whole picture. Raises
        PictureError."""
        cls = _TYPES.get(parcel.type)
        if cls is None or cls._md5sum != parcel.md5:
            raise PictureError(f"a packed {parcel.type} {parcel.md5}")
        header, encoding, shape, data = _split_front(parcel.data)
        if parcel.packing == wire.JPEG and cls is CompressedImage:
            return serialized(CompressedImage(header=header, format="jpeg", data=data))
        if parcel.packing == wire.JPEG:
            array = decode_jpeg(data, shape)
        else:
            decoder = self._decoders.setdefault((parcel.source, parcel.topic), H264Decoder())
            array = decoder.decode(data, parcel.sequence)
        if array is None:
            return None
        if cls is CompressedImage:
            return serialized(
                CompressedImage(
                    header=header, format="jpeg", data=AdaptiveJpeg().encode(array, None, 1.0)
                )
            )
        return serialized(_image(header, encoding, array))


def _array(picture) -> Tuple[np.ndarray, str]:
    """HxW or HxWx3 (BGR), and how it was encoded."""
    if isinstance(picture, CompressedImage):
        return decode_jpeg(picture.data), "compressed"
    channels = _CHANNELS.get(picture.encoding)
    if channels is None:
        raise PictureError(
            f"pictures in '{picture.encoding}' cannot be packed; known: {', '.join(_CHANNELS)}"
        )
    width = picture.width * channels
    if (
        picture.step < width
        or len(picture.data) != picture.step * picture.height
        or not picture.height
        or not width
    ):
        raise PictureError(
            f"a picture whose data do not fit its {picture.width} by {picture.height} pixels"
        )
    rows = np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.step)[:, :width]
    if channels == 1:
        return rows, picture.encoding
    array = rows.reshape(picture.height, picture.width, channels)
    return (array[:, :, ::-1] if picture.encoding == "rgb8" else array), picture.encoding


def _image(header: Header, encoding: str, array: np.ndarray) -> Image:
    channels = _CHANNELS.get(encoding)
    if channels != (1 if array.ndim == 2 else array.shape[2]):
        raise PictureError(f"a picture of shape {array.shape} for '{encoding}'")
    data = array[:, :, ::-1] if encoding == "rgb8" else array
    height, width = array.shape[:2]
    return Image(
        header, height, width, encoding, 0, width * channels, np.ascontiguousarray(data).tobytes()
    )


def _front(header: Header, encoding: str, array: np.ndarray) -> bytes:
    packed = serialized(header)
    return _FRONT.pack(_CODES.index(encoding), array.shape[1], array.shape[0], len(packed)) + packed


def _split_front(data: bytes) -> Tuple[Header, str, Tuple[int, int], bytes]:
    if len(data) < _FRONT.size:
        raise PictureError("a packed picture without its front")
    code, width, height, octets = _FRONT.unpack_from(data)
    if code >= len(_CODES) or len(data) < _FRONT.size + octets:
        raise PictureError("a packed picture with a malformed front")
    header = _deserialize(Header, data[_FRONT.size : _FRONT.size + octets])
    return header, _CODES[code], (height, width), data[_FRONT.size + octets :]


def serialized(message) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def _deserialize(cls, data: bytes):
    try:
        return cls().deserialize(data)
    except (genpy.DeserializationError, struct.error, UnicodeDecodeError, ValueError) as error:
        raise PictureError(f"a {cls._type} that cannot be read: {error}") from error
