# SPDX-License-Identifier: Apache-2.0
"""A mission's list flown on paper before anybody takes off: separation, fence, battery."""

from dataclasses import dataclass, field
from itertools import combinations
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission.activities.calibrating import USUAL_S, sway_places
from fcsv_control.mission.activities.looking_round import turns_s
from fcsv_control.mission.plans.task_list import Task, TaskList, tasks
from fcsv_control.mission.ways import traffic
from fcsv_control.mission.ways.formation import Figure, FormationLeg, legs_to
from fcsv_control.mission.ways.routes import Keep, route
from fcsv_control.mission.ways.timed_way import TimedWay, timed_way
from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError, PlanRefused
from fcsv_geometry.missions.camera_places import (
    T_HOME_CAM_AT_HOME,
    in_home,
    mover_end,
    mover_place,
    sweep_place,
)
from fcsv_geometry.missions.mission import Mission

RADIUS_M = 0.25  # of a vehicle whose file says nothing else
_APART_M = 0.5  # between the outlines of two vehicles, at least
_RESERVE = 1.3  # times the planned time must be in the battery
_BEFORE_S = 150.0  # take-off, column, calibration, home
_AFTER_S = 30.0  # landing
_RECORDERS_S = 1.0  # on and off
_NEAREST = 1.0 - 1e-6  # share of what is to be kept, of vehicles that stand while others sweep
_EVERY_STEPS = 2  # of a way, each 0.1 s, is compared with the fence
_EVERY_S = 0.25  # of a way of the column is compared with the fence
_GATHER_S = 4.0  # the column takes its figure, and stands at the end of its way
_SHAPE_M = 0.5  # vehicles of a column that flies may be nearer to each other by so much


@dataclass(frozen=True)
class Situation:
    """Describes from where the list is flown: by the mission's hints before take-off, as it is once
    home is set.

    ``places`` are the cameras' positions (3,) in home.
    """

    home_height_m: float
    places: Mapping[str, np.ndarray]
    battery_share: Mapping[str, float]  # those that are known
    before_s: float = _BEFORE_S


def on_the_ground(
    mission: Mission, vehicles: Sequence[str], battery_share: Mapping[str, float]
) -> Situation:
    """Makes the situation before take-off: the reference will be at home, the others before and
    behind it in the column."""
    at = list(vehicles).index(mission.reference)
    places = {
        n: np.array([-(k - at) * mission.column_spacing_m, 0.0, 0.0])
        for k, n in enumerate(vehicles)
    }
    return Situation(mission.home_height_m, places, battery_share)


@dataclass
class PlannedView:
    """One viewpoint on paper, in s from the list's beginning: when its list begins and when all are
    back in the column, how long the way home takes from there, and the last configuration."""

    view: int
    begins_s: float
    ends_s: float
    home_s: float
    # least height (m) of the column above the ground on its way there, and whether all of that is
    # known; NaN where none is
    above_m: float = float("nan")
    above_all: bool = False
    configurations: List[int] = field(default_factory=list)


@dataclass
class PaperFlight:
    """A list as it was flown on paper: ``wrong``: a line for each leg that cannot be flown;
    ``views`` in their order; ``flight_s`` until all may land."""

    wrong: List[str]
    views: List[PlannedView]
    flight_s: float


def check_plan(
    mission: Mission,
    situation: Situation,
    radius_m: Optional[Mapping[str, float]] = None,
    indices: Optional[Sequence[int]] = None,
    as_many: Optional[bool] = None,
) -> List[str]:
    """Why the list cannot be flown, a line per leg with the leg's name; empty where it can.

    ``radius_m`` of each vehicle (default: 0.25 m), ``indices`` of the configurations to fly
    (default: all). ``as_many``: of stations as many as the batteries allow, at least one (default:
    where all are to be flown).
    """
    flight = fly_on_paper(mission, situation, radius_m, indices)
    return wrong_with(mission, situation, flight, indices is None if as_many is None else as_many)


def wrong_with(
    mission: Mission, situation: Situation, flight: PaperFlight, as_many: bool = True
) -> List[str]:
    """Why a list that was flown on paper cannot be flown with a situation's batteries."""
    some = as_many and mission.stations and reached(mission, situation, flight)
    batteries = [] if some else _batteries(mission, situation, flight)
    return flight.wrong + list(batteries)


def fly_on_paper(
    mission: Mission,
    situation: Situation,
    radius_m: Optional[Mapping[str, float]] = None,
    indices: Optional[Sequence[int]] = None,
) -> PaperFlight:
    """The list leg by leg, with all that is wrong with its ways, and its times."""
    vehicles = list(situation.places)
    found = list(_too_little_room(mission, dict.fromkeys(vehicles, RADIUS_M), radius_m or {}))
    chosen = range(len(mission.configurations)) if indices is None else indices
    places, flight_s = dict(situation.places), turns_s(mission, chosen, len(vehicles))
    left = TaskList(mission, vehicles, tasks(mission, vehicles, indices))
    views: List[PlannedView] = []
    column = _Column.of(mission, situation)
    ways: Dict[int, _AboveGround] = {}
    while left.left:
        moment, at = left.moment, left.at or 0
        left.done()
        if moment[0].changes:
            wrong, way_s = column.change_over(at, moment[0].view)
            ways[moment[0].view] = column.above_ground(at, moment[0].view)
            wrong = wrong or ways[moment[0].view].wrong
            if wrong:
                where = mission.viewpoints[moment[0].view].title
                found.append(f"way of the column to {where}: {wrong}")
            wrong, calibrates_s = column.calibrate(at, moment[0].view)
            if wrong:
                where = mission.viewpoints[moment[0].view].title
                found.append(f"the column that calibrates at {where}: {wrong}")
            flight_s += way_s + calibrates_s
            places = column.places(moment[0].view)
            continue
        goals = {
            t.vehicle: column.place(t.vehicle, t.view)
            if t.index is None
            else mover_place(mission, t.index)[:3, 3]
            for t in moment
        }
        wrong, legs_s = _legs(mission, goals, places, situation.home_height_m)
        if moment[0].index is not None and (not views or views[-1].view != moment[0].view):
            lands = mission.lands_there(moment[0].index)
            home_s = 0.0 if lands else column.change_over(moment[0].view, 0)[1]
            way = ways.get(moment[0].view, _AboveGround())
            view = PlannedView(moment[0].view, flight_s, flight_s, home_s, way.least_m, way.whole)
            views.append(view)
        if wrong:  # the legs after it are judged as if it were left out
            found.append(f"{_named(mission, moment)}: {wrong}")
            continue
        places.update(goals)
        wrong, sweeps_s = _sweeps(mission, moment, places, situation.home_height_m)
        if wrong:
            found.append(f"{_named(mission, moment)}: {wrong}")
        flown = {t.vehicle: t.index for t in moment if t.index is not None}
        places.update({n: mover_end(mission, i)[:3, 3] for n, i in flown.items()})
        flight_s += legs_s + sweeps_s + _standing_s(mission, moment[0])
        if views:
            views[-1].ends_s = flight_s
            views[-1].configurations += flown.values()
    return PaperFlight(found, views, flight_s)


def reached(mission: Mission, situation: Situation, flight: PaperFlight) -> List[PlannedView]:
    """The viewpoints that the batteries allow, with the way home after the last of them."""
    lasts_s = min(lasts for _, lasts in _lasting(mission, situation))
    found = []
    for view in flight.views:
        if _needed_s(situation, view.ends_s + view.home_s) > lasts_s:
            break
        found.append(view)
    return found


@dataclass(frozen=True)
class _AboveGround:
    """Least height (m) of a way above the ground, whether it is known all along, and what is wrong
    with it."""

    least_m: float = float("nan")
    whole: bool = False
    wrong: str = ""


@dataclass(frozen=True)
class _Column:
    """The column as it stands at home, to be flown as one body."""

    mission: Mission
    home_height_m: float
    figure: Figure

    @classmethod
    def of(cls, mission: Mission, situation: Situation) -> "_Column":
        figure = {
            n: T_HOME_CAM_AT_HOME
            if n == mission.reference and mission.stations
            else transforms.transform(T_HOME_CAM_AT_HOME[:3, :3], p)
            for n, p in situation.places.items()
        }
        return cls(mission, situation.home_height_m, figure)

    def place(self, name: str, view: int) -> np.ndarray:
        """(3,) of a vehicle in the column at a viewpoint."""
        return in_home(self.mission, view, self.figure[name])[:3, 3]

    def places(self, view: int) -> Dict[str, np.ndarray]:
        """All of them."""
        return {n: self.place(n, view) for n in self.figure}

    def calibrate(self, at: int, view: int) -> Tuple[str, float]:
        """(what is wrong where it sways at a viewpoint to which it came from another one, time in
        s)."""
        views = self.mission.viewpoints
        if views[at].station == views[view].station or not self.mission.calibrates(view):
            return "", 0.0
        T_home_view = in_home(self.mission, view, np.eye(4))
        ends = [sway_places(T_home_view, self.figure, at) for at in (-1.0, 1.0)]
        return self._outside(T for end in ends for T in end.values()), USUAL_S

    def change_over(self, at: int, view: int) -> Tuple[str, float]:
        """(what is wrong with the way from one viewpoint to another, time in s)."""
        legs = self._legs(at, view)
        takes_s = _GATHER_S + sum(leg.rate.takes_s for leg in legs)
        least_m = self.mission.min_separation_m + _SHAPE_M
        for a, b in combinations(self.figure, 2):
            away_m = float(np.linalg.norm(self.figure[a][:3, 3] - self.figure[b][:3, 3]))
            if away_m < least_m:
                wrong = f"{a} and {b} are {away_m:.1f} m apart in the column, it flies with {least_m:g} m"
                return wrong, takes_s
        for leg in legs:
            steps = max(int(leg.rate.takes_s / _EVERY_S), 1)
            for share in np.linspace(0.0, 1.0, steps + 1):
                wrong = self._outside(leg.places(self.figure, float(share)).values())
                if wrong:
                    return wrong, takes_s
        return "", takes_s

    def _legs(self, at: int, view: int) -> List[FormationLeg]:
        T_from = in_home(self.mission, at, np.eye(4))
        return legs_to(T_from, self.mission.viewpoints[view], self.figure, self.mission.flight)

    def above_ground(self, at: int, view: int) -> _AboveGround:
        """The way from one viewpoint to another above the mission's terrain."""
        ground = self.mission.ground
        if ground is None:
            return _AboveGround()
        places = list(self.places(view).values())
        for leg in self._legs(at, view):
            shares = np.linspace(0.0, 1.0, max(int(leg.rate.takes_s / _EVERY_S), 1) + 1)
            for share in shares.tolist():
                places += [T[:3, 3] for T in leg.places(self.figure, share).values()]
        p_home_m = np.array(places)
        above_m = p_home_m[:, 2] + self.home_height_m - ground.at(p_home_m[:, :2])
        known = np.isfinite(above_m)
        if not known.any():
            return _AboveGround()
        lowest = int(np.nanargmin(above_m))
        least_m, (x_m, y_m, _) = float(above_m[lowest]), p_home_m[lowest]
        needed_m = max(self.mission.terrain_clearance_m, self.mission.fence.floor_m)
        where = f"{least_m:.1f} m above the ground at ({x_m:.1f}, {y_m:.1f}) m in home"
        wrong = f"{where}, {needed_m:g} m at least" if least_m < needed_m else ""
        return _AboveGround(least_m, bool(known.all()), wrong)

    def _outside(self, places: Iterable[np.ndarray]) -> str:
        """Why one of these (T_home_cam) is outside of the fence."""
        found = (self.mission.fence.outside(T[:3, 3], self.home_height_m) for T in places)
        return next(filter(None, found), "")


def require_flyable(
    mission: Mission, vehicles: Sequence[str], radius_m: Optional[Mapping[str, float]] = None
) -> PaperFlight:
    """The whole list on paper. Raises PlanRefused naming every leg that cannot be flown, and why."""
    situation = on_the_ground(mission, vehicles, {})
    flight = fly_on_paper(mission, situation, radius_m)
    found = wrong_with(mission, situation, flight)
    if found:
        raise PlanRefused(f"mission '{mission.name}' cannot be flown: {'; '.join(found)}")
    return flight


def _too_little_room(
    mission: Mission, usual: Dict[str, float], radius_m: Mapping[str, float]
) -> Iterator[str]:
    largest_m = max({**usual, **radius_m}.values())
    least_m = 2.0 * largest_m + _APART_M
    if mission.min_separation_m < least_m - 1e-9:
        yield (
            f"min_separation_m: {mission.min_separation_m:g} m is under {least_m:g} m, twice the largest vehicle's "
            f"radius ({largest_m:g} m) and {_APART_M:g} m"
        )


def _legs(
    mission: Mission,
    goals: Dict[str, np.ndarray],
    places: Dict[str, np.ndarray],
    home_height_m: float,
) -> Tuple[str, float]:
    """(what is wrong with the ways of those that move at once, time in s)."""
    standing = [p for n, p in places.items() if n not in goals]
    wrong = [mission.fence.outside(goal, home_height_m) for goal in goals.values()]
    if any(wrong):
        return next(filter(None, wrong)), 0.0
    starts, keep = {n: places[n] for n in goals}, Keep.of(mission)
    try:
        if len(goals) == 1:
            ((name, goal),) = goals.items()
            ways = {
                name: timed_way(
                    starts[name], route(starts[name], goal, standing, keep), mission.flight
                )
            }
            ends_s = ways[name].ends_s
        else:
            planned = traffic.plan(starts, goals, standing, keep, mission.flight).at_once()
            ways = {n: d.timed for n, d in (planned.departures or {}).items()}
            ends_s = planned.ends_s
    except MissionError as error:
        return str(error), 0.0
    outside = _outside(mission, ways.values(), home_height_m)
    return f"on the way there {outside}" if outside else "", ends_s


def _outside(mission: Mission, ways: Iterable[TimedWay], home_height_m: float) -> str:
    """Where ways leave the fence."""
    places = (p for way in ways for p in way.places[::_EVERY_STEPS])
    return next(filter(None, (mission.fence.outside(place, home_height_m) for place in places)), "")


def _sweeps(
    mission: Mission, moment: Sequence[Task], places: Mapping[str, np.ndarray], home_height_m: float
):
    """(what is wrong with the sweeps that begin at once, time in s)."""
    swept = {
        t.vehicle: mission.configurations[t.index]
        for t in moment
        if t.index is not None and mission.configurations[t.index].sweep is not None
    }
    if not swept:
        return "", 0.0
    keep = Keep.of(mission)
    lines = {
        n: [in_home(mission, c.view, sweep_place(c, share))[:3, 3] for share in (0.0, 1.0)]
        for n, c in swept.items()
    }
    ways = {
        n: timed_way(start_m, [end_m], swept[n].sweep.bounds(mission.flight))
        for n, (start_m, end_m) in lines.items()
    }
    for name, (start_m, end_m) in lines.items():
        for other, place in places.items():
            if other not in swept and keep.shares(place, start_m, end_m[None])[0] < _NEAREST:
                return f"comes too near to {other}: {_needed(keep, ways[name], place)}", 0.0
    for a, b in combinations(ways, 2):
        ends = keep.share(lines[a][1] - lines[b][1])
        if ends < _NEAREST or not traffic.clear(ways[a], ways[b], keep):
            return f"{a} and {b} come too near to each other", 0.0
    outside = _outside(mission, ways.values(), home_height_m)
    return f"on its way {outside}" if outside else "", max(w.ends_s for w in ways.values())


def _needed(keep: Keep, way: TimedWay, other: np.ndarray) -> str:
    """Says, in words, where a way is nearest to a vehicle that stands."""
    offsets = way.places - other
    return keep.needed(offsets[int(keep.shares_of(offsets).argmin())])


def _standing_s(mission: Mission, task: Task) -> float:
    if task.index is None:
        return 0.0
    configuration = mission.configurations[task.index]
    if configuration.sweep is not None:
        return _RECORDERS_S
    if configuration.follow_s is not None:
        return configuration.follow_s
    return mission.settle.time_s + configuration.record_s + _RECORDERS_S


def _batteries(mission: Mission, situation: Situation, flight: PaperFlight) -> Iterator[str]:
    needed_s = _needed_s(situation, flight.flight_s)
    for name, lasts_s in _lasting(mission, situation):
        share = situation.battery_share.get(name)
        words = "a full" if share is None else f"{share:.0%} of its"
        if lasts_s < needed_s:
            yield (
                f"{name} with {words} battery flies {lasts_s:.0f} s until "
                f"{mission.low_battery_share:.0%} are left, the flight needs {needed_s:.0f} s "
                f"({_RESERVE:g} times its time): fewer configurations, or full batteries"
            )


def _needed_s(situation: Situation, flight_s: float) -> float:
    return _RESERVE * (situation.before_s + flight_s + _AFTER_S)


def _lasting(mission: Mission, situation: Situation) -> List[Tuple[str, float]]:
    """How long (s) each vehicle's battery lasts; those that are not known count as full."""
    full = {n: 1.0 for n in situation.places if n not in situation.battery_share}
    shares = {**full, **situation.battery_share}
    return [(name, mission.lasts_s(share)) for name, share in shares.items()]


def _named(mission: Mission, moment: Sequence[Task]) -> str:
    if moment[0].index is None:
        return f"way of {' and '.join(t.vehicle for t in moment)} back to the column"
    return " and ".join(f"configurations[{t.index}] ({mission.title(t.index)})" for t in moment)
