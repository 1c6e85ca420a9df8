# SPDX-License-Identifier: Apache-2.0
"""Where a photograph was taken, by EXIF's GPS tags and DJI's XMP, and how well they say it."""

import math
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

from PIL import ExifTags

#: What a receiver without corrections is good to, where the file does not say (m, one standard
#: deviation).
GPS_SIGMA_M, GPS_HEIGHT_SIGMA_M = 2.0, 4.0
# DJI's: single point, float, fixed; 0: no RTK, and its deviations mean nothing
_RTK_FLAGS = (16, 34, 50)
_LEAST_SIGMA_M = 0.005
_M_PER_DEGREE = 111_320.0
#: Steps in which places are written: decimals of degrees, minutes, seconds.
_STEPS_DEG = sorted(
    {unit * 10.0**-k for unit in (1.0, 1 / 60, 1 / 3600) for k in range(8)}, reverse=True
)
_STEPS_M = [10.0**-k for k in range(-2, 4)]
_EXACT_DEG, _EXACT_M = 1e-10, 1e-6  # so near a whole number of steps is no chance
#: GPSAltitudeRef of EXIF 3.0: above and below the ellipsoid, above and below sea level (before 3.0
#: the first two: sea).
_SIGNS = {0: 1.0, 1: -1.0, 2: 1.0, 3: -1.0}


@dataclass(frozen=True)
class Gps:
    """WGS 84; the standard deviations are per axis, east and north alike.

    ``step_m`` and ``height_step_m``: the steps in which the place is written, where that is seen.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_m: float = GPS_SIGMA_M
    height_sigma_m: float = GPS_HEIGHT_SIGMA_M
    step_m: float = 0.0
    height_step_m: float = 0.0


def read_gps(exif, dji: Dict[str, float]) -> Tuple[Optional[Gps], str]:
    """Reads, from EXIF's GPS tags and DJI's numbers: the place, or why there is none. XMP counts
    where it is finer."""
    found, why = _exif_place(exif)
    xmp = _xmp_place(dji)
    if xmp is not None and (found is None or step_deg(*xmp) < step_deg(*found)):
        found = xmp
    if found is None:
        return None, why
    why = _wrong(*found)
    height_m, why_height = _height_m(exif, dji)
    if why or height_m is None:
        return None, why or why_height
    return Gps(*found, height_m, *_sigmas_m(exif, dji)), ""


def with_steps(places: Sequence[Gps]) -> List[Gps]:
    """The same places, of one camera, with the steps in which each is written, and in which all
    heights are.

    >>> with_steps([Gps(48.0, 11.0 + 1 / 3600, 5.5), Gps(48.0 + 1 / 3600, 11.0, 6.7)])[0].step_m
    30.922
    """
    steps_m = [round(step_deg(p.latitude_deg, p.longitude_deg) * _M_PER_DEGREE, 3) for p in places]
    height_step_m = _step(_STEPS_M, _EXACT_M, *(p.height_m for p in places))
    return [replace(p, step_m=s, height_step_m=height_step_m) for p, s in zip(places, steps_m)]


def step_deg(*values_deg: float) -> float:
    """Gives the step in which all values are written; 0 where no step is seen.

    >>> step_deg(48.0 + 13 / 3600, 11.0 + 55 / 3600) * 3600
    1.0
    """
    return _step(_STEPS_DEG, _EXACT_DEG, *values_deg)


def _step(steps, exact: float, *values: float) -> float:
    for step in steps:
        if all(abs(v - round(v / step) * step) < exact for v in values):
            return step
    return 0.0


def number(value) -> Optional[float]:
    """Finite, or None: cameras write 0/0 where they do not know."""
    try:
        found = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return found if math.isfinite(found) else None


def degrees(parts, side, sides: str) -> Optional[float]:
    """Degrees, minutes, seconds as one number; None where they are none, or are on neither side.

    >>> degrees((48.0, 30.0, 36.0), "S", "NS")
    -48.51
    """
    numbers = [number(p) for p in parts] if isinstance(parts, (tuple, list)) else []
    side = _letter(side)
    if len(numbers) != 3 or None in numbers or side not in tuple(sides):
        return None
    value = numbers[0] + numbers[1] / 60.0 + numbers[2] / 3600.0
    return -value if side == sides[1] else value


def _letter(side) -> str:
    side = side.decode("ascii", "ignore") if isinstance(side, bytes) else side
    return side.strip("\0 ").upper()[:1] if isinstance(side, str) else ""


def _exif_place(exif) -> Tuple[Optional[Tuple[float, float]], str]:
    names, found = ExifTags.GPS, []
    for what, sides in (("Latitude", "NS"), ("Longitude", "EW")):
        parts, side = exif.get(names[f"GPS{what}"]), exif.get(names[f"GPS{what}Ref"])
        if parts is None:
            return None, f"it has no GPS{what}"
        if _letter(side) not in tuple(sides):
            return None, f"its GPS{what}Ref is missing: {sides[0]} or {sides[1]}"
        found.append(degrees(parts, side, sides))
    if None in found:
        return None, "its GPS position is no number"
    return (found[0], found[1]), ""


def _xmp_place(dji: Dict[str, float]) -> Optional[Tuple[float, float]]:
    """None also for zeros: no fix."""
    latitude = dji.get("GpsLatitude")
    longitude = dji.get("GpsLongitude", dji.get("GpsLongtitude"))  # older cameras spell it so
    return (latitude, longitude) if latitude and longitude else None


def _wrong(latitude: float, longitude: float) -> str:
    if latitude == longitude == 0.0:
        return "its GPS position is 0, 0: the camera had no fix"
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        return f"its GPS position is {latitude:g}, {longitude:g} degrees; that is no place"
    return ""


def _height_m(exif, dji: Dict[str, float]) -> Tuple[Optional[float], str]:
    """XMP's number has a sign of its own; zero there, beside another height, is none."""
    names = ExifTags.GPS
    height, absolute, side = (
        number(exif.get(names.GPSAltitude)),
        dji.get("AbsoluteAltitude"),
        exif.get(names.GPSAltitudeRef),
    )
    if absolute is not None and (absolute != 0.0 or height is None):
        return absolute, ""
    if height is None:
        return None, "it has no height (GPSAltitude)"
    side = side[0] if isinstance(side, bytes) and side else side
    if side not in (None, b"", *_SIGNS):
        return None, f"its GPSAltitudeRef is {side}; 0 to 3 are defined"
    return _SIGNS.get(side, 1.0) * height, ""


def _sigmas_m(exif, dji: Dict[str, float]) -> Tuple[float, float]:
    rtk = [dji.get(k, 0.0) for k in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")]
    if dji.get("RtkFlag") in _RTK_FLAGS and min(rtk) > 0.0:
        return max(*rtk[:2], _LEAST_SIGMA_M), max(rtk[2], _LEAST_SIGMA_M)
    said = number(exif.get(ExifTags.GPS.GPSHPositioningError))
    if said and said > 0.0:
        return max(said, _LEAST_SIGMA_M), 2.0 * max(said, _LEAST_SIGMA_M)
    return GPS_SIGMA_M, GPS_HEIGHT_SIGMA_M
