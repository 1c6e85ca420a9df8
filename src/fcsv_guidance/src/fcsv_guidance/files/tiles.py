# SPDX-License-Identifier: Apache-2.0
"""The ground of a large site, tile by tile: a tile takes the views that show something of it, and
so much around it as a footprint's judgement reaches, so that tiles fit together.

What grows with the number of views, each view's own ground, is held for one tile at a time.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Callable, Dict, List, Sequence, Tuple

import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.files.map_files import layers_of, plain_layers
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import together, tuning
from fcsv_guidance.ground.model import (
    KEPT_PERCENT,
    LAYERS,
    MOST_POINTS,
    Ground,
    ground_of,
    near_points,
    nothing_near,
    points_of,
    stand_probability,
    within,
)
from fcsv_guidance.ground.occupancy import UNKNOWN, occupancy
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.robot import Robot

_TILE_CELLS = 512
_LEAST_TILE_CELLS = 32
_KEPT_POINTS = 1 << 24  # of views between two tiles
_MOST_CELLS = 1 << 21  # of all maps of a tile: some 0.2 GB

Window = Tuple[slice, slice]


@dataclass(frozen=True)
class JudgedGround:
    """The ground with all that is written of it: ``stands`` (rows, columns), the probability that
    the robot can stand; ``occupied`` int8 of an OccupancyGrid; ``layers`` by the names of their
    files."""

    ground: Ground
    stands: np.ndarray
    occupied: np.ndarray
    layers: Dict[str, np.ndarray]


def judged(ground: Ground, robot: Robot) -> JudgedGround:
    """The ground judged for a robot."""
    stands = stand_probability(ground, robot)
    occupied = occupancy(ground, robot, stands)
    return JudgedGround(ground, stands, occupied, layers_of(ground, stands))


def judged_by_tiles(
    views: Sequence[DepthView],
    robot: Robot,
    cell_m: float,
    reach_m: float,
    tile_cells: int = _TILE_CELLS,
    progress: Callable[[float], None] = lambda share: None,
) -> JudgedGround:
    """Judges what ``ground_from`` would make of the views, without each map's own ground; ``progress`` is told the
    share that is done.

    Raises GroundError where no view shows ground, or where the grid or one tile is too large.
    """
    low, high, boxes = [], [], []
    kept = max(2, _KEPT_POINTS // (4 * max(v.depth.size for v in _first(views))))
    points = lru_cache(kept)(lambda number: _points(views, number, cell_m))
    for number in range(len(views)):
        found = points(number)
        boxes.append((found[:, :2].min(0), found[:, :2].max(0)) if len(found) else None)
        near = near_points(found, reach_m)
        if len(near):
            corners = np.percentile(near, KEPT_PERCENT, axis=0)
            low.append(corners[0])
            high.append(corners[1])
    if not low:
        raise nothing_near(reach_m)
    grid = Grid.around(np.min(low, axis=0), np.max(high, axis=0) + cell_m, cell_m)
    names = getattr(views, "names", None) or tuple(v.name for v in views)
    whole = _unknown(grid, names)
    around = _around(robot, cell_m)
    work, size = _windows(grid, tile_cells), float(grid.rows * grid.columns)
    done = 0
    while work:
        window = work.pop()
        outer = _grown(window, around, grid)
        part = grid.part(outer)
        seen = [n for n, box in enumerate(boxes) if box is not None and _meets(part, *box)]
        cut = [(n, _inside(points(n), part)) for n in seen]
        cut = [(n, found) for n, found in cut if len(found)]
        if sum(len(found) for _, found in cut) >= MOST_POINTS:
            work += _quarters(window)
            continue
        if len(cut) * _cells(outer) > _MOST_CELLS and _cells(window) > _LEAST_TILE_CELLS**2:
            work += _quarters(window)  # the average holds all maps' cells at once
            continue
        if cut:
            numbers = np.array([n for n, _ in cut])
            stamps = np.full(len(cut), np.nan)
            tile = ground_of([f for _, f in cut], part, stamps, [names[n] for n in numbers])
            _lay(whole, judged(tile, robot), numbers, window, outer)
        done += _cells(window)
        progress(done / size)
    if not whole.ground.known.any():
        raise nothing_near(reach_m)
    return whole


def _first(views: Sequence[DepthView]) -> List[DepthView]:
    if not len(views):
        raise GroundError("no map was given")
    return [views[0]]


def _points(views: Sequence[DepthView], number: int, cell_m: float) -> np.ndarray:
    """Points of a view; none where it shows nothing that is sure, for others may."""
    try:
        return points_of(views[number], cell_m)
    except GroundError:
        if len(views) == 1:
            raise
        return np.empty((0, 6), np.float32)


def _unknown(grid: Grid, names: Sequence[str]) -> JudgedGround:
    """A grid of which nothing is known yet."""

    def nothing() -> np.ndarray:
        return np.full(grid.shape, np.nan, np.float32)

    layers = {name: nothing() for name in LAYERS}
    seen_s = np.broadcast_to(np.nan, grid.shape)
    seen_by = np.full(grid.shape, -1, np.int32)
    ground = Ground(grid, **layers, seen_s=seen_s, seen_by=seen_by, views=tuple(names))
    stands, occupied = nothing(), np.full(grid.shape, UNKNOWN, np.int8)
    return JudgedGround(ground, stands, occupied, {**plain_layers(ground), "stand": stands})


def _lay(
    whole: JudgedGround, tile: JudgedGround, numbers: np.ndarray, window: Window, outer: Window
) -> None:
    """Writes a tile's ``window`` into the whole; the tile holds ``outer``, ``numbers`` are its
    views'."""
    inner = within(outer, window)
    for name in LAYERS:
        getattr(whole.ground, name)[window] = getattr(tile.ground, name)[inner]
    by = tile.ground.seen_by[inner]
    whole.ground.seen_by[window] = np.where(by >= 0, numbers[by], -1)
    whole.stands[window], whole.occupied[window] = tile.stands[inner], tile.occupied[inner]
    for name, values in tile.layers.items():
        if name not in whole.layers:
            whole.layers[name] = np.full(whole.ground.grid.shape, np.nan, np.float32)
        whole.layers[name][window] = values[inner]


def _around(robot: Robot, cell_m: float) -> int:
    """Cells around a tile that its judgement looks at, a multiple of the coarsest cell's side: a
    footprint and what stands.weighed covers with it, what is beside it, beams, slopes, steps, what
    maps are levelled by."""
    reach_m = 4 * robot.radius_m + 2 * together.WIDE_M + tuning.OVERHEAD_REACH_M
    reach_m += max(robot.radius_m, 1.5 * cell_m) + (3 + together.LEVEL_CELLS) * cell_m
    side = max(tuning.COARSER_SIDES)
    return side * int(np.ceil(reach_m / cell_m / side))


def _windows(grid: Grid, cells: int) -> List[Window]:
    """Tiles of a grid, of which neighbours follow each other; the last comes first."""
    found = [
        (slice(row, min(row + cells, grid.rows)), slice(column, min(column + cells, grid.columns)))
        for row in range(0, grid.rows, cells)
        for column in range(0, grid.columns, cells)
    ]
    return found[::-1]


def _quarters(window: Window) -> List[Window]:
    """Raises GroundError where a tile cannot be smaller."""
    side = max(s.stop - s.start for s in window)
    if side <= _LEAST_TILE_CELLS:
        raise GroundError("too many points show one place; take smaller cells or fewer views")
    half = max(tuning.COARSER_SIDES) * int(np.ceil(side / 2 / max(tuning.COARSER_SIDES)))
    rows, columns = (
        [slice(at, min(at + half, s.stop)) for at in range(s.start, s.stop, half)] for s in window
    )
    return [(r, c) for r in rows for c in columns]


def _grown(window: Window, cells: int, grid: Grid) -> Window:
    rows, columns = (
        slice(max(0, s.start - cells), min(s.stop + cells, n)) for s, n in zip(window, grid.shape)
    )
    return rows, columns


def _meets(part: Grid, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether a box (x, y) reaches into a grid."""
    x0, x1, y0, y1 = part.extent_m
    return bool(low[0] <= x1 and high[0] >= x0 and low[1] <= y1 and high[1] >= y0)


def _inside(points: np.ndarray, part: Grid) -> np.ndarray:
    return points[part.cells_of(points[:, 0], points[:, 1])[2]]


def _cells(window: Window) -> int:
    rows, columns = window
    return (rows.stop - rows.start) * (columns.stop - columns.start)
