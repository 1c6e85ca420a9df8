# SPDX-License-Identifier: Apache-2.0
"""A robot on the ground as the planner sees it: size, what it can climb, how it drives."""

from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry.config import load, require_positive
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.robot_tags import require_ids_once

_STEEPEST_DEG = 60.0  # no wheeled robot holds a steeper slope
_FLATTEST_DEG = 1.05  # 60 degrees in radians
#: What a robot on wheels or tracks may have, by field: least, most, unit, and what else was meant.
_BOUNDS = (
    ("radius_m", 0.01, 10.0, "m", "is it in cm or mm?"),
    ("height_m", 0.01, 10.0, "m", "is it in cm or mm?"),
    ("speed_mps", 0.001, 20.0, "m/s", "is it in cm/s or mm/s?"),
    ("acceleration_mps2", 0.001, 20.0, "m/s^2", "is it in cm/s^2?"),
    ("braking_mps2", 0.001, 20.0, "m/s^2", "is it in cm/s^2?"),
    ("turning_rate_radps", 0.001, 10.0, "rad/s", "is it in degrees a second?"),
    ("turning_radius_m", 0.0, 100.0, "m", "is it in cm or mm?"),
)


@dataclass(frozen=True)
class Robot:
    """A robot with a round footprint; a file ``config/robots/NAME.yaml`` names these fields.

    ``height_m`` is what has to pass under a beam, ``clearance_m`` what its belly passes over. A
    step above ``largest_step_m`` and a slope above ``largest_slope_deg`` stop it.
    ``turning_radius_m`` is 0 where it turns on the spot.
    """

    name: str  # in messages
    radius_m: float  # of its round footprint
    height_m: float  # what has to pass under a beam
    clearance_m: float  # what its belly passes over; below height_m
    largest_step_m: float  # it climbs; at most its width
    largest_slope_deg: float  # it climbs
    speed_mps: float  # at most
    acceleration_mps2: float  # at most
    turning_rate_radps: float  # at most
    turning_radius_m: float = 0.0  # 0: it turns on the spot
    braking_mps2: Optional[float] = None  # at most; as acceleration_mps2 where it is not given
    tags: Tuple[BodyTag, ...] = ()  # on its sides; z from the ground it stands on

    def __post_init__(self):
        if not self.name.strip() or not self.name.isprintable():
            raise ValueError("name: must be a word or more, on one line")
        if not 0 <= self.turning_radius_m < np.inf:
            raise ValueError(f"turning_radius_m: must not be negative, got {self.turning_radius_m}")
        require_positive(self, but=("turning_radius_m",))
        require_ids_once(self.tags)
        if self.largest_slope_deg > _STEEPEST_DEG:
            raise ValueError(
                f"largest_slope_deg: at most {_STEEPEST_DEG:.0f}, got {self.largest_slope_deg}"
            )
        if self.largest_slope_deg < _FLATTEST_DEG:
            raise ValueError(
                f"largest_slope_deg: at least {_FLATTEST_DEG}, got {self.largest_slope_deg}; is it in radians?"
            )
        for name, least, most, unit, hint in _BOUNDS:
            value = getattr(self, name)
            if value is not None and value > most:
                raise ValueError(f"{name}: at most {most:g} {unit}, got {value}; {hint}")
            if value is not None and value < least:
                raise ValueError(f"{name}: at least {least:g} {unit}, got {value}")
        if self.clearance_m >= self.height_m:
            raise ValueError(
                f"clearance_m: must be below height_m ({self.height_m}), got {self.clearance_m}"
            )
        if self.largest_step_m > 2 * self.radius_m:
            raise ValueError(
                f"largest_step_m: must be below the robot's width, got {self.largest_step_m}"
            )

    @property
    def slows_mps2(self) -> float:
        """How fast it brakes (m/s^2)."""
        return self.acceleration_mps2 if self.braking_mps2 is None else self.braking_mps2

    @property
    def largest_slope(self) -> float:
        """Rise over run."""
        return float(np.tan(np.radians(self.largest_slope_deg)))

    def climbing(self, share: float) -> "Robot":
        """The same robot with a largest step of so much less."""
        return replace(self, largest_step_m=share * self.largest_step_m)


def load_robot(path) -> Robot:
    """The robot in a YAML file. Raises ConfigError naming file and field."""
    return load(path, Robot)
