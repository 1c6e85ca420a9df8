# SPDX-License-Identifier: Apache-2.0
"""Open farmland: crops, lines of trees along and across, lone trees, bales, fences, a farm, woods
behind."""

import numpy as np

from fcsv_sim.world import vegetation
from fcsv_sim.world.buildings import Body, house
from fcsv_sim.world.country import CountryPlan, bales, pasture_fence, power_line
from fcsv_sim.world.land import foreground, ground, hills, on_ground, plant
from fcsv_sim.world.mesh import MeshBuilder, Placement


def build_field(mesh: MeshBuilder, random: np.random.Generator) -> CountryPlan:
    """No lane, hardly a house: nature at every range."""
    plan = CountryPlan.of(random, [], [])
    ground(mesh, plan)
    side = random.choice([-1.0, 1.0])
    lines = [
        _across(random, random.uniform(165, 200)),
        _across(random, random.uniform(300, 345)),
        _along(random, side * random.uniform(24, 34), (46, 175)),
        _along(random, -side * random.uniform(70, 110), (95, 330)),
    ]
    lone = np.column_stack([random.uniform(34, 420, 60), random.uniform(-1, 1, 60)])
    lone[:, 1] *= plan.half_width(lone[:, 0])
    copses = [_copse(random) for _ in range(5)]
    plant(mesh, plan, np.concatenate([*lines, lone, *copses]), random)
    for line in lines:
        _undergrowth(mesh, plan, line, random)
    foreground(mesh, plan, random)
    spots = np.column_stack([random.uniform(24, 210, 70), random.uniform(-1, 1, 70)])
    bales(
        mesh,
        plan,
        spots * np.column_stack([np.ones(70), 0.5 * plan.half_width(spots[:, 0])]),
        random,
    )
    s = np.arange(28.0, 84.0, 3.5)
    pasture_fence(mesh, plan, s, -side * (6.0 + 0.12 * s))
    t = np.arange(-60.0, 60.0, 4.0)
    pasture_fence(mesh, plan, np.full(len(t), 86.0), t)
    s = np.arange(40.0, 440.0, 42.0)
    power_line(mesh, plan, s, side * (0.22 * s - 4.0))
    _farm(mesh, plan, np.array([random.uniform(110, 150), -side * random.uniform(22, 40)]), random)
    _farm(mesh, plan, np.array([random.uniform(235, 280), side * random.uniform(60, 110)]), random)
    hills(mesh, plan, random)
    return plan


def _across(random, s_m: float) -> np.ndarray:
    """A line of trees across the view with gaps, (K,2)."""
    t = np.arange(-260.0, 260.0, 6.0) + random.uniform(-1.5, 1.5, 87)
    slant = random.uniform(-0.12, 0.12)
    t = t[np.sin(t / 41.0 + random.uniform(0, 6)) + random.normal(0, 0.3, len(t)) > -0.75]
    return np.column_stack([s_m + slant * t + random.uniform(-2, 2, len(t)), t])


def _along(random, t_m: float, along_m) -> np.ndarray:
    """A windbreak that runs away from the viewer, (K,2)."""
    s = np.arange(*along_m, 6.5)
    return np.column_stack(
        [s + random.uniform(-1.5, 1.5, len(s)), t_m + 0.1 * s + random.uniform(-1, 1, len(s))]
    )


def _copse(random) -> np.ndarray:
    middle = np.array([random.uniform(130, 430), random.uniform(-200, 200)])
    return middle + random.normal(0.0, 9.0, (22, 2))


def _undergrowth(mesh: MeshBuilder, plan: CountryPlan, line: np.ndarray, random) -> None:
    """Bushes under a line of trees."""
    spots = line[line[:, 0] < 240].repeat(2, 0)
    spots = spots + random.normal(0.0, 1.6, spots.shape)
    size = random.uniform(0.7, 1.6, (len(spots), 1)) * [1.1, 1.1, 0.9]
    vegetation.bushes(mesh, on_ground(plan, *spots.T) + [0, 0, 0.4], size, random)


def _farm(mesh: MeshBuilder, plan: CountryPlan, place: np.ndarray, random) -> None:
    """A farmhouse and two barns around a yard."""
    yaw = random.uniform(-0.4, 0.4)
    for offset, turn, size in (
        ((0, 0), 0.0, (13, 9, 2, 2.8)),
        ((16, 9), np.pi / 2, (21, 10, 1, 4.4)),
        ((2, 24), 0.0, (17, 9, 1, 3.8)),
    ):
        x, y, z = plan.world(*(place + offset))
        house(mesh, Placement(x, y, z + 0.1, yaw + turn), Body(*size), random)
