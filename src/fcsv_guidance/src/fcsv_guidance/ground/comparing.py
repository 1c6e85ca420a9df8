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
from fcsv_guidance.ground.standing import disk
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
_THING_M, _SHOWN = 0.3, 0.4  # side of the smallest thing, and share of its pixels that is flagged
_THIN = np.ones((3, 3), np.uint8)  # what is thinner is an edge, no thing
_LEAST_GROUP_PX, _WIDE = 12, 4.0  # of so many times the least, one view is enough
_SPREAD_M = 0.3  # along its ray: how far a thing's depth is off where it is matched small
_BETWEEN_M = 0.2  # beside pixels that show what is mapped: half of the smallest thing, and a cell
_PAST_PX = 5  # about a pixel, in which nothing is nearer than what is mapped
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
    edges = _edges(expected, spread)
    noise = max(_noise((inverse - expected)[both & ~edges]), _FLOOR * usual)
    foretold = _Foretold(expected, edges, noise)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(inverse > 0, 1.0 / inverse, np.nan).astype(np.float32)
    return replace(view, depth=depth), _judged(view, inverse, foretold, grid, own)


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
        spread = 1.4826 * float(np.median(np.abs(left)))
        weight = 1.0 / np.maximum(1.0, np.abs(left) / max(2.0 * spread, 1e-12))
    g = np.where(np.isfinite(expected), expected, np.nan_to_num(inverse))
    return terms(u, v, g) @ found, spread


def _edges(expected: np.ndarray, spread: float) -> np.ndarray:
    """(H,W) bool: pixels about which the foretold inverse depth bends, jumps or ends. In the
    picture of a plane it is affine, so that its second differences are nothing."""
    ends = cv2.morphologyEx(
        np.isfinite(expected).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    edges = np.pad(ends[1:-1, 1:-1], 1) == 0
    n, w = _EDGE_PX, expected
    with np.errstate(invalid="ignore"):
        edges[n:-n] |= np.abs(w[2 * n :] + w[: -2 * n] - 2 * w[n:-n]) > _BENDS * spread
        edges[:, n:-n] |= np.abs(w[:, 2 * n :] + w[:, : -2 * n] - 2 * w[:, n:-n]) > _BENDS * spread
    return cv2.dilate(edges.astype(np.uint8), _window(_BLUR_PX)) > 0


def _noise(off: np.ndarray) -> float:
    """Standard deviation of errors (N,), 0 without. They have long tails, and come in groups: taken
    by what one of twenty exceeds more than of even noise (1.96 standard deviations)."""
    if not len(off):
        return 0.0
    even = 1.4826 * float(np.median(np.abs(off)))
    return max(even, float(np.quantile(np.abs(off), 0.95)) - 0.96 * even)


def _window(half_px: int) -> np.ndarray:
    return np.ones((2 * half_px + 1,) * 2, np.uint8)


class _Foretold:
    """Inverse depth (H,W) that the maps foretell, NaN where they do not, and its bounds by what lies
    about each pixel: ``low`` 9, ``high`` -1 where nothing is known. ``noise`` (1/m): away from
    ``edges`` (H,W) bool, at which a view is worse."""

    def __init__(self, inverse: np.ndarray, edges: np.ndarray, noise: float):
        self.inverse, self.noise, self._edges = inverse, noise, edges
        self.known = np.isfinite(inverse)
        self.high = self._about(cv2.dilate, -1.0)
        self.low = self._about(cv2.erode, 9.0)

    def noise_of(self, beyond: np.ndarray, both: np.ndarray) -> np.ndarray:
        """(H,W) noise of pixels that lie ``beyond`` the bounds by so much, of which ``both`` know."""
        at_edges = beyond[both & self._edges]
        worse = float(np.quantile(at_edges, 0.95)) if len(at_edges) else 0.0
        return np.where(self._edges, max(self.noise, worse), self.noise)

    def _about(self, bound, nothing: float) -> np.ndarray:
        known = np.where(self.known, self.inverse, nothing).astype(np.float32)
        far, near = (bound(known, _window(px)) for px in (_BLUR_PX, _EDGE_PX))
        return np.where(self._edges, far, near)


def _judged(
    view: DepthView, inverse: np.ndarray, mapped: _Foretold, grid: Grid, own: Optional[np.ndarray]
) -> Compared:
    high, low = mapped.high, mapped.low
    both = np.isfinite(inverse) & (inverse > 1.0 / _FARTHEST_M) & (high > 0)
    nearer, farther = np.where(both, inverse - high, 0.0), np.where(both, low - inverse, 0.0)
    beyond = np.maximum(np.maximum(nearer, farther), 0.0)
    noise = mapped.noise_of(beyond, both)
    came, apart, shift, went = (np.zeros(grid.shape, np.float32) for _ in range(4))
    at_z_m = np.full(grid.shape, np.nan, np.float32)
    for group in _groups(view, inverse, high, nearer, noise):
        cells, z_m = _cells_of(view, inverse, group, grid)
        at_z_m[cells] = z_m
        came[cells] = np.maximum(came[cells], group.sure)
        shift[cells] = np.maximum(shift[cells], group.by)
        beside = None if own is None else group.beside(own)
        if beside is not None:
            cells, _ = _cells_of(view, inverse, beside, grid)
            apart[cells] = np.maximum(apart[cells], beside.sure)
    for group in _groups(view, inverse, low, farther, noise):
        for depths in (low, inverse):  # where the thing was, and what is seen in its place
            went[_cells_of(view, depths, group, grid)[0]] = 1.0
    same = np.zeros(grid.shape, bool)
    seen = both & mapped.known & (beyond <= _SAME * mapped.noise)
    row, column, inside = grid.cells_of(*_places(view, inverse, seen)[:, :2].T)
    same[row[inside], column[inside]] = True
    between = disk(_BETWEEN_M, grid.cell_m)  # rows of pixels lie apart on the ground
    same = cv2.morphologyEx(same.astype(np.uint8), cv2.MORPH_CLOSE, between) > 0
    same &= (came == 0) & (went == 0)
    window = np.ones((_PAST_PX,) * 2, np.uint8)
    nothing = cv2.dilate((nearer > _FLAGGED * noise).astype(np.uint8), window) == 0
    past = nothing & (cv2.blur(seen.astype(np.float32), window.shape) >= _SHOWN)
    behind = np.where(past, mapped.inverse, np.nan)
    eye = view.camera, view.T_home_cam
    return Compared(came, apart, shift, at_z_m, went > 0, same, mapped.noise, behind, *eye)


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
        """How surely it is a thing, 0 to 1, by its shift against the noise and by its number of pixels
        against that of a thing for which one view is enough."""
        whole = min(len(self.rows) / (_WIDE * self.least_px), 1.0)
        return min(self.by / (_SURE * self.noise), 1.0) * whole

    def beside(self, own: np.ndarray) -> Optional["_Group"]:
        """What of it lies beside ``own`` pixels (H,W); None where that is too little for a thing."""
        off = ~own[self.rows, self.columns]
        if off.sum() < self.least_px:
            return None
        return replace(self, rows=self.rows[off], columns=self.columns[off])


def _groups(view: DepthView, inverse, edge, differs, noise) -> Iterator[_Group]:
    """Connected pixels whose inverse depth ``differs`` surely from its foretold ``edge``, as many
    as of a thing, and by a step that matters."""
    up = np.abs(_rays(view)[..., 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        step_m = np.abs(1.0 / edge - 1.0 / inverse) * up
        least_px = _SHOWN * (_THING_M * view.K[0, 0] * inverse) ** 2
    flagged = ((differs > _FLAGGED * noise) & (step_m > _LEAST_STEP_M)).astype(np.uint8)
    flagged = cv2.morphologyEx(flagged, cv2.MORPH_OPEN, _THIN)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(flagged)
    for k in range(1, count):
        left, top, width, height, size = stats[k]
        rows, columns = np.nonzero(labels[top : top + height, left : left + width] == k)
        rows, columns = rows + top, columns + left
        least = max(_LEAST_GROUP_PX, float(np.median(least_px[rows, columns])))
        if size >= least:
            by, off = (float(np.median(of[rows, columns])) for of in (differs, noise))
            yield _Group(rows, columns, by, off, least)


def _cells_of(view: DepthView, inverse: np.ndarray, group: _Group, grid: Grid) -> Tuple:
    """Rows and columns of the cells that a group covers at an ``inverse`` depth (H,W), and z (m) of
    its points there."""
    ray = _rays(view)[group.rows, group.columns]
    off = np.arange(-_SPREAD_M, _SPREAD_M + 1e-6, 0.5 * grid.cell_m)
    depth = 1.0 / inverse[group.rows, group.columns]
    along = depth[:, None] + off / np.hypot(ray[:, 0], ray[:, 1])[:, None]
    points = view.T_home_cam[:3, 3] + along[..., None] * ray[:, None]
    row, column, inside = grid.cells_of(points[..., 0], points[..., 1])
    return (row[inside], column[inside]), points[..., 2][inside]


def _rays(view: DepthView) -> np.ndarray:
    """(H,W,3) in home, of depth 1 m."""
    v, u = np.indices(view.depth.shape)
    K = view.K
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
    return rays @ view.T_home_cam[:3, :3].T


def _places(view: DepthView, inverse: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(N,3) in home of the ``chosen`` pixels."""
    return view.T_home_cam[:3, 3] + _rays(view)[chosen] / inverse[chosen][:, None]
