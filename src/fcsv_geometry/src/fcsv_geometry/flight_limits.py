# SPDX-License-Identifier: Apache-2.0
"""Bounds of a mission (fields of the mission file): how long it waits, where it may fly, how fast and how long."""

from dataclasses import dataclass, field
from typing import List, Tuple

import numpy as np

from fcsv_geometry import config

_CORNERS = 3


@dataclass(frozen=True)
class PauseLimits:
    """How long (s) each pause lasts at most; after it the mission goes on by itself: out of the place, or home."""

    pause_s: float = 60.0  # no pose, no state, vehicles too near: land
    low_battery_s: float = 20.0  # a battery low or unknown: back to the column, land
    recorder_s: float = 60.0  # a recorder that is silent or full: back, land; one that refuses: next configuration
    pilot_s: float = 120.0  # a vehicle in a pilot's hands: the others go back to the column and land
    handover_s: float = 60.0  # GUIDED is refused: land
    task_s: float = 300.0  # a configuration with pauses again and again (and attempts x 4 x record_s): land
    operator_s: float = 300.0  # the operator confirms nothing, or does not end his pause: land

    def __post_init__(self):
        config.require_positive(self)


@dataclass(frozen=True)
class Fence:
    """Where cameras may be. Heights above the take-off place; x, y along home's axes, from home."""

    floor_m: float = 0.5
    ceiling_m: float = 40.0
    radius_m: float = 60.0
    polygon: List[Tuple[float, float]] = field(default_factory=list)  # corners x, y (m); none: the circle alone

    def __post_init__(self):
        if not 0.0 < self.floor_m < self.ceiling_m:
            raise ValueError(f"ceiling_m: {self.ceiling_m} must be above floor_m {self.floor_m}, and that above 0")
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: {self.radius_m} must be positive")
        if self.polygon and len(self.polygon) < _CORNERS:
            raise ValueError(f"polygon: {len(self.polygon)} corners are no area; give three or more, or none")

    def outside(self, p_home_m: np.ndarray, home_height_m: float) -> str:
        """Why a place (3,) in home is out of bounds, "" where it is within; home is so high (m) above the take-off.

        >>> Fence().outside(np.array([0.0, 0.0, 60.0]), 8.0)
        '68 m above take-off, the fence ends at 40 m'
        >>> Fence().outside(np.array([1.0, -4.0, 0.0]), 8.0)
        ''
        """
        height_m, away_m = float(p_home_m[2]) + home_height_m, float(np.hypot(p_home_m[0], p_home_m[1]))
        if height_m > self.ceiling_m:
            return f"{height_m:g} m above take-off, the fence ends at {self.ceiling_m:g} m"
        if height_m < self.floor_m:
            return f"{height_m:.1f} m above take-off, the fence begins at {self.floor_m:g} m"
        if away_m > self.radius_m:
            return f"{away_m:.0f} m from home, the fence ends at {self.radius_m:g} m"
        if self.polygon and not _inside(self.polygon, float(p_home_m[0]), float(p_home_m[1])):
            return f"({p_home_m[0]:.1f}, {p_home_m[1]:.1f}) m in home is outside of the fence's polygon"
        return ""


@dataclass(frozen=True)
class FlightBounds:
    """How vehicles fly in GUIDED, as far as a plan's time depends on it."""

    speed_mps: float = 2.0
    acceleration_mps2: float = 1.0
    endurance_s: float = 900.0  # in the air with a full battery

    def __post_init__(self):
        config.require_positive(self)

    def leg_s(self, length_m: float) -> float:
        """Time (s) of a leg from standing to standing.

        >>> FlightBounds(2.0, 1.0).leg_s(8.0), FlightBounds(2.0, 1.0).leg_s(1.0)
        (6.0, 2.0)
        """
        ramps_m = self.speed_mps**2 / self.acceleration_mps2
        if length_m < ramps_m:
            return float(2.0 * np.sqrt(length_m / self.acceleration_mps2))
        return float(length_m / self.speed_mps + self.speed_mps / self.acceleration_mps2)


def _inside(polygon: List[Tuple[float, float]], x_m: float, y_m: float) -> bool:
    """Whether an odd number of edges lies to the right of the point."""
    crossed = False
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]]):
        if (ay > y_m) != (by > y_m) and x_m < ax + (y_m - ay) * (bx - ax) / (by - ay):
            crossed = not crossed
    return crossed
