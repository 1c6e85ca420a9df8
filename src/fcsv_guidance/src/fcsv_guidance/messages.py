# SPDX-License-Identifier: Apache-2.0
"""What the ports of guidance tell each other: where the robot is and shall go, what is clear, and how
it drives."""

from dataclasses import dataclass

import numpy as np

from fcsv_guidance.errors import RouteError
from fcsv_guidance.grid import Grid


@dataclass(frozen=True)
class RobotPlace:
    """Where the robot is in home: x, y (m), yaw (rad), standard deviation of x and y together (m),
    when (s)."""

    stamp_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    sigma_m: float

    @property
    def is_sound(self) -> bool:
        """Whether all of it is finite; what is not counts as lost."""
        values = (self.stamp_s, self.x_m, self.y_m, self.yaw_rad, self.sigma_m)
        return bool(np.isfinite(values).all()) and self.sigma_m >= 0


@dataclass(frozen=True)
class PlaceLost:
    """Nobody knows where the robot is, for this reason, until another place comes."""

    reason: str


@dataclass(frozen=True)
class OwnVehicle:
    """Where a vehicle of ours flies, ``p_home_m`` (3,) of its camera: what a picture shows there is
    no obstacle."""

    stamp_s: float
    vehicle: str
    p_home_m: np.ndarray


@dataclass(frozen=True)
class Goal:
    """Where the robot shall go, x and y in home (m)."""

    x_m: float
    y_m: float

    def require_finite(self) -> None:
        """Raises RouteError where it is not."""
        if not np.isfinite([self.x_m, self.y_m]).all():
            raise RouteError(
                f"the goal ({self.x_m}, {self.y_m}) is not finite; give x and y in home (m)"
            )


@dataclass(frozen=True)
class ClearanceMap:
    """``clear_m`` (rows, columns) of ``grid``: how far the nearest cell is in which the robot must
    not stand with its middle; 0 there. ``stamp_s``: when its pictures were taken, -inf where that
    is not known."""

    stamp_s: float
    grid: Grid
    clear_m: np.ndarray


@dataclass(frozen=True)
class GroundDated:
    """The ground that routes cross is as its pictures at ``stamp_s`` show it, -inf where that is
    not known."""

    stamp_s: float


@dataclass(frozen=True)
class StopRobot:
    """stop_all, the operator, or a route that is no more: the robot stands until a new one
    comes."""

    reason: str = "stopped by the operator"


@dataclass(frozen=True)
class HoldRobot:
    """The robot stands for this reason and keeps its route; an empty one takes back what the same
    ``source`` said."""

    reason: str
    source: str = ""


@dataclass(frozen=True)
class DriveCommand:
    """Forward speed and turning rate; ``reason`` says why the robot stands, empty where it
    drives."""

    speed_mps: float
    turning_radps: float
    reason: str = ""
