# SPDX-License-Identifier: Apache-2.0
"""A whole town out of one seed: ground, streets, buildings, gardens, hills."""

from dataclasses import dataclass

import numpy as np

from fcsv_sim.world import furniture, vegetation
from fcsv_sim.world.buildings import Body, block, hall, house
from fcsv_sim.world.materials import GROUND
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.plan import FAR_M, HILLS_END_M, PAVEMENT_M, ROAD_HALF_M, Parcel, TownPlan


@dataclass(frozen=True)
class Town:
    """Mesh in the world frame (m): vertices (N,3) f32, triangles (M,3) i32, uv (N,2) f32 in metres per vertex,
    material (M) u8 and instance (M) i32 per triangle, and the instances' parameters (I, COLUMNS) f32."""

    seed: int
    plan: TownPlan
    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    instance: np.ndarray
    parameters: np.ndarray

    @classmethod
    def generate(cls, seed: int) -> "Town":
        """The same town for the same seed, on every machine."""
        random = np.random.default_rng([seed, 1])
        plan = TownPlan.draw(random)
        mesh = MeshBuilder()
        _ground(mesh, plan)
        garden_trees = _parcels(mesh, plan, random)
        _streets(mesh, plan, random)
        _foreground(mesh, plan, random)
        _plant(mesh, plan, np.concatenate([garden_trees, _street_trees(plan, random)]), random)
        _hills(mesh, plan, random)
        return cls(seed, plan, *mesh.build())


def _ground(mesh: MeshBuilder, plan: TownPlan) -> None:
    """A height field, finer where it is near."""
    xs = np.concatenate([np.arange(-60, 120, 5.0), np.arange(120, HILLS_END_M + 61, 8.0)])
    ys = np.arange(-420, 421, 8.0)
    x, y = np.meshgrid(xs, ys, indexing="ij")
    p = np.stack([x, y, plan.height(x, y)], -1)
    quads = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], 2).reshape(-1, 4, 3)
    mesh.faces(quads, GROUND, mesh.instance([0.1, 0.12, 0.05]), np.zeros((len(quads), 4, 2)))


def _parcels(mesh: MeshBuilder, plan: TownPlan, random) -> np.ndarray:
    """A building or a green on every plot; returns where garden trees stand, (K, 2) in plan coordinates."""
    spots = [np.zeros((0, 2))]
    parcels = plan.parcels(random)
    wall_at = min(
        parcels, key=lambda p: abs(p.s - 78.0) + abs(p.t - plan.avenues_t[6] + np.sign(plan.bend_phase[0] - 3) * 24.0)
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
            _built(mesh, plan, parcel, random)
            spots.append(_spread(parcel, random, random.integers(1, 4)))
            _boundary(mesh, plan, parcel, random)
    return np.concatenate(spots)


def _built(mesh: MeshBuilder, plan: TownPlan, parcel: Parcel, random) -> None:
    """Low and sparse in front, higher towards the back and the sides."""
    tall = random.random() < np.clip((parcel.s - 150) / 350 + (abs(parcel.t) - 30) / 500, 0.0, 0.6)
    depth = min(random.uniform(8.5, 12.0), parcel.depth_m - 5.0)
    back = random.uniform(2.0, 5.0)
    t = parcel.t + parcel.front * (parcel.depth_m / 2 - back - depth / 2)
    x, y, z = plan.world(parcel.s, t)
    place = Placement(x, y, z + 0.2, plan.heading(x) + np.radians(random.normal(0.0, 2.0)))
    if tall:
        floors = int(random.integers(3, 6) + random.uniform(0.0, 4.5) * np.clip((parcel.s - 120) / 250, 0.0, 1.0))
        block(
            mesh,
            place,
            Body(parcel.length_m - random.uniform(1.5, 5.0), depth + 2, floors, random.uniform(2.8, 3.2)),
            random,
        )
        return
    most = 1.5 if parcel.s < 45 and abs(parcel.t) < 30 else 2.6 if parcel.s < 90 else 3.8
    length = min(parcel.length_m - random.uniform(2.5, 5.5), 15.0)
    house(mesh, place, Body(length, depth, max(1, int(random.uniform(1.0, most))), random.uniform(2.6, 3.1)), random)


def _spread(parcel: Parcel, random, count: int) -> np.ndarray:
    """Tree spots in the garden behind the building."""
    s = parcel.s + random.uniform(-0.42, 0.42, count) * parcel.length_m
    t = parcel.t - parcel.front * random.uniform(0.15, 0.46, count) * parcel.depth_m
    return np.stack([s, t], -1)


def _boundary(mesh: MeshBuilder, plan: TownPlan, parcel: Parcel, random) -> None:
    """Hedge or fence towards the street and along one side; far ones would not be seen."""
    if parcel.s > 260 or random.random() < 0.25:
        return
    half, front = parcel.length_m / 2 - 0.4, parcel.t + parcel.front * (parcel.depth_m / 2 - 0.4)
    rear = parcel.t - parcel.front * (parcel.depth_m / 2 - 0.3)
    line = np.array([[parcel.s - half, rear], [parcel.s - half, front], [parcel.s + half * 0.5, front]])
    s = np.concatenate([np.linspace(a, b, 7) for a, b in zip(line[:-1, 0], line[1:, 0])])
    t = np.concatenate([np.linspace(a, b, 7) for a, b in zip(line[:-1, 1], line[1:, 1])])
    if random.random() < 0.5:
        furniture.fence(mesh, _on_ground(plan, s, t), random.uniform(0.9, 1.7), random)
        return
    fine = np.linspace(0, len(s) - 1, 30)
    middle = _on_ground(plan, np.interp(fine, np.arange(len(s)), s), np.interp(fine, np.arange(len(t)), t))
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
                furniture.lamp_post(mesh, Placement(x, y, z, plan.heading(x)), random.uniform(5.5, 7.0))
        for s in np.arange(plan.crossings_s[0] + 7, min(FAR_M, 330.0), 6.5):
            if abs(t) < plan.half_width(s) and np.abs(plan.crossings_s - s).min() > 7 and random.random() < 0.4:
                _park(
                    mesh, plan, s + random.uniform(-0.6, 0.6), t + random.choice([-1, 1]) * (ROAD_HALF_M - 1.05), random
                )
    s = plan.crossings_s[0]
    for t in np.arange(-60.0, 61.0, 7.0):
        if np.abs(plan.avenues_t - t).min() > 8 and random.random() < 0.45:
            _park(mesh, plan, s + ROAD_HALF_M - 1.05, t, random, np.pi / 2)


def _park(mesh, plan: TownPlan, s: float, t: float, random, turn: float = 0.0) -> None:
    x, y, z = plan.world(s, t)
    heading = plan.heading(x) + turn + random.choice([0, np.pi]) + np.radians(random.normal(0, 2))
    furniture.car(mesh, Placement(x, y, z + 0.02, heading), random)


def _foreground(mesh: MeshBuilder, plan: TownPlan, random) -> None:
    """On the field, 12 to 20 m ahead: a few small trees, bushes, a post; nothing where vehicles fly (x < 11 m)."""
    side = random.choice([-1.0, 1.0])
    spots = np.array([[13.2, side * random.uniform(4.6, 5.8)], [17.5, -side * random.uniform(6.5, 9.0)],
                      [20.0, side * random.uniform(12.0, 15.0)]])  # fmt: skip
    base = np.column_stack([spots, plan.height(*spots.T)])
    vegetation.trees(mesh, base, random.uniform([5.4, 5.6, 7.0], [6.4, 7.2, 9.5]), random, 18, 2, 2200)
    furniture.lamp_post(mesh, Placement(16.0, side * random.uniform(1.2, 2.4), 0.0, -np.pi / 2), 6.4)
    x, y = random.uniform(14, 20, 14), random.uniform(-16, 16, 14)
    size = random.uniform(0.3, 0.8, (14, 1)) * [1.0, 1.0, 0.9]
    vegetation.bushes(mesh, np.column_stack([x, y, plan.height(x, y) + 0.2]), size, random, 2)


def _street_trees(plan: TownPlan, random) -> np.ndarray:
    """Rows of trees along some avenues, on the pavement's edge."""
    rows = []
    for t in plan.avenues_t[random.random(len(plan.avenues_t)) < 0.45]:
        s = np.arange(plan.crossings_s[0] + 12, FAR_M, 13.0)
        s = s[(np.abs(plan.crossings_s[:, None] - s).min(0) > 8) & (random.random(len(s)) < 0.8)]
        rows.append(np.stack([s, np.full(len(s), t + ROAD_HALF_M + PAVEMENT_M)], -1))
    return np.concatenate([np.zeros((0, 2)), *rows])


def _plant(mesh: MeshBuilder, plan: TownPlan, spots: np.ndarray, random) -> None:
    """Garden and street trees at their level of detail."""
    spots = spots[np.abs(spots[:, 1]) < plan.half_width(spots[:, 0])]
    base = _on_ground(plan, spots[:, 0], spots[:, 1])
    height = random.uniform(4.0, 10.5, len(base)) + np.clip((base[:, 0] - 60) / 60, 0, 2.5)
    height[base[:, 0] < 60] *= 0.8
    for nearest, farthest, blobs, level, leaves in ((0, 70, 13, 2, 700), (70, 160, 9, 1, 250), (160, 900, 5, 1, 0)):
        mine = (base[:, 0] >= nearest) & (base[:, 0] < farthest)
        vegetation.trees(mesh, base[mine], height[mine], random, blobs, level, leaves)


def _hills(mesh: MeshBuilder, plan: TownPlan, random) -> None:
    """Woods on the hills, in patches."""
    x, y = random.uniform(FAR_M + 5, HILLS_END_M, 3600), random.uniform(-390, 390, 3600)
    woods = np.sin(x / 31 + plan.ground_phase[0]) + np.sin(y / 47 + plan.ground_phase[1]) + random.normal(0, 0.5, 3600)
    x, y = x[woods > -0.35], y[woods > -0.35]
    base = np.column_stack([x, y, plan.height(x, y)])
    vegetation.trees(mesh, base, random.uniform(7, 14, len(x)), random, 3, 0)


def _on_ground(plan: TownPlan, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    y = t + plan.bend(s)
    return np.column_stack([s, y, plan.height(s, y)])
