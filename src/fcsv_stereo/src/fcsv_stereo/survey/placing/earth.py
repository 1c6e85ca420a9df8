# SPDX-License-Identifier: Apache-2.0
"""Leads from places on the earth to a frame of metres in which views are adjusted, and to the
projected reference system of the output (PROJ, by pyproj)."""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Optional

import numpy as np
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.database import query_utm_crs_info
from pyproj.exceptions import ProjError

from fcsv_stereo.errors import SurveyError

WGS84 = "EPSG:4326"
_ODM_UTM = re.compile(r"(?i)^wgs\s*84\s+utm\s+(\d{1,2})\s*([NS])$")
_STEP_M = 1.0  # of numerical derivatives
_ROUND_M = 1000.0  # the origin of output in a projected system


def crs_of(words: str) -> CRS:
    """The reference system that words name: ``EPSG:32633``, a PROJ string, or ODM's ``WGS84 UTM
    33N``. Raises SurveyError.

    >>> crs_of("WGS84 UTM 33N").to_epsg(), crs_of("EPSG:25832").to_epsg()
    (32633, 25832)
    """
    utm = _ODM_UTM.match(words.strip())
    if utm and 1 <= int(utm.group(1)) <= 60:
        north = utm.group(2).upper() == "N"
        words = f"EPSG:{(32600 if north else 32700) + int(utm.group(1))}"
    try:
        crs = CRS.from_user_input(words.strip())
    except ProjError as error:
        raise SurveyError(
            f"'{words.strip()}' is no reference system of PROJ; give EPSG:NUMBER, a PROJ string or 'WGS84 UTM 33N'"
        ) from error
    if len(crs.axis_info) != 2:
        raise SurveyError(
            f"'{words.strip()}' has {len(crs.axis_info)} axes; give its horizontal part: heights are taken as they are"
        )
    return crs


def projected_crs(words: str) -> CRS:
    """The reference system that words name, whose axes must be metres. Raises SurveyError."""
    crs = crs_of(words)
    if not in_metres(crs):
        raise SurveyError(f"'{words}' is not projected to metres; choose such a system, as UTM's")
    return crs


def in_metres(crs: CRS) -> bool:
    """Whether a system is projected, with axes in metres."""
    return crs.is_projected and all(a.unit_conversion_factor == 1.0 for a in crs.axis_info)


def utm_at(longitude_deg: float, latitude_deg: float) -> CRS:
    """WGS 84's UTM zone of a place. Raises SurveyError where there is none, near the poles.

    >>> utm_at(13.4, 52.5).to_epsg()
    32633
    """
    here = AreaOfInterest(longitude_deg, latitude_deg, longitude_deg, latitude_deg)
    found = query_utm_crs_info(datum_name="WGS 84", area_of_interest=here)
    if not found:
        raise SurveyError(
            f"no UTM zone holds {latitude_deg:.4f}, {longitude_deg:.4f}; name a system with --crs"
        )
    return CRS.from_epsg(found[0].code)


def name_of(crs: CRS) -> str:
    """``EPSG:NUMBER`` where it has one, else its text (WKT)."""
    number = crs.to_epsg()
    return crs.to_wkt() if number is None else f"EPSG:{number}"


def to_geographic(crs: CRS, xyz: np.ndarray) -> np.ndarray:
    """(N,3) longitude and latitude (degrees, WGS 84) and height (m, as given) of coordinates (N,3)
    in a system, x before y. Raises SurveyError where one is no place."""
    to_wgs84 = Transformer.from_crs(crs, WGS84, always_xy=True)
    found = np.column_stack([_through(to_wgs84, xyz[:, :2]), xyz[:, 2]])
    if not np.isfinite(found).all() or np.abs(found[:, 1]).max(initial=0.0) > 90.0:
        raise SurveyError(f"coordinates lie outside of {name_of(crs)}")
    return found


def _through(transformer: Transformer, p: np.ndarray, direction: str = "FORWARD") -> np.ndarray:
    """(N,2 or 3) of the same; pyproj takes arrays of one for numbers, so that one more goes
    along."""
    columns = np.concatenate([p, p[:1]]).T
    return np.column_stack(transformer.transform(*columns, direction=direction))[:-1]


@dataclass(frozen=True)
class EarthFrame:
    """Metres east, north, up of a place (``longitude_deg``, ``latitude_deg``, ``height_m``), in
    which views are adjusted: a projected system stretches lengths by up to 0.1 % and bends heights.
    ``crs``: the system of the output. Heights count from the surface that the input's count from.
    """

    longitude_deg: float
    latitude_deg: float
    height_m: float
    crs: CRS

    @classmethod
    def about(cls, geographic: np.ndarray, crs: Optional[CRS]) -> "EarthFrame":
        """The frame in the middle of places (N,3); ``crs`` None: their UTM zone."""
        longitude, latitude, height = map(float, np.median(geographic, axis=0))
        return cls(longitude, latitude, height, crs or utm_at(longitude, latitude))

    @cached_property
    def _local(self) -> Transformer:
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart "
            f"+ellps=WGS84 +step +proj=topocentric +ellps=WGS84 +lon_0={self.longitude_deg!r} "
            f"+lat_0={self.latitude_deg!r} +h_0={self.height_m!r}"
        )

    @cached_property
    def _projected(self) -> Transformer:
        return Transformer.from_crs(WGS84, self.crs, always_xy=True)

    def from_geographic(self, geographic: np.ndarray) -> np.ndarray:
        """(N,3) m in the frame of (N,3) longitude, latitude (degrees), height (m).

        >>> frame = EarthFrame.about(np.array([[11.0, 48.0, 500.0]]), None)
        >>> frame.from_geographic(np.array([[11.001, 48.0, 505.0]])).round(2).tolist()
        [[74.63, 0.0, 5.0]]
        """
        return _through(self._local, np.asarray(geographic, float))

    def to_projected(self, p: np.ndarray) -> np.ndarray:
        """(N,3) x, y (m, in ``crs``) and height (m) of points (N,3) in the frame."""
        geographic = _through(self._local, p, "INVERSE")
        return np.column_stack([_through(self._projected, geographic[:, :2]), geographic[:, 2]])

    def turn_at(self, p: np.ndarray) -> np.ndarray:
        """3x3: how directions and lengths at a point (3,) of the frame become those of ``crs``:
        convergence, scale factor, the plumb line's bend."""
        steps = _STEP_M * np.vstack([np.eye(3), -np.eye(3)])
        there = self.to_projected(p + steps)
        return (there[:3] - there[3:]).T / (2.0 * _STEP_M)

    def rounded_origin(self) -> np.ndarray:
        """(3,) m in ``crs``, to whole kilometres."""
        at = self.to_projected(np.zeros((1, 3)))[0]
        return np.array([*(np.round(at[:2] / _ROUND_M) * _ROUND_M), 0.0])
