# SPDX-License-Identifier: Apache-2.0
"""What the Tello link hears and what it wants done, without ROS and without the library."""

import math
from dataclasses import dataclass
from typing import Optional, Union

import numpy as np

from fcsv_control.tello.pid import Sticks
from fcsv_geometry.vehicles.modes import Mode

#: MAV_SEVERITY, as MAVROS's StatusText has it.
ALERT, CRITICAL, ERROR, WARNING, NOTICE, INFO = 1, 2, 3, 4, 5, 6


@dataclass(frozen=True)
class FlightReport:
    """Flight data, ten times a second: height above take-off (m), the battery's share (NaN: not
    known)."""

    in_the_air: bool
    height_m: float
    battery_share: float = math.nan


@dataclass(frozen=True)
class LogReport:
    """A log packet: T_own_body in the vehicle's own odometry frame and its velocity in the body's
    axes (m/s)."""

    T_own_body: np.ndarray
    v_body_mps: np.ndarray


@dataclass(frozen=True)
class GiveSticks:
    """Gives the sticks from now on."""

    sticks: Sticks


@dataclass(frozen=True)
class TakeOffNow:
    """The Tello's own take-off."""


@dataclass(frozen=True)
class LandNow:
    """The Tello's own landing."""


@dataclass(frozen=True)
class StayUp:
    """An end of the Tello's own landing."""


@dataclass(frozen=True)
class TelloText:
    """Is a text for people; ``severity`` as MAVLink has it."""

    severity: int
    text: str


@dataclass(frozen=True)
class FrameMoved:
    """The estimate's frame changed: from the vehicle's own odometry to the tracker's. ``step_m``
    (3,)."""

    step_m: np.ndarray


Output = Union[GiveSticks, TakeOffNow, LandNow, StayUp, TelloText, FrameMoved]


@dataclass(frozen=True)
class TelloState:
    """What a ground station shows."""

    connected: bool
    armed: bool
    mode: Mode
    in_the_air: Optional[bool]
    battery_share: float
    height_m: float
