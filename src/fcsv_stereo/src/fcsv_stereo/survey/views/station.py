# SPDX-License-Identifier: Apache-2.0
"""What is known of a view's place before any picture is compared: ``station.yaml``, and gravity."""

from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import config, transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.model.pictures import is_level
from fcsv_stereo.survey import tuning

FILE = "station.yaml"
# horizontal part of the optical axis below which the picture's top tells the heading
_LEAST_AHEAD = 0.2


@dataclass(frozen=True)
class Station:
    """Where the reference camera was, in a frame that several stations share (x forward, y left, z
    up; m), which way it looked (degrees to the left of x), and standard deviations: per axis, and
    of the map's scale as a share."""

    place_m: Tuple[float, float, float]
    heading_deg: float
    place_sigma_m: float
    heading_sigma_deg: float
    scale_sigma: float = tuning.SCALE

    def __post_init__(self):
        config.require_positive(self, ("place_m", "heading_deg"))
        if not self.scale_sigma < 0.5:
            raise ValueError(
                f"scale_sigma: is a share of the scale, below 0.5, got {self.scale_sigma}"
            )


def load_station(folder: Path) -> Optional[Station]:
    """The station of an input's folder, None where it brings none. Raises ConfigError naming file
    and field, or a file whose name is nearly right."""
    path = Path(folder) / FILE
    beside = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
    for name in beside:
        if name != FILE and name.lower() in (FILE, "station.yml"):
            raise ConfigError(f"{path.with_name(name)}: would not be read; name it {FILE}")
    return config.load(path, Station) if path.is_file() else None


@dataclass(frozen=True)
class Prior:
    """``T_site_cam`` (4x4) of the reference camera with standard deviations: roll and pitch (rad),
    yaw (rad), place per axis (m), scale (share). Infinite: not known, and then the pose says
    nothing of it."""

    T_site_cam: np.ndarray
    tilt_rad: float
    yaw_rad: float
    place_m: float
    scale: float

    @property
    def placed(self) -> bool:
        """Whether place and heading are known."""
        return bool(np.isfinite(self.place_m) and np.isfinite(self.yaw_rad))


def prior_of(station: Optional[Station], T_home_cam: np.ndarray, level: bool, name: str) -> Prior:
    """The prior of a view with its camera at ``T_home_cam``; ``level``: gravity made home's z point
    up.

    Raises SurveyError where there is a station, which needs that, and home's z cannot point up.
    """
    tilt_rad = tuning.LEVEL_RAD if level else float("inf")
    if station is None:
        T = transforms.transform(T_home_cam[:3, :3], np.zeros(3))
        return Prior(T, tilt_rad, float("inf"), float("inf"), tuning.SCALE)
    if not is_level(T_home_cam):
        raise SurveyError(
            f"{name}: has a {FILE}, but its pictures stand on the side or on the head in home; turn the model upright "
            "(its world's z up)"
        )
    turn_rad = np.radians(station.heading_deg) - heading_rad(T_home_cam)
    R_site_home = transforms.from_xyz_yaw([0.0, 0.0, 0.0], turn_rad)[:3, :3]
    T_site_cam = transforms.transform(R_site_home @ T_home_cam[:3, :3], station.place_m)
    yaw_rad = float(np.radians(station.heading_sigma_deg))
    return Prior(T_site_cam, tuning.LEVEL_RAD, yaw_rad, station.place_sigma_m, station.scale_sigma)


def flown_prior(
    station: Optional[Station], in_site: bool, T_home_cam: np.ndarray, name: str
) -> Prior:
    """The prior of one view of a flight from stations: its trackers know ``T_home_cam``, and err
    with the distance from home. ``station``: where home is; without one home is the site's frame
    (``in_site``), or not known. Raises SurveyError as prior_of."""
    away_m = float(np.linalg.norm(T_home_cam[:3, 3]))
    place_m = float(np.hypot(tuning.FLOWN_M, tuning.FLOWN_SHARE * away_m))
    if station is not None:
        home = prior_of(station, T_HOME_CAM_AT_HOME, True, name)
        T_site_home = home.T_site_cam @ transforms.invert(T_HOME_CAM_AT_HOME)
        place_m = float(np.hypot(np.hypot(place_m, home.place_m), home.yaw_rad * away_m))
        yaw_rad = float(np.hypot(home.yaw_rad, tuning.FLOWN_RAD))
        return Prior(T_site_home @ T_home_cam, tuning.LEVEL_RAD, yaw_rad, place_m, home.scale)
    if not in_site:
        return prior_of(None, T_home_cam, True, name)
    return Prior(T_home_cam, tuning.LEVEL_RAD, tuning.FLOWN_RAD, place_m, tuning.SCALE)


def heading_rad(T_home_cam: np.ndarray) -> float:
    """Which way the optical axis looks, to the left of x; of a camera that looks down, the
    picture's top.

    >>> T = transforms.from_xyz_yaw([0, 0, 0], 0.5) @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
    >>> round(heading_rad(T), 6)
    0.5
    """
    ahead, top = T_home_cam[:3, 2], -T_home_cam[:3, 1]
    x, y = (ahead if np.hypot(*ahead[:2]) > _LEAST_AHEAD else top)[:2]
    return float(np.arctan2(y, x))
