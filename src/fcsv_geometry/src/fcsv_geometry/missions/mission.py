# SPDX-License-Identifier: Apache-2.0
"""The mission file, config/missions/NAME.yaml: what the planner writes and the mission flies, with
all its rules."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError, MissionError
from fcsv_geometry.missions.configuration import StereoConfiguration, moment_of
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.flight_limits import FlightBounds, PauseLimits
from fcsv_geometry.missions.look_round import LookRound
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.missions.stations import (
    HOME_VIEW,
    HomeFix,
    MissionStation,
    Viewpoint,
    viewpoints_of,
)
from fcsv_geometry.missions.terrain import Terrain, read_terrain
from fcsv_geometry.vehicles.thresholds import BATTERY

# horizontally, of a vehicle of 0.6 m; guardians keep what is theirs of it (SeparationRules)
AIR_M = 0.95
ON_BOARD, GROUND = "on_board", "ground"
TRACKERS = (ON_BOARD, GROUND)
_COLUMN_SPACING_M = (1.0, 8.0)  # further away the tag is not seen
_LEAST_HOME_M = 1.0  # above the minimum separation
_JUST_CALIBRATED_M = 5.0  # from home: a first station there needs no calibration of its own


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
    # places from which the list is flown, with their headings; none: from home alone
    stations: List[MissionStation] = field(default_factory=list)
    home_fix: Optional[HomeFix] = None  # where on the earth home will be
    # GeoTIFF of the ground's height, beside the mission's file: on the earth (with home_fix), or in
    # home; none: the ground under the ways is not known
    terrain: Optional[str] = None
    # the column's ways between stations are so high above that ground at least, and above the
    # fence's floor: a surface model errs by a metre or two
    terrain_clearance_m: float = 3.0

    def __post_init__(self):
        own = [s.configurations for s in self.stations]
        if not self.configurations and not (own and all(own)):
            raise ValueError(
                "configurations: the list is empty; give at least one {axis, baseline_m}"
            )
        if self.tracker not in TRACKERS:
            raise ValueError(f"tracker: '{self.tracker}' is not one of {', '.join(TRACKERS)}")
        if not self.min_separation_m > 0:
            raise ValueError(f"min_separation_m: {self.min_separation_m} must be positive")
        if not 0 <= self.terrain_clearance_m < math.inf:
            raise ValueError(
                f"terrain_clearance_m: {self.terrain_clearance_m} must not be negative"
            )
        self._check_list("configurations", self.configurations)
        for i, listed in enumerate(own):
            self._check_list(f"stations[{i}].configurations", listed)
            if self.stations[i].calibrate and self.tracker == GROUND:
                raise ValueError(
                    f"stations[{i}].calibrate: a tracker on the ground has all in one frame; leave it out"
                )
        self._fly_from_stations()
        following = [i for i, c in enumerate(self.configurations) if c.follow_s is not None]
        if following and following[0] < len(self.configurations) - 1:
            raise ValueError(
                f"configurations[{following[0]}].follow_s: vehicles that follow fly nothing afterwards; "
                "only the last configuration may have it, of the last station at its only heading"
            )
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

    def _check_list(self, where: str, listed: Sequence[StereoConfiguration]) -> None:
        for i, c in enumerate(listed):
            self._check_configuration(f"{where}[{i}]", c)
        if listed and listed[0].at_once:
            raise ValueError(f"{where}[0].at_once: there is none before it")
        for first in (i for i, c in enumerate(listed) if not c.at_once):
            self._check_moment(where, listed, moment_of(listed, first))

    def _check_moment(
        self, where: str, listed: Sequence[StereoConfiguration], moment: Sequence[int]
    ) -> None:
        of = [listed[i] for i in moment]
        if len(moment) > 1 and (
            any(c.vehicle is None for c in of) or len({c.vehicle for c in of}) < len(of)
        ):
            raise ValueError(
                f"{where}[{moment[0]}..{moment[-1]}].vehicle: those at once each need a vehicle of their own"
            )
        if len({c.sweep is None for c in of}) > 1:
            raise ValueError(
                f"{where}[{moment[-1]}].at_once: at once all sweep or all stand; "
                f"{where}[{moment[0]}] does the other"
            )
        if len({c.record_s for c in of}) > 1:
            raise ValueError(
                f"{where}[{moment[-1]}].record_s: must be that of {where}[{moment[0]}]"
            )

    def _fly_from_stations(self) -> None:
        """Makes ``configurations`` what is flown: the list of each station at each of its headings.
        A list that says its viewpoints was made so before."""
        names = self._station_names
        for i, name in enumerate(names):
            if name in (HOME_VIEW.station, *names[:i]):
                raise ValueError(f"stations[{i}].name: '{name}' is another's; names are unique")
        most, made = len(self.viewpoints) - 1, any(c.view for c in self.configurations)
        for i, c in enumerate(self.configurations):
            if not (1 if made else 0) <= c.view <= most:
                raise ValueError(
                    f"configurations[{i}].view: is {c.view}; leave it out, stations say it"
                )
        if not self.stations or made:
            return
        flown, view = [], 0
        for station in self.stations:
            for _ in station.headings_deg:
                view += 1
                listed = station.configurations or self.configurations
                flown += [replace(c, view=view) for c in listed]
        object.__setattr__(self, "configurations", flown)

    @cached_property
    def viewpoints(self) -> Tuple[Viewpoint, ...]:
        """Home, then each heading of each station, in the order of flight; ``view`` of a
        configuration counts them."""
        found = [HOME_VIEW]
        for i, (station, name) in enumerate(zip(self.stations, self._station_names)):
            try:
                found += viewpoints_of(station, name, self.home_height_m, self.home_fix)
            except ValueError as error:
                raise ValueError(f"stations[{i}].{error}") from error
        return tuple(found)

    @cached_property
    def ground(self) -> Optional[Terrain]:
        """What `terrain` knows, read once; None where there is none. Raises MissionError naming the
        file and what is wrong with it."""
        return None if self.terrain is None else read_terrain(Path(self.terrain), self.home_fix)

    def viewpoint(self, index: int) -> Viewpoint:
        """Viewpoint from which configuration ``index`` is flown."""
        return self.viewpoints[self.configurations[index].view]

    def calibrates(self, view: int) -> bool:
        """Whether the column is calibrated anew where it comes to the station of a viewpoint."""
        names = [v.station for v in self.viewpoints]
        found = [s for s, name in zip(self.stations, self._station_names) if name == names[view]]
        if not found:
            return False
        if found[0].calibrate is not None:
            return found[0].calibrate
        x_m, y_m, _ = self.viewpoints[view].place_m
        at_home = found[0] is self.stations[0] and math.hypot(x_m, y_m) < _JUST_CALIBRATED_M
        return self.tracker == ON_BOARD and not at_home

    @cached_property
    def calibrates_in_flight(self) -> bool:
        """Whether it does so anywhere."""
        return any(self.calibrates(view) for view in range(len(self.viewpoints)))

    @property
    def _station_names(self) -> List[str]:
        return [s.name or f"station {i + 1}" for i, s in enumerate(self.stations)]

    def follows(self, index: int) -> bool:
        """Whether vehicles follow at configuration ``index``, and nothing is recorded."""
        return self.configurations[index].follow_s is not None

    def lands_there(self, index: int) -> bool:
        """Whether vehicles that follow at configuration ``index`` land where they are."""
        return self.follows(index) and not self.configurations[index].returns

    @property
    def recorded(self) -> List[int]:
        """Indices of the configurations with pictures."""
        return [i for i in range(len(self.configurations)) if not self.follows(i)]

    def title(self, index: int) -> str:
        """Configuration ``index`` in words, with its station and heading where there are
        stations."""
        title = self.configurations[index].title
        return f"{title}, {self.viewpoint(index).title}" if self.stations else title

    def moment_of(self, index: int) -> List[int]:
        """Indices of the configurations that are flown at the same time as ``index``, with it."""
        return moment_of(self.configurations, index)

    def moments(self, indices: Optional[Sequence[int]] = None) -> List[List[int]]:
        """Chosen configurations (None: all) in their order, those together that are flown at the
        same time; one in which vehicles follow is the last."""
        found: List[List[int]] = []
        chosen = range(len(self.configurations)) if indices is None else indices
        for i in sorted(chosen, key=self.follows):
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
    """A mission from its file, with its terrain. Raises ConfigError naming file, field and
    remedy."""
    mission = beside(path, config.load(path, Mission))
    try:
        _ = mission.ground
    except MissionError as error:
        raise ConfigError(f"{path}: {error}", "terrain", str(error)) from error
    return mission


def beside(path, mission: Mission) -> Mission:
    """The mission of a file; a terrain that it names is looked for in the file's folder."""
    if mission.terrain is None:
        return mission
    return replace(mission, terrain=str(Path(path).resolve().parent / mission.terrain))
