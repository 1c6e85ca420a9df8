# SPDX-License-Identifier: Apache-2.0
"""Bounds of a mission (fields of the mission file): how long it waits, how fast and how long it flies."""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry import config


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
