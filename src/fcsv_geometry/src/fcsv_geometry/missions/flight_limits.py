# SPDX-License-Identifier: Apache-2.0
"""Bounds of a mission (fields of the mission file): how long it waits, how fast and how long it
flies."""

from dataclasses import dataclass
from typing import Dict, Tuple

import numpy as np

from fcsv_geometry import config


@dataclass(frozen=True)
class PauseLimits:
    """How long (s) each pause lasts at most; after it the mission goes on by itself: out of the
    place, or home."""

    pause_s: float = 60.0  # no pose, no state, vehicles too near: land
    low_battery_s: float = 20.0  # a battery low or unknown: back to the column, land
    # a recorder that is silent or full: back, land; one that refuses: next configuration
    recorder_s: float = 60.0
    # a vehicle in a pilot's hands: the others go back to the column and land
    pilot_s: float = 120.0
    handover_s: float = 60.0  # GUIDED is refused: land
    # a configuration with pauses again and again (and attempts x 4 x record_s): land
    task_s: float = 300.0
    operator_s: float = 300.0  # the operator confirms nothing, or does not end his pause: land

    def __post_init__(self):
        config.require_positive(self)


@dataclass(frozen=True)
class FlightBounds:
    """How vehicles fly in GUIDED: a plan's times, and what the autopilots' parameters must say."""

    speed_mps: float = 2.0  # horizontal; ArduCopter's WPNAV_SPEED, in cm/s there
    climb_mps: float = 1.5  # WPNAV_SPEED_UP
    sink_mps: float = 1.5  # WPNAV_SPEED_DN
    acceleration_mps2: float = 1.5  # horizontal; WPNAV_ACCEL
    climb_mps2: float = 1.0  # vertical acceleration; WPNAV_ACCEL_Z
    endurance_s: float = 900.0  # in the air with a full battery

    def __post_init__(self):
        config.require_positive(self)

    @property
    def autopilot_parameters(self) -> Dict[str, float]:
        """ArduCopter's parameters with which it flies so, in cm/s and cm/s^2.

        >>> FlightBounds().autopilot_parameters["WPNAV_SPEED"]
        200.0
        """
        return {
            "WPNAV_SPEED": 100.0 * self.speed_mps,
            "WPNAV_SPEED_UP": 100.0 * self.climb_mps,
            "WPNAV_SPEED_DN": 100.0 * self.sink_mps,
            "WPNAV_ACCEL": 100.0 * self.acceleration_mps2,
            "WPNAV_ACCEL_Z": 100.0 * self.climb_mps2,
        }

    def along(self, level_m: float, up_m: float) -> Tuple[float, float]:
        """(m/s, m/s^2) on the straight way to a place so far away horizontally and upwards."""
        away_m = max(float(np.hypot(level_m, up_m)), 1e-9)
        level, up = max(level_m / away_m, 1e-6), max(abs(up_m) / away_m, 1e-6)
        upright_mps = self.climb_mps if up_m > 0.0 else self.sink_mps
        return min(self.speed_mps / level, upright_mps / up), min(
            self.acceleration_mps2 / level, self.climb_mps2 / up
        )

    def leg_s(self, level_m: float, up_m: float = 0.0) -> float:
        """Time (s) of a leg from standing to standing.

        >>> bounds = FlightBounds(speed_mps=2.0, climb_mps=1.0, acceleration_mps2=1.0)
        >>> bounds.leg_s(8.0), bounds.leg_s(1.0), bounds.leg_s(0.0, 3.0)
        (6.0, 2.0, 4.0)
        """
        speed_mps, acceleration_mps2 = self.along(level_m, up_m)
        length_m = float(np.hypot(level_m, up_m))
        ramps_m = speed_mps**2 / acceleration_mps2
        if length_m < ramps_m:
            return float(2.0 * np.sqrt(length_m / acceleration_mps2))
        return float(length_m / speed_mps + speed_mps / acceleration_mps2)
