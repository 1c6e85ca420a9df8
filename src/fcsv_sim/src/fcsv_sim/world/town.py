# SPDX-License-Identifier: Apache-2.0
"""A whole world out of one seed: ground, streets, buildings, gardens, hills; of one of several
kinds."""

from dataclasses import dataclass
from typing import Callable, Dict

import numpy as np

from fcsv_sim.errors import SimulationError
from fcsv_sim.world.field import build_field
from fcsv_sim.world.maze import build_low_maze, build_maze, build_small_maze, build_small_rubble
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.plan import TownPlan
from fcsv_sim.world.rubble import build_rubble
from fcsv_sim.world.street import build_plain, build_street
from fcsv_sim.world.village import build_village

#: Kinds of worlds. All leave the field up to x = 10 m free for vehicles and show something at every
#: range.
WORLDS: Dict[str, Callable[[MeshBuilder, np.random.Generator], TownPlan]] = {
    "street": build_street,  # a town
    "village": build_village,  # scattered houses, gardens, lanes
    "field": build_field,  # open farmland with tree lines
    "plain": build_plain,  # the town with blank walls, on snow or sand: little texture
}

#: Kinds of worlds for a robot on the ground: their plan is a PlacePlan.
PLACES: Dict[str, Callable[[MeshBuilder, np.random.Generator], TownPlan]] = {
    "maze": build_maze,
    "low_maze": build_low_maze,  # that one look from above shows
    "small_maze": build_small_maze,  # for System I's robot, with gimbals
    "small_rubble": build_small_rubble,
    "rubble": build_rubble,
}


@dataclass(frozen=True)
class Town:
    """Mesh in the world frame (m): vertices (N,3) f32, triangles (M,3) i32, uv (N,2) f32 in metres
    per vertex, material (M) u8 and instance (M) i32 per triangle, and the instances' parameters (I,
    COLUMNS) f32."""

    seed: int
    plan: TownPlan
    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    instance: np.ndarray
    parameters: np.ndarray

    @classmethod
    def generate(cls, seed: int, world: str = "street") -> "Town":
        """The same world for the same seed and kind, on every machine. Raises SimulationError on an
        unknown kind."""
        worlds = {**WORLDS, **PLACES}
        if world not in worlds:
            raise SimulationError(f"world '{world}' is not one of {', '.join(worlds)}")
        random = np.random.default_rng([seed, 1])
        mesh = MeshBuilder()
        plan = worlds[world](mesh, random)
        return cls(seed, plan, *mesh.build())
