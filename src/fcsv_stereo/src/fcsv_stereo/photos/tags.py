# SPDX-License-Identifier: Apache-2.0
"""What a photograph's file says: orientation, focal length, GPS (EXIF), attitude and RTK (DJI's
XMP). By Pillow."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Optional, Tuple

import numpy as np
from PIL import Image, UnidentifiedImageError
from scipy.spatial.transform import Rotation

from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import read_picture
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.gps import Gps, number, read_gps

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
#: EXIF numbers; Pillow names them too, by names that changed between its versions.
ORIENTATION, _MAKE, _MODEL, _EXIF, _GPS = 0x0112, 0x010F, 0x0110, 0x8769, 0x8825
_FOCAL_MM, _FOCAL_35_MM, _PLANE_RESOLUTION, _PLANE_UNIT, _TAGGED_WIDTH = (
    0x920A,
    0xA405,
    0xA20E,
    0xA210,
    0xA002,
)
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}
_DIAGONAL_35_MM = math.hypot(36.0, 24.0)
_XMP_VALUE = re.compile(rb"drone-dji:(\w+)\s*(?:=\s*[\"']([^\"'<>]{1,64})[\"']|>([^<>]{1,64})<)")
#: A camera that looks along the body: body x forward, y right, z down (as DJI's angles are) to
#: optical axes.
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Tags:
    """``size`` is (width, height) as stored. ``focal_px`` may be None. ``R_enu_cam`` is the
    gimbal's. Where ``gps`` is None, or there are angles that are none, ``no_gps`` and ``no_angles``
    say why."""

    path: Path
    size: Tuple[int, int]
    orientation: int
    camera: str
    focal_px: Optional[float]
    gps: Optional[Gps]
    R_enu_cam: Optional[np.ndarray] = None
    no_gps: str = ""
    no_angles: str = ""


def read_tags(path: Path) -> Tags:
    """Raises InputError where the file is no picture."""
    try:
        with Image.open(path) as image:
            exif, size = image.getexif(), image.size
            xmp = image.info.get("xmp") or exif.get(0x02BC) or b""  # TIFF keeps it among its tags
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise InputError(_no_picture(path)) from error
    inner, dji = exif.get_ifd(_EXIF), _dji(xmp.encode() if isinstance(xmp, str) else bytes(xmp))
    orientation = exif.get(ORIENTATION, 1)
    if orientation in range(5, 9) and path.suffix.lower() in (".tif", ".tiff"):
        size = _stored_size(path)  # Pillow says that of the turned picture
    camera = " ".join(str(exif.get(t, "")).strip("\0 ") for t in (_MAKE, _MODEL)).strip()
    gps, no_gps = read_gps(exif.get_ifd(_GPS), dji)
    R_enu_cam, no_angles = _attitude(dji)
    return Tags(
        path,
        size,
        orientation if orientation in range(1, 9) else 1,
        camera,
        _focal_px(inner, dji, size),
        gps,
        R_enu_cam,
        no_gps,
        no_angles,
    )


def _stored_size(path: Path) -> Tuple[int, int]:
    """Raises InputError."""
    try:
        return read_picture(path).size
    except PictureFileError as error:
        raise InputError(str(error)) from error


def _no_picture(path: Path) -> str:
    """What the file is instead, as the reader of pictures says it."""
    try:
        read_picture(path)
    except PictureFileError as error:
        return str(error)
    return f"{path}: cannot be read as a picture"


def _dji(xmp: bytes) -> Dict[str, float]:
    """Numbers of DJI's own part, by name; values stand as attributes or as elements."""
    found = {}
    for name, attribute, element in _XMP_VALUE.findall(xmp):
        value = number((attribute or element).decode("ascii", "ignore"))
        if value is not None:
            found[name.decode("ascii")] = value
    return found


def _focal_px(exif, dji: Dict[str, float], size: Tuple[int, int]) -> Optional[float]:
    """Gives the focal length by DJI's calibration, else by the focal length of a 35 mm camera with
    the same diagonal, else by the sensor's resolution."""
    width, shrunk = number(exif.get(_TAGGED_WIDTH)), 1.0
    if width and width > 0.0:  # of a picture that was made smaller, or turned, later
        shrunk = min(size[0] / width, max(size) / width)
    if dji.get("CalibratedFocalLength", 0.0) > 0.0:
        return dji["CalibratedFocalLength"] * shrunk
    like_35_mm = number(exif.get(_FOCAL_35_MM))
    if like_35_mm and like_35_mm > 0.0:
        return like_35_mm * math.hypot(*size) / _DIAGONAL_35_MM
    focal_mm, resolution = number(exif.get(_FOCAL_MM)), number(exif.get(_PLANE_RESOLUTION))
    unit_mm = _MM_PER_UNIT.get(exif.get(_PLANE_UNIT, 2))
    if focal_mm and resolution and unit_mm and focal_mm > 0.0 and resolution > 0.0:
        return focal_mm * resolution / unit_mm * shrunk
    return None


def _attitude(dji: Dict[str, float]) -> Tuple[Optional[np.ndarray], str]:
    """R_enu_cam of the upright picture by the gimbal's yaw (from north, clockwise), pitch (up) and
    roll; or why not."""
    angles = [dji.get(f"Gimbal{k}Degree") for k in ("Yaw", "Pitch", "Roll")]
    if None in angles:
        return None, ""
    if not any(angles):
        return None, "its gimbal angles are all 0, which means not known"
    R_ned_body = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    return _R_ENU_NED @ R_ned_body @ _R_BODY_OPTICAL, ""
