# SPDX-License-Identifier: Apache-2.0
"""What is told of one vehicle: state, places, pictures, what it says. Units are in the names."""

import math
from dataclasses import dataclass
from typing import Tuple

from fcsv_geometry.vehicles.modes import Mode

Vector3 = Tuple[float, float, float]


@dataclass(frozen=True)
class AutopilotReport:
    """``system_status`` is MAVLink's: 5 and 6 are the autopilot's own failsafe."""

    vehicle: str
    connected: bool
    armed: bool
    mode: Mode
    system_status: int = 4


@dataclass(frozen=True)
class BatteryReport:
    """``share`` of the charge, 0..1; NaN: not known."""

    vehicle: str
    share: float
    voltage_v: float = math.nan


@dataclass(frozen=True)
class OdometryReport:
    """A pose of the vehicle's own odometry: its body in ``vehicle/odom``; yaw to the left."""

    vehicle: str
    p_odom_m: Vector3
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class CameraPoseReport:
    """Where a camera is and looks, in home; ``roll_rad``: about its view, right side down."""

    vehicle: str
    p_home_m: Vector3
    heading_rad: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


@dataclass(frozen=True)
class PreviewReport:
    """``stamp_s``: when it was taken; ``data``: JPEG or PNG."""

    vehicle: str
    stamp_s: float
    data: bytes = b""


@dataclass(frozen=True)
class CameraKnown:
    """Holds the camera as sensor_msgs/CameraInfo: size of the pictures, focal length (px) along the
    rows and across them."""

    vehicle: str
    width: int
    height: int
    focal_px: float
    focal_v_px: float


@dataclass(frozen=True)
class GuardianReport:
    """Holds the state as fcsv_msgs/GuardianState."""

    vehicle: str
    action: str = ""
    holds: bool = False
    uncontrolled: bool = False
    lost: bool = False
    taken: bool = False
    reasons: Tuple[str, ...] = ()
    forbids: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Agent:
    """Whom a vehicle's agent obeys, and why it does nothing."""

    vehicle: str
    sender: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Recorder:
    """``vehicle`` is "control" for the control PC's own; ``minutes_left`` infinite: no rate is
    known yet."""

    vehicle: str
    pictures_on: bool
    pictures: int
    dropped: int
    minutes_left: float
    problem: str = ""


@dataclass(frozen=True)
class ClockReport:
    """Vehicle minus control PC."""

    vehicle: str
    offset_s: float
    uncertainty_s: float


@dataclass(frozen=True)
class EpochReport:
    """Another number means that the odometry began anew."""

    vehicle: str
    epoch: int


@dataclass(frozen=True)
class RadioReport:
    """The link to a vehicle as the relay measures it; ``loss`` 0..1 of what comes in, NaN: not
    measured yet."""

    vehicle: str
    round_trip_s: float
    loss: float
    problem: str = ""


@dataclass(frozen=True)
class VehicleText:
    """A text for people; ``severity`` is MAVLink's (0 emergency .. 7 debug), ``who`` "autopilot" or
    "guardian"."""

    vehicle: str
    who: str
    text: str
    severity: int = 6


@dataclass(frozen=True)
class Answered:
    """What became of a numbered command."""

    vehicle: str
    sender: str
    number: int
    outcome: str


@dataclass(frozen=True)
class TagReport:
    """The tags in one picture: identities, and for each four corners (u, v) in px of the picture of
    ``stamp_s``."""

    vehicle: str
    ids: Tuple[int, ...]
    corners_px: Tuple[Tuple[Tuple[float, float], ...], ...] = ()
    stamp_s: float = 0.0


@dataclass(frozen=True)
class PictureCaptured:
    """A picture taken while recording; ``stamp_s`` by the vehicle's clock."""

    vehicle: str
    stamp_s: float


@dataclass(frozen=True)
class Diagnosed:
    """What is wrong in its diagnostics, the worst first: (name, level, text), a last one without a
    name counts the others; empty: it is well. Levels are those of
    diagnostic_msgs/DiagnosticStatus."""

    vehicle: str
    wrong: Tuple[Tuple[str, int, str], ...] = ()


@dataclass(frozen=True)
class NotInBags:
    """Topics of a vehicle that nobody plays while others of it are played: they were not
    recorded."""

    vehicle: str
    topics: Tuple[str, ...]
