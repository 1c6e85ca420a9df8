# SPDX-License-Identifier: Apache-2.0
"""What lies between points that are neighbours in the reference picture, from above.

Rows of the picture meet far ground metres apart, so that its points alone leave holes. Neighbouring pixels of one
surface span triangles; across a step of depth there is none.
"""

from typing import Tuple

import numpy as np
from numba import njit

from fcsv_stereo.depth import pixels_of
from fcsv_stereo.model import Cloud, Reference

#: Of the inverse depth: a smaller step between neighbouring pixels is no edge. Above it a surface goes on where its
#: step is at most _ALIKE times those before and after it: inverse depth of a plane has the same step everywhere.
_STEP, _ALIKE = 0.03, 1.5


def triangles(cloud: Cloud, reference: Reference) -> np.ndarray:
    """(M, 3) indices of points: corners of triangles between neighbouring pixels of one surface."""
    rows, columns, z, inside = pixels_of(reference.camera, reference.T_home_cam, cloud.points_home_m)
    index = np.full((reference.camera.height, reference.camera.width), -1)
    of = np.flatnonzero(inside)
    of = of[np.argsort(-z[of], kind="stable")]  # of several at a pixel the nearest is written last
    index[rows[of], columns[of]] = of
    w = np.where(index >= 0, 1.0 / np.maximum(z, 1e-6)[index], np.nan)
    along, down = _one_surface(w), _one_surface(w.T).T
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    above = along[:-1] & down[:, :-1]  # a-b and a-c
    below = along[1:] & down[:, 1:]  # c-d and b-d
    return np.concatenate([np.stack([a, b, c], -1)[above], np.stack([b, c, d], -1)[below]])


def _one_surface(w: np.ndarray) -> np.ndarray:
    """HxW-1 bool: pixels and their right neighbours that are of one surface, by inverse depth w (HxW, NaN: none)."""
    step = np.abs(np.diff(w, axis=1))
    none = np.full((len(w), 1), np.nan)
    before, after = np.concatenate([none, step[:, :-1]], axis=1), np.concatenate([step[:, 1:], none], axis=1)
    usual = np.nan_to_num(np.fmin(before, after), nan=0.0)
    with np.errstate(invalid="ignore"):
        return step <= _STEP * np.fmax(w[:, :-1], w[:, 1:]) + _ALIKE * usual


def span(cloud: Cloud, corners: np.ndarray, origin: Tuple[float, float], cell_m: float, height, rgb) -> None:
    """Cells of ``height`` (H,W) m and ``rgb`` (H,W,3) that triangles (M, 3) cover, in place: the highest of all.

    ``origin`` is (x, y) of the outer corner of the first cell, whose row lies at the largest y.
    """
    p = cloud.points_home_m.astype(float)
    cells = np.column_stack([(p[:, 0] - origin[0]) / cell_m - 0.5, (origin[1] - p[:, 1]) / cell_m - 0.5])
    _span(cells, p[:, 2].copy(), cloud.colors, corners, height, rgb)


@njit(cache=True, nogil=True)
def _span(cells, z, colors, corners, height, rgb):
    rows, columns = height.shape
    for n in range(len(corners)):
        i, j, k = corners[n]
        xi, yi = cells[i]
        xj, yj = cells[j]
        xk, yk = cells[k]
        area = (xj - xi) * (yk - yi) - (xk - xi) * (yj - yi)
        if abs(area) < 1e-9:
            continue
        for row in range(max(0, int(np.ceil(min(yi, yj, yk)))), min(rows - 1, int(np.floor(max(yi, yj, yk)))) + 1):
            first, last = int(np.ceil(min(xi, xj, xk))), int(np.floor(max(xi, xj, xk)))
            for column in range(max(0, first), min(columns - 1, last) + 1):
                b = ((column - xi) * (yk - yi) - (xk - xi) * (row - yi)) / area
                c = ((xj - xi) * (row - yi) - (column - xi) * (yj - yi)) / area
                a = 1.0 - b - c
                if a < -1e-9 or b < -1e-9 or c < -1e-9:
                    continue
                at = a * z[i] + b * z[j] + c * z[k]
                if at > height[row, column] or np.isnan(height[row, column]):
                    height[row, column] = at
                    for channel in range(3):
                        value = a * colors[i, channel] + b * colors[j, channel] + c * colors[k, channel]
                        rgb[row, column, channel] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
