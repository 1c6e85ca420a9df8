# SPDX-License-Identifier: Apache-2.0
"""Pictures of a vehicle from the bags of a session, in whatever encoding they were recorded, as 8-bit RGB."""

from pathlib import Path
from typing import Callable, Iterator, List, Tuple

import cv2
import numpy as np

from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError
from fcsv_geometry.messages import seconds
from fcsv_stereo.errors import InputError
from fcsv_stereo.exposure import Exposure

#: by what encodings begin with: samples per pixel, and OpenCV's way to RGB (OpenCV names a mosaic by its second row)
_KINDS = {
    "rgb": (3, None), "bgr": (3, cv2.COLOR_BGR2RGB), "mono": (1, cv2.COLOR_GRAY2RGB), "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB), "bayer_rggb": (1, cv2.COLOR_BayerBG2RGB), "bayer_bggr": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg": (1, cv2.COLOR_BayerGR2RGB), "bayer_grbg": (1, cv2.COLOR_BayerGB2RGB),
}  # fmt: skip
_TYPE = "sensor_msgs/Image"
_DTYPES = {8: np.dtype(np.uint8), 16: np.dtype(np.uint16)}
#: by bits: sensor_msgs' encodings that are read
ENCODINGS = {bits: tuple(f"{kind}{bits}" for kind in _KINDS) for bits in _DTYPES}


def read_pictures(
    bags: List[Path], topic: str, camera: PinholeCamera, wanted: Callable[[float], bool], warnings: List[str]
) -> Iterator[Tuple[float, np.ndarray]]:
    """Stamp (s) and HxWx3 uint8 RGB of each picture whose stamp is wanted; those of 16 bits scaled in common.

    A bag that cannot be read on gives those before, and a warning. Raises InputError naming bag, topic and what is
    wrong with the picture.
    """
    found = [p for bag in bags for p in _of_bag(bag, topic, camera, wanted, warnings)]
    exposure = Exposure.common(image for _, image in found if image.dtype == np.uint16)
    while found:  # let go one by one: the 16-bit ones are twice as large
        stamp_s, image = found.pop(0)
        yield stamp_s, exposure.to_8_bit(image)


def _of_bag(path: Path, topic: str, camera: PinholeCamera, wanted, warnings) -> Iterator[Tuple[float, np.ndarray]]:
    try:
        for _, message in reading.messages(path, lambda name, kind: _holds_pictures(path, topic, name, kind)):
            stamp_s = seconds(message.header.stamp)
            if wanted(stamp_s):
                yield stamp_s, rgb_of(f"{path}, topic {topic}", message, camera)
    except BagError as error:
        warnings.append(f"{error}; the pictures of {topic} that follow there are left out")


def _holds_pictures(path: Path, topic: str, name: str, kind: str) -> bool:
    if name == topic and kind != _TYPE:
        raise InputError(f"{path}, topic {topic}: is of type {kind}, not {_TYPE}")
    return name == topic


def rgb_of(where: str, message, camera: PinholeCamera) -> np.ndarray:
    """HxWx3 RGB of a sensor_msgs/Image, uint8 or uint16 as recorded. Raises InputError that begins with ``where``."""
    bits = next((b for b, known in ENCODINGS.items() if message.encoding in known), None)
    if bits is None:
        known = ", ".join((*ENCODINGS[8], *ENCODINGS[16]))
        raise InputError(f"{where}: encoding '{message.encoding}' is not one of {known}")
    if (message.width, message.height) != (camera.width, camera.height):
        sizes = f"{message.width}x{message.height}, camera_info says {camera.width}x{camera.height}"
        raise InputError(f"{where}: picture is {sizes}")
    samples, code = _KINDS[message.encoding[: -len(str(bits))]]
    array = samples_of(where, message, samples, _DTYPES[bits])
    return array if code is None else cv2.cvtColor(array, code)


def samples_of(where: str, message, samples: int, dtype: np.dtype) -> np.ndarray:
    """HxW or HxWxN as they stand in the message, in this machine's order of bytes. Raises InputError."""
    line, step, data = message.width * samples * dtype.itemsize, message.step, message.data
    if len(data) != step * message.height:
        raise InputError(f"{where}: image has {len(data)} bytes where height x step is {step * message.height}")
    if step < line:
        raise InputError(f"{where}: image has lines of {step} bytes where {message.encoding} needs {line}")
    lines = np.frombuffer(data, np.uint8).reshape(message.height, step)[:, :line]
    array = np.ascontiguousarray(lines).view(dtype.newbyteorder(">" if message.is_bigendian else "<"))
    shape = (message.height, message.width) + ((samples,) if samples > 1 else ())
    return array.astype(dtype).reshape(shape)
