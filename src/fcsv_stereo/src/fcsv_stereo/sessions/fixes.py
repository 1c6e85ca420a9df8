# SPDX-License-Identifier: Apache-2.0
"""Where on the earth a session was flown, by the GPS fixes of its vehicles."""

import math
from dataclasses import dataclass, replace
from typing import Dict, List, Mapping, Optional

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.earth import east_north_up_m
from fcsv_geometry.errors import GeometryError, PoseUnavailable
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.photos.gps import Gps

FIXES = "mavros/global_position/raw/fix"
_FAR_SIGMAS = 6.0  # a fix that is further from the others than this, and than the vehicle flew


_NUMBERS = ("latitude_deg", "longitude_deg", "height_m", "sigma_m", "height_sigma_m")


@dataclass(frozen=True)
class SessionGps:
    """The middle of a session's fixes (heights above the ellipsoid, NaN: not told), and of where the
    vehicles were then: ``place_home_m`` (3,).

    Fixes of one flight err alike, by orbits, clocks and air: their mean is no surer than one.
    """

    fix: Gps
    place_home_m: np.ndarray
    fixes: Mapping[str, int]  # how many, by vehicle

    def to_dict(self) -> dict:
        """Is for report.json; a height that is not known is null."""
        known = math.isfinite(self.fix.height_m)
        return {
            **{n: getattr(self.fix, n) if known or "height" not in n else None for n in _NUMBERS},
            "place_home_m": self.place_home_m.tolist(),
            "fixes": dict(self.fixes),
        }


def fix_of(message) -> Optional[Gps]:
    """Reads sensor_msgs/NavSatFix; None where the receiver has no fix. Raises GeometryError where
    it is none of a place."""
    if message.status.status < 0:
        return None
    latitude_deg, longitude_deg = message.latitude, message.longitude
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        raise GeometryError(f"GPS fix at {latitude_deg}, {longitude_deg} is no place on the earth")
    fix = Gps(latitude_deg, longitude_deg, message.altitude)
    if message.position_covariance_type > 0:
        east, _, _, _, north, *_, up = (float(v) for v in message.position_covariance)
        across, height = math.sqrt(max(east, north, 0.0)), math.sqrt(max(up, 0.0))
        fix = replace(fix, sigma_m=across) if 0.0 < across < math.inf else fix
        fix = replace(fix, height_sigma_m=height) if 0.0 < height < math.inf else fix
    return fix


def session_gps(
    fixes: Mapping[str, List], tracks: Mapping[str, Trajectory], in_home: HomeFrames
) -> Optional[SessionGps]:
    """Joins the fixes (by vehicle, [(stamp_s, Gps)]) whose vehicle's place in home is known; None
    where there are none."""
    of: Dict[str, np.ndarray] = {}
    for vehicle, told in sorted(fixes.items()):
        if vehicle not in tracks or vehicle not in in_home.places:
            continue
        rows = []
        for stamp_s, fix in told:
            try:
                T_home_body = in_home.at(stamp_s)[vehicle] @ tracks[vehicle].at(stamp_s)
            except PoseUnavailable:
                continue
            rows.append((*(getattr(fix, n) for n in _NUMBERS), *T_home_body[:3, 3]))
        rows = _without_far(np.array(rows)) if rows else rows
        if len(rows):
            of[vehicle] = rows
    if not of:
        return None
    means = np.array([rows.mean(axis=0) for rows in of.values()])
    latitude, longitude, height, sigma, height_sigma, *place = means.mean(axis=0)
    fix = Gps(latitude, longitude, height, sigma, height_sigma)
    return SessionGps(fix, np.array(place), {v: len(rows) for v, rows in of.items()})


def _without_far(rows: np.ndarray) -> np.ndarray:
    """Rows (N,8) of fix and place (m) without fixes that jumped away."""
    middle = Gps(*np.median(rows[:, :2], axis=0), 0.0)
    off_m = np.linalg.norm(
        east_north_up_m([Gps(*place, 0.0) for place in rows[:, :2]], middle)[:, :2], axis=1
    )
    flown_m = float(np.linalg.norm(np.ptp(rows[:, 5:7], axis=0)))
    return rows[off_m <= _FAR_SIGMAS * np.median(rows[:, 3]) + flown_m]


def cam_place(gps: Mapping, T_home_cam: np.ndarray) -> np.ndarray:
    """(3,) m: where the fixes of report.json's ``gps`` are, in the camera of the map. Raises
    GeometryError, KeyError or TypeError where it does not say it."""
    place = np.array(gps["place_home_m"], float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise GeometryError(f"gps: place_home_m is {gps['place_home_m']}")
    return transforms.apply(transforms.invert(T_home_cam), place[None])[0]
