# SPDX-License-Identifier: Apache-2.0
"""How much room other vehicles need, and where there is enough of it."""

from functools import partial
from typing import Dict

import numpy as np

from fcsv_control.guardian.air import VehicleSituation
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry.missions import airspace
from fcsv_geometry.missions.airspace import HorizontalClearance, Occupant

_UNHEARD_S = 0.5  # in calm flights 0.4 at most


def clearance(rules: GuardianRules) -> HorizontalClearance:
    """How far away horizontally other vehicles must be: one without a position drifts."""
    return HorizontalClearance(rules.clear_m, rules.uncontrolled_clear_m)


def others(now_s: float, air: VehicleSituation, rules: GuardianRules) -> Dict[str, Occupant]:
    """What the other vehicles occupy."""
    return {name: o.occupant(now_s, rules.silent_above_s) for name, o in air.others.items()}


def aside(
    now_s: float, air: VehicleSituation, rules: GuardianRules, away_from: str, lands: bool
) -> np.ndarray:
    """(3,) in home, clear of everybody, away from a vehicle; to land there, outside of where a lost
    one may lie.

    Where another vehicle is not heard it may dodge, too, and has not heard this one: everybody goes
    to a side that the other knows beforehand then. Away from a third that both dodge two have met
    at one place, and away from where each was last heard two that were above each other.
    """
    own, occupants = Occupant([air.p_home_m]), others(now_s, air, rules)
    # of two in one column the upper goes left
    is_upper = own.here_m[2] > airspace.nearest_m(own, occupants[away_from])[2]
    side = np.array([0.0, 1.0 if is_upper else -1.0])
    unheard = any(now_s - o.heard_s > _UNHEARD_S for o in air.others.values())
    within, keeps = partial(within_fences, air, rules), clearance(rules)
    return airspace.aside(own, occupants, away_from, keeps, lands, side, unheard, within)


def within_fences(air: VehicleSituation, rules: GuardianRules, p_home_m: np.ndarray) -> bool:
    """Whether a place (3,) in home, at the vehicle's height, is in the guardian's fence and the
    mission's."""
    place = air.from_take_off_m
    height_m = 0.0 if place is None else float(place[2])
    if rules.fence.outside_m(p_home_m, height_m) > 0.0:
        return False
    mission = air.mission_fence
    return mission is None or mission.outside_m(p_home_m, height_m) <= rules.mission_fence_slack_m
