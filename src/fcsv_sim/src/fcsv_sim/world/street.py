# SPDX-License-Identifier: Apache-2.0
"""A town: streets with houses and blocks, gardens, cars, trees; also with plain facades on snow or
sand."""

from dataclasses import replace

import numpy as np

from fcsv_sim.world import furniture, vegetation
from fcsv_sim.world.buildings import Body, block, hall, house
from fcsv_sim.world.land import foreground, ground, hills, on_ground, plant
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.plan import FAR_M, PAVEMENT_M, ROAD_HALF_M, Cover, Plot, TownPlan

_COVERS = (Cover((0.50, 0.52, 0.56), 0.94), Cover((0.52, 0.43, 0.29), 0.90))  # snow, sand


def build_street(mesh: MeshBuilder, random: np.random.Generator) -> TownPlan:
    """The town in summer."""
    return _build(mesh, TownPlan.draw(random), random, plain=False)


def build_plain(mesh: MeshBuilder, random: np.random.Generator) -> TownPlan:
    """Little texture: most walls blank and smooth, roofs and ground under snow or sand, few
    trees."""
    cover = _COVERS[int(random.integers(len(_COVERS)))]
    return _build(mesh, replace(TownPlan.draw(random), cover=cover), random, plain=True)


def _build(mesh: MeshBuilder, plan: TownPlan, random, plain: bool) -> TownPlan:
    ground(mesh, plan)
    garden_trees = _parcels(mesh, plan, random, plain)
    _streets(mesh, plan, random)
    foreground(mesh, plan, random)
    spots = np.concatenate([garden_trees, _street_trees(plan, random)])
    plant(mesh, plan, spots[::4] if plain else spots, random)
    hills(mesh, plan, random)
    return plan


def _parcels(mesh: MeshBuilder, plan: TownPlan, random, plain: bool) -> np.ndarray:
    """A building or a green on every plot; returns where garden trees stand, (K, 2) in plan
    coordinates."""
    spots = [np.zeros((0, 2))]
    parcels = plan.parcels(random)
    wall_at = min(
        parcels,
        key=lambda p: (
            abs(p.s - 78.0) + abs(p.t - plan.avenues_t[6] + np.sign(plan.bend_phase[0] - 3) * 24.0)
        ),
    )
    for parcel in parcels:
        if parcel is wall_at:
            x, y, z = plan.world(parcel.s, parcel.t)
            hall(
                mesh,
                Placement(x, y, z, plan.heading(x)),
                parcel.length_m - 2,
                parcel.depth_m - 2,
                8.5,
                [0.7, 0.69, 0.66],
            )
        elif random.random() < (0.3 if parcel.s < 48 else 0.1):
            spots.append(_spread(parcel, random, 9))
        else:
            _built(mesh, plan, parcel, random, plain)
            spots.append(_spread(parcel, random, random.integers(1, 4)))
            _boundary(mesh, plan, parcel, random)
    return np.concatenate(spots)


def _built(mesh: MeshBuilder, plan: TownPlan, parcel: Plot, random, plain: bool) -> None:
    """Low and sparse in front, higher towards the back and the sides."""
    tall = random.random() < np.clip((parcel.s - 150) / 350 + (abs(parcel.t) - 30) / 500, 0.0, 0.6)
    depth = min(random.uniform(8.5, 12.0), parcel.depth_m - 5.0)
    back = random.uniform(2.0, 5.0)
    t = parcel.t + parcel.front * (parcel.depth_m / 2 - back - depth / 2)
    x, y, z = plan.world(parcel.s, t)
    place = Placement(x, y, z + 0.2, plan.heading(x) + np.radians(random.normal(0.0, 2.0)))
    if tall:
        floors = int(
            random.integers(3, 6)
            + random.uniform(0.0, 4.5) * np.clip((parcel.s - 120) / 250, 0.0, 1.0)
        )
        block(
            mesh,
            place,
            Body(
                parcel.length_m - random.uniform(1.5, 5.0),
                depth + 2,
                floors,
                random.uniform(2.8, 3.2),
            ),
            random,
            plan.cover.colour if plain else None,
        )
        return
    most = 1.5 if parcel.s < 45 and abs(parcel.t) < 30 else 2.6 if parcel.s < 90 else 3.8
    length = min(parcel.length_m - random.uniform(2.5, 5.5), 15.0)
    body = Body(length, depth, max(1, int(random.uniform(1.0, most))), random.uniform(2.6, 3.1))
    house(mesh, place, body, random, plan.cover.colour if plain else None)


def _spread(parcel: Plot, random, count: int) -> np.ndarray:
    """Tree spots in the garden behind the building."""
    s = parcel.s + random.uniform(-0.42, 0.42, count) * parcel.length_m
    t = parcel.t - parcel.front * random.uniform(0.15, 0.46, count) * parcel.depth_m
    return np.stack([s, t], -1)


def _boundary(mesh: MeshBuilder, plan: TownPlan, parcel: Plot, random) -> None:
    """Hedge or fence towards the street and along one side; far ones would not be seen."""
    if parcel.s > 260 or random.random() < 0.25:
        return
    half, front = parcel.length_m / 2 - 0.4, parcel.t + parcel.front * (parcel.depth_m / 2 - 0.4)
    rear = parcel.t - parcel.front * (parcel.depth_m / 2 - 0.3)
    line = np.array(
        [[parcel.s - half, rear], [parcel.s - half, front], [parcel.s + half * 0.5, front]]
    )
    s = np.concatenate([np.linspace(a, b, 7) for a, b in zip(line[:-1, 0], line[1:, 0])])
    t = np.concatenate([np.linspace(a, b, 7) for a, b in zip(line[:-1, 1], line[1:, 1])])
    if random.random() < 0.5:
        furniture.fence(mesh, on_ground(plan, s, t), random.uniform(0.9, 1.7), random)
        return
    fine = np.linspace(0, len(s) - 1, 30)
    middle = on_ground(
        plan, np.interp(fine, np.arange(len(s)), s), np.interp(fine, np.arange(len(t)), t)
    )
    tall = random.uniform(0.7, 1.2)
    vegetation.bushes(
        mesh,
        middle + [0, 0, tall * 0.6],
        np.tile([0.75, 0.6, tall], (30, 1)) * random.uniform(0.8, 1.2, (30, 1)),
        random,
    )


def _streets(mesh: MeshBuilder, plan: TownPlan, random) -> None:
    """Lamp posts and parked cars along the avenues and crossings."""
    kerb = ROAD_HALF_M + 0.5
    for t in plan.avenues_t:
        for s in np.arange(plan.crossings_s[0] + 8, FAR_M, 27.0) + random.uniform(-2, 2):
            if abs(t) < plan.half_width(s):
                x, y, z = plan.world(s, t - kerb)
                furniture.lamp_post(
                    mesh, Placement(x, y, z, plan.heading(x)), random.uniform(5.5, 7.0)
                )
        for s in np.arange(plan.crossings_s[0] + 7, min(FAR_M, 330.0), 6.5):
            if (
                abs(t) < plan.half_width(s)
                and np.abs(plan.crossings_s - s).min() > 7
                and random.random() < 0.4
            ):
                _park(
                    mesh,
                    plan,
                    s + random.uniform(-0.6, 0.6),
                    t + random.choice([-1, 1]) * (ROAD_HALF_M - 1.05),
                    random,
                )
    s = plan.crossings_s[0]
    for t in np.arange(-60.0, 61.0, 7.0):
        if np.abs(plan.avenues_t - t).min() > 8 and random.random() < 0.45:
            _park(mesh, plan, s + ROAD_HALF_M - 1.05, t, random, np.pi / 2)


def _park(mesh, plan: TownPlan, s: float, t: float, random, turn: float = 0.0) -> None:
    x, y, z = plan.world(s, t)
    heading = plan.heading(x) + turn + random.choice([0, np.pi]) + np.radians(random.normal(0, 2))
    furniture.car(mesh, Placement(x, y, z + 0.02, heading), random)


def _street_trees(plan: TownPlan, random) -> np.ndarray:
    """Rows of trees along some avenues, on the pavement's edge."""
    rows = []
    for t in plan.avenues_t[random.random(len(plan.avenues_t)) < 0.45]:
        s = np.arange(plan.crossings_s[0] + 12, FAR_M, 13.0)
        s = s[(np.abs(plan.crossings_s[:, None] - s).min(0) > 8) & (random.random(len(s)) < 0.8)]
        rows.append(np.stack([s, np.full(len(s), t + ROAD_HALF_M + PAVEMENT_M)], -1))
    return np.concatenate([np.zeros((0, 2)), *rows])
