# SPDX-License-Identifier: Apache-2.0
"""A GPS receiver without corrections, which the autopilot reports and does not fly by."""

import math
from functools import lru_cache
from typing import Sequence, Tuple

import numpy as np
from pyproj import Transformer

#: Where the simulated worlds lie: the origin (degrees, m above the ellipsoid); x is east, y north.
LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_M = 48.1, 11.6, 560.0
SIGMA_M, HEIGHT_SIGMA_M = 2.0, 4.0  # per axis; what the receiver says of itself, and what is true
SATELLITES = 14
_LASTS_S = 300.0  # orbits, clocks and air are wrong for minutes in the same way
_NOISE_M = 0.1  # of a fix


@lru_cache(maxsize=1)
def _earth() -> Transformer:
    return Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lon_0={LONGITUDE_DEG} "
        f"+lat_0={LATITUDE_DEG} +h_0={HEIGHT_M} +step +inv +proj=cart +ellps=WGS84 "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )


def geographic(p_world_m: Sequence[float]) -> Tuple[float, float, float]:
    """Latitude, longitude (degrees) and height (m above the ellipsoid) of a point of the world.

    >>> [round(v, 5) for v in geographic((0.0, 111.2, 10.0))]
    [48.101, 11.6, 570.00097]
    """
    longitude_deg, latitude_deg, height_m = _earth().transform(*map(float, p_world_m))
    return latitude_deg, longitude_deg, height_m


class GpsReceiver:
    """``feel`` is told the truth with each pass, ``fix`` reads the receiver at a time (s)."""

    def __init__(self, seed: int):
        self._random = np.random.default_rng([seed, 11])
        self._sigma_m = np.array([SIGMA_M, SIGMA_M, HEIGHT_SIGMA_M])
        self._off_m = self._sigma_m * self._random.standard_normal(3)
        self._read_s = math.nan
        self._p_world_m = np.zeros(3)

    def feel(self, p_world_m: Sequence[float]) -> None:
        """Where the antenna is."""
        self._p_world_m = np.array(p_world_m, float)

    def fix(self, now_s: float) -> Tuple[float, float, float]:
        """Latitude, longitude (degrees), height (m above the ellipsoid)."""
        passed_s = 0.0 if math.isnan(self._read_s) else now_s - self._read_s
        self._read_s = now_s
        keep = math.exp(-passed_s / _LASTS_S)
        new, noise = self._random.standard_normal((2, 3))
        self._off_m = keep * self._off_m + math.sqrt(1.0 - keep**2) * self._sigma_m * new
        return geographic(self._p_world_m + self._off_m + _NOISE_M * noise)
