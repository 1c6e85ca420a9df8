# SPDX-License-Identifier: Apache-2.0
"""The mission file: config/missions/NAME.yaml."""

from dataclasses import dataclass, field
from typing import List, Optional

import numpy as np

from fcsv_geometry import config

AXES = ("horizontal", "vertical")


@dataclass(frozen=True)
class StereoConfiguration:
    """One place of the moving camera. ``tilt_deg`` turns it inward (horizontal only: the cameras are fixed)."""

    axis: str
    baseline_m: float
    tilt_deg: float = 0.0
    record_s: float = 5.0
    name: Optional[str] = None
    vehicle: Optional[str] = None  # who moves; default: the second of the column

    def __post_init__(self):
        if self.axis not in AXES:
            raise ValueError(f"axis: '{self.axis}' is not one of {', '.join(AXES)}")
        if not self.baseline_m > 0:
            raise ValueError(f"baseline_m: {self.baseline_m} must be positive; the axis says the direction")
        if not 0.5 <= self.record_s <= 600:
            raise ValueError(f"record_s: {self.record_s} is not in 0.5..600 s")
        if abs(self.tilt_deg) > 30:
            raise ValueError(f"tilt_deg: {self.tilt_deg} is beyond 30 degrees; the pictures would hardly overlap")
        if self.axis == "vertical" and self.tilt_deg:
            raise ValueError("tilt_deg: a hovering multirotor cannot pitch a fixed camera; set it to 0 for vertical")

    @property
    def title(self) -> str:
        tilt = f" tilt {self.tilt_deg:g} deg" if self.tilt_deg else ""
        return self.name or f"{self.axis} {self.baseline_m:g} m{tilt}"


@dataclass(frozen=True)
class SettleBounds:
    """When a vehicle counts as standing at its place, and how well it must hold while recording."""

    position_m: float = 0.12
    speed_mps: float = 0.15
    pose_age_s: float = 0.5
    time_s: float = 1.5
    timeout_s: float = 40.0
    hold_m: float = 0.15
    attempts: int = 3

    def __post_init__(self):
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"{name}: {value} must be positive")


@dataclass(frozen=True)
class Mission:
    """What is flown. Raises ValueError ("field: what is wrong") on a list that cannot be flown safely."""

    name: str
    configurations: List[StereoConfiguration]
    reference: str = "uav1"
    min_separation_m: float = 1.5
    home_height_m: float = 8.0  # a hint for the operators: above the take-off place
    column_spacing_m: float = 3.5  # likewise
    settle: SettleBounds = field(default_factory=SettleBounds)

    def __post_init__(self):
        if not self.configurations:
            raise ValueError("configurations: the list is empty; give at least one {axis, baseline_m}")
        if not self.min_separation_m > 0:
            raise ValueError(f"min_separation_m: {self.min_separation_m} must be positive")
        for i, c in enumerate(self.configurations):
            if c.baseline_m < self.min_separation_m:
                raise ValueError(
                    f"configurations[{i}].baseline_m: {c.baseline_m} is under the vehicles' minimum separation of "
                    f"{self.min_separation_m} m (min_separation_m)"
                )
        if not 1.0 <= self.column_spacing_m <= 8.0:
            raise ValueError(f"column_spacing_m: {self.column_spacing_m} is not in 1..8 m (the tag must be seen)")
        if self.home_height_m < 1.0 + max(0.0, self.min_separation_m):
            raise ValueError(f"home_height_m: {self.home_height_m} is too near the ground")


def load_mission(path) -> Mission:
    """A mission from its file. Raises ConfigError naming file, field and remedy."""
    return config.load(path, Mission)


def tilt_rad(configuration: StereoConfiguration) -> float:
    return float(np.radians(configuration.tilt_deg))
