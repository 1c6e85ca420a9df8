# SPDX-License-Identifier: Apache-2.0
"""What lies between points that are neighbours in the reference picture, from above.

Rows of the picture meet far ground metres apart, so that its points alone leave holes. Neighbouring
pixels of one surface span triangles; across a step of depth there is none. Where a surface ends,
its last pixels go on for half a pixel: so much of it each of them saw.
"""

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from numba import njit

from fcsv_geometry import transforms
from fcsv_stereo.depth import pixels_of
from fcsv_stereo.model import Cloud, Reference

#: Of the inverse depth: a smaller step between neighbouring pixels is no edge. Above it a surface
#: goes on where its step is at most _ALIKE times those before and after it: inverse depth of a
#: plane has the same step everywhere.
STEP, _ALIKE = 0.03, 1.5
#: A rim lies at most so much deeper than its pixel: a share of its inverse depth.
_LEAST_RIM = 0.5


@dataclass(frozen=True)
class Surfaces:
    """The cloud's points in the reference picture: ``index`` (H,W) of the point, -1: none; ``w``
    (H,W) 1/m, its inverse depth, NaN: none; ``along`` (H,W-1), ``down`` (H-1,W) bool: of one
    surface with the pixel to the right, below."""

    index: np.ndarray
    w: np.ndarray
    along: np.ndarray
    down: np.ndarray

    @classmethod
    def of(cls, cloud: Cloud, reference: Reference) -> "Surfaces":
        """Makes surfaces: of several points at a pixel the nearest."""
        rows, columns, z, inside = pixels_of(
            reference.camera, reference.T_home_cam, cloud.points_home_m
        )
        index = np.full((reference.camera.height, reference.camera.width), -1)
        of = np.flatnonzero(inside)
        of = of[np.argsort(-z[of], kind="stable")]  # the nearest is written last
        index[rows[of], columns[of]] = of
        w = np.where(index >= 0, 1.0 / np.maximum(z, 1e-6)[index], np.nan)
        return cls(index, w, _one_surface(w), _one_surface(w.T).T)

    @property
    def joined(self) -> np.ndarray:
        """(H,W) uint8: bit 0 as ``along``, bit 1 as ``down``."""
        return np.pad(self.along, ((0, 0), (0, 1))) + 2 * np.pad(
            self.down, ((0, 1), (0, 0))
        ).astype(np.uint8)

    def triangles(self) -> np.ndarray:
        """(M, 3) indices of points: corners of triangles between neighbouring pixels of one
        surface."""
        a, b, c, d = (
            self.index[:-1, :-1],
            self.index[:-1, 1:],
            self.index[1:, :-1],
            self.index[1:, 1:],
        )
        above = self.along[:-1] & self.down[:, :-1]  # a-b and a-c
        below = self.along[1:] & self.down[:, 1:]  # c-d and b-d
        return np.concatenate([np.stack([a, b, c], -1)[above], np.stack([b, c, d], -1)[below]])

    def rims(self) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What pixels at the edge of a surface cover beyond their middle: rows and columns (4 N,)
        px and inverse depths (4 N,) 1/m of the corners of N pixels, one after the other about each
        pixel."""
        left, right = _halves(self.w, self.along)
        up, below = (half.T for half in _halves(self.w.T, self.down.T))
        whole = np.zeros(self.w.shape, bool)
        whole[1:-1, 1:-1] = (self.along[1:-1, :-1] & self.along[1:-1, 1:]) & (
            self.down[:-1, 1:-1] & self.down[1:, 1:-1]
        )
        v, u = np.nonzero((self.index >= 0) & ~whole)
        w = self.w[v, u]
        corners = [
            (v + dv, u + du, np.maximum(w + across[v, u] + along[v, u], _LEAST_RIM * w))
            for dv, du, across, along in (
                (-0.5, -0.5, up, left),
                (-0.5, 0.5, up, right),
                (0.5, 0.5, below, right),
                (0.5, -0.5, below, left),
            )
        ]
        rows, columns, inverse = (np.stack(x, axis=1).ravel() for x in zip(*corners))
        return rows, columns, inverse


def _halves(w: np.ndarray, along: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """(H,W) each: how inverse depth changes from a pixel's middle to its left and its right border.
    Where its surface ends, as on the other side of it; where it has no neighbour at all, not at
    all."""
    step = np.where(along, np.diff(w, axis=1), np.nan) / 2.0
    none = np.full((len(w), 1), np.nan)
    left, right = -np.concatenate([none, step], axis=1), np.concatenate([step, none], axis=1)
    return np.nan_to_num(np.where(np.isnan(left), -right, left)), np.nan_to_num(
        np.where(np.isnan(right), -left, right)
    )


def _one_surface(w: np.ndarray) -> np.ndarray:
    """HxW-1 bool: pixels and their right neighbours that are of one surface, by inverse depth w
    (HxW, NaN: none)."""
    step = np.abs(np.diff(w, axis=1))
    none = np.full((len(w), 1), np.nan)
    before, after = (
        np.concatenate([none, step[:, :-1]], axis=1),
        np.concatenate([step[:, 1:], none], axis=1),
    )
    usual = np.nan_to_num(np.fmin(before, after), nan=0.0)
    with np.errstate(invalid="ignore"):
        return step <= STEP * np.fmax(w[:, :-1], w[:, 1:]) + _ALIKE * usual


def span(
    cloud: Cloud,
    surfaces: Surfaces,
    reference: Reference,
    origin: Tuple[float, float],
    cell_m: float,
    height,
    rgb,
) -> None:
    """Cells of ``height`` (H,W) m and ``rgb`` (H,W,3) that the surfaces touch, in place: the
    highest of all.

    ``origin`` is (x, y) of the outer corner of the first cell, whose row lies at the largest y.
    """
    of, points, quads = _rim_points(surfaces, reference)
    p = np.concatenate([cloud.points_home_m.astype(float), points])
    colors = np.concatenate([cloud.colors, cloud.colors[of]])
    cells = np.column_stack(
        [(p[:, 0] - origin[0]) / cell_m - 0.5, (origin[1] - p[:, 1]) / cell_m - 0.5]
    )
    corners = np.concatenate([surfaces.triangles(), quads + len(cloud)])
    _span(cells, p[:, 2].copy(), colors, corners, height, rgb)


def _rim_points(
    surfaces: Surfaces, reference: Reference
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gives the corners of the rims' corners: whose colour (4 N,), places in home (4 N, 3) m;
    triangles (2 N, 3) of them."""
    rows, columns, w = surfaces.rims()
    c = reference.camera
    z = 1.0 / w
    p_cam = np.column_stack([(columns - c.cx) / c.fx * z, (rows - c.cy) / c.fy * z, z])
    first = 4 * np.arange(len(w) // 4)
    quads = np.concatenate(
        [
            np.column_stack([first, first + 1, first + 2]),
            np.column_stack([first, first + 2, first + 3]),
        ]
    )
    middle = [np.floor(x.reshape(-1, 4).mean(axis=1) + 0.5).astype(int) for x in (rows, columns)]
    return (
        np.repeat(surfaces.index[middle[0], middle[1]], 4),
        transforms.apply(reference.T_home_cam, p_cam),
        quads,
    )


@njit(cache=True, nogil=True)
def _span(cells, z, colors, corners, height, rgb):
    rows, columns = height.shape
    most = 4.0 * (rows + columns)
    for n in range(len(corners)):
        i, j, k = corners[n]
        _edge(i, j, most, cells, z, colors, height, rgb)
        _edge(j, k, most, cells, z, colors, height, rgb)
        _edge(k, i, most, cells, z, colors, height, rgb)
        xi, yi = cells[i]
        xj, yj = cells[j]
        xk, yk = cells[k]
        area = (xj - xi) * (yk - yi) - (xk - xi) * (yj - yi)
        if abs(area) < 1e-9:
            continue
        for row in range(
            max(0, int(np.ceil(min(yi, yj, yk)))), min(rows - 1, int(np.floor(max(yi, yj, yk)))) + 1
        ):
            first, last = int(np.ceil(min(xi, xj, xk))), int(np.floor(max(xi, xj, xk)))
            for column in range(max(0, first), min(columns - 1, last) + 1):
                b = ((column - xi) * (yk - yi) - (xk - xi) * (row - yi)) / area
                c = ((xj - xi) * (row - yi) - (column - xi) * (yj - yi)) / area
                a = 1.0 - b - c
                if a >= -1e-9 and b >= -1e-9 and c >= -1e-9:
                    _put(row, column, a, i, b, j, c, k, z, colors, height, rgb)


@njit(cache=True, nogil=True)
def _edge(i, j, most, cells, z, colors, height, rgb):
    """Every cell that the line from point i to point j touches, to a quarter of a cell."""
    rows, columns = height.shape
    along = max(abs(cells[j, 0] - cells[i, 0]), abs(cells[j, 1] - cells[i, 1]))
    steps = int(min(2.0 * along, most)) + 1
    for n in range(steps + 1):
        b = n / steps
        column = int(np.rint(cells[i, 0] + b * (cells[j, 0] - cells[i, 0])))
        row = int(np.rint(cells[i, 1] + b * (cells[j, 1] - cells[i, 1])))
        if 0 <= row < rows and 0 <= column < columns:
            _put(row, column, 1.0 - b, i, b, j, 0.0, j, z, colors, height, rgb)


@njit(cache=True, nogil=True)
def _put(row, column, a, i, b, j, c, k, z, colors, height, rgb):
    """The mean of points i, j and k with weights a, b and c, where it is the highest of its
    cell."""
    at = a * z[i] + b * z[j] + c * z[k]
    if at > height[row, column] or np.isnan(height[row, column]):
        height[row, column] = at
        for channel in range(3):
            value = a * colors[i, channel] + b * colors[j, channel] + c * colors[k, channel]
            rgb[row, column, channel] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
