# SPDX-License-Identifier: Apache-2.0
"""Pictures of a vehicle from the bags of a session, in whatever encoding they were recorded, as
8-bit RGB."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Iterator, List, Tuple

import cv2
import numpy as np

from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError
from fcsv_geometry.messages import seconds
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.exposure import Exposure
from fcsv_stereo.sessions import compressed
from fcsv_stereo.sessions.cameras import CameraTimeline
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.stamped import Stamped

#: by what encodings begin with: samples per pixel, and OpenCV's way to RGB (OpenCV names a mosaic
#: by its second row)
_KINDS = {
    "rgb": (3, None),
    "bgr": (3, cv2.COLOR_BGR2RGB),
    "mono": (1, cv2.COLOR_GRAY2RGB),
    "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB),
    "bayer_rggb": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg": (1, cv2.COLOR_BayerGB2RGB),
}
_TYPE = "sensor_msgs/Image"
_ALONE_S = 10.0  # odometry is recorded all the time: a picture so far from it has a wrong stamp
_DTYPES = {8: np.dtype(np.uint8), 16: np.dtype(np.uint16)}
#: by bits: sensor_msgs' encodings that are read
ENCODINGS = {bits: tuple(f"{kind}{bits}" for kind in _KINDS) for bits in _DTYPES}


@dataclass
class PicturesSeen:
    """What the bags hold of a vehicle's pictures: their topic (empty: none), all their stamps (s),
    how many of them are inside a window, and of those how many have no pose."""

    topic: str = ""
    stamps_s: List[float] = field(default_factory=list)
    inside: int = 0
    unposed: int = 0


@dataclass(frozen=True)
class PictureSource:
    """Where a vehicle's pictures are: bags, topic, cameras by time, which stamps are wanted, and
    the time (s) of its odometry."""

    bags: List[Path]
    topic: str
    cameras: CameraTimeline
    wanted: Callable[[float], bool]
    span_s: Tuple[float, float]


def read_pictures(
    source: PictureSource, left_out: LeftOut, warnings: List[str], seen: PicturesSeen
) -> Iterator[Tuple[float, np.ndarray, PinholeCamera]]:
    """Stamp (s), HxWx3 uint8 RGB and camera of each picture whose stamp is wanted; those of 16 bits
    scaled in common.

    Where the topic has none of use, those of its compressed twin. A picture that is none, or whose
    stamp cannot be right, is left out; a bag that cannot be read on gives those before, and a
    warning.
    """
    found: List[Tuple[float, Any]] = []
    for name, kind, rgb in (
        (source.topic, _TYPE, rgb_of),
        (source.topic + compressed.SUFFIX, compressed.TYPE, compressed_rgb_of),
    ):
        reader = _Reader(source, Stamped(name), kind, rgb, left_out, warnings)
        for bag in source.bags:
            reader.read(bag)
        if reader.stamps_s:
            seen.topic, seen.stamps_s = name, reader.stamps_s
            seen.inside = sum(map(source.wanted, reader.stamps_s))
            found = reader.believed()
        if found:
            break
    exposure = Exposure.common(v[0] for _, v in found if v[0].dtype == np.uint16)
    while found:  # let go one by one: the 16-bit ones are twice as large
        stamp_s, (image, camera) = found.pop(0)
        yield stamp_s, exposure.to_8_bit(image), camera


@dataclass
class _Reader:
    """Reads the messages of one topic of pictures, bag after bag; ``stamps_s`` are also of those
    that are none."""

    source: PictureSource
    pictures: Stamped
    kind: str
    rgb: Callable[[str, Any, PinholeCamera], np.ndarray]
    left_out: LeftOut
    warnings: List[str]
    stamps_s: List[float] = field(default_factory=list)

    def read(self, path: Path) -> None:
        """Those of a bag; of those outside the windows the stamp alone."""
        topic = self.pictures.topic
        try:
            for _, message in reading.messages(
                path, lambda n, kind: self._wants(path, n, kind), self._broken
            ):
                stamp_s = seconds(message.header.stamp)
                self.stamps_s.append(stamp_s)
                try:
                    self.pictures.add(path, stamp_s, self._value(path.name, message, stamp_s))
                except InputError as error:
                    self.left_out.add(topic, stamp_s, str(error))
        except BagError as error:
            self.warnings.append(f"{error}; the pictures of {topic} that follow there are left out")

    def believed(self) -> List[Tuple[float, Any]]:
        """Those to use, in order of stamp."""
        found = self.pictures.in_order(_same, self.left_out, self.warnings, None)
        first_s, last_s = self.source.span_s
        alone = [s for s, _ in found if not first_s - _ALONE_S <= s <= last_s + _ALONE_S]
        for s in alone if len(alone) < len(found) else ():
            where = f"{first_s - s:.1f} s before" if s < first_s else f"{s - last_s:.1f} s after"
            self.left_out.add(self.pictures.topic, s, f"its stamp is {where} all odometry")
        return [(s, value) for s, value in found if value is not None]

    def _value(self, where: str, message, stamp_s: float):
        if not self.source.wanted(stamp_s):
            return None
        camera = self.source.cameras.at(stamp_s)
        return self.rgb(where, message, camera), camera

    def _wants(self, path: Path, name: str, kind: str) -> bool:
        topic = self.pictures.topic
        if name == topic and kind != self.kind:
            raise InputError(f"{path}, topic {topic}: is of type {kind}, not {self.kind}")
        return name == topic

    def _broken(self, topic: str, recorded_s: float, why: str) -> None:
        self.left_out.add(topic, recorded_s, f"its bytes are no {self.kind} ({why})")


def _same(a, b) -> bool:
    """Says whether they are the same: of what two bags hold at one stamp; pictures outside the
    windows were not looked at."""
    return (a is None and b is None) or (
        a is not None and b is not None and np.array_equal(a[0], b[0])
    )


def compressed_rgb_of(where: str, message, camera: PinholeCamera) -> np.ndarray:
    """Decodes, as rgb_of, of a sensor_msgs/CompressedImage."""
    image = compressed.decoded(where, message)
    _require_size(where, image.shape[1], image.shape[0], camera)
    return image


def _require_size(where: str, width: int, height: int, camera: PinholeCamera) -> None:
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"{where}: picture is {width}x{height}, camera_info says {camera.width}x{camera.height}"
        )


def rgb_of(where: str, message, camera: PinholeCamera) -> np.ndarray:
    """HxWx3 RGB of a sensor_msgs/Image, uint8 or uint16 as recorded. Raises InputError that begins
    with ``where``."""
    bits = next((b for b, known in ENCODINGS.items() if message.encoding in known), None)
    if bits is None:
        known = ", ".join((*ENCODINGS[8], *ENCODINGS[16]))
        raise InputError(f"{where}: encoding '{message.encoding}' is not one of {known}")
    _require_size(where, message.width, message.height, camera)
    samples, code = _KINDS[message.encoding[: -len(str(bits))]]
    array = samples_of(where, message, samples, _DTYPES[bits])
    return array if code is None else cv2.cvtColor(array, code)


def samples_of(where: str, message, samples: int, dtype: np.dtype) -> np.ndarray:
    """HxW or HxWxN as they stand in the message, in this machine's order of bytes. Raises
    InputError."""
    line, step, data = message.width * samples * dtype.itemsize, message.step, message.data
    if len(data) != step * message.height:
        raise InputError(
            f"{where}: image has {len(data)} bytes where height x step is {step * message.height}"
        )
    if step < line:
        raise InputError(
            f"{where}: image has lines of {step} bytes where {message.encoding} needs {line}"
        )
    lines = np.frombuffer(data, np.uint8).reshape(message.height, step)[:, :line]
    array = np.ascontiguousarray(lines).view(
        dtype.newbyteorder(">" if message.is_bigendian else "<")
    )
    shape = (message.height, message.width) + ((samples,) if samples > 1 else ())
    return array.astype(dtype).reshape(shape)
