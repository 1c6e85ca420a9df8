# SPDX-License-Identifier: Apache-2.0
"""The mission file, config/missions/NAME.yaml: what the planner writes and the mission flies, with
all its rules."""

import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence

import numpy as np

from fcsv_geometry import config
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.flight_limits import FlightBounds, PauseLimits
from fcsv_geometry.missions.look_round import LookRound
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.missions.sweep import AXES, MOST_BASELINE_M, Sweep
from fcsv_geometry.vehicles.thresholds import BATTERY

# horizontally, of a vehicle of 0.6 m; guardians keep what is theirs of it (SeparationRules)
AIR_M = 0.95
ON_BOARD, GROUND = "on_board", "ground"
TRACKERS = (ON_BOARD, GROUND)
_RECORD_S = (0.5, 600.0)
_MOST_PICTURES = 1000
_MOST_TILT_DEG = 30.0
_COLUMN_SPACING_M = (1.0, 8.0)  # further away the tag is not seen
_LEAST_HOME_M = 1.0  # above the minimum separation


@dataclass(frozen=True)
class StereoConfiguration:
    """One place of the moving camera: right of the reference (horizontal) or above it (vertical).

    ``tilt_deg`` turns it inward: for a horizontal baseline by yaw to the left. A vertical baseline
    would need pitch down, which a fixed camera on a hovering multirotor cannot have; so there it
    must be 0.

    With ``sweep`` it is no place but a way, along which pictures are taken without a stop; ``axis``
    and ``baseline_m`` (the longest) are then the sweep's.
    """

    # must be given but for a sweep; horizontal: to the right of the reference, vertical: above it
    axis: str = ""
    baseline_m: float = math.nan  # must be given but for a sweep; between both cameras
    tilt_deg: float = 0.0  # inwards, of horizontal baselines
    record_s: float = 5.0  # so long pictures are taken
    # of each vehicle; a slow camera is waited for, up to four times ``record_s``
    least_pictures: int = 6
    name: Optional[str] = None  # in reports and messages; default: axis and baseline
    vehicle: Optional[str] = None  # who moves; default: the first that is not the reference
    # flown and recorded at the same time as the one before, by another vehicle
    at_once: bool = False
    sweep: Optional[Sweep] = None  # a way in place of a place

    def __post_init__(self):
        if self.sweep is not None:
            self._apply_sweep(self.sweep)
        for name, missing in (
            ("axis", self.axis == ""),
            ("baseline_m", math.isnan(self.baseline_m)),
        ):
            if missing:
                raise ValueError(f"{name}: is missing")
        if self.axis not in AXES:
            raise ValueError(f"axis: '{self.axis}' is not one of {', '.join(AXES)}")
        if not self.baseline_m > 0:
            raise ValueError(
                f"baseline_m: {self.baseline_m} must be positive; the axis says the direction"
            )
        if self.baseline_m > MOST_BASELINE_M:
            raise ValueError(
                f"baseline_m: {self.baseline_m} is over {MOST_BASELINE_M:g} m; give metres"
            )
        if not _RECORD_S[0] <= self.record_s <= _RECORD_S[1]:
            raise ValueError(
                f"record_s: {self.record_s} is not in {_RECORD_S[0]:g}..{_RECORD_S[1]:g} s"
            )
        if not 1 <= self.least_pictures <= _MOST_PICTURES:
            raise ValueError(f"least_pictures: {self.least_pictures} is not in 1..{_MOST_PICTURES}")
        if abs(self.tilt_deg) > _MOST_TILT_DEG:
            raise ValueError(
                f"tilt_deg: {self.tilt_deg} is beyond {_MOST_TILT_DEG:g} degrees; the pictures would hardly overlap"
            )
        if self.axis == "vertical" and self.tilt_deg:
            raise ValueError(
                "tilt_deg: a hovering multirotor cannot pitch a fixed camera; set it to 0 for vertical"
            )

    def _apply_sweep(self, sweep: Sweep) -> None:
        if self.axis not in ("", sweep.axis):
            raise ValueError(f"axis: '{self.axis}' is not that of the sweep; leave it out")
        if not (
            math.isnan(self.baseline_m)
            or math.isclose(self.baseline_m, sweep.longest_m, abs_tol=1e-6)
        ):
            raise ValueError(
                f"baseline_m: {self.baseline_m} is beside a sweep, which has no single one; leave it out"
            )
        if self.record_s != StereoConfiguration.record_s:
            raise ValueError("record_s: a sweep is recorded for as long as it flies; leave it out")
        object.__setattr__(self, "axis", sweep.axis)
        object.__setattr__(self, "baseline_m", sweep.longest_m)

    @property
    def title(self) -> str:
        """Its name, or what it is in words."""
        if self.sweep is not None:
            return self.name or self.sweep.title
        tilt = f" tilt {self.tilt_deg:g} deg" if self.tilt_deg else ""
        return self.name or f"{self.axis} {self.baseline_m:g} m{tilt}"

    @property
    def tilt_rad(self) -> float:
        """Inward tilt (rad)."""
        return float(np.radians(self.tilt_deg))


@dataclass(frozen=True)
class SettleBounds:
    """When a vehicle counts as standing at its place, and how well it must hold while recording."""

    position_m: float = 0.12  # from its place, at most
    heading_deg: float = 3.0  # off the planned heading, at most
    speed_mps: float = 0.15  # at most
    pose_age_s: float = 0.3  # of the newest pose, at most
    time_s: float = 1.5  # for so long all of these must hold before it is recorded
    timeout_s: float = 30.0  # for each way-point, and to become calm at the place
    hold_m: float = 0.15  # a recording that leaves this is taken again
    attempts: int = 3  # at one configuration; after the last the next one follows

    def __post_init__(self):
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"{name}: {value} must be positive")


@dataclass(frozen=True)
class Mission:
    """What is flown. Raises ValueError ("field: what is wrong") on a list that cannot be flown
    safely."""

    name: str  # in reports and messages
    configurations: List[StereoConfiguration]  # flown in this order
    reference: str = "uav1"  # the vehicle that holds at home, whose picture gets depth
    min_separation_m: float = 1.5  # between cameras; what no way and no configuration may undercut
    # of a vehicle, with its downwash
    air: SeparationRules = field(default_factory=lambda: SeparationRules(AIR_M))
    # "ground": one on the ground gives all in one frame, and no tag is needed to calibrate
    tracker: str = ON_BOARD
    low_battery_share: float = BATTERY.mission.amber  # below: all hold until the operator decides
    empty_battery_share: float = BATTERY.mission.red  # below: everybody lands
    home_height_m: float = 8.0  # a hint for the operators: above the take-off place
    column_spacing_m: float = 3.5  # a hint for the operators: between vehicles in the column
    settle: SettleBounds = field(default_factory=SettleBounds)  # when a vehicle counts as standing
    limits: PauseLimits = field(default_factory=PauseLimits)  # how long each kind of pause may last
    fence: Fence = field(default_factory=Fence)  # where vehicles may be
    flight: FlightBounds = field(default_factory=FlightBounds)  # by which ways are planned
    # vehicles that stand turn about themselves; none: nobody turns
    look_round: Optional[LookRound] = None

    def __post_init__(self):
        if not self.configurations:
            raise ValueError(
                "configurations: the list is empty; give at least one {axis, baseline_m}"
            )
        if self.tracker not in TRACKERS:
            raise ValueError(f"tracker: '{self.tracker}' is not one of {', '.join(TRACKERS)}")
        if not self.min_separation_m > 0:
            raise ValueError(f"min_separation_m: {self.min_separation_m} must be positive")
        for i, c in enumerate(self.configurations):
            self._check_configuration(f"configurations[{i}]", c)
        self._check_moments()
        low, high = _COLUMN_SPACING_M
        if not low <= self.column_spacing_m <= high:
            raise ValueError(
                f"column_spacing_m: {self.column_spacing_m} is not in {low:g}..{high:g} m (the tag must be seen)"
            )
        if self.column_spacing_m < self.min_separation_m:
            raise ValueError(
                f"column_spacing_m: {self.column_spacing_m} is under min_separation_m {self.min_separation_m}; "
                f"line up further apart"
            )
        least_m = _LEAST_HOME_M + self.min_separation_m
        if self.home_height_m < least_m:
            raise ValueError(
                f"home_height_m: {self.home_height_m} is too near the ground; give at least {least_m:g}"
            )
        if not 0.0 <= self.empty_battery_share <= self.low_battery_share < 1.0:
            raise ValueError(
                f"low_battery_share: {self.low_battery_share} must be in 0..1 and not under "
                f"empty_battery_share {self.empty_battery_share}"
            )

    def _check_configuration(self, where: str, c: StereoConfiguration) -> None:
        shortest_m = c.baseline_m if c.sweep is None else c.sweep.shortest_m
        if shortest_m < self.min_separation_m:
            field_ = "baseline_m" if c.sweep is None else "sweep.from_m"
            raise ValueError(
                f"{where}.{field_}: {shortest_m} is under the vehicles' minimum separation of "
                f"{self.min_separation_m} m (min_separation_m); use a longer baseline"
            )
        if c.sweep is not None and c.sweep.speed_mps > c.sweep.most_mps(self.flight):
            raise ValueError(
                f"{where}.sweep.speed_mps: {c.sweep.speed_mps} is over the {c.sweep.most_mps(self.flight):g} m/s that "
                "'flight' allows on this way"
            )
        if c.vehicle == self.reference:
            raise ValueError(
                f"{where}.vehicle: {c.vehicle} is the reference and holds at home; name another"
            )

    def _check_moments(self) -> None:
        if self.configurations[0].at_once:
            raise ValueError("configurations[0].at_once: there is none before it")
        for moment in self.moments():
            of = [self.configurations[i] for i in moment]
            if len(moment) > 1 and (
                any(c.vehicle is None for c in of) or len({c.vehicle for c in of}) < len(of)
            ):
                raise ValueError(
                    f"configurations[{moment[0]}..{moment[-1]}].vehicle: those at once each need a vehicle of their own"
                )
            if len({c.sweep is None for c in of}) > 1:
                raise ValueError(
                    f"configurations[{moment[-1]}].at_once: at once all sweep or all stand; "
                    f"configurations[{moment[0]}] does the other"
                )
            if len({c.record_s for c in of}) > 1:
                raise ValueError(
                    f"configurations[{moment[-1]}].record_s: must be that of configurations[{moment[0]}]"
                )

    def moment_of(self, index: int) -> List[int]:
        """Indices of the configurations that are flown at the same time as ``index``, with it."""
        first, last = index, index + 1
        while self.configurations[first].at_once:
            first -= 1
        while last < len(self.configurations) and self.configurations[last].at_once:
            last += 1
        return list(range(first, last))

    def moments(self, indices: Optional[Sequence[int]] = None) -> List[List[int]]:
        """Chosen configurations (None: all) in their order, those together that are flown at the
        same time."""
        found: List[List[int]] = []
        for i in range(len(self.configurations)) if indices is None else indices:
            if found and i in self.moment_of(found[-1][0]):
                found[-1].append(i)
            else:
                found.append([i])
        return found

    def mover(self, index: int, vehicles: Sequence[str]) -> str:
        """Who takes configuration ``index``'s place."""
        return self.configurations[index].vehicle or next(
            v for v in vehicles if v != self.reference
        )

    def lasts_s(self, battery_share: float) -> float:
        """How long (s) a vehicle flies until its battery is low; NaN where that is not known."""
        return max(self.flight.endurance_s * (battery_share - self.low_battery_share), 0.0)

    def check_vehicles(self, vehicles: Sequence[str]) -> None:
        """Raises MissionError where the list names a vehicle that does not fly."""
        if self.reference not in vehicles or len(vehicles) < 2:
            raise MissionError(
                f"mission '{self.name}': reference '{self.reference}' needs to be one of two or more vehicles, "
                f"this fleet is {', '.join(vehicles)}"
            )
        for i, c in enumerate(self.configurations):
            if c.vehicle is not None and c.vehicle not in vehicles:
                raise MissionError(
                    f"mission '{self.name}': configurations[{i}].vehicle is '{c.vehicle}', this fleet is "
                    f"{', '.join(vehicles)}"
                )


def spaced(min_separation_m: float) -> Dict[str, float]:
    """The fields of a Mission that keep ``min_separation_m`` (m), the hints raised where it needs
    more room.

    >>> spaced(5.0)
    {'min_separation_m': 5.0, 'column_spacing_m': 5.0, 'home_height_m': 8.0}
    """
    return {
        "min_separation_m": float(min_separation_m),
        "column_spacing_m": float(max(Mission.column_spacing_m, min_separation_m)),
        "home_height_m": float(max(Mission.home_height_m, _LEAST_HOME_M + min_separation_m)),
    }


def load_mission(path) -> Mission:
    """A mission from its file. Raises ConfigError naming file, field and remedy."""
    return config.load(path, Mission)
