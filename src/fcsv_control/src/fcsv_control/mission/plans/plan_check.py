# SPDX-License-Identifier: Apache-2.0
"""A mission's list flown on paper before anybody takes off: separation, fence, battery."""

from dataclasses import dataclass
from itertools import combinations
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission.activities.looking_round import turns_s
from fcsv_control.mission.plans.task_list import Task, TaskList, tasks
from fcsv_control.mission.ways import traffic
from fcsv_control.mission.ways.routes import Keep, route
from fcsv_control.mission.ways.timed_way import TimedWay, timed_way
from fcsv_geometry.errors import MissionError, PlanRefused
from fcsv_geometry.missions.camera_places import camera_place, last_place
from fcsv_geometry.missions.mission import Mission

RADIUS_M = 0.25  # of a vehicle whose file says nothing else
_APART_M = 0.5  # between the outlines of two vehicles, at least
_RESERVE = 1.3  # times the planned time must be in the battery
_BEFORE_S = 150.0  # take-off, column, calibration, home
_AFTER_S = 30.0  # landing
_RECORDERS_S = 1.0  # on and off
_NEAREST = 1.0 - 1e-6  # share of what is to be kept, of vehicles that stand while others sweep
_EVERY_STEPS = 2  # of a way, each 0.1 s, is compared with the fence


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


def check_plan(
    mission: Mission,
    situation: Situation,
    radius_m: Optional[Mapping[str, float]] = None,
    indices: Optional[Sequence[int]] = None,
) -> List[str]:
    """Why the list cannot be flown, a line per leg with the leg's name; empty where it can.

    ``radius_m`` of each vehicle (default: 0.25 m), ``indices`` of the configurations to fly
    (default: all).
    """
    vehicles = list(situation.places)
    found = list(_too_little_room(mission, dict.fromkeys(vehicles, RADIUS_M), radius_m or {}))
    chosen = range(len(mission.configurations)) if indices is None else indices
    places, flight_s = dict(situation.places), turns_s(mission, chosen, len(vehicles))
    left = TaskList(mission, vehicles, tasks(mission, vehicles, indices))
    while left.left:
        moment = left.moment
        goals = {
            t.vehicle: situation.places[t.vehicle]
            if t.index is None
            else camera_place(mission.configurations[t.index])[:3, 3]
            for t in moment
        }
        wrong, legs_s = _legs(mission, goals, places, situation.home_height_m)
        left.done()
        if wrong:  # the legs after it are judged as if it were left out
            found.append(f"{_named(mission, moment)}: {wrong}")
            continue
        places.update(goals)
        wrong, sweeps_s = _sweeps(mission, moment, places, situation.home_height_m)
        if wrong:
            found.append(f"{_named(mission, moment)}: {wrong}")
        places.update(
            {
                t.vehicle: last_place(mission.configurations[t.index])[:3, 3]
                for t in moment
                if t.index is not None
            }
        )
        flight_s += legs_s + sweeps_s + _standing_s(mission, moment[0])
    return found + list(_batteries(mission, situation, flight_s))


def require_flyable(
    mission: Mission, vehicles: Sequence[str], radius_m: Optional[Mapping[str, float]] = None
) -> None:
    """Raises PlanRefused naming every leg that cannot be flown, and why."""
    found = check_plan(mission, on_the_ground(mission, vehicles, {}), radius_m)
    if found:
        raise PlanRefused(f"mission '{mission.name}' cannot be flown: {'; '.join(found)}")


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
    sweeps = {
        t.vehicle: c.sweep
        for t in moment
        if t.index is not None
        for c in [mission.configurations[t.index]]
        if c.sweep is not None
    }
    if not sweeps:
        return "", 0.0
    keep = Keep.of(mission)
    ways = {
        n: timed_way(s.place_m(0.0), [s.place_m(1.0)], s.bounds(mission.flight))
        for n, s in sweeps.items()
    }
    for name, sweep in sweeps.items():
        for other, place in places.items():
            if (
                other not in sweeps
                and keep.shares(place, sweep.place_m(0.0), sweep.place_m(1.0)[None])[0] < _NEAREST
            ):
                return f"comes too near to {other}: {_needed(keep, ways[name], place)}", 0.0
    for a, b in combinations(ways, 2):
        ends = keep.share(sweeps[a].place_m(1.0) - sweeps[b].place_m(1.0))
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
    return mission.settle.time_s + configuration.record_s + _RECORDERS_S


def _batteries(mission: Mission, situation: Situation, flight_s: float) -> Iterator[str]:
    needed_s = _RESERVE * (situation.before_s + flight_s + _AFTER_S)
    full = {n: 1.0 for n in situation.places if n not in situation.battery_share}
    for name, share in {**full, **situation.battery_share}.items():
        lasts_s, words = mission.lasts_s(share), f"{share:.0%} of its"
        if lasts_s < needed_s:
            yield (
                f"{name} with {'a full' if name in full else words} battery flies {lasts_s:.0f} s until "
                f"{mission.low_battery_share:.0%} are left, the flight needs {needed_s:.0f} s "
                f"({_RESERVE:g} times its time): fewer configurations, or full batteries"
            )


def _named(mission: Mission, moment: Sequence[Task]) -> str:
    if moment[0].index is None:
        return f"way of {' and '.join(t.vehicle for t in moment)} back to the column"
    return " and ".join(
        f"configurations[{t.index}] ({mission.configurations[t.index].title})" for t in moment
    )
