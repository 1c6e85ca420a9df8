# SPDX-License-Identifier: Apache-2.0
"""Why a cell of the map from above is empty: nothing in the picture tells what is there, or the
raster missed it.

The vertical line over a cell is a line in the reference picture. Follow it from its top down: a
pixel that is deeper than the line looks past it, a pixel that is less deep lies before it. The cell
holds what is between the last pixel that looks past it and the first that lies before it: a surface
that both are of, or what the nearer one hides.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from fcsv_geometry import transforms
from fcsv_stereo.model import Cloud, Reference
from fcsv_stereo.products.from_above import Raster
from fcsv_stereo.products.spanned import STEP, Surfaces

#: Codes of ``why``: not in the picture's field of view, filled, and the reasons of a hole.
UNSEEN, FILLED, HIDDEN, UNANSWERED, BELOW, OPEN = range(6)
_ROUND_M = 1.0  # heights above and below those of the map are tried, too
_MOST_STEPS = 4000
_ENOUGH_CELLS = 50_000
_LEAST_DEPTH_M = 0.1


@dataclass(frozen=True)
class HoleShares:
    """Shares of the cells within the picture's field of view.

    Holes: ``hidden`` behind something nearer; pixels ``unanswered`` (no depth in the cloud);
    ``below`` the picture's border; ``open``: a surface was seen there all the same.
    """

    cells: int
    filled: float
    hidden: float
    unanswered: float
    below: float
    open: float

    @classmethod
    def of(cls, why: np.ndarray) -> "HoleShares":
        """``why`` (H,W) uint8 of ``why_empty``."""
        counts = np.bincount(why.ravel(), minlength=OPEN + 1)
        cells = int(counts[FILLED:].sum())
        return cls(
            cells, *(float(counts[code] / max(cells, 1)) for code in range(FILLED, OPEN + 1))
        )

    @property
    def without_evidence(self) -> float:
        """Holes of which no picture tells anything."""
        return self.hidden + self.unanswered + self.below

    def to_dict(self) -> dict:
        """Gives the shares for report.json."""
        return {
            "cells": self.cells,
            "filled": self.filled,
            "holes_without_evidence": self.without_evidence,
            "hidden": self.hidden,
            "unanswered": self.unanswered,
            "below_the_picture": self.below,
            "holes_with_evidence": self.open,
        }


def hole_shares(raster: Raster, cloud: Cloud, reference: Reference, sky: np.ndarray) -> HoleShares:
    """Counts the holes of a raster of the ``cloud``; of a large one every n-th cell of every n-th
    row. ``sky`` as in ``why_empty``."""
    n = max(1, int(np.sqrt(raster.height.size / _ENOUGH_CELLS)))
    off_m = 0.5 * raster.cell_m * (n - 1)  # the middle of the first cell stays where it is
    some = Raster(
        raster.height[::n, ::n],
        raster.rgb[::n, ::n],
        n * raster.cell_m,
        raster.x0_m - off_m,
        raster.y0_m + off_m,
    )
    return HoleShares.of(why_empty(some, Surfaces.of(cloud, reference), reference, sky))


def why_empty(
    raster: Raster, surfaces: Surfaces, reference: Reference, sky: np.ndarray
) -> np.ndarray:
    """(H,W) uint8, codes of this module, of the raster's cells. ``sky``: bool, of the reference
    picture's pixels."""
    known = raster.height[np.isfinite(raster.height)]
    if not len(known):
        return np.full(raster.height.shape, UNSEEN, np.uint8)
    c = reference.camera
    return _why(
        raster.height,
        raster.cell_m,
        raster.x0_m,
        raster.y0_m,
        transforms.invert(reference.T_home_cam),
        np.array([c.fx, c.fy, c.cx, c.cy]),
        np.where(sky, np.inf, 1.0 / surfaces.w),
        surfaces.joined,
        float(known.min()) - _ROUND_M,
        float(known.max()) + _ROUND_M,
    )


@njit(cache=True, nogil=True)
def _why(height, cell_m, x0_m, y0_m, T_cam_home, intrinsics, seen, joined, low_m, high_m):
    rows, columns = height.shape
    why = np.zeros((rows, columns), np.uint8)
    fx, fy, cx, cy = intrinsics
    for row in range(rows):
        y = y0_m - (row + 0.5) * cell_m
        for column in range(columns):
            x = x0_m + (column + 0.5) * cell_m
            top, bottom = np.empty(3), np.empty(3)
            for i in range(3):
                flat = T_cam_home[i, 0] * x + T_cam_home[i, 1] * y + T_cam_home[i, 3]
                top[i], bottom[i] = (
                    flat + T_cam_home[i, 2] * high_m,
                    flat + T_cam_home[i, 2] * low_m,
                )
            if top[2] < _LEAST_DEPTH_M or bottom[2] < _LEAST_DEPTH_M:
                continue
            u = fx * top[0] / top[2] + cx - fx * bottom[0] / bottom[2] - cx
            v = fy * top[1] / top[2] + cy - fy * bottom[1] / bottom[2] - cy
            why[row, column] = _down(
                top,
                bottom,
                min(int(max(abs(u), abs(v))) + 2, _MOST_STEPS),
                intrinsics,
                seen,
                joined,
            )
            if why[row, column] != UNSEEN and not np.isnan(height[row, column]):
                why[row, column] = FILLED
    return why


@njit(cache=True, nogil=True)
def _down(top, bottom, steps, intrinsics, seen, joined):
    """The code of an empty cell, from the top of its vertical line (3,) m in the camera's frame to
    its bottom."""
    fx, fy, cx, cy = intrinsics
    rows, columns = seen.shape
    found, past, gap, u0, v0 = UNSEEN, False, False, -1, -1
    for n in range(steps + 1):
        share = n / steps
        at_z = top[2] + share * (bottom[2] - top[2])
        u = int(np.rint(fx * (top[0] + share * (bottom[0] - top[0])) / at_z + cx))
        v = int(np.rint(fy * (top[1] + share * (bottom[1] - top[1])) / at_z + cy))
        if u < 0 or v < 0 or u >= columns or v >= rows:
            continue
        z = seen[v, u]
        if np.isnan(z):
            gap = True
            if found != HIDDEN:
                found = UNANSWERED
        elif z > at_z:
            past, gap, u0, v0, found = True, False, u, v, BELOW
        elif past and gap:
            apart = max(abs(u - u0), abs(v - v0))
            return UNANSWERED if 1.0 / z - 1.0 / seen[v0, u0] <= STEP * apart / z else HIDDEN
        elif past:
            return OPEN if _one_surface(joined, u0, v0, u, v) else HIDDEN
        else:
            found = HIDDEN
    return found


@njit(cache=True, nogil=True)
def _one_surface(joined, u0, v0, u, v):
    """Whether pixels (u0, v0) and (u, v), at most one row and one column apart, are of one
    surface."""
    if abs(u - u0) > 1 or abs(v - v0) > 1:
        return False
    beside, under = min(u, u0), min(v, v0)
    if u == u0:
        return v == v0 or joined[under, u] & 2 != 0
    if v == v0:
        return joined[v, beside] & 1 != 0
    first = joined[v0, beside] & 1 != 0 and joined[under, u] & 2 != 0
    return first or (joined[under, u0] & 2 != 0 and joined[v, beside] & 1 != 0)
