# SPDX-License-Identifier: Apache-2.0
"""How much of a mapped place is called free, and how much of that is not: the ground against the
truth."""

from dataclasses import dataclass

import numpy as np

from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.robot import Robot
from fcsv_sim.robot.places.mapped import MappedPlace
from fcsv_sim.world.footing import footprints

REACH_M = 40.0  # from the nearest camera whose map knows the cell
OBSTACLE_M = 0.3  # and more above the ground


@dataclass(frozen=True)
class FreeGround:
    """Cells to REACH_M that some map knows: ``free`` are truly so, and ``found`` of these are called
    so; ``called_free`` are called so, and ``not_free`` of these are not; ``obstacles`` are columns
    of OBSTACLE_M and more, and ``missed`` of these are called free."""

    world: str
    seed: int
    free: int
    found: int
    called_free: int
    not_free: int
    obstacles: int
    missed: int


def free_ground(place: MappedPlace, robot: Robot) -> FreeGround:
    """Counts the cells in which ``robot`` can stand by all maps of the place, and in truth."""
    known = place.known(robot)
    inside, free = footprints(place.town.plan, place.clear, known.grid)
    far = [ground.distance_m for ground in place.grounds if ground is not None]
    judged = inside & (np.fmin.reduce(far) <= REACH_M)
    called = judged & (known.stands >= FREE_P)
    x, y = np.moveaxis(known.grid.middle_of(*np.indices(known.grid.shape)), -1, 0)
    row, column, _ = place.footing.grid.cells_of(x, y)
    stands_m = (place.footing.top_m - place.footing.ground_m)[row, column]
    obstacles = judged & (stands_m >= OBSTACLE_M)
    counted = (judged & free, called & free, called, called & ~free, obstacles, called & obstacles)
    return FreeGround(place.world, place.town.seed, *(int(cells.sum()) for cells in counted))
