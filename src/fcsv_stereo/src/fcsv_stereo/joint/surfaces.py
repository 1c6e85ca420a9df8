# SPDX-License-Identifier: Apache-2.0
"""At a finer size: which of the surfaces about a pixel it belongs to, decided for all pixels together.

Each candidate (``candidates``) is judged by small windows, pair by pair where the pair can see it: nothing known is in
front of it there. In front of what a pair itself is known to show there is nothing, however alike it looks. A place
that is hidden from all counts the same for all candidates; then its surroundings and its colour decide. The candidates'
costs are aggregated along eight paths as in semi-global matching (Hirschmüller 2008), from plane to plane: a slanted
surface goes on without a price.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.bits import differing_bits
from fcsv_stereo.joint.candidates import MOST, Candidates, candidates, for_rows
from fcsv_stereo.joint.census import census
from fcsv_stereo.joint.colour import add_likeness, alike_bits, settle
from fcsv_stereo.joint.sweep import Views
from fcsv_stereo.joint.trust import SEEN_THROUGH
from fcsv_stereo.joint.upright import add_leaving, thin_uprights
from fcsv_stereo.joint.volume import pair_weights

_BITS, _BRIGHTNESS = 0.75, 8.0 / 30.0  # what a bit of 32 and a grey level count
_MOST_GREY = 30.0
_CUT = 18.0  # the most that one pair objects
_UNSEEN = 8.0  # what a pair counts that cannot see the place
_DENIED = 60.0  # and one that sees through it
_P1, _P2, _EDGE = 2.0, 40.0, 10.0  # price of planes that do not meet, at most; grey levels that halve the latter
_MEET = 0.02  # share of inverse depth that counts as P1
_STEP = 0.05  # a step of inverse depth between neighbours, as a share of the nearer
_FRONT = 1.08  # by which something must be nearer to hide


@dataclass(frozen=True)
class Map:
    """Inverse depth ``w`` (HxW, 1/m) in the pictures ``found``.

    HxW bool: where it is ``known``, so that planes about it may go on, and ``certain`` enough to hide what is behind.
    NxHxW bool: where pair i has ``confirmed`` it, so that nothing can be in front.
    """

    found: Views
    w: np.ndarray
    known: np.ndarray
    certain: np.ndarray
    confirmed: np.ndarray


def choose_surfaces(found: Views, coarser: Map, image: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """Inverse depth (HxW, 1/m) of the plane that each pixel of the finer ``found`` chose; ``image`` is its reference in
    colour (HxWx3)."""
    fastest = float(np.hypot(found.projections[:, 9], found.projections[:, 10]).max())
    given = candidates(coarser.w, coarser.known, found.shape, fastest, pool)
    certain = np.broadcast_to(coarser.certain, coarser.confirmed.shape)
    in_front, shown = (fronts(coarser.found, coarser.w, which) for which in (certain, coarser.confirmed))
    cost = _evidence(found, in_front, shown, given, image, pool)
    add_likeness(image, coarser.w.shape, given, pool, cost)
    add_leaving(coarser.w, given, cost)
    total = _aggregate(found.reference, given, cost, pool)
    best = np.empty(found.shape, np.float32)
    _pick(*_of(given), given.w, total, best)
    thin, chosen = thin_uprights(best), best.copy()
    settle(image, given, best, pool)
    return np.where(thin, chosen, best)


def stretched(w: np.ndarray, shape: Tuple[int, int]) -> np.ndarray:
    """A coarser map (1/m) at a finer ``shape`` without asking the pictures: interpolated, but not across steps."""
    size = shape[::-1]
    near, far = (cv2.resize(f(w, np.ones((3, 3), np.uint8)), size) for f in (cv2.dilate, cv2.erode))
    own = cv2.resize(w, size, interpolation=cv2.INTER_NEAREST)
    return np.where(near - far > _STEP * near, own, cv2.resize(w, size, interpolation=cv2.INTER_LINEAR))


def fronts(found: Views, w: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(N,Ho,Wo) the nearest inverse depth (1/m) that each pixel of the other pictures shows, of what is ``known`` to
    its pair (NxHxW bool); 0 where none."""
    out = np.zeros(found.others.shape, np.float32)
    for front, which, p, size in zip(out, known, found.projections, found.sizes):
        _draw(w, which, p, size, front)
    return out


def _of(given: Candidates):
    return given.start, given.count


def _evidence(found: Views, in_front, shown, given: Candidates, image, pool: ThreadPoolExecutor) -> np.ndarray:
    """(N,) cost of each candidate by the pictures; the pairs' costs sorted, the better ones weigh more."""
    codes = np.zeros(found.others.shape, np.uint32)
    for c, other, (h, w) in zip(codes, found.others, found.sizes):
        c[:h, :w] = census(np.ascontiguousarray(other[:h, :w]))
    here = found.reference, census(found.reference), *alike_bits(image, pool)
    there = found.others, codes, found.sizes, found.projections, in_front, shown
    weights, cost = pair_weights(len(found)), np.zeros(len(given.w), np.float32)

    def run(y0, y1):
        _judge(*here, *there, *_of(given), given.w, weights, y0, y1, cost)

    for_rows(pool, found.shape[0], run)
    return cost


def _aggregate(grey: np.ndarray, given: Candidates, cost: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """(N,) sums of the costs along eight paths."""
    down, up = np.zeros_like(cost), np.zeros_like(cost)
    planes = grey, *_of(given), given.w, *given.slope, cost, given.step
    jobs = [pool.submit(_vertical, *planes, total, upward) for total, upward in ((down, False), (up, True))]
    for job in jobs:
        job.result()
    for_rows(pool, grey.shape[0], lambda y0, y1: _horizontal(*planes, y0, y1, down))
    return down + up


@njit(cache=True, nogil=True)
def _draw(w, known, p, size, front):
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            z = p[6] * u + p[7] * v + p[8] + w[v, u] * p[11]
            if not known[v, u] or z <= 0:
                continue
            x = int(np.floor((p[0] * u + p[1] * v + p[2] + w[v, u] * p[9]) / z))
            y = int(np.floor((p[3] * u + p[4] * v + p[5] + w[v, u] * p[10]) / z))
            for b in range(max(y, 0), min(y + 2, size[0])):
                for a in range(max(x, 0), min(x + 2, size[1])):
                    front[b, a] = max(front[b, a], w[v, u])


@njit(cache=True, nogil=True, fastmath=True)
def _judge(
    reference, code, mask, scale, others, codes, sizes, projections, in_front, shown,
    start, count, values, weights, y0, y1, cost,
):  # fmt: skip
    pairs = others.shape[0]
    ranked = np.empty(pairs, np.float32)
    for y in range(y0, y1):
        for x in range(reference.shape[1]):
            if count[y, x] < 2:
                continue
            for k in range(start[y, x], start[y, x] + count[y, x]):
                for i in range(pairs):
                    ranked[i] = _unlike(
                        reference, code, mask, scale, others, codes, sizes, projections, in_front, shown, i, y, x,
                        values[k],
                    )  # fmt: skip
                    for j in range(i, 0, -1):
                        if ranked[j] < ranked[j - 1]:
                            ranked[j], ranked[j - 1] = ranked[j - 1], ranked[j]
                total = np.float32(0.0)
                for i in range(pairs):
                    total += weights[i] * ranked[i]
                cost[k] = total


@njit(cache=True, nogil=True, fastmath=True)
def _unlike(reference, code, mask, scale, others, codes, sizes, p, front, shown, i, y, x, w):
    """How unlike pair i is at inverse depth w, or what counts where it cannot see the place."""
    half, zero, u, v = np.float32(0.5), np.float32(0.0), np.float32(x), np.float32(y)
    z = p[i, 6] * u + p[i, 7] * v + p[i, 8] + w * p[i, 11]
    if not z > zero:
        return np.float32(_UNSEEN)
    a = (p[i, 0] * u + p[i, 1] * v + p[i, 2] + w * p[i, 9]) / z
    b = (p[i, 3] * u + p[i, 4] * v + p[i, 5] + w * p[i, 10]) / z
    if not (a >= zero and b >= zero and a <= sizes[i, 1] - 1 and b <= sizes[i, 0] - 1):
        return np.float32(_UNSEEN)
    r = min(int((b + half) * front.shape[1] / others.shape[1]), front.shape[1] - 1)
    c = min(int((a + half) * front.shape[2] / others.shape[2]), front.shape[2] - 1)
    if front[i, r, c] > w * np.float32(_FRONT) + np.float32(1e-4):
        return np.float32(_UNSEEN)
    if zero < shown[i, r, c] * np.float32(SEEN_THROUGH) < w:
        return np.float32(_DENIED)
    alike, there = mask[y, x], codes[i, int(b + half), int(a + half)]
    bits = scale[y, x] * differing_bits(np.uint32(code[y, x] & alike), np.uint32(there & alike))
    step = abs(reference[y, x] - _between(others, i, sizes, a, b))
    value = np.float32(_BITS) * bits + np.float32(_BRIGHTNESS) * min(step, np.float32(_MOST_GREY))
    return min(value, np.float32(_CUT))


@njit(cache=True, nogil=True, fastmath=True)
def _between(images, i, sizes, x, y):
    """Picture i at a place between its pixels."""
    c, r = int(x), int(y)
    fx, fy = x - np.float32(c), y - np.float32(r)
    right, below = min(c + 1, sizes[i, 1] - 1), min(r + 1, sizes[i, 0] - 1)
    top = images[i, r, c] + fx * (images[i, r, right] - images[i, r, c])
    low = images[i, below, c] + fx * (images[i, below, right] - images[i, below, c])
    return top + fy * (low - top)


@njit(cache=True, nogil=True, fastmath=True)
def _begin(first, n, cost, paths, now, total):
    least = np.float32(1e9)
    for k in range(n):
        paths[now, k] = cost[first + k]
        total[first + k] += cost[first + k]
        least = min(least, cost[first + k])
    return least


@njit(cache=True, nogil=True, fastmath=True)
def _step(
    first, n, first_before, n_before, dx, dy, values, slope_x, slope_y, cost, step, paths, before, least, price, now,
    total,
):  # fmt: skip
    """One pixel of one path: row ``now`` of ``paths`` from row ``before``; the new least. (Rows are not handed over as
    slices: those are counted references, and two threads that count wait for each other.)"""
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
            gap = half * (abs(ahead) + abs(back)) / (np.float32(_MEET) * max(values[i], values[j]) + step)
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
                if t == 0 or x_before < 0 or x_before >= width:
                    least[now] = _begin(start[y, x], count[y, x], cost, paths, now, total)
                    continue
                before = (b + path) * width + x_before
                least[now] = _step(
                    start[y, x], count[y, x], start[y_before, x_before], count[y_before, x_before],
                    np.float32(1 - path), dy, values, slope_x, slope_y, cost, step, paths, before, least[before],
                    _price(grey[y, x] - grey[y_before, x_before]), now, total,
                )  # fmt: skip


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
                if t == 0:
                    least = _begin(start[y, x], count[y, x], cost, paths, 0, total)
                    continue
                least = _step(
                    start[y, x], count[y, x], start[y, x_before], count[y, x_before], dx, np.float32(0.0), values,
                    slope_x, slope_y, cost, step, paths, (t + 1) % 2, least, _price(grey[y, x] - grey[y, x_before]),
                    t % 2, total,
                )  # fmt: skip


@njit(cache=True, nogil=True)
def _pick(start, count, values, total, best):
    for y in range(best.shape[0]):
        for x in range(best.shape[1]):
            k = start[y, x]
            for j in range(k + 1, k + count[y, x]):
                if total[j] < total[k]:
                    k = j
            best[y, x] = values[k]
