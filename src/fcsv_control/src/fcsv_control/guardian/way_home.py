# SPDX-License-Identifier: Apache-2.0
"""Whether a vehicle that nobody commands can fly to above its take-off place, straight and at the
height that it has, and come down there."""

import math

import numpy as np

from fcsv_control import conditions
from fcsv_control.guardian import room
from fcsv_control.guardian.air import Other, VehicleSituation
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.missions import separation
from fcsv_geometry.vehicles import thresholds as at

THERE_M = 0.4  # horizontally
_MORE_M = 0.3  # of room, to set out: what is only just clear would stop it on the way
_SLOWEST_MPS = 1.0  # it flies at least as fast
_MOVES_MPS = 0.5


def left_m(air: VehicleSituation) -> float:
    """Horizontally, to above the take-off place; both places must be known."""
    return math.hypot(*(air.estimate[:2, 3] - air.take_off[:2, 3]))


def against(now_s: float, air: VehicleSituation, rules: GuardianRules, under_way: bool) -> str:
    """What speaks against it, "" where nothing does."""
    if air.take_off is None or air.estimate is None or air.take_off_epoch != air.epoch:
        return "its take-off place is not known"
    if air.p_home_m is None:
        return "its place among the others is not known"
    if not _believed(now_s, air, rules):
        return "its position is not good"
    T_odom_there = transforms.level(air.estimate)
    T_odom_there[:2, 3] = air.take_off[:2, 3]
    p_home_there = transforms.apply(air.T_home_odom, T_odom_there[:3, 3])
    if not _within_fences(air, rules, p_home_there):
        return "the way leaves the fence"
    occupants = room.others(now_s, air, rules)
    for name, other in air.others.items():
        if now_s - other.heard_s > rules.silent_above_s:
            return f"{name} is not heard"
        doubt_m = separation.doubt_m(
            (air.sigma_m, other.sigma_m), now_s - other.heard_s, other.speed_mps
        )
        needed_m = (
            room.clearance(rules).to_land(occupants[name])
            + doubt_m
            + (0.0 if under_way else _MORE_M)
        )
        if not _clear(air, rules, other, needed_m, p_home_there):
            return f"{name} is too near to the way, or to the take-off place"
    return ""


def _believed(now_s: float, air: VehicleSituation, rules: GuardianRules) -> bool:
    """Whether it knows well where it is."""
    asked = (
        conditions.feed_age(air.feed.age_s(now_s), rules.feed_warn_s),
        conditions.ekf(air.link.ekf_variance, rules.ekf_variance),
        conditions.estimate_apart(air.apart_m, at.APART_IN_FLIGHT_M.guardian.red),
    )
    low = conditions.confidence(air.confidence, rules.confidence).red
    return all(c.green for c in asked) and not (low or air.link.doubt or air.lost)


def _within_fences(air: VehicleSituation, rules: GuardianRules, p_home_there: np.ndarray) -> bool:
    parts = 1 + math.ceil(left_m(air))
    way = p_home_there - air.p_home_m
    return all(
        room.within_fences(air, rules, air.p_home_m + k / parts * way) for k in range(parts + 1)
    )


def _clear(
    air: VehicleSituation,
    rules: GuardianRules,
    other: Other,
    clear_m: float,
    p_home_there: np.ndarray,
) -> bool:
    """Whether another vehicle keeps away from the way and its end; at any height, so that neither
    flies over the other. One that moves, or that a pilot has, may be anywhere that it reaches
    meanwhile."""
    here, there = air.p_home_m, p_home_there
    if other.taken and other.armed:
        clear_m = max(clear_m, rules.uncontrolled_clear_m)
    if other.armed and other.speed_mps > _MOVES_MPS:
        reaches_m = other.speed_mps * left_m(air) / _SLOWEST_MPS
        return separation.passes_m(here, there, other.p_home_m) > clear_m + reaches_m
    return separation.room_m(here, there, [other.p_home_m], clear_m) >= 0.0
