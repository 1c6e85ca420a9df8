# SPDX-License-Identifier: Apache-2.0
"""A field of rubble: blocks, pits, heaps, a fallen beam to pass under, ground of little texture."""

from dataclasses import dataclass, field, replace
from typing import List

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_sim.world.materials import CONCRETE
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.place import PlacePlan, Solid, draw_place
from fcsv_sim.world.plan import Cover, TownPlan

_AREA_M = (18.0, 54.0, -16.0, 16.0)
_DUST = Cover((0.36, 0.34, 0.31), 0.75)
_BLOCKS, _HEAPS, _PITS = 70, 8, 6
_CLEAR_M = 2.5  # around start and goal
_PIT_EDGE_M = 0.3


@dataclass(frozen=True)
class RubblePlan(PlacePlan):
    """``heaps`` (N,4): x, y, height, sigma (m) of Gaussian heaps; ``pits`` (M,4): x, y, depth,
    radius (m)."""

    heaps: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    pits: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))

    def height(self, x, y):
        """Ground (m)."""
        z = TownPlan.height(self, x, y)
        for x0, y0, high, sigma in self.heaps:
            z = z + high * np.exp(-0.5 * ((x - x0) ** 2 + (y - y0) ** 2) / sigma**2)
        for x0, y0, deep, radius in self.pits:
            inside = np.clip(
                (radius - np.hypot(np.subtract(x, x0), np.subtract(y, y0))) / _PIT_EDGE_M, 0.0, 1.0
            )
            z = z - deep * inside**2 * (3.0 - 2.0 * inside)
        return z


def build_rubble(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """Start at the near side, goal at the far one."""
    start, goal = (20.0, random.uniform(-6, 6)), (51.0, random.uniform(-11, 11))
    kept = np.array([start, goal])
    heaps = np.column_stack(
        [
            _spots(random, _HEAPS, kept, 6.0),
            random.uniform(0.3, 1.3, _HEAPS),
            random.uniform(1.2, 3.0, _HEAPS),
        ]
    )
    pits = np.column_stack(
        [
            _spots(random, _PITS, kept, 4.0),
            random.uniform(0.4, 1.0, _PITS),
            random.uniform(0.8, 1.8, _PITS),
        ]
    )
    phases = random.uniform(0, 2 * np.pi, 2), random.uniform(0, 2 * np.pi, 6)
    bare = RubblePlan(
        np.empty(0),
        np.empty(0),
        *phases,
        cover=_DUST,
        area_m=_AREA_M,
        start_m=start,
        goal_m=goal,
        heaps=heaps,
        pits=pits,
    )
    solids = [_block(bare, spot, random) for spot in _spots(random, _BLOCKS, kept, _CLEAR_M)]
    solids += _beam(bare, _spots(random, 1, kept, 5.0)[0], random)
    return draw_place(mesh, replace(bare, solids=tuple(solids)), random)


def _spots(random: np.random.Generator, count: int, kept: np.ndarray, apart_m: float) -> np.ndarray:
    """(count,2) m in the area, none nearer than that to ``kept``."""
    x0, x1, y0, y1 = _AREA_M
    tried = np.column_stack(
        [random.uniform(x0 + 1, x1 - 1, 20 * count), random.uniform(y0 + 1, y1 - 1, 20 * count)]
    )
    return tried[np.hypot(*np.moveaxis(tried[:, None] - kept, -1, 0)).min(1) > apart_m][:count]


def _block(plan: PlacePlan, spot: np.ndarray, random: np.random.Generator) -> Solid:
    half = random.uniform([0.12, 0.12, 0.08], [0.8, 0.6, 0.6])
    turned = Rotation.from_euler(
        "zyx", [random.uniform(0, np.pi), *random.normal(0.0, 0.12, 2)]
    ).as_matrix()
    # its lowest edges lie in the ground
    z = float(plan.height(*spot)) + half[2] - 0.05 - 0.2 * max(half[:2])
    return Solid(np.array([*spot, z]), half, turned, CONCRETE, _grey(random))


def _beam(plan: PlacePlan, spot: np.ndarray, random: np.random.Generator) -> List[Solid]:
    """A beam of 6 m on two posts; its lower edge is 0.9 to 1.2 m above the highest ground below
    it."""
    yaw, length = random.uniform(0, np.pi), 6.0
    turned = Rotation.from_euler("z", yaw).as_matrix()
    along = turned[:2, 0] * 0.5 * (length - 0.5)
    line = spot + np.linspace(-1, 1, 30)[:, None] * along
    bottom = float(plan.height(*line.T).max()) + random.uniform(0.9, 1.2)
    solids = [
        Solid(
            np.array([*spot, bottom + 0.15]),
            np.array([0.5 * length, 0.15, 0.15]),
            turned,
            CONCRETE,
            _grey(random),
        )
    ]
    for end in (spot - along, spot + along):
        low = float(plan.height(*end)) - 0.3
        half = np.array([0.25, 0.25, 0.5 * (bottom - low)])
        solids.append(
            Solid(np.array([*end, 0.5 * (bottom + low)]), half, turned, CONCRETE, _grey(random))
        )
    return solids


def _grey(random: np.random.Generator):
    return tuple(
        np.array([0.42, 0.40, 0.37]) * random.uniform(0.6, 1.3) * random.uniform(0.93, 1.07, 3)
    )
