# SPDX-License-Identifier: Apache-2.0
"""How much room other vehicles need, and where there is enough of it."""

from functools import partial
from typing import Dict, List

import numpy as np

from fcsv_control.guardian.air import Other, VehicleSituation
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry.missions import separation

_UNHEARD_S = 0.5  # in calm flights 0.4 at most


def clear_m(rules: GuardianRules, other: Other) -> float:
    """How far away horizontally another vehicle must be: one without a position drifts."""
    return rules.uncontrolled_clear_m if other.astray else rules.clear_m


def landing_clear_m(now_s: float, rules: GuardianRules, other: Other) -> float:
    """Measures the room, likewise for one that comes down: where a lost one lies nobody knows."""
    return max(clear_m(rules, other), other.reach_m(now_s) if other.lost else 0.0)


def places_m(
    now_s: float, air: VehicleSituation, rules: GuardianRules
) -> Dict[str, List[np.ndarray]]:
    """Where to look for each other vehicle."""
    return {name: o.places_m(now_s, rules.silent_above_s) for name, o in air.others.items()}


def aside(
    now_s: float, air: VehicleSituation, rules: GuardianRules, away_from: str, lands: bool
) -> np.ndarray:
    """(3,) in home, clear of everybody, away from a vehicle; to land there, outside of where a lost
    one may lie.

    Where another vehicle is not heard it may dodge, too, and has not heard this one: everybody goes
    to a side that the other knows beforehand then. Away from a third that both dodge two have met
    at one place, and away from where each was last heard two that were above each other.
    """
    here, places = air.p_home_m, places_m(now_s, air, rules)
    there = min(places[away_from], key=lambda p: float(np.linalg.norm((p - here)[:2])))
    # of two in one column the upper goes left
    side = np.array([0.0, 1.0 if here[2] > there[2] else -1.0])
    least_m = clear_m(rules, air.others[away_from])
    needed_m = {n: landing_clear_m(now_s, rules, air.others[n]) if lands else 0.0 for n in places}
    clears_m = [max(least_m, needed_m[n]) for n, found in places.items() for _ in found]
    within = partial(within_fences, air, rules)
    unheard = any(now_s - o.heard_s > _UNHEARD_S for o in air.others.values())
    return separation.aside(
        here, sum(places.values(), []), clears_m, None if unheard else there, side, within
    )


def within_fences(air: VehicleSituation, rules: GuardianRules, p_home_m: np.ndarray) -> bool:
    """Whether a place (3,) in home, at the vehicle's height, is in the guardian's fence and the
    mission's."""
    place = air.from_take_off_m
    height_m = 0.0 if place is None else float(place[2])
    if rules.fence.outside_m(p_home_m, height_m) > 0.0:
        return False
    mission = air.mission_fence
    return mission is None or mission.outside_m(p_home_m, height_m) <= rules.mission_fence_slack_m
