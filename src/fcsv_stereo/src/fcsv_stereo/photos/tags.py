# SPDX-License-Identifier: Apache-2.0
"""What a photograph's file says: orientation, focal length, GPS (EXIF), attitude and RTK (DJI's XMP). By Pillow."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Optional, Tuple

import numpy as np
from PIL import ExifTags, Image, UnidentifiedImageError
from scipy.spatial.transform import Rotation

from fcsv_stereo.errors import InputError

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
#: EXIF numbers; Pillow names them too, by names that changed between its versions.
ORIENTATION, _MAKE, _MODEL, _EXIF, _GPS = 0x0112, 0x010F, 0x0110, 0x8769, 0x8825
_FOCAL_MM, _FOCAL_35_MM, _PLANE_RESOLUTION, _PLANE_UNIT, _TAGGED_WIDTH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0}
_DIAGONAL_35_MM = math.hypot(36.0, 24.0)
#: What a receiver without corrections is good to, where the file does not say (m, one standard deviation).
GPS_SIGMA_M, GPS_HEIGHT_SIGMA_M = 2.0, 4.0
_FIXED = 50  # DJI's RtkFlag of a fixed solution
_XMP_VALUE = re.compile(rb"drone-dji:(\w+)\s*(?:=\s*[\"']([^\"'<>]{1,64})[\"']|>([^<>]{1,64})<)")
#: A camera that looks along the body: body x forward, y right, z down (as DJI's angles are) to optical axes.
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Gps:
    """WGS 84; the standard deviations are per axis, east and north alike."""

    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_m: float = GPS_SIGMA_M
    height_sigma_m: float = GPS_HEIGHT_SIGMA_M


@dataclass(frozen=True)
class Tags:
    """``size`` is (width, height) as stored. ``focal_px`` may be None. ``R_enu_cam`` is the gimbal's."""

    path: Path
    size: Tuple[int, int]
    orientation: int
    camera: str
    focal_px: Optional[float]
    gps: Optional[Gps]
    R_enu_cam: Optional[np.ndarray] = None


def read_tags(path: Path) -> Tags:
    """Raises InputError where the file is no picture, or its position is none."""
    try:
        with Image.open(path) as image:
            exif, size = image.getexif(), image.size
            xmp = image.info.get("xmp") or exif.get(0x02BC) or b""  # TIFF keeps it among its tags
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a picture") from error
    inner, dji = exif.get_ifd(_EXIF), _dji(xmp.encode() if isinstance(xmp, str) else bytes(xmp))
    orientation = exif.get(ORIENTATION, 1)
    camera = " ".join(str(exif.get(t, "")).strip("\0 ") for t in (_MAKE, _MODEL)).strip()
    return Tags(
        path, size, orientation if orientation in range(1, 9) else 1, camera,
        _focal_px(inner, dji, size), _gps(path, exif.get_ifd(_GPS), dji), _attitude(dji),
    )  # fmt: skip


def _dji(xmp: bytes) -> Dict[str, float]:
    """Numbers of DJI's own part, by name; values stand as attributes or as elements."""
    found = {}
    for name, attribute, element in _XMP_VALUE.findall(xmp):
        number = _number((attribute or element).decode("ascii", "ignore"))
        if number is not None:
            found[name.decode("ascii")] = number
    return found


def _number(value) -> Optional[float]:
    """Finite, or None: cameras write 0/0 where they do not know."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None


def _focal_px(exif, dji: Dict[str, float], size: Tuple[int, int]) -> Optional[float]:
    """By DJI's calibration, else by the focal length of a 35 mm camera with the same diagonal, else by the sensor's
    resolution."""
    width, shrunk = _number(exif.get(_TAGGED_WIDTH)), 1.0
    if width and width > 0.0:  # of a picture that was made smaller, or turned, later
        shrunk = min(size[0] / width, max(size) / width)
    if dji.get("CalibratedFocalLength", 0.0) > 0.0:
        return dji["CalibratedFocalLength"] * shrunk
    like_35_mm = _number(exif.get(_FOCAL_35_MM))
    if like_35_mm and like_35_mm > 0.0:
        return like_35_mm * math.hypot(*size) / _DIAGONAL_35_MM
    focal_mm, resolution = _number(exif.get(_FOCAL_MM)), _number(exif.get(_PLANE_RESOLUTION))
    unit_mm = _MM_PER_UNIT.get(exif.get(_PLANE_UNIT, 2))
    if focal_mm and resolution and unit_mm and focal_mm > 0.0 and resolution > 0.0:
        return focal_mm * resolution / unit_mm * shrunk
    return None


def _gps(path: Path, tags, dji: Dict[str, float]) -> Optional[Gps]:
    names = ExifTags.GPS
    latitude = _degrees(tags.get(names.GPSLatitude), tags.get(names.GPSLatitudeRef), "S")
    longitude = _degrees(tags.get(names.GPSLongitude), tags.get(names.GPSLongitudeRef), "W")
    height = _number(tags.get(names.GPSAltitude))
    if latitude is None or longitude is None or height is None or (latitude == longitude == 0.0):
        return None  # no fix: cameras leave out the tags or write noughts
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise InputError(f"{path}: its GPS position is {latitude:g}, {longitude:g} degrees; that is no place")
    if tags.get(names.GPSAltitudeRef) in (1, b"\x01"):
        height = -height
    sigma, height_sigma = GPS_SIGMA_M, GPS_HEIGHT_SIGMA_M
    said = _number(tags.get(names.GPSHPositioningError))
    if said and said > 0.0:
        sigma, height_sigma = said, 2.0 * said
    rtk = [dji.get(k, 0.0) for k in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")]
    if dji.get("RtkFlag") == _FIXED and min(rtk) > 0.0:
        sigma, height_sigma = max(rtk[:2]), rtk[2]
        height = dji.get("AbsoluteAltitude", height)
    return Gps(latitude, longitude, height, sigma, height_sigma)


def _degrees(parts, side, negative: str) -> Optional[float]:
    """Degrees, minutes, seconds as one number.

    >>> _degrees((48.0, 30.0, 36.0), "S", "S")
    -48.51
    """
    numbers = [_number(p) for p in parts] if isinstance(parts, (tuple, list)) else []
    if len(numbers) != 3 or None in numbers or not isinstance(side, str):
        return None
    value = numbers[0] + numbers[1] / 60.0 + numbers[2] / 3600.0
    return -value if side.strip("\0 ").upper() == negative else value


def _attitude(dji: Dict[str, float]) -> Optional[np.ndarray]:
    """R_enu_cam of the upright picture from the gimbal's yaw (from north, clockwise), pitch (up) and roll."""
    angles = [dji.get(f"Gimbal{k}Degree") for k in ("Yaw", "Pitch", "Roll")]
    if None in angles:
        return None
    return _R_ENU_NED @ Rotation.from_euler("ZYX", angles, degrees=True).as_matrix() @ _R_BODY_OPTICAL
