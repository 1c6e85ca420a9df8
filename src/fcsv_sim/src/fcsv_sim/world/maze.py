# SPDX-License-Identifier: Apache-2.0
"""A maze of low walls (thesis, figure 2.10): dead ends, and a goal that the robot cannot see."""

from dataclasses import dataclass, replace
from typing import List, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_sim.world.materials import CONCRETE
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.place import PlacePlan, Solid, draw_place

_LEFT_OUT = 0.12  # share of the walls of a perfect maze that are left out: some ways meet again
_CLOSED = 0.15  # share of mazes whose goal no way leads to
_COLOURS = ((0.40, 0.36, 0.30), (0.30, 0.14, 0.10), (0.45, 0.44, 0.40), (0.22, 0.24, 0.20))
Cell = Tuple[int, int]


@dataclass(frozen=True)
class _Shape:
    """Cells away from the vehicles and across, and what their sizes are drawn from; how thick walls
    are, how far off the first of them stands, how far before it the robot, how much ground lies
    around, and how many low things on it."""

    deep: int = 6
    wide: int = 6
    pitch_m: Tuple[float, float] = (4.4, 5.4)
    height_m: Tuple[float, float] = (0.6, 1.5)
    thick_m: float = 0.3
    nearest_x_m: float = 22.0
    before_m: float = 2.0
    around_m: float = 3.0
    low_things: int = 0

    @property
    def cells(self) -> List[Cell]:
        return [(i, j) for i in range(self.deep) for j in range(self.wide)]


_SMALL = _Shape(3, 4, (1.5, 1.6), (0.2, 0.25), 0.1, 4.0, 0.6, 1.5)


def build_maze(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """Walls of 0.6 to 1.5 m on level ground; of every seven mazes about one has a goal that is
    walled in."""
    return _build(mesh, random, _Shape())


def build_low_maze(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """Walls of 0.6 to 0.7 m, 17 m deep: one look from 10 m above shows most of its ways."""
    return _build(mesh, random, _Shape(3, 5, (5.6, 6.0), (0.6, 0.7)))


def build_small_maze(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """Walls of 0.2 to 0.25 m, 6 m across, for System I: its vehicles see over them from 2 m, and
    its robot keeps within 4 m of them."""
    return _build(mesh, random, _SMALL)


def build_small_rubble(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """A small maze in which things of 1 to 10 cm lie about."""
    return _build(mesh, random, replace(_SMALL, low_things=40))


def _build(mesh: MeshBuilder, random: np.random.Generator, shape: _Shape) -> PlacePlan:
    pitch = random.uniform(*shape.pitch_m)
    opened = _opened(shape, random)
    goal = _goal(shape, opened, random)
    if random.random() < _CLOSED:
        opened = [pair for pair in opened if goal not in pair]
    half = 0.5 * shape.wide * pitch
    corner = np.array([shape.nearest_x_m, -half])
    entrance = int(random.integers(shape.wide))
    walls = _walls(shape, opened, entrance)
    solids = [_wall(corner, pitch, shape, a, b, random) for a, b in walls]
    near_x, side = shape.nearest_x_m, shape.around_m
    start = (near_x - shape.before_m, float(corner[1] + (entrance + 0.5) * pitch))
    end = tuple(float(v) for v in corner + (np.array(goal) + 0.5) * pitch)
    near_x, far_x = near_x - shape.before_m - 2.0, near_x + shape.deep * pitch + side
    area = (near_x, far_x, -half - side, half + side)
    plan = PlacePlan(
        np.empty(0),
        np.empty(0),
        random.uniform(0, 2 * np.pi, 2),
        random.uniform(0, 2 * np.pi, 6),
        area_m=area,
        start_m=start,
        goal_m=end,
        solids=tuple(solids),
    )
    things = tuple(_low_thing(plan, random) for _ in range(shape.low_things))
    return draw_place(mesh, replace(plan, solids=plan.solids + things), random)


def _opened(shape: _Shape, random: np.random.Generator) -> List[Tuple[Cell, Cell]]:
    """Pairs of neighbouring cells without a wall between: a spanning tree by a random walk that
    turns back at dead ends, and a few more."""
    stack, seen, opened = [(0, 0)], {(0, 0)}, []
    while stack:
        new = [cell for cell in _around(shape, stack[-1]) if cell not in seen]
        if not new:
            stack.pop()
            continue
        cell = new[int(random.integers(len(new)))]
        opened.append(tuple(sorted((stack[-1], cell))))
        seen.add(cell)
        stack.append(cell)
    pairs = ((a, b) for a in shape.cells for b in _around(shape, a) if a < b)
    closed = [pair for pair in pairs if pair not in opened]
    return opened + [pair for pair in closed if random.random() < _LEFT_OUT]


def _around(shape: _Shape, cell: Cell) -> List[Cell]:
    i, j = cell
    return [
        (a, b)
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
        if 0 <= a < shape.deep and 0 <= b < shape.wide
    ]


def _goal(shape: _Shape, opened, random: np.random.Generator) -> Cell:
    """A dead end in the far half, else any cell there."""
    far = [(i, j) for i, j in shape.cells if i >= shape.deep // 2]
    dead = [cell for cell in far if sum(cell in pair for pair in opened) == 1] or far
    return dead[int(random.integers(len(dead)))]


def _walls(shape: _Shape, opened, entrance: int):
    """Ends (in cells) of pieces of wall: all sides of all cells but the opened ones and the
    entrance at the near side."""
    for i in range(max(shape.deep, shape.wide) + 1):
        for j in range(max(shape.deep, shape.wide)):
            is_side = i <= shape.deep and j < shape.wide
            if is_side and not (i == 0 and j == entrance) and ((i - 1, j), (i, j)) not in opened:
                yield (i, j), (i, j + 1)
            if i <= shape.wide and j < shape.deep and ((j, i - 1), (j, i)) not in opened:
                yield (j, i), (j + 1, i)


def _wall(corner: np.ndarray, pitch: float, shape: _Shape, a: Cell, b: Cell, random) -> Solid:
    ends = corner + np.array([a, b]) * pitch
    high = random.uniform(*shape.height_m)
    half = 0.5 * (np.abs(ends[1] - ends[0]) + shape.thick_m)
    colour = np.array(_COLOURS[int(random.integers(len(_COLOURS)))]) * random.uniform(0.7, 1.2)
    middle = np.array([*ends.mean(0), 0.5 * high - 0.15])
    return Solid(middle, np.array([*half, 0.5 * high + 0.15]), np.eye(3), CONCRETE, tuple(colour))


def _low_thing(plan: PlacePlan, random: np.random.Generator) -> Solid:
    x0, x1, y0, y1 = plan.area_m
    spot = random.uniform([x0, y0], [x1, y1])
    while np.hypot(*(spot - plan.start_m)) < 0.5:  # the robot stands there
        spot = random.uniform([x0, y0], [x1, y1])
    half = np.array([*random.uniform(0.04, 0.25, 2), 0.1])
    tilted = Rotation.from_euler("zyx", [random.uniform(0, np.pi), *random.normal(0.0, 0.03, 2)])
    z = float(plan.height(*spot)) + random.uniform(0.01, 0.1) - half[2]
    colour = np.array(_COLOURS[int(random.integers(len(_COLOURS)))]) * random.uniform(0.7, 1.2)
    return Solid(np.array([*spot, z]), half, tilted.as_matrix(), CONCRETE, tuple(colour))
