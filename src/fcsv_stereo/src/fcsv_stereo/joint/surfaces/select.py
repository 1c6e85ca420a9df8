# SPDX-License-Identifier: Apache-2.0
"""Chooses surfaces at a finer size: which of the surfaces about a pixel it belongs to, decided for
all pixels together.

Each candidate (``candidates``) is judged by the pictures (``evidence``); where these say nothing,
its surroundings and its colour decide. The candidates' costs are aggregated along eight paths as in
semi-global matching (Hirschmüller 2008), from plane to plane: a slanted surface goes on without a
price.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.surfaces.candidates import MOST, Candidates, candidates
from fcsv_stereo.joint.surfaces.colour import add_likeness, settle
from fcsv_stereo.joint.surfaces.data_cost import evidence, fronts
from fcsv_stereo.joint.surfaces.thin_uprights import add_leaving, thin_uprights
from fcsv_stereo.joint.tuning import SELECT, SHARED
from fcsv_stereo.joint.views import Views

_P1, _P2, _EDGE, _MEET = SELECT.p1, SELECT.p2, SHARED.surface_grey, SHARED.same


@dataclass(frozen=True)
class Map:
    """Inverse depth ``w`` (HxW, 1/m) in the pictures ``found``.

    HxW bool: where it is ``known``, so that planes about it may go on, and ``certain`` enough to
    hide what is behind. NxHxW bool: where pair i has ``confirmed`` it, so that nothing can be in
    front.
    """

    found: Views
    w: np.ndarray
    known: np.ndarray
    certain: np.ndarray
    confirmed: np.ndarray


def choose_surfaces(
    found: Views, coarser: Map, image: np.ndarray, pool: ThreadPoolExecutor
) -> np.ndarray:
    """Inverse depth (HxW, 1/m) of the plane that each pixel of the finer ``found`` chose; ``image``
    is its reference in colour (HxWx3)."""
    given = candidates(coarser.w, coarser.known, found.shape, found.fastest_px_m, pool)
    certain = np.broadcast_to(coarser.certain, coarser.confirmed.shape)
    in_front, shown = (
        fronts(coarser.found, coarser.w, which) for which in (certain, coarser.confirmed)
    )
    cost = evidence(found, in_front, shown, given, image, pool)
    add_likeness(image, coarser.w.shape, given, pool, cost)
    add_leaving(coarser.w, given, cost)
    given = replace(given, source=None)  # of no use any more, and as large as the pictures
    total = _aggregate(found.reference, given, cost, pool)
    best = np.empty(found.shape, np.float32)
    _pick(given.start, given.count, given.w, total, best)
    del cost, total
    given = replace(given, slope=None)
    thin, chosen = thin_uprights(best), best.copy()
    settle(image, given, best, pool)
    return np.where(thin, chosen, best)


def stretched(w: np.ndarray, shape: Tuple[int, int]) -> np.ndarray:
    """A coarser map (1/m) at a finer ``shape`` without asking the pictures: interpolated, but not
    across steps."""
    size = shape[::-1]
    near, far = (cv2.resize(f(w, np.ones((3, 3), np.uint8)), size) for f in (cv2.dilate, cv2.erode))
    own = cv2.resize(w, size, interpolation=cv2.INTER_NEAREST)
    return np.where(
        near - far > SHARED.one_surface * near,
        own,
        cv2.resize(w, size, interpolation=cv2.INTER_LINEAR),
    )


def _aggregate(
    grey: np.ndarray, given: Candidates, cost: np.ndarray, pool: ThreadPoolExecutor
) -> np.ndarray:
    """(N,) sums of the costs along eight paths."""
    down, up = np.zeros_like(cost), np.zeros_like(cost)
    planes = grey, given.start, given.count, given.w, *given.slope, cost, given.step
    jobs = [
        pool.submit(_vertical, *planes, total, upward)
        for total, upward in ((down, False), (up, True))
    ]
    for job in jobs:
        job.result()
    for_rows(pool, grey.shape[0], lambda y0, y1: _horizontal(*planes, y0, y1, down))
    down += up
    return down


# Where there is no choice a path has no memory: the one candidate's cost is the least, and only
# what lies above it goes on. So nothing is computed there, which is nearly everywhere in large
# pictures.


@njit(cache=True, nogil=True, fastmath=True)
def _begin(first, n, cost, paths, now, total):
    least = np.float32(1e9)
    for k in range(n):
        paths[now, k] = cost[first + k]
        total[first + k] += cost[first + k]
        least = min(least, cost[first + k])
    return least


@njit(cache=True, nogil=True, fastmath=True)
def _step(  # noqa: PLR0913
    first,
    n,
    first_before,
    n_before,
    dx,
    dy,
    values,
    slope_x,
    slope_y,
    cost,
    step,
    paths,
    before,
    least,
    price,
    now,
    total,
):
    """One pixel of one path: row ``now`` of ``paths`` from row ``before``; the new least. (Rows are
    not handed over as slices: those are counted references, and two threads that count wait for
    each other.)"""
    smallest, half = np.float32(1e9), np.float32(0.5)
    for k in range(n):
        i = first + k
        best = least + price
        for m in range(n_before):
            if paths[before, m] >= best:
                continue
            j = first_before + m
            ahead = values[j] + slope_x[j] * dx + slope_y[j] * dy - values[i]
            back = values[i] - slope_x[i] * dx - slope_y[i] * dy - values[j]
            gap = (
                half
                * (abs(ahead) + abs(back))
                / (np.float32(_MEET) * max(values[i], values[j]) + step)
            )
            best = min(best, paths[before, m] + np.float32(_P1) * gap)
        value = cost[i] + best - least
        paths[now, k] = value
        smallest = min(smallest, value)
        total[i] += value
    return smallest


@njit(cache=True, nogil=True, fastmath=True)
def _price(step):
    """The most that a jump costs; less on a step of grey."""
    return max(np.float32(_P2) / (np.float32(1.0) + abs(step) / np.float32(_EDGE)), np.float32(_P1))


@njit(cache=True, nogil=True, fastmath=True)
def _vertical(grey, start, count, values, slope_x, slope_y, cost, step, total, upward):
    """The three paths that come from the row above (or below)."""
    height, width = grey.shape
    paths = np.zeros((6 * width, MOST), np.float32)
    least = np.zeros(6 * width, np.float32)
    dy = np.float32(-1.0) if upward else np.float32(1.0)
    for t in range(height):
        y = height - 1 - t if upward else t
        y_before = y + 1 if upward else y - 1
        a, b = (t % 2) * 3, ((t + 1) % 2) * 3
        for x in range(width):
            for path in range(3):
                x_before, now = x + path - 1, (a + path) * width + x
                if count[y, x] == 1:
                    paths[now, 0] = least[now] = np.float32(0.0)
                    continue
                if t == 0 or x_before < 0 or x_before >= width:
                    least[now] = _begin(start[y, x], count[y, x], cost, paths, now, total)
                    continue
                before = (b + path) * width + x_before
                least[now] = _step(
                    start[y, x],
                    count[y, x],
                    start[y_before, x_before],
                    count[y_before, x_before],
                    np.float32(1 - path),
                    dy,
                    values,
                    slope_x,
                    slope_y,
                    cost,
                    step,
                    paths,
                    before,
                    least[before],
                    _price(grey[y, x] - grey[y_before, x_before]),
                    now,
                    total,
                )


@njit(cache=True, nogil=True, fastmath=True)
def _horizontal(grey, start, count, values, slope_x, slope_y, cost, step, y0, y1, total):
    """The two paths along the rows."""
    width = grey.shape[1]
    paths = np.zeros((2, MOST), np.float32)
    for y in range(y0, y1):
        for backward in range(2):
            least = np.float32(0.0)
            dx = np.float32(-1.0) if backward else np.float32(1.0)
            for t in range(width):
                x = width - 1 - t if backward else t
                x_before = x + 1 if backward else x - 1
                if count[y, x] == 1:
                    paths[t % 2, 0] = least = np.float32(0.0)
                    continue
                if t == 0:
                    least = _begin(start[y, x], count[y, x], cost, paths, 0, total)
                    continue
                least = _step(
                    start[y, x],
                    count[y, x],
                    start[y, x_before],
                    count[y, x_before],
                    dx,
                    np.float32(0.0),
                    values,
                    slope_x,
                    slope_y,
                    cost,
                    step,
                    paths,
                    (t + 1) % 2,
                    least,
                    _price(grey[y, x] - grey[y, x_before]),
                    t % 2,
                    total,
                )


@njit(cache=True, nogil=True)
def _pick(start, count, values, total, best):
    for y in range(best.shape[0]):
        for x in range(best.shape[1]):
            k = start[y, x]
            for j in range(k + 1, k + count[y, x]):
                if total[j] < total[k]:
                    k = j
            best[y, x] = values[k]
