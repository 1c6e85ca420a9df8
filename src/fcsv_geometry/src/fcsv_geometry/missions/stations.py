# SPDX-License-Identifier: Apache-2.0
"""Stations of a mission: places from which the list is flown again, each with one or several
headings."""

import math
from dataclasses import dataclass, field
from typing import List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.earth import EarthPlace, east_north_up_m
from fcsv_geometry.missions.configuration import StereoConfiguration

_LEAST_TURN_DEG = 1.0  # headings nearer to each other are one


@dataclass(frozen=True)
class HomeFix:
    """Where on the earth home will be: stations may then be given by latitude and longitude."""

    latitude_deg: float  # WGS 84, of home
    longitude_deg: float  # WGS 84, of home
    course_deg: float  # of home's x axis, clockwise from true north

    def __post_init__(self):
        _check_degrees(self.latitude_deg, self.longitude_deg)
        if not -360.0 <= self.course_deg <= 360.0:
            raise ValueError(f"course_deg: {self.course_deg} is not in -360..360")

    def in_home_m(self, latitude_deg: float, longitude_deg: float) -> Tuple[float, float]:
        """x, y (m) in home of a place on the earth, in the plane that touches the ellipsoid there.

        >>> x, y = HomeFix(48.0, 11.0, 0.0).in_home_m(48.001, 11.0)
        >>> round(x, 2), abs(round(y, 2))
        (111.19, 0.0)
        """
        home = EarthPlace(self.latitude_deg, self.longitude_deg)
        east_m, north_m, _ = east_north_up_m([EarthPlace(latitude_deg, longitude_deg)], home)[0]
        course_rad = math.radians(self.course_deg)
        c, s = math.cos(course_rad), math.sin(course_rad)
        return float(c * north_m + s * east_m), float(s * north_m - c * east_m)


@dataclass(frozen=True)
class MissionStation:
    """A place of the reference from which a list of configurations is flown, at each heading."""

    headings_deg: List[float]  # of the reference's view, to the left of home's x; flown in order
    place_m: Optional[Tuple[float, float]] = None  # x, y in home; or latitude and longitude
    latitude_deg: Optional[float] = None  # WGS 84; needs `home_fix`
    longitude_deg: Optional[float] = None  # WGS 84; needs `home_fix`
    # above the take-off place; default: the mission's home_height_m
    height_m: Optional[float] = None
    name: Optional[str] = None  # in reports and messages; default: station and its number
    # whether the column is calibrated anew there; default: yes, but not within 5 m of home when it
    # comes first: the operators have just calibrated there, and a walk of 5 m adds less than the
    # 0.05 m to which a calibration is known
    calibrate: Optional[bool] = None
    # through which places the column comes there (x, y in home, heading), each as the station itself
    via: List[Tuple[float, float, float]] = field(default_factory=list)
    # its own list; none: that of the mission
    configurations: List[StereoConfiguration] = field(default_factory=list)

    def __post_init__(self):
        if not self.headings_deg:
            raise ValueError("headings_deg: the list is empty; give at least one, such as [0]")
        for i, heading_deg in enumerate(self.headings_deg):
            if not -360.0 <= heading_deg <= 360.0:
                raise ValueError(f"headings_deg[{i}]: {heading_deg} is not in -360..360")
            for before_deg in self.headings_deg[:i]:
                if abs((heading_deg - before_deg + 180.0) % 360.0 - 180.0) < _LEAST_TURN_DEG:
                    raise ValueError(
                        f"headings_deg[{i}]: {heading_deg} is the heading {before_deg} again"
                    )
        for i, (x_m, y_m, heading_deg) in enumerate(self.via):
            if not (math.isfinite(x_m) and math.isfinite(y_m) and -360.0 <= heading_deg <= 360.0):
                raise ValueError(f"via[{i}]: {self.via[i]} is not [x, y, heading in -360..360]")
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            missing = "latitude_deg" if self.latitude_deg is None else "longitude_deg"
            raise ValueError(f"{missing}: is missing beside the other one")
        if (self.place_m is None) == (self.latitude_deg is None):
            raise ValueError("place_m: give either place_m, or latitude_deg and longitude_deg")
        if self.latitude_deg is not None:
            _check_degrees(self.latitude_deg, self.longitude_deg)


@dataclass(frozen=True)
class Viewpoint:
    """One heading at one station: ``place_m`` (x, y, z) in home of the reference's camera, and its
    heading to the left of home's x; ``via``: x, y and heading of places through which it comes
    there."""

    station: str
    place_m: Tuple[float, float, float]
    heading_rad: float
    via: Tuple[Tuple[float, float, float], ...] = ()

    @property
    def title(self) -> str:
        """Its name in words.

        >>> Viewpoint("north", (20.0, 0.0, 0.0), math.pi / 2).title
        'north at 90 deg'
        """
        if self == HOME_VIEW:
            return self.station
        return f"{self.station} at {math.degrees(self.heading_rad):.6g} deg"

    @property
    def T_home_view(self) -> np.ndarray:
        """4x4 of the frame in which a list's places are those of a mission without stations."""
        return transforms.from_xyz_yaw(self.place_m, self.heading_rad)

    @property
    def T_home_ways(self) -> List[np.ndarray]:
        """``T_home_view`` of the places on the way, at its height, and its own."""
        on_way = [transforms.from_xyz_yaw([x, y, self.place_m[2]], yaw) for x, y, yaw in self.via]
        return [*on_way, self.T_home_view]


#: From where a mission without stations is flown; with stations, where the flight begins and ends.
HOME_VIEW = Viewpoint("home", (0.0, 0.0, 0.0), 0.0)


def viewpoints_of(
    station: MissionStation, name: str, home_height_m: float, fix: Optional[HomeFix]
) -> List[Viewpoint]:
    """The viewpoints of a station, in the order of its headings. Raises ValueError ("field: what is
    wrong") where its place needs a fix of home that is not there."""
    if station.place_m is not None:
        x_m, y_m = station.place_m
    elif fix is None:
        raise ValueError(
            "latitude_deg: needs the mission's home_fix (latitude_deg, longitude_deg, course_deg)"
        )
    else:
        x_m, y_m = fix.in_home_m(station.latitude_deg, station.longitude_deg)
    up_m = 0.0 if station.height_m is None else station.height_m - home_height_m
    place_m = (float(x_m), float(y_m), float(up_m))
    via = tuple((x_m, y_m, math.radians(heading_deg)) for x_m, y_m, heading_deg in station.via)
    return [
        Viewpoint(name, place_m, math.radians(h), () if k else via)
        for k, h in enumerate(station.headings_deg)
    ]


def _check_degrees(latitude_deg: float, longitude_deg: float) -> None:
    if not -89.0 <= latitude_deg <= 89.0:
        raise ValueError(f"latitude_deg: {latitude_deg} is not in -89..89")
    if not -180.0 <= longitude_deg <= 180.0:
        raise ValueError(f"longitude_deg: {longitude_deg} is not in -180..180")
