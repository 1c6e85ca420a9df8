# SPDX-License-Identifier: Apache-2.0
"""Ways of several vehicles at once: checked against each other in time, delayed where they would
meet."""

import math
from dataclasses import dataclass
from itertools import combinations, islice, permutations
from typing import Dict, Generator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_control.mission.ways.routes import Keep, route
from fcsv_control.mission.ways.timed_way import EARLY_S, LATE_S, STEP_S, TimedWay, timed_way
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.flight_limits import FlightBounds

_BAND_STEPS = int(round((EARLY_S + LATE_S) / STEP_S))  # one may be late while the other is early
_DELAY_STEP_S = 1.0
_MOST_DELAY_S = 30.0
_ORDERS = 6  # of the vehicles are tried: all of three
_EPSILON = 1e-6
_MANY = 1000  # slices

Places = Mapping[str, np.ndarray]
Slices = Generator[None, None, "Traffic"]


@dataclass(frozen=True)
class Departure:
    """A vehicle's way-points (3,) and when it is where."""

    way: List[np.ndarray]
    timed: TimedWay


@dataclass(frozen=True)
class Traffic:
    """``departures`` by vehicle: all at once, or None where they can only go one after the other in
    ``order``."""

    order: Tuple[str, ...]
    departures: Optional[Dict[str, Departure]]
    ends_s: float


def clear(a: TimedWay, b: TimedWay, keep: Keep) -> bool:
    """Whether two vehicles, each within the band of its time, keep what is to be kept from each
    other: as much as their starts and goals do, where these keep less."""
    last = max(len(a.places), len(b.places)) + _BAND_STEPS
    times_s = np.arange(last) * STEP_S
    of_a, of_b = a.at(times_s), b.at(times_s)
    least = min(1.0, *(keep.share(a.places[k] - b.places[k]) for k in (0, -1))) - _EPSILON
    for shift in sorted(range(-_BAND_STEPS, _BAND_STEPS + 1), key=abs):
        first, end = max(0, shift), min(last, last + shift)
        if keep.shares_of(of_a[first:end] - of_b[first - shift : end - shift]).min() < least:
            return False
    return True


class Planning:
    """A plan that is made in slices: whoever flies must not wait for it. ``step`` until there is
    one; nobody moves meanwhile. One slice is one way, or one delay of one vehicle held against
    those before it: some milliseconds."""

    def __init__(self, slices: Slices):
        self._slices = slices

    def step(self, slices: int) -> Optional[Traffic]:
        """Go on by so many slices; the plan once it is made. Raises MissionError where there is
        none."""
        for _ in range(slices):
            try:
                next(self._slices)
            except StopIteration as made:
                return made.value
        return None

    def at_once(self) -> Traffic:
        """Works on to its end."""
        while True:
            made = self.step(_MANY)
            if made is not None:
                return made


def plan(
    starts: Places, goals: Places, standing: Sequence[np.ndarray], keep: Keep, bounds: FlightBounds
) -> Planning:
    """Ways of all vehicles from starts to goals (3,) past those that stand; together where that is
    free, else delayed in the shortest way found, else one after the other. A MissionError where not
    even that can be flown."""
    return Planning(_together(starts, goals, standing, keep, bounds))


def one_after_the_other(
    starts: Places, goals: Places, standing: Sequence[np.ndarray], keep: Keep, bounds: FlightBounds
) -> Planning:
    """Plans ways in the first order in which each has a way past all others; else a
    MissionError."""
    return Planning(_single_file(starts, goals, standing, keep, bounds))


def _together(starts: Places, goals: Places, standing, keep: Keep, bounds: FlightBounds) -> Slices:
    for a, b in combinations(goals, 2):
        if keep.share(goals[a] - goals[b]) < 1.0 - _EPSILON:
            away_m = float(np.linalg.norm(goals[a] - goals[b]))
            raise MissionError(
                f"{a} and {b} would be {away_m:.1f} m apart, {keep.needed(goals[a] - goals[b])}"
            )
    best: Optional[Traffic] = None
    for order in islice(permutations(goals), _ORDERS):
        for around in (False, True):
            try:
                ways = yield from _ways(order, starts, goals, standing, keep, around)
            except MissionError:
                continue
            best = (yield from _delayed(order, starts, ways, keep, bounds, best)) or best
        if best is not None and _nobody_waits(best):
            break
    return best or (yield from _single_file(starts, goals, standing, keep, bounds))


def _single_file(
    starts: Places, goals: Places, standing, keep: Keep, bounds: FlightBounds
) -> Slices:
    why = ""
    for order in islice(permutations(goals), _ORDERS):
        try:
            ways = yield from _ways(order, starts, goals, standing, keep, around=True)
        except MissionError as error:
            why = why or str(error)
            continue
        ends_s = sum(timed_way(starts[n], w, bounds).ends_s + LATE_S for n, w in ways.items())
        return Traffic(tuple(order), None, ends_s)
    raise MissionError(why)


def _ways(
    order, starts: Places, goals: Places, standing, keep: Keep, around: bool
) -> Generator[None, None, Dict[str, List[np.ndarray]]]:
    """``around``: those before at their goals, those after at their starts, as when they go one
    after the other."""
    ways = {}
    for k, name in enumerate(order):
        others = (
            [*(goals[n] for n in order[:k]), *(starts[n] for n in order[k + 1 :])] if around else []
        )
        ways[name] = route(starts[name], goals[name], [*standing, *others], keep)
        yield
    return ways


def _delayed(
    order, starts: Places, ways, keep: Keep, bounds: FlightBounds, best: Optional[Traffic]
) -> Generator[None, None, Optional[Traffic]]:
    """Each as early as those before it in the order allow; None where that is never, or not before
    the best ends."""
    departures: Dict[str, Departure] = {}
    before_s = math.inf if best is None else best.ends_s - _EPSILON
    for name in order:
        for delay_s in np.arange(0.0, _MOST_DELAY_S, _DELAY_STEP_S):
            timed = timed_way(starts[name], ways[name], bounds, float(delay_s))
            if timed.ends_s >= before_s:
                return None
            free = all(clear(timed, d.timed, keep) for d in departures.values())
            yield
            if free:
                departures[name] = Departure(ways[name], timed)
                break
        else:
            return None
    return Traffic(tuple(order), departures, max(d.timed.ends_s for d in departures.values()))


def _nobody_waits(traffic: Traffic) -> bool:
    return all(d.timed.begins_s[0] == 0.0 for d in traffic.departures.values() if d.timed.begins_s)
