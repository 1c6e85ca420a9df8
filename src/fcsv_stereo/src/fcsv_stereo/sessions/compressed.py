# SPDX-License-Identifier: Apache-2.0
"""Pictures of sensor_msgs/CompressedImage (JPEG or PNG), as image_transport writes them."""

import cv2
import numpy as np

from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import decode_picture
from fcsv_stereo.errors import InputError

SUFFIX, TYPE = "/compressed", "sensor_msgs/CompressedImage"
_STARTS_ENDS = ((b"\xff\xd8", b"\xff\xd9"), (b"\x89PNG", b"IEND"))
_TAIL = 64  # octets that some encoders append
#: OpenCV names a mosaic by its second row
_MOSAICS = {
    "bayer_rggb": cv2.COLOR_BayerBG2RGB,
    "bayer_bggr": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg": cv2.COLOR_BayerGB2RGB,
}


def decoded(where: str, message) -> np.ndarray:
    """HxWx3 RGB, uint8 or uint16 as compressed. Raises InputError that begins with ``where``.

    ``format`` is "jpeg", "png", or image_transport's "ENCODING; jpeg compressed ORDER": ORDER
    "rgb8" says that the encoder was given red first.
    """
    data = bytes(message.data)
    if not any(data.startswith(start) for start, _ in _STARTS_ENDS):
        raise InputError(
            f"{where}: compressed picture ('{message.format}') is neither JPEG nor PNG"
        )
    if not any(data.startswith(start) and end in data[-_TAIL:] for start, end in _STARTS_ENDS):
        raise InputError(f"{where}: compressed picture ends early, after {len(data)} bytes")
    try:
        decode_picture(data, where)  # OpenCV fills what is damaged, and says so on stderr only
    except PictureFileError as error:
        raise InputError(f"{where}: compressed picture is damaged inside") from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{where}: compressed picture ('{message.format}') cannot be decoded")
    encoding, _, how = message.format.partition(";")
    if image.ndim == 2:
        return cv2.cvtColor(image, _MOSAICS.get(encoding.strip()[:10], cv2.COLOR_GRAY2RGB))
    red_first = "compressed rgb" in how
    if image.shape[2] == 4:
        return cv2.cvtColor(image, cv2.COLOR_RGBA2RGB if red_first else cv2.COLOR_BGRA2RGB)
    return image if red_first else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
