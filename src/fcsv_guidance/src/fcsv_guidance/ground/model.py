# SPDX-License-Identifier: Apache-2.0
"""The ground model: what is known of the ground in a grid of home, and where a robot can stand.

A cell that no pixel's surface touched is unknown: it is neither free nor an obstacle, and nothing
fills it.
"""

from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.special import ndtr

from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import kernels, standing, together, tuning
from fcsv_guidance.ground.views import FARTHEST_M, DepthView
from fcsv_guidance.robot import Robot
from fcsv_stereo.model.kinds import MOST_PAIRS

MOST_POINTS = 1 << kernels.INDEX_BITS  # of one grid
KEPT_PERCENT = (0.2, 99.8)  # of x and of y: a stray point must not make the grid large
_LARGEST_SIGMA_SHARE = 0.2  # of the depth: a pixel that says less is left out
LAYERS = (
    "height_m",
    "sigma_m",
    "low_m",
    "high_m",
    "roughness_m",
    "overhead_m",
    "trust",
    "distance_m",
)


@dataclass(frozen=True)
class Ground:
    """Layers of ``grid`` (rows, columns), NaN where unknown. In m above home: ``height_m`` of the
    lowest layer, its ``sigma_m``, lower and upper edge ``low_m`` and ``high_m``, ``roughness_m``
    (spread of its points), ``overhead_m`` (bottom of what hangs above, inf where nothing does).
    ``trust`` is the probability that the cell's points are no gross errors, ``distance_m`` the
    camera's distance, ``seen_s`` when it was seen last (NaN: not told), ``seen_by`` the index in
    ``views`` (-1 where unknown). ``maps``: the ground as each of several maps alone shows it: their
    heights differ by errors of pose, so that steps are looked for in each.
    """

    grid: Grid
    height_m: np.ndarray
    sigma_m: np.ndarray
    low_m: np.ndarray
    high_m: np.ndarray
    roughness_m: np.ndarray
    overhead_m: np.ndarray
    trust: np.ndarray
    distance_m: np.ndarray
    seen_s: np.ndarray
    seen_by: np.ndarray
    views: Tuple[str, ...] = ()
    maps: Tuple["Ground", ...] = ()

    @property
    def known(self) -> np.ndarray:
        """(rows, columns) bool."""
        return np.isfinite(self.height_m)

    @property
    def free_height_m(self) -> np.ndarray:
        """Measures the height from the ground's upper edge to what hangs above; inf where nothing
        does, NaN where unknown.

        A view from above shows the upper side of a beam, and its lower edge only at its near side:
        so the lowest that hangs within ``OVERHEAD_REACH_M``, at most ``OVERHEAD_CELLS``, counts.
        """
        reach_m = min(tuning.OVERHEAD_REACH_M, tuning.OVERHEAD_CELLS * self.grid.cell_m)
        n = int(np.ceil(reach_m / self.grid.cell_m - 1e-9))
        hangs = np.where(self.known, self.overhead_m, np.inf).astype(np.float32)
        return (
            standing.least(hangs, np.ones((2 * n + 1, 2 * n + 1), np.uint8), np.inf) - self.high_m
        )

    @property
    def step_m(self) -> np.ndarray:
        """Largest difference of height to one of eight known neighbours; NaN where unknown."""
        return _largest_step(self.height_m, self.sigma_m)[0]

    def part(self, window: Tuple[slice, slice]) -> "Ground":
        """The ground of a window (rows, columns) of its grid, without maps."""
        names = (*LAYERS, "seen_s", "seen_by")
        layers = {name: getattr(self, name)[window] for name in names}
        return replace(self, grid=self.grid.part(window), maps=(), **layers)

    def slope(self, radius_m: float = 0.0) -> np.ndarray:
        """Rise over run of the plane through the known cells within ``radius_m``; NaN where they
        span no plane."""
        return _plane_slope(self.height_m, self.grid.cell_m, radius_m)


def ground_from(
    views: Sequence[DepthView],
    cell_m: float = 0.1,
    grid: Optional[Grid] = None,
    reach_m: float = 60.0,
) -> Ground:
    """The ground that the views show together; ``grid`` is laid around what they see up to
    ``reach_m`` from their cameras unless it is given.

    Raises GroundError where no pixel has a depth, a sigma and a pair that supports it.
    """
    if not views:
        raise GroundError("no map was given")
    points = [points_of(view, cell_m if grid is None else grid.cell_m) for view in views]
    if grid is None:
        near = near_points(np.concatenate(points), reach_m)
        if not len(near):
            raise nothing_near(reach_m)
        low, high = np.percentile(near, KEPT_PERCENT, axis=0)
        grid = Grid.around(low, high + cell_m, cell_m)
    stamps = np.array([view.stamp_s for view in views])
    return ground_of(points, grid, stamps, [view.name for view in views])


def near_points(points: np.ndarray, reach_m: float) -> np.ndarray:
    """(M,2) x, y of those of a view's ``points_of`` that lie within ``reach_m`` of its camera."""
    return points[points[:, 4] <= reach_m, :2]


def nothing_near(reach_m: float) -> GroundError:
    """The error where no map has such a point."""
    return GroundError(
        f"no map shows anything within {reach_m:g} m of its camera; give a larger reach"
    )


def ground_of(
    points: Sequence[np.ndarray], grid: Grid, stamps: np.ndarray, names: Sequence[str]
) -> Ground:
    """The ground that the ``points_of`` views show together in a grid; when (s) and by which name
    each view was seen. Raises GroundError where they are too many for one grid."""
    ground = _summarised(np.concatenate(points), grid)
    seen_by = _seen_by(points, grid, ground.known)
    seen_s = np.where(seen_by >= 0, stamps[seen_by], np.nan)
    alone = tuple(_summarised(part, grid) for part in points) if len(points) > 1 else ()
    return replace(ground, seen_s=seen_s, seen_by=seen_by, views=tuple(names), maps=alone)


def renewed(ground: Ground, view: DepthView) -> Ground:
    """The ground with the cells that an instant shows replaced by what it shows; all others stay as
    they are."""
    new = _summarised(points_of(view, ground.grid.cell_m), ground.grid)
    layers = {
        name: np.where(new.known, getattr(new, name), getattr(ground, name)) for name in LAYERS
    }
    before = tuple(_without(part, new.known) for part in ground.maps or (ground,))
    seen_s = np.where(new.known, view.stamp_s, ground.seen_s)
    seen_by = np.where(new.known, len(ground.views), ground.seen_by)
    return replace(
        ground,
        **layers,
        maps=(*before, new),
        views=(*ground.views, view.name),
        seen_s=seen_s,
        seen_by=seen_by,
    )


def window_of(cells: np.ndarray, more: int) -> Tuple[slice, slice]:
    """Rows and columns of the smallest window that holds all ``cells`` (bool), at least one, and
    ``more`` cells around, cut at the edges.

    >>> window_of(np.eye(9, dtype=bool)[:, ::-1] & (np.arange(9) == 4), 2)
    (slice(2, 7, None), slice(2, 7, None))
    """
    found = []
    for axis in (1, 0):
        at = np.flatnonzero(cells.any(axis))
        found.append(
            slice(max(0, int(at[0]) - more), min(cells.shape[1 - axis], int(at[-1]) + more + 1))
        )
    return found[0], found[1]


def within(outer: Tuple[slice, slice], inner: Tuple[slice, slice]) -> Tuple[slice, slice]:
    """The ``inner`` window as counted from the first row and column of the ``outer``."""
    rows, columns = (slice(i.start - o.start, i.stop - o.start) for o, i in zip(outer, inner))
    return rows, columns


def cell_probability(ground: Ground, robot: Robot) -> np.ndarray:
    """(rows, columns): probability that the robot's wheel can be in the cell; NaN where unknown.

    A lone cell, whose slope nothing tells, is unknown unless what is seen of it is an obstacle.
    """
    step, step_sigma = _largest_step(ground.height_m, ground.sigma_m)
    half = standing.slope_radius_m(ground, robot)
    within = ground.high_m - ground.low_m
    parts = [
        _below(step, robot.largest_step_m, step_sigma),
        _below(within, robot.largest_step_m, np.sqrt(2.0) * ground.sigma_m),
        _below(ground.slope(half), robot.largest_slope, standing.slope_sigma(ground, half)),
        _below(-ground.free_height_m, -robot.height_m, np.sqrt(2.0) * ground.sigma_m),
    ]
    p = np.nanmin(np.where(ground.known, parts, 0.0), axis=0) * ground.trust
    judged = ground.known & (np.isfinite(parts[2]) | (p <= tuning.OBSTACLE_P))
    return np.where(judged, p, np.nan)


def stand_probability(ground: Ground, robot: Robot) -> np.ndarray:
    """(rows, columns): calibrated probability that the robot can stand with its middle in the cell;
    NaN where unknown. What drives goes by the same (known.KnownGround).

    It is unknown where no map knows all cells below the footprint, unless one shows an obstacle
    there, or free footprints cover it. Maps are judged by their average (together.probability), and
    where that is not learnt weighed by number (standing.weighed).
    """
    maps = ground.maps or (ground,)
    each, whole = zip(*(standing.by_one(alone, robot) for alone in maps))
    around = standing.disk(robot.radius_m, ground.grid.cell_m)
    return standing.weighed(each, whole, around, together.probability(maps, robot))


def _without(ground: Ground, cells: np.ndarray) -> Ground:
    """The ground with ``cells`` (rows, columns) made unknown."""
    return replace(
        ground, maps=(), **{name: np.where(cells, np.nan, getattr(ground, name)) for name in LAYERS}
    )


def _below(value: np.ndarray, bound: float, sigma: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return ndtr((bound - value) / sigma)


def sure_depth(view: DepthView) -> np.ndarray:
    """(H,W) float32 m, NaN where a pixel has no depth that a pair supports, or a large sigma. A
    depth is above 0 and below FARTHEST_M, its sigma above 0.

    Raises GroundError where none has one.
    """
    depth, sigma = view.depth.astype(np.float32), view.sigma.astype(np.float32)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        sure = (depth > 0) & (depth < FARTHEST_M)
        sure &= (sigma > 0) & (sigma < _LARGEST_SIGMA_SHARE * depth)
        sure &= (view.kind >= 1) & (view.kind <= MOST_PAIRS)
    if not sure.any():
        raise GroundError(
            f"{view.name}: no pixel has a depth with sigma that a pair supports (depth above 0 "
            f"and below {FARTHEST_M:.0f} m, sigma above 0); map it again"
        )
    return np.where(sure, depth, np.nan).astype(np.float32)


def points_of(view: DepthView, cell_m: float) -> np.ndarray:
    """(N,6) float32 as ``kernels.points_of_view`` gives them: x, y, z, sigma of z, distance (m),
    whether pairs agree. Raises GroundError where the view has no sure depth."""
    depth = sure_depth(view)
    R, p = (
        np.ascontiguousarray(view.T_home_cam[:3, :3], float),
        np.ascontiguousarray(view.T_home_cam[:3, 3], float),
    )
    return kernels.points_of_view(
        depth,
        view.sigma.astype(np.float32),
        view.kind.astype(np.uint8),
        MOST_PAIRS,
        np.ascontiguousarray(view.K, float),
        R,
        p,
        tuning.SPAN_FACTOR,
        tuning.LONGEST_SPAN_M,
        cell_m,
    )


def _summarised(points: np.ndarray, grid: Grid) -> Ground:
    if len(points) >= MOST_POINTS:
        raise GroundError(
            f"{len(points)} points are too many for one grid; give fewer maps at once"
        )
    z0_m = float(np.percentile(points[::16, 2], 1)) - 20.0 if len(points) else 0.0
    keys = kernels.keys_of(points, grid.x0_m, grid.y0_m, z0_m, grid.cell_m, grid.rows, grid.columns)
    keys.sort()
    out = kernels.lowest_layers(
        keys,
        points,
        grid.rows * grid.columns,
        tuning.LAYER_GAP_M,
        tuning.LEAST_POINTS,
        tuning.LOW_QUANTILE,
        tuning.HIGH_QUANTILE,
        tuning.COMMON_SHARE,
        tuning.GROSS_ONE_PAIR,
        tuning.GROSS_AGREED,
    )
    out = out.reshape(*grid.shape, len(LAYERS))
    for side in tuning.COARSER_SIDES:
        kernels.coarser_where_sparse(out, side, tuning.COARSER_SHARE)
    layers = {name: np.ascontiguousarray(out[..., i]) for i, name in enumerate(LAYERS)}
    nowhere = np.full(grid.shape, -1)
    return Ground(grid, **layers, seen_s=np.full(grid.shape, np.nan), seen_by=nowhere)


def _seen_by(points: Sequence[np.ndarray], grid: Grid, known: np.ndarray) -> np.ndarray:
    """Index of the last view with a point in the cell; -1 where unknown."""
    seen = np.full(grid.shape, -1)
    for i, of_view in enumerate(points):
        row, column, inside = grid.cells_of(of_view[:, 0], of_view[:, 1])
        seen[row[inside], column[inside]] = i
    return np.where(known, seen, -1)


def _largest_step(height: np.ndarray, sigma: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Largest difference to a neighbour (m), 0 where none is known, and its sigma; NaN where
    unknown."""
    step, step_sigma = np.where(np.isfinite(height), np.float32(0), np.nan), np.array(sigma)
    rows, columns = height.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, rows - dy), slice(max(0, -dx), columns - max(0, dx)))
        b = (slice(dy, rows), slice(max(0, dx), columns - max(0, -dx)))
        apart, both = np.abs(height[a] - height[b]), np.hypot(sigma[a], sigma[b])
        for side in (a, b):
            with np.errstate(invalid="ignore"):
                larger = apart > step[side]
            step[side] = np.where(larger, apart, step[side])
            step_sigma[side] = np.where(larger, both, step_sigma[side])
    return step, step_sigma


def _plane_slope(height: np.ndarray, cell_m: float, radius_m: float) -> np.ndarray:
    known = np.isfinite(height)
    n = max(1, int(round(radius_m / cell_m)))
    side = (2 * n + 1, 2 * n + 1)
    middle = float(np.median(height[known])) if known.any() else 0.0
    w, z = known.astype(float), np.where(known, height - middle, 0.0).astype(float)
    y, x = np.mgrid[0 : height.shape[0], 0 : height.shape[1]] * cell_m

    def mean(v):
        return cv2.boxFilter(v, -1, side, normalize=True, borderType=cv2.BORDER_CONSTANT)

    with np.errstate(invalid="ignore", divide="ignore"):
        s, sx, sy, sz = mean(w), mean(w * x), mean(w * y), mean(z)
        mx, my, mz = sx / s, sy / s, sz / s
        xx, yy, xy = (
            mean(w * x * x) / s - mx * mx,
            mean(w * y * y) / s - my * my,
            mean(w * x * y) / s - mx * my,
        )
        xz, yz = mean(x * z) / s - mx * mz, mean(y * z) / s - my * mz
        det = xx * yy - xy * xy
        slope = np.hypot((yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det)
        spans = known & (s * (2 * n + 1) ** 2 >= 5.5) & (det > 0.02 * cell_m**4)
    return np.where(spans, slope, np.nan)
