# SPDX-License-Identifier: Apache-2.0
"""Semi-global aggregation (Hirschmüller 2008) of the cost volume along eight paths.

From row to row not only an upright surface goes on as it is, but also a level one, by its own slope
(after Scharstein, Taniai and Sinha 2017): untextured ground is not cut into upright steps.

Path costs are small whole numbers: sixteen bits each, so that one instruction takes many levels.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Tuple

import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.tuning import SHARED, VOLUME

#: Largest price (volume units) that path costs have room for.
MOST_PRICE = 600
_FAR = np.int16(1000)  # above every path cost: a cell's (255) and the largest price
_LEVEL = np.int16(VOLUME.unlikely)
_PER_GREY = np.float32(1.0 / SHARED.surface_grey)
_PARTS = 6  # bits of a level's parts, in 16
_HALF = np.int16(1 << (_PARTS - 1))
# step whose product with a part has room in sixteen bits
_DEEPEST = np.int16(1 - (1 << (15 - _PARTS)))


def aggregate(
    volume: np.ndarray,
    counts: np.ndarray,
    grey: np.ndarray,
    prices: Tuple[float, float],
    drift: np.ndarray,
    pool: ThreadPoolExecutor,
) -> np.ndarray:
    """Sums of the path costs (HxWxD uint16) of a volume (HxWxD uint8) over a float32 picture.

    Row y has ``counts[y]`` levels; what is beyond is not looked at. ``prices``: of a step of one
    level, and of any larger one (at most ``MOST_PRICE``), lowered where the picture has an
    edge. ``drift`` (2xHxD) is by how many levels a level surface differs in the row above, and in
    the row below.
    """
    if prices[1] > MOST_PRICE:
        raise ValueError(f"a jump's price is {prices[1]}; path costs have room for {MOST_PRICE}")
    height, _, _ = volume.shape
    # not zeros: two threads that first touch pages of those wait for each other longer than all
    # else takes
    down, up = np.empty(volume.shape, np.uint16), np.empty(volume.shape, np.uint16)
    p1, p2 = np.int16(prices[0]), np.float32(prices[1])
    jobs = [
        pool.submit(_vertical, volume, counts, grey, p1, p2, *_split(d), total, upward)
        for d, total, upward in ((drift[0], down, False), (drift[1], up, True))
    ]
    for job in jobs:
        job.result()
    alone = volume, counts, grey, p1, p2, down, up
    for_rows(pool, height, lambda y0, y1: _horizontal(*alone, y0, y1), (height + 1) // 2)
    return down


def _split(drift: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Whole levels of a drift (HxD int16) and the rest in parts of a level."""
    parts = np.round(drift * (1 << _PARTS)).astype(np.int32)
    return (parts >> _PARTS).astype(np.int16), (parts & ((1 << _PARTS) - 1)).astype(np.int16)


# Whole arrays and indices go into what is called for every pixel, not slices: those are counted
# references, and two threads that count wait for each other.


@njit(cache=True, nogil=True)
def _upright(costs, k, top, p1, count, ways):
    """The least way to each level of one pixel of a path from what is before it, row ``k`` of
    ``costs``."""
    for d in range(count):
        beside = np.int16(min(costs[k, d], costs[k, d + 2]) + p1)
        ways[d] = min(min(costs[k, d + 1], top), beside)


@njit(cache=True, nogil=True)
def _stretches(whole, count, count_before, out):
    """Into ``out``: first level, end and shift of each stretch of levels that drift by the same
    whole number to levels that there are. Returns how many."""
    n, first = 0, 0
    while first < count:
        end = first + 1
        while end < count and whole[end] == whole[first]:
            end += 1
        shift = np.int64(whole[first])
        d0, d1 = max(first, -shift), min(end, count_before - shift)
        if d0 < d1:
            out[n, 0], out[n, 1], out[n, 2] = d0, d1, shift
            n += 1
        first = end
    return n


@njit(cache=True, nogil=True)
def _level(costs, k, stretches, found, part, y, p1, ways):
    """Lowers the ways to those from further on, as far as a level surface drifts."""
    one = np.uintp(1)
    for n in range(found):
        first = np.uintp(stretches[n, 0])
        at = np.uintp(stretches[n, 0] + stretches[n, 2] + 1)
        for i in range(np.uintp(stretches[n, 1] - stretches[n, 0])):
            here = costs[k, at + i]
            step = max(np.int16(min(costs[k, at + i + one], np.int16(here + p1)) - here), _DEEPEST)
            rest = np.int16(np.int16(step * part[y, first + i] + _HALF) >> _PARTS)
            sloped = np.int16(here + rest + _LEVEL)
            ways[first + i] = min(ways[first + i], sloped)


@njit(cache=True, nogil=True)
def _add(ways, volume, y, x, least_before, count, costs, k, total):
    """Path costs from the ways to them, and into the sums; the least of them."""
    least = _FAR
    for d in range(count):
        value = np.int16(np.int16(ways[d] - least_before) + np.int16(volume[y, x, d]))
        costs[k, d + 1] = value
        least = min(least, value)
        total[y, x, d] = np.uint16(total[y, x, d] + np.uint16(value))
    for d in range(count + 1, costs.shape[1]):
        costs[k, d] = _FAR
    return least


@njit(cache=True, nogil=True)
def _nothing(values, y, x, count):
    for d in range(count):
        values[y, x, d] = 0


@njit(cache=True, nogil=True)
def _price(p1, p2, step):
    """P2 on a step of grey: a jump of depth is likely there."""
    price = max(p2 / (np.float32(1.0) + abs(step) * _PER_GREY), np.float32(p1))
    return np.int16(price + np.float32(0.5))


@njit(cache=True, nogil=True)
def _vertical(volume, counts, grey, p1, p2, whole, part, total, upward):
    """The three paths that come from the row above (or below). Each row's costs take the place of
    those before it, in an order that needs no other copy: caches are small."""
    height, width, depth = volume.shape
    costs, least = np.full((3 * width, depth + 2), _FAR, np.int16), np.zeros(3 * width, np.int16)
    ways, stretches = np.zeros(depth, np.int16), np.empty((depth, 3), np.int64)
    for n in range(height):
        y = height - 1 - n if upward else n
        y_before = min(max(y + 1 if upward else y - 1, 0), height - 1)
        drifts = np.any(whole[y] != 0) or np.any(part[y] != 0)
        found = _stretches(whole[y], counts[y], counts[y_before], stretches) if drifts else 0
        for x in range(width):
            _nothing(total, y, x, counts[y])
        for path in range(3):
            for i in range(width):
                x = width - 1 - i if path == 0 else i
                x_before, smallest = x + path - 1, np.int16(0)
                now, before = path * width + x, path * width + x_before
                if n == 0 or x_before < 0 or x_before >= width:
                    ways[:] = 0
                else:
                    smallest = least[before]
                    top = np.int16(smallest + _price(p1, p2, grey[y, x] - grey[y_before, x_before]))
                    _upright(costs, before, top, p1, counts[y], ways)
                    _level(costs, before, stretches, found, part, y, p1, ways)
                least[now] = _add(ways, volume, y, x, smallest, counts[y], costs, now, total)


@njit(cache=True, nogil=True)
def _horizontal(volume, counts, grey, p1, p2, total, other, y0, y1):
    """The two paths along the rows, into ``total``, and the other total with them."""
    _, width, depth = volume.shape
    costs, ways = np.full((1, depth + 2), _FAR, np.int16), np.zeros(depth, np.int16)
    for y in range(y0, y1):
        for backward in range(2):
            least = np.int16(0)
            for n in range(width):
                x = width - 1 - n if backward else n
                if n == 0:
                    ways[:] = 0
                else:
                    step = grey[y, x] - grey[y, x + 1 if backward else x - 1]
                    _upright(costs, 0, np.int16(least + _price(p1, p2, step)), p1, counts[y], ways)
                least = _add(ways, volume, y, x, least, counts[y], costs, 0, total)
        for x in range(width):
            for d in range(counts[y]):
                total[y, x, d] += other[y, x, d]
