# SPDX-License-Identifier: Apache-2.0
"""Semi-global aggregation (Hirschmüller 2008) of the cost volume along eight paths.

From row to row not only an upright surface goes on as it is, but also a level one, by its own slope (after Scharstein,
Taniai and Sinha 2017): untextured ground is not cut into upright steps.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit

_FAR = 1e9
_LEVEL = 5.0  # price of going on level: where nothing is known, an upright surface is likelier


def aggregate(
    volume: np.ndarray, grey: np.ndarray, p1: float, p2: float, drift: np.ndarray, pool: ThreadPoolExecutor
) -> np.ndarray:
    """Sums of the path costs (HxWxD uint16) of a volume (HxWxD uint8) over a float32 picture.

    ``p1`` is the price of a step of one level, ``p2`` of any larger one, lowered where the picture has an edge.
    ``drift`` (2xHxD) is by how many levels a level surface differs in the row above, and in the row below.
    """
    height, width, _ = volume.shape
    down = np.zeros(volume.shape, np.uint16)
    up = np.zeros(volume.shape, np.uint16)
    penalties = np.float32(p1), np.float32(p2)
    jobs = [
        pool.submit(_vertical, volume, grey, *penalties, np.float32(_LEVEL), drift[0], down, False),
        pool.submit(_vertical, volume, grey, *penalties, np.float32(_LEVEL), drift[1], up, True),
    ]
    for job in jobs:
        job.result()
    half = (height + 1) // 2
    jobs = [
        pool.submit(_horizontal, volume, grey, *penalties, down, up, y0, y1) for y0, y1 in ((0, half), (half, height))
    ]
    for job in jobs:
        job.result()
    return down


@njit(cache=True, nogil=True, fastmath=True)
def _step(cost, before, least, p1, p2, now, total):
    """One pixel of one path: ``now`` from ``before`` (both padded by one at each end); the new least."""
    top = least + p2
    smallest = np.float32(_FAR)
    for d in range(cost.shape[0]):
        best = min(min(before[d + 1], top), min(before[d], before[d + 2]) + p1)
        value = np.float32(cost[d]) + best - least
        now[d + 1] = value
        smallest = min(smallest, value)
        total[d] = np.uint16(np.float32(total[d]) + value)
    return smallest


@njit(cache=True, nogil=True, fastmath=True)
def _step_between_rows(cost, before, least, p1, p2, level, drift, now, total):
    """As ``_step``; a surface may also come from ``drift`` (D) levels further on, at the price ``level``."""
    top = least + p2
    last = np.float32(cost.shape[0] - 1)
    smallest = np.float32(_FAR)
    for d in range(cost.shape[0]):
        at = min(max(np.float32(d) + drift[d], np.float32(0.0)), last)
        i = np.int32(at)
        # the padding is far above any cost: its share must be none, not some
        after = min(before[i + 2], before[i + 1] + p1)
        sloped = before[i + 1] + (at - np.float32(i)) * (after - before[i + 1]) + level
        best = min(min(min(before[d + 1], sloped), top), min(before[d], before[d + 2]) + p1)
        value = np.float32(cost[d]) + best - least
        now[d + 1] = value
        smallest = min(smallest, value)
        total[d] = np.uint16(np.float32(total[d]) + value)
    return smallest


@njit(cache=True, nogil=True, fastmath=True)
def _price(p1, p2, step):
    """P2 on a step of grey: a jump of depth is likely there."""
    return max(p2 / (np.float32(1.0) + abs(step) * np.float32(0.1)), p1 * np.float32(1.5))


@njit(cache=True, nogil=True, fastmath=True)
def _start(cost, now, total):
    smallest = np.float32(_FAR)
    for d in range(cost.shape[0]):
        value = np.float32(cost[d])
        now[d + 1] = value
        smallest = min(smallest, value)
        total[d] = np.uint16(np.float32(total[d]) + value)
    return smallest


@njit(cache=True, nogil=True, fastmath=True)
def _vertical(volume, grey, p1, p2, level, drift, total, upward):
    """The three paths that come from the row above (or below)."""
    height, width, depth = volume.shape
    rows = np.full((2, 3, width, depth + 2), np.float32(_FAR), np.float32)
    least = np.zeros((2, 3, width), np.float32)
    for n in range(height):
        y = height - 1 - n if upward else n
        y_before = y + 1 if upward else y - 1
        a, b = n % 2, (n + 1) % 2
        for x in range(width):
            for path in range(3):
                x_before = x + path - 1
                if n == 0 or x_before < 0 or x_before >= width:
                    least[a, path, x] = _start(volume[y, x], rows[a, path, x], total[y, x])
                    continue
                price = _price(p1, p2, grey[y, x] - grey[y_before, x_before])
                least[a, path, x] = _step_between_rows(
                    volume[y, x], rows[b, path, x_before], least[b, path, x_before], p1, price, level, drift[y],
                    rows[a, path, x], total[y, x],
                )  # fmt: skip


@njit(cache=True, nogil=True, fastmath=True)
def _horizontal(volume, grey, p1, p2, total, other, y0, y1):
    """The two paths along the rows, into ``total``, and the other total with them."""
    _, width, depth = volume.shape
    row = np.full((2, depth + 2), np.float32(_FAR), np.float32)
    for y in range(y0, y1):
        for backward in range(2):
            least = np.float32(0.0)
            for n in range(width):
                x = width - 1 - n if backward else n
                a, b = n % 2, (n + 1) % 2
                if n == 0:
                    least = _start(volume[y, x], row[a], total[y, x])
                    continue
                price = _price(p1, p2, grey[y, x] - grey[y, x + 1 if backward else x - 1])
                least = _step(volume[y, x], row[b], least, p1, price, row[a], total[y, x])
        for x in range(width):
            for d in range(depth):
                total[y, x, d] += other[y, x, d]
