# SPDX-License-Identifier: Apache-2.0
"""Pictures of a vehicle from the bags of a session, in whatever encoding they were recorded, as 8-bit RGB."""

from pathlib import Path
from typing import Callable, Iterator, List, Tuple

import numpy as np
import rosbag
from genpy import MessageException
from rosbag.bag import ROSBagException

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions
from fcsv_stereo.errors import InputError
from fcsv_stereo.exposure import Exposure

_PATTERNS = ("rggb", "bggr", "gbrg", "grbg")
#: by bits: sensor_msgs' encodings that cv_bridge turns into RGB, mosaics demosaiced by their pattern
ENCODINGS = {
    bits: (*(f"{c}{bits}" for c in ("rgb", "bgr", "mono", "rgba", "bgra")), *(f"bayer_{p}{bits}" for p in _PATTERNS))
    for bits in (8, 16)
}


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
        with rosbag.Bag(str(path)) as bag:
            for _, message, _ in bag.read_messages(topics=[topic]):
                stamp_s = message.header.stamp.to_sec()
                if wanted(stamp_s):
                    yield stamp_s, _image(path, topic, message, camera)
    except FcsvError:
        raise
    except (ROSBagException, MessageException, EOFError, OSError) as error:
        warnings.append(f"{path}, topic {topic}: cannot be read on ({error}); the pictures that follow are left out")


def _image(path: Path, topic: str, message, camera: PinholeCamera) -> np.ndarray:
    """HxWx3 RGB, uint8 or uint16 as recorded."""
    bits = next((b for b, known in ENCODINGS.items() if message.encoding in known), None)
    if bits is None:
        known = ", ".join((*ENCODINGS[8], *ENCODINGS[16]))
        raise InputError(f"{path}, topic {topic}: encoding '{message.encoding}' is not one of {known}")
    if (message.width, message.height) != (camera.width, camera.height):
        sizes = f"{message.width}x{message.height}, camera_info says {camera.width}x{camera.height}"
        raise InputError(f"{path}, topic {topic}: picture is {sizes}")
    try:
        return conversions.image_to_array(message, f"rgb{bits}")
    except GeometryError as error:
        raise InputError(f"{path}, topic {topic}: {error}") from error
