# SPDX-License-Identifier: Apache-2.0
"""A maze of low walls (thesis, figure 2.10): dead ends, and a goal that the robot cannot see."""

from typing import List, Tuple

import numpy as np

from fcsv_sim.world.materials import CONCRETE
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.place import PlacePlan, Solid, draw_place

_CELLS = 6
_PITCH_M = (4.4, 5.4)
_THICK_M = 0.3
_HEIGHT_M = (0.6, 1.5)
_LEFT_OUT = 0.12  # share of the walls of a perfect maze that are left out: some ways meet again
_CLOSED = 0.15  # share of mazes whose goal no way leads to
_NEAREST_X_M = 22.0
_COLOURS = ((0.40, 0.36, 0.30), (0.30, 0.14, 0.10), (0.45, 0.44, 0.40), (0.22, 0.24, 0.20))
Cell = Tuple[int, int]


def build_maze(mesh: MeshBuilder, random: np.random.Generator) -> PlacePlan:
    """Walls of 0.6 to 1.5 m on level ground; of every seven mazes about one has a goal that is
    walled in."""
    pitch = random.uniform(*_PITCH_M)
    opened = _opened(random)
    goal = _goal(opened, random)
    if random.random() < _CLOSED:
        opened = [pair for pair in opened if goal not in pair]
    half = 0.5 * _CELLS * pitch
    corner = np.array([_NEAREST_X_M, -half])
    entrance = int(random.integers(_CELLS))
    solids = [_wall(corner, pitch, a, b, random) for a, b in _walls(opened, entrance)]
    start = (_NEAREST_X_M - 2.0, float(corner[1] + (entrance + 0.5) * pitch))
    end = tuple(float(v) for v in corner + (np.array(goal) + 0.5) * pitch)
    area = (_NEAREST_X_M - 4.0, _NEAREST_X_M + 2 * half + 3.0, -half - 3.0, half + 3.0)
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
    return draw_place(mesh, plan, random)


def _opened(random: np.random.Generator) -> List[Tuple[Cell, Cell]]:
    """Pairs of neighbouring cells without a wall between: a spanning tree by a random walk that
    turns back at dead ends, and a few more."""
    inside = [(i, j) for i in range(_CELLS) for j in range(_CELLS)]
    stack, seen, opened = [(0, 0)], {(0, 0)}, []
    while stack:
        new = [cell for cell in _around(stack[-1]) if cell not in seen]
        if not new:
            stack.pop()
            continue
        cell = new[int(random.integers(len(new)))]
        opened.append(tuple(sorted((stack[-1], cell))))
        seen.add(cell)
        stack.append(cell)
    closed = [(a, b) for a in inside for b in _around(a) if a < b and (a, b) not in opened]
    return opened + [pair for pair in closed if random.random() < _LEFT_OUT]


def _around(cell: Cell) -> List[Cell]:
    i, j = cell
    return [
        (a, b)
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
        if 0 <= a < _CELLS and 0 <= b < _CELLS
    ]


def _goal(opened, random: np.random.Generator) -> Cell:
    """A dead end in the far half, else any cell there."""
    far = [(i, j) for i in range(_CELLS // 2, _CELLS) for j in range(_CELLS)]
    dead = [cell for cell in far if sum(cell in pair for pair in opened) == 1] or far
    return dead[int(random.integers(len(dead)))]


def _walls(opened, entrance: int):
    """Ends (in cells) of pieces of wall: all sides of all cells but the opened ones and the
    entrance at the near side."""
    for i in range(_CELLS + 1):
        for j in range(_CELLS):
            if not (i == 0 and j == entrance) and ((i - 1, j), (i, j)) not in opened:
                yield (i, j), (i, j + 1)
            if ((j, i - 1), (j, i)) not in opened:
                yield (j, i), (j + 1, i)


def _wall(corner: np.ndarray, pitch: float, a: Cell, b: Cell, random: np.random.Generator) -> Solid:
    ends = corner + np.array([a, b]) * pitch
    high = random.uniform(*_HEIGHT_M)
    half = 0.5 * (np.abs(ends[1] - ends[0]) + _THICK_M)
    colour = np.array(_COLOURS[int(random.integers(len(_COLOURS)))]) * random.uniform(0.7, 1.2)
    middle = np.array([*ends.mean(0), 0.5 * high - 0.15])
    return Solid(middle, np.array([*half, 0.5 * high + 0.15]), np.eye(3), CONCRETE, tuple(colour))
