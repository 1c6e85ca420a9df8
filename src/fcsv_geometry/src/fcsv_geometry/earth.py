# SPDX-License-Identifier: Apache-2.0
"""Places on the earth in metres east, north and up of one of them."""

import math
from typing import NamedTuple, Sequence

import numpy as np

_EQUATOR_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84
_ECCENTRICITY_2 = _FLATTENING * (2.0 - _FLATTENING)


class EarthPlace(NamedTuple):
    """WGS 84, height (m) above the ellipsoid; what has these fields serves as well."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0


def from_centre_m(place: EarthPlace) -> np.ndarray:
    """(3,) about the earth's centre: x towards latitude and longitude 0, z to the north pole.

    >>> from_centre_m(EarthPlace(0.0, 0.0, 10.0)).tolist()
    [6378147.0, 0.0, 0.0]
    """
    lat, lon = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    normal_m = _EQUATOR_M / math.sqrt(1.0 - _ECCENTRICITY_2 * math.sin(lat) ** 2)
    across_m = (normal_m + place.height_m) * math.cos(lat)
    z_m = (normal_m * (1.0 - _ECCENTRICITY_2) + place.height_m) * math.sin(lat)
    return np.array([across_m * math.cos(lon), across_m * math.sin(lon), z_m])


def east_north_up_m(places: Sequence[EarthPlace], origin: EarthPlace) -> np.ndarray:
    """(N, 3) in the level plane that touches the ellipsoid's normal at ``origin``.

    >>> east_north_up_m([EarthPlace(48.0, 11.001, 5.0)], EarthPlace(48.0, 11.0)).round(2).tolist()
    [[74.63, 0.0, 5.0]]
    """
    lat, lon = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    east = [-math.sin(lon), math.cos(lon), 0.0]
    north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
    up = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
    return (np.array([from_centre_m(p) for p in places]) - from_centre_m(origin)) @ np.array(
        [east, north, up]
    ).T
