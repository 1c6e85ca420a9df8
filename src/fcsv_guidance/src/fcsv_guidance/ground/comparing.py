# SPDX-License-Identifier: Apache-2.0
"""What a watching view shows against the depth that the maps foretell for its picture.

Most of a live depth's sigma is of the cameras' poses, which all its pixels share: a crate 3 m
before the ground behind it stays within one sigma. So the shared error is fitted and taken off, and
what is left is judged against its own spread, in inverse depth, where matching's noise is even.
Where the foretold depth bends or jumps, live matching blurs it: there it may be what is foretold
some pixels beside, and has a spread of its own, else walls would set the noise of open ground.
"""

from dataclasses import dataclass, replace
from typing import Iterator, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import kernels
from fcsv_guidance.ground.model import sure_depth
from fcsv_guidance.ground.standing import SIDE, disk, least, most
from fcsv_guidance.ground.views import DepthView
from fcsv_stereo.depth import pixels_of

_FARTHEST_M = 60.0  # of what is compared, as a ground's reach
_LEAST_PIXELS = 2000  # that both know: fewer fit no shared error
_UNSURE = 2.0  # times the usual sigma of inverse depth: no pixel was matched there
_LEAST_COVERED = 0.3  # of the near pixels of a view: a map that foretells fewer is none for it
_NEAR_CAMERA_M = 3.0  # a map from farther away shows other sides of things
_EDGE_PX = 2  # the foretold depth may lie so far beside
_BLUR_PX, _BENDS = 4, 3.0  # so far at edges; usual errors by which the foretold depth bends there
_FLAGGED, _SURE = 3.0, 7.0  # standard deviations of one pixel, and of a group that closes at once
_SAME = 2.0  # standard deviations within which a pixel shows what is mapped
_LEAST_STEP_M = 0.15  # above the foretold ground: below the smallest step that stops a robot
#: Side of the smallest thing that is told.
THING_M = 0.3
_SHOWN = 0.4  # share of a thing's pixels that is flagged
_LEAST_GROUP_PX, _WIDE = 12, 4.0  # of so many times the least, one view is enough
_SPREAD_M = 0.3  # along its ray: how far a thing's depth is off where it is matched small
_BETWEEN_M = 0.2  # beside pixels that show what is mapped: half of the smallest thing, and a cell
_PAST_PX = 2  # about a pixel, in which nothing is nearer than what is mapped
_FLOOR = 0.1  # of the stated sigma: noise that is taken for granted


@dataclass(frozen=True)
class Compared:
    """Layers of a grid (rows, columns). ``came``: how surely something stands nearer than what is
    mapped, 0 to 1, of which 1 is enough for one view. ``shift`` (1/m): by how much inverse depth it
    is nearer, ``at_z_m`` at which height in home. ``went``: bool, what is seen lies farther than what
    is mapped. ``same``: bool, the ground is seen as it is mapped. ``noise`` (1/m): standard deviation
    of the view's inverse depth; a smaller shift is not told. ``past`` (1/m): the foretold inverse
    depth (H,W) of pixels about which nothing is nearer than that, NaN elsewhere; of ``camera`` at
    ``T_home_cam``. ``apart``: as ``came``, of what is seen beside the robot's own pixels."""

    came: np.ndarray
    apart: np.ndarray
    shift: np.ndarray
    at_z_m: np.ndarray
    went: np.ndarray
    same: np.ndarray
    noise: float
    past: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray

    def looks_past(self, points_home_m: np.ndarray) -> np.ndarray:
        """(N,) bool: whether the view shows what is mapped behind each point (N,3): nothing is
        there."""
        row, column, z_m, inside = pixels_of(self.camera, self.T_home_cam, points_home_m)
        with np.errstate(divide="ignore"):
            return inside & (1.0 / z_m > self.past[row, column] + _SAME * self.noise)


def compared(
    view: DepthView, maps: Sequence[DepthView], grid: Grid, own: Optional[np.ndarray] = None
) -> Tuple[DepthView, Optional[Compared]]:
    """The view with the shared error taken off its depth, and what it shows against ``maps``; the
    view as it is, and None, where no map foretells enough of it. ``own`` (H,W) bool: pixels in which
    the robot may be seen; None where nobody knows."""
    depth, mapped = sure_depth(view), _mapped_depth(view, maps)
    if mapped is None:
        return view, None
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse, expected = 1.0 / depth, 1.0 / mapped
        stated, near = view.sigma * inverse**2, inverse > 1.0 / _FARTHEST_M
        usual = float(np.median(stated[near])) if near.any() else 0.0
        # what no other camera sees goes on as the surface beside it, and may be metres off
        inverse = np.where(stated <= _UNSURE * usual, inverse, np.float32(np.nan))
    both = np.isfinite(inverse) & np.isfinite(expected)
    if both.sum() < _LEAST_PIXELS:
        return view, None
    shared, spread = _shared(inverse, expected, both)
    inverse = inverse - shared
    foretold = _Foretold(expected, spread)
    noise = max(_noise((inverse - expected)[both & ~foretold.edges]), _FLOOR * usual)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(inverse > 0, 1.0 / inverse, np.nan).astype(np.float32)
    return replace(view, depth=depth), _judged(view, inverse, foretold, noise, grid, own)


def _mapped_depth(view: DepthView, maps: Sequence[DepthView]) -> Optional[np.ndarray]:
    """(H,W) depth m up to _FARTHEST_M, NaN where unknown, by the map whose camera stood nearest."""
    away = [float(np.linalg.norm(m.T_home_cam[:3, 3] - view.T_home_cam[:3, 3])) for m in maps]
    for k in np.argsort(away):
        if away[k] > _NEAR_CAMERA_M:
            break
        try:
            known = sure_depth(maps[k])
        except GroundError:
            continue
        T = transforms.invert(view.T_home_cam) @ maps[k].T_home_cam
        depth = kernels.seen_from(
            known, np.float64(maps[k].K), np.float64(T), np.float64(view.K), *view.depth.shape
        )
        depth[depth > _FARTHEST_M] = np.nan
        near = np.isfinite(view.depth) & (view.depth < _FARTHEST_M)
        if np.isfinite(depth[near]).sum() >= _LEAST_COVERED * max(near.sum(), 1):
            return depth
    return None


def _shared(inverse: np.ndarray, expected: np.ndarray, both: np.ndarray) -> Tuple:
    """(H,W) smooth difference of inverse depth that wrong poses and focal lengths make, and the
    robust standard deviation (1/m) of what is left."""
    height, width = inverse.shape
    v, u = (np.indices(inverse.shape) - np.array([[[height]], [[width]]]) / 2) / width

    def terms(u, v, g):
        g = g / (np.nanmedian(expected[both]))
        return np.stack([np.ones_like(u), u, v, g, u * v, u * u, g * u, g * v], -1)

    at = np.flatnonzero(both)[:: max(1, int(both.sum()) // 20000)]
    A = terms(u.flat[at], v.flat[at], expected.flat[at])
    off = (inverse - expected).flat[at]
    weight = np.ones(len(at))
    for _ in range(8):
        found = np.linalg.lstsq(A * weight[:, None], off * weight, rcond=None)[0]
        left = off - A @ found
        spread = _even(left)
        weight = 1.0 / np.maximum(1.0, np.abs(left) / max(2.0 * spread, 1e-12))
    g = np.where(np.isfinite(expected), expected, np.nan_to_num(inverse))
    return terms(u, v, g) @ found, spread


def _even(off: np.ndarray) -> float:
    """Standard deviation of errors (N,) by their median, in which their tails do not count."""
    return 1.4826 * float(np.median(np.abs(off)))


def _noise(off: np.ndarray) -> float:
    """Standard deviation of errors (N,), 0 without. They have long tails, and come in groups: taken
    by what one of twenty exceeds more than of even noise (1.96 standard deviations)."""
    if not len(off):
        return 0.0
    even = _even(off)
    return max(even, float(np.quantile(np.abs(off), 0.95)) - 0.96 * even)


def _window(half_px: int) -> np.ndarray:
    return np.ones((2 * half_px + 1,) * 2, np.uint8)


def _edges(expected: np.ndarray, spread: float) -> np.ndarray:
    """(H,W) bool: pixels about which the foretold inverse depth bends, jumps or ends. In the
    picture of a plane it is affine, so that its second differences are nothing."""
    ends = cv2.morphologyEx(np.isfinite(expected).astype(np.uint8), cv2.MORPH_CLOSE, SIDE)
    edges = np.pad(ends[1:-1, 1:-1], 1) == 0
    n = _EDGE_PX
    with np.errstate(invalid="ignore"):
        for w, at in ((expected, edges), (expected.T, edges.T)):  # down, across
            at[n:-n] |= np.abs(w[2 * n :] + w[: -2 * n] - 2 * w[n:-n]) > _BENDS * spread
    return most(edges, _window(_BLUR_PX)) > 0


class _Foretold:
    """Inverse depth (H,W) that the maps foretell, NaN where they do not, to a ``spread``; its
    ``edges`` (H,W) bool, and its bounds by what lies about each pixel: ``low`` 9, ``high`` -1 where
    nothing is known."""

    def __init__(self, inverse: np.ndarray, spread: float):
        self.inverse, self.edges = inverse, _edges(inverse, spread)
        self.high, self.low = self._about(most, -1.0), self._about(least, 9.0)

    def _about(self, bound, nothing: float) -> np.ndarray:
        known = np.where(np.isfinite(self.inverse), self.inverse, nothing)
        far, near = (bound(known, _window(px)) for px in (_BLUR_PX, _EDGE_PX))
        return np.where(self.edges, far, near)


def _judged(
    view: DepthView,
    inverse: np.ndarray,
    foretold: _Foretold,
    noise: float,
    grid: Grid,
    own: Optional[np.ndarray],
) -> Compared:
    high, low, sight = foretold.high, foretold.low, _Sight(view)
    both = np.isfinite(inverse) & (inverse > 1.0 / _FARTHEST_M) & (high > 0)
    nearer, farther = np.where(both, inverse - high, 0.0), np.where(both, low - inverse, 0.0)
    beyond = np.maximum(np.maximum(nearer, farther), 0.0)
    at_edges = beyond[both & foretold.edges]
    worse = float(np.quantile(at_edges, 0.95)) if len(at_edges) else 0.0
    noises = np.where(foretold.edges, max(noise, worse), noise)
    came, apart, shift, went = (np.zeros(grid.shape, np.float32) for _ in range(4))
    at_z_m = np.full(grid.shape, np.nan, np.float32)
    for group in _groups(sight, inverse, high, nearer, noises):
        cells, z_m = sight.cells_of(inverse, group, grid)
        at_z_m[cells] = z_m
        came[cells] = np.maximum(came[cells], group.sure)
        shift[cells] = np.maximum(shift[cells], group.by)
        beside = None if own is None else group.beside(own)
        if beside is not None:
            cells, _ = sight.cells_of(inverse, beside, grid)
            apart[cells] = np.maximum(apart[cells], beside.sure)
    for group in _groups(sight, inverse, low, farther, noises):
        for depths in (low, inverse):  # where the thing was, and what is seen in its place
            went[sight.cells_of(depths, group, grid)[0]] = 1.0
    same = np.zeros(grid.shape, bool)
    seen = both & np.isfinite(foretold.inverse) & (beyond <= _SAME * noise)
    row, column, inside = grid.cells_of(*sight.places(inverse, seen)[:, :2].T)
    same[row[inside], column[inside]] = True
    between = disk(_BETWEEN_M, grid.cell_m)  # rows of pixels lie apart on the ground
    same = cv2.morphologyEx(same.astype(np.uint8), cv2.MORPH_CLOSE, between) > 0
    same &= (came == 0) & (went == 0)
    window = _window(_PAST_PX)
    nothing = most(nearer > _FLAGGED * noises, window) == 0
    past = nothing & (cv2.blur(seen.astype(np.float32), window.shape) >= _SHOWN)
    behind = np.where(past, foretold.inverse, np.nan)
    eye = view.camera, view.T_home_cam
    return Compared(came, apart, shift, at_z_m, went > 0, same, noise, behind, *eye)


@dataclass(frozen=True)
class _Group:
    """Pixels (rows, columns) that differ together, ``by`` inverse depth (1/m) in the middle, where
    the view's ``noise`` is so large; ``least_px`` of the smallest thing."""

    rows: np.ndarray
    columns: np.ndarray
    by: float
    noise: float
    least_px: float

    @property
    def sure(self) -> float:
        """How surely it is a thing, 0 to 1, by its shift against the noise and by its number of
        pixels against that of a thing for which one view is enough."""
        whole = min(len(self.rows) / (_WIDE * self.least_px), 1.0)
        return min(self.by / (_SURE * self.noise), 1.0) * whole

    def beside(self, own: np.ndarray) -> Optional["_Group"]:
        """What of it lies beside ``own`` pixels (H,W); None where that is too little for a thing."""
        off = ~own[self.rows, self.columns]
        if off.sum() < self.least_px:
            return None
        return replace(self, rows=self.rows[off], columns=self.columns[off])


class _Sight:
    """Where the pixels of a view look: ``rays`` (H,W,3) in home, of depth 1 m."""

    def __init__(self, view: DepthView):
        self.rays = view.camera.rays() @ view.T_home_cam[:3, :3].T
        self.focal_px = view.K[0, 0]
        self._eye_m = view.T_home_cam[:3, 3]

    def places(self, inverse: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(N,3) in home of the ``chosen`` pixels at an ``inverse`` depth (H,W)."""
        return self._eye_m + self.rays[chosen] / inverse[chosen][:, None]

    def cells_of(self, inverse: np.ndarray, group: _Group, grid: Grid) -> Tuple:
        """Rows and columns of the cells that a group covers at an ``inverse`` depth (H,W), and z
        (m) of its points there."""
        ray = self.rays[group.rows, group.columns]
        off = np.arange(-_SPREAD_M, _SPREAD_M + 1e-6, 0.5 * grid.cell_m)
        depth = 1.0 / inverse[group.rows, group.columns]
        along = depth[:, None] + off / np.hypot(ray[:, 0], ray[:, 1])[:, None]
        points = self._eye_m + along[..., None] * ray[:, None]
        row, column, inside = grid.cells_of(points[..., 0], points[..., 1])
        return (row[inside], column[inside]), points[..., 2][inside]


def _groups(sight: _Sight, inverse, edge, differs, noises) -> Iterator[_Group]:
    """Connected pixels whose inverse depth ``differs`` surely from its foretold ``edge``, as many
    as of a thing, and by a step that matters; a line is none."""
    up = np.abs(sight.rays[..., 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        step_m = np.abs(1.0 / edge - 1.0 / inverse) * up
        of_thing_px = _SHOWN * (THING_M * sight.focal_px * inverse) ** 2
    flagged = ((differs > _FLAGGED * noises) & (step_m > _LEAST_STEP_M)).astype(np.uint8)
    flagged = cv2.morphologyEx(flagged, cv2.MORPH_OPEN, SIDE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(flagged)
    for k in range(1, count):
        left, top, width, height, size = stats[k]
        rows, columns = np.nonzero(labels[top : top + height, left : left + width] == k)
        rows, columns = rows + top, columns + left
        least_px = max(_LEAST_GROUP_PX, float(np.median(of_thing_px[rows, columns])))
        if size >= least_px:
            by, noise = (float(np.median(of[rows, columns])) for of in (differs, noises))
            yield _Group(rows, columns, by, noise, least_px)
