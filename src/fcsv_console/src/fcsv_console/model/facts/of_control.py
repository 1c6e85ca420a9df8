# SPDX-License-Identifier: Apache-2.0
"""What the control PC's nodes tell: mission, flight check, calibration, map."""

import math
from dataclasses import dataclass
from typing import Tuple

from fcsv_control.flight_check.lines import Line


@dataclass(frozen=True)
class Calibrated:
    """A calibration for these epochs; ``age_s``: for how long it has held, when told."""

    epochs: Tuple[Tuple[str, int], ...]
    age_s: float = 0.0


@dataclass(frozen=True)
class CalibratedLink:
    """``child`` against ``parent``, the vehicle in front: from so many views of its tag; standard
    deviation of yaw."""

    child: str
    parent: str
    used: int
    rejected: int
    spread_m: float
    yaw_std_rad: float


@dataclass(frozen=True)
class CalibrationReport:
    """Holds the calibration as fcsv_msgs/Calibration; without links where a tracker on the ground
    sees everybody."""

    links: Tuple[CalibratedLink, ...]


@dataclass(frozen=True)
class HomeSet:
    """Home is set in the odometry of ``reference``."""

    reference: str
    age_s: float = 0.0


@dataclass(frozen=True)
class FlightCheckReport:
    """The fleet's flight check; after ``patience_s`` without another one it counts for nothing."""

    lines: Tuple[Line, ...]
    patience_s: float = 4.0


@dataclass(frozen=True)
class MissionReport:
    """Holds the mission's state as fcsv_msgs/MissionState."""

    phase: str
    detail: str = ""
    waits_for: str = ""
    configuration: int = 0
    configurations: int = 0
    problems: Tuple[str, ...] = ()
    stage: str = ""


@dataclass(frozen=True)
class MissionFlown:
    """The text of the mission file that the mission node read when it started."""

    text: str


@dataclass(frozen=True)
class MissionHeartbeat:
    """A sign of life of the mission node."""

    instance: str = ""


@dataclass(frozen=True)
class StopReport:
    """Holds the report as fcsv_msgs/StopReport; ``asked``: "stop", "land" or empty; ``words``: what
    became of it."""

    asked: str = ""
    words: str = ""


@dataclass(frozen=True)
class MapReport:
    """Holds the state as fcsv_msgs/MapState."""

    state: str
    detail: str = ""
    coverage: float = math.nan
    problems: Tuple[str, ...] = ()


@dataclass(frozen=True)
class MapPicture:
    """``kind`` "reference": RGB, 8 bits, three octets a pixel; "depth": metres, float32, NaN where
    there is none."""

    kind: str
    width: int
    height: int
    data: bytes


@dataclass(frozen=True)
class SeenFrom:
    """What a camera on the ground sees: a pyramid from its eye to four corners, each (x, y, z) in
    home (m).

    ``gimbal_of``: the vehicle that it follows, "" of a mocap; ``age_s``: of where it looked, when
    told.
    """

    gimbal_of: str
    eye_m: Tuple[float, float, float]
    corners_m: Tuple[Tuple[float, float, float], ...]
    age_s: float = 0.0


@dataclass(frozen=True)
class RobotGround:
    """Cells that a guided robot drives on: outer corner ``x0_m``, ``y0_m`` in home, ``percents``
    int8 of nav_msgs/OccupancyGrid, row 0 at the smallest y: -1 unknown, 0 free, 100 an obstacle."""

    x0_m: float
    y0_m: float
    cell_m: float
    rows: int
    columns: int
    percents: bytes


@dataclass(frozen=True)
class RobotRoute:
    """Its route, (x, y) in home; empty where there is none."""

    points_m: Tuple[Tuple[float, float], ...]


@dataclass(frozen=True)
class RobotSeen:
    """Where it is in home, and its yaw."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True)
class RobotStatus:
    """What a node of guidance says: ``source`` is "ground" or "follower"."""

    source: str
    text: str
