# SPDX-License-Identifier: Apache-2.0
"""Scattered houses with gardens, barns, a church, orchards and lanes between fields."""

import numpy as np

from fcsv_sim.world import furniture, vegetation
from fcsv_sim.world.buildings import Body, church, house
from fcsv_sim.world.country import CountryPlan, apart, bales, power_line
from fcsv_sim.world.land import foreground, ground, hills, on_ground, plant
from fcsv_sim.world.mesh import MeshBuilder, Placement

_HOUSES = 150
_GAP_M = 19.0


def build_village(mesh: MeshBuilder, random: np.random.Generator) -> CountryPlan:
    """Three clusters of houses along a lane, farms about them."""
    side = random.choice([-1.0, 1.0])
    lanes = [
        side * random.uniform(3.0, 7.0),
        side * random.uniform(85, 120),
        -side * random.uniform(75, 110),
    ]
    plan = CountryPlan.of(
        random, lanes, [random.uniform(24, 32), random.uniform(120, 150), random.uniform(270, 310)]
    )
    ground(mesh, plan)
    church_at = np.array([plan.crossings_s[1] + 22.0, plan.avenues_t[1] + side * 32.0])
    places = _places(plan, church_at, random)
    church(mesh, Placement(*plan.world(*church_at), plan.heading(church_at[0])), random)
    trees = [_home(mesh, plan, place, random) for place in places]
    trees += [
        _orchards(plan, places, random),
        _hedgerows(plan, random),
        _loose(plan, places, random),
    ]
    plant(mesh, plan, np.concatenate(trees), random)
    foreground(mesh, plan, random)
    power_line(mesh, plan, np.arange(34.0, 420.0, 38.0), np.full(11, lanes[0] + side * 9.0))
    bales(mesh, plan, _free(plan, places, random, 40, (30, 180)), random)
    _cars(mesh, plan, random)
    hills(mesh, plan, random)
    return plan


def _places(plan: CountryPlan, church_at: np.ndarray, random) -> np.ndarray:
    """Where houses stand (K,2), in plan coordinates: crowded about the lanes' crossings, loose
    elsewhere."""
    centres = np.column_stack([plan.crossings_s + [12.0, 5.0, 5.0], np.full(3, plan.avenues_t[1])])
    near = centres[random.integers(0, 3, 4 * _HOUSES)] + random.normal(
        0.0, [30.0, 48.0], (4 * _HOUSES, 2)
    )
    loose = np.column_stack(
        [random.uniform(36, 455, 3 * _HOUSES), random.uniform(-280, 280, 3 * _HOUSES)]
    )
    candidates = np.concatenate([near, loose])
    lane = plan.from_lane_m(*candidates.T)
    good = (candidates[:, 0] > 36) & (candidates[:, 0] < 455) & (lane > 6.5)
    good &= np.abs(candidates[:, 1]) < plan.half_width(candidates[:, 0])
    good &= np.hypot(*(candidates - church_at).T) > 27
    return apart(random, candidates[good], _GAP_M, _HOUSES)


def _home(mesh: MeshBuilder, plan: CountryPlan, place: np.ndarray, random) -> np.ndarray:
    """A house or a barn with its garden; returns its trees (K,2)."""
    s, t = place
    x, y, z = plan.world(s, t)
    yaw = plan.heading(s) + random.choice([0.0, np.pi / 2]) + np.radians(random.normal(0.0, 14.0))
    barn = random.random() < 0.16
    length, depth = (
        (random.uniform(15, 19), random.uniform(8.5, 10))
        if barn
        else random.uniform((8.5, 7), (13, 9))
    )
    floors = 1 if barn or random.random() < 0.55 else 2
    body = Body(
        length, depth, floors, random.uniform(3.4, 4.2) if barn else random.uniform(2.5, 2.9)
    )
    house(mesh, Placement(x, y, z + 0.15, yaw), body, random)
    if s < 250 and random.random() < 0.7:
        _garden(mesh, plan, place, random)
    around = random.uniform(0, 2 * np.pi, random.integers(1, 5))
    away = random.uniform(8.5, 13.0, len(around))
    trees = place + np.column_stack([away * np.cos(around), away * np.sin(around)])
    return trees[plan.from_lane_m(*trees.T) > 0.5]


def _garden(mesh: MeshBuilder, plan: CountryPlan, place: np.ndarray, random) -> None:
    """Fence or hedge on three sides of it, shrubs inside."""
    half = random.uniform(8.0, 9.2, 2)
    corners = (
        place
        + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])[random.permutation(4)[0] - np.arange(4)]
        * half
    )
    steps = 9 if random.random() < 0.5 else 14
    line = np.concatenate([np.linspace(a, b, steps) for a, b in zip(corners[:-1], corners[1:])])
    line = line[plan.from_lane_m(*line.T) > -0.5]
    if len(line) < 2:
        return
    if steps == 9:
        furniture.fence(mesh, on_ground(plan, *line.T), random.uniform(0.9, 1.3), random)
    else:
        tall = random.uniform(0.7, 1.1)
        size = np.tile([0.8, 0.8, tall], (len(line), 1)) * random.uniform(0.8, 1.2, (len(line), 1))
        vegetation.bushes(mesh, on_ground(plan, *line.T) + [0, 0, tall * 0.6], size, random)
    shrubs = place + random.uniform(-1, 1, (5, 2)) * (half - 1.0)
    size = random.uniform(0.35, 0.9, (5, 1)) * [1.0, 1.0, 1.0]
    vegetation.bushes(mesh, on_ground(plan, *shrubs.T) + [0, 0, 0.3], size, random)


def _orchards(plan: CountryPlan, places: np.ndarray, random) -> np.ndarray:
    """Fruit trees in rows on a few plots."""
    grid = np.stack(np.meshgrid(np.arange(5) * 7.0, np.arange(4) * 7.0), -1).reshape(-1, 2)
    plots = _free(plan, places, random, 9, (45, 380))
    trees = (plots[:, None] + grid + random.normal(0.0, 0.5, (len(plots), len(grid), 2))).reshape(
        -1, 2
    )
    return trees[_clear(plan, places, trees, 9.0)]


def _hedgerows(plan: CountryPlan, random) -> np.ndarray:
    """Trees along lanes, in stretches."""
    s = (
        np.arange(40.0, 440.0, 9.0)
        + random.uniform(-2.5, 2.5, 45)[: len(np.arange(40.0, 440.0, 9.0))]
    )
    rows = [
        np.column_stack([s, np.full(len(s), t + side * 7.0)])[np.sin(s / 33.0 + 3 * t) > 0.2]
        for t in plan.avenues_t
        for side in (-1.0, 1.0)
    ]
    trees = np.concatenate(rows)
    return trees[plan.from_lane_m(*trees.T) > 0.5]


def _loose(plan: CountryPlan, places: np.ndarray, random) -> np.ndarray:
    return _free(plan, places, random, 150, (42, 460))


def _free(plan: CountryPlan, places: np.ndarray, random, count: int, along_m) -> np.ndarray:
    """Up to ``count`` places (K,2) off lanes and houses."""
    s = random.uniform(*along_m, 3 * count)
    spots = np.column_stack([s, random.uniform(-1, 1, 3 * count) * plan.half_width(s)])
    return spots[_clear(plan, places, spots, 14.0)][:count]


def _clear(
    plan: CountryPlan, places: np.ndarray, spots: np.ndarray, distance_m: float
) -> np.ndarray:
    apart_m = np.hypot(*(spots[:, None] - places[None]).transpose(2, 0, 1)).min(1)
    return (apart_m > distance_m) & (plan.from_lane_m(*spots.T) > 1.0)


def _cars(mesh: MeshBuilder, plan: CountryPlan, random) -> None:
    """A few, parked on the lanes' edges."""
    for s in np.arange(plan.crossings_s[0] + 9, 330.0, 17.0):
        if random.random() < 0.5 and np.abs(plan.crossings_s - s).min() > 8:
            x, y, z = plan.world(s, plan.avenues_t[1] + random.choice([-1, 1]) * 2.1)
            furniture.car(mesh, Placement(x, y, z + 0.02, plan.heading(s)), random)
