# SPDX-License-Identifier: Apache-2.0
"""What every world has: ground, a foreground ahead of the vehicles, trees at their level of detail,
wooded hills."""

from typing import Optional, Tuple

import numpy as np

from fcsv_sim.world import furniture, vegetation
from fcsv_sim.world.materials import GROUND
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.plan import FAR_M, HILLS_END_M, TownPlan


def ground_axes_m() -> Tuple[np.ndarray, np.ndarray]:
    """x (N) and y (M) of the ground's nodes, closer where it is near."""
    return np.concatenate(
        [np.arange(-60, 120, 5.0), np.arange(120, HILLS_END_M + 61, 8.0)]
    ), np.arange(-420, 421, 8.0)


def ground(
    mesh: MeshBuilder, plan: TownPlan, axes_m: Optional[Tuple[np.ndarray, np.ndarray]] = None
) -> None:
    """A height field with nodes at the axes' places."""
    x, y = np.meshgrid(*(axes_m or ground_axes_m()), indexing="ij")
    p = np.stack([x, y, plan.height(x, y)], -1)
    quads = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], 2).reshape(-1, 4, 3)
    mesh.faces(quads, GROUND, mesh.instance([0.1, 0.12, 0.05]), np.zeros((len(quads), 4, 2)))


def foreground(mesh: MeshBuilder, plan: TownPlan, random) -> None:
    """Puts, on the field, 12 to 20 m ahead: a few small trees, bushes, a post; nothing where
    vehicles fly (x < 11 m)."""
    side = random.choice([-1.0, 1.0])
    spots = np.array(
        [
            [13.2, side * random.uniform(4.6, 5.8)],
            [17.5, -side * random.uniform(6.5, 9.0)],
            [20.0, side * random.uniform(12.0, 15.0)],
        ]
    )
    base = np.column_stack([spots, plan.height(*spots.T)])
    vegetation.trees(
        mesh, base, random.uniform([5.4, 5.6, 7.0], [6.4, 7.2, 9.5]), random, 18, 2, 2200
    )
    furniture.lamp_post(
        mesh, Placement(16.0, side * random.uniform(1.2, 2.4), 0.0, -np.pi / 2), 6.4
    )
    x, y = random.uniform(14, 20, 14), random.uniform(-16, 16, 14)
    size = random.uniform(0.3, 0.8, (14, 1)) * [1.0, 1.0, 0.9]
    vegetation.bushes(mesh, np.column_stack([x, y, plan.height(x, y) + 0.2]), size, random, 2)


def plant(mesh: MeshBuilder, plan: TownPlan, spots: np.ndarray, random) -> None:
    """Garden and street trees at their level of detail."""
    spots = spots[np.abs(spots[:, 1]) < plan.half_width(spots[:, 0])]
    base = on_ground(plan, spots[:, 0], spots[:, 1])
    height = random.uniform(4.0, 10.5, len(base)) + np.clip((base[:, 0] - 60) / 60, 0, 2.5)
    height[base[:, 0] < 60] *= 0.8
    for nearest, farthest, blobs, level, leaves in (
        (0, 70, 13, 2, 700),
        (70, 160, 9, 1, 250),
        (160, 900, 5, 1, 0),
    ):
        mine = (base[:, 0] >= nearest) & (base[:, 0] < farthest)
        vegetation.trees(mesh, base[mine], height[mine], random, blobs, level, leaves)


def hills(mesh: MeshBuilder, plan: TownPlan, random) -> None:
    """Woods on the hills, in patches."""
    x, y = random.uniform(FAR_M + 5, HILLS_END_M, 3600), random.uniform(-390, 390, 3600)
    woods = (
        np.sin(x / 31 + plan.ground_phase[0])
        + np.sin(y / 47 + plan.ground_phase[1])
        + random.normal(0, 0.5, 3600)
    )
    x, y = x[woods > -0.35], y[woods > -0.35]
    base = np.column_stack([x, y, plan.height(x, y)])
    vegetation.trees(mesh, base, random.uniform(7, 14, len(x)), random, 3, 0)


def on_ground(plan: TownPlan, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points (K,3) in the world (m) of plan coordinates (K)."""
    y = t + plan.bend(s)
    return np.column_stack([s, y, plan.height(s, y)])
