# SPDX-License-Identifier: Apache-2.0
"""Worlds for a robot on the ground: the same again for a seed, and a truth that fits the drawn
mesh."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.robot import load_robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.caster import make_caster
from fcsv_sim.render.rays import T, ray_buffer, set_rays
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.maze import build_maze
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.town import PLACES, Town

_DOWN_FROM_M = 40.0


@pytest.fixture(scope="module")
def places():
    return {world: Town.generate(1, world) for world in PLACES}


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.mark.parametrize("world", sorted(PLACES))
def test_a_seed_is_a_place(places, world):
    made, again = places[world], Town.generate(1, world)
    assert np.array_equal(made.vertices, again.vertices) and made.plan.goal_m == again.plan.goal_m
    assert made.plan.goal_m != Town.generate(2, world).plan.goal_m
    assert np.isfinite(made.vertices).all() and made.instance.max() < len(made.parameters)


@pytest.mark.parametrize("world", sorted(PLACES))
def test_the_truth_is_that_of_the_drawn_mesh(places, world):
    """Rays from above meet what the columns say is highest, to a centimetre; 1 % of them hit an
    edge's other side."""
    town = places[world]
    footing = Footing.of(town.plan)
    rows, columns = np.random.default_rng(3).integers(0, footing.top_m.shape, (4000, 2)).T
    x, y = footing.grid.middle_of(rows, columns).T
    rays = ray_buffer(len(x))
    set_rays(
        rays,
        np.column_stack([x, y, np.full(len(x), _DOWN_FROM_M)]),
        np.tile([0.0, 0.0, -1.0], (len(x), 1)),
    )
    make_caster(town.vertices, town.triangles, 1).cast(rays)
    hit = _DOWN_FROM_M - rays[:, T]
    top, overhead = footing.top_m[rows, columns], footing.overhead_m[rows, columns]
    seen_top = ~np.isfinite(overhead)
    assert (np.abs(hit - top)[seen_top] < 0.01).mean() > 0.99
    assert (hit[~seen_top] > overhead[~seen_top]).all()


def test_a_wall_is_touched_and_a_corridor_is_not(places, rescue):
    plan = places["maze"].plan
    clear = Footing.of(plan).clearance(rescue)
    assert not clear.touches(*plan.start_m) and not clear.touches(*plan.goal_m)
    for solid in plan.solids:
        along = int(np.argmax(solid.half_m[:2]))
        beside = solid.middle_m[:2].copy()
        beside[1 - along] += solid.half_m[1 - along] + rescue.radius_m
        off = np.zeros(2)
        off[1 - along] = 0.1
        assert clear.touches(*(beside - off)) and not clear.touches(*(beside + off))
    assert clear.touches(*plan.solids[0].middle_m[:2] - [0.16, 0]) and clear.touches(-500.0, 0.0)


@pytest.mark.parametrize("cell_m", [0.05, 0.13, 0.4])
def test_no_wall_is_too_thin_for_a_pictures_cells(places, rescue, cell_m):
    plan = places["maze"].plan
    clear = Footing.of(plan).clearance(rescue)
    for solid in plan.solids:
        along, at = int(np.argmax(solid.half_m[:2])), solid.middle_m[:2].copy()
        at[1 - along] += solid.half_m[1 - along]
        at[along] += np.random.default_rng(0).uniform(-0.8, 0.8) * solid.half_m[along]
        middle = (np.floor(at / cell_m) + 0.5) * cell_m
        assert clear.stopped(*middle, cell_m)
    assert not clear.stopped(*plan.start_m, cell_m) and not clear.stopped(-500.0, 0.0, cell_m)


def test_some_goals_have_no_way(rescue):
    """About one of seven mazes; the truth says which."""
    leads = []
    for seed in range(14):
        plan = build_maze(MeshBuilder(), np.random.default_rng([seed, 1]))
        leads.append(Footing.of(plan, 0.1).clearance(rescue).leads(plan.start_m, plan.goal_m))
    assert 1 <= leads.count(False) <= 5


def test_a_robot_passes_under_the_beam_as_its_height_allows(places, rescue):
    """Its lower edge is 0.9 m and more above the ground: a robot of 0.7 m passes, one of 1.5 m does
    not."""
    plan = places["rubble"].plan
    footing, beam = Footing.of(plan), plan.solids[-3]
    bottom = beam.middle_m[2] - beam.half_m[2]
    under = np.abs(footing.overhead_m - bottom) < 1e-6
    assert under.sum() > 200 and (footing.overhead_m - footing.ground_m)[under].min() >= 0.9
    assert footing.impassable(rescue)[under].mean() < 0.5
    assert footing.impassable(replace(rescue, height_m=1.5))[under].mean() > 0.9


def test_a_goal_in_a_wall_is_refused(places, rescue):
    plan = places["maze"].plan
    with pytest.raises(
        SimulationError, match=r"the goal \(.*\) m is no place for the robot rescue"
    ):
        Footing.of(plan).clearance(rescue).leads(plan.start_m, tuple(plan.solids[0].middle_m[:2]))
