# SPDX-License-Identifier: Apache-2.0
"""The cost volume: how little the reference and the other pictures agree, per pixel and inverse depth.

Every other picture is warped onto the reference for every plane of inverse depth (plane sweep; Collins 1996), so that
its census code (Zabih and Woodfill 1994) is taken at sub-pixel places and for any relative pose. All pairs speak in
one volume (Okutomi and Kanade 1993); each pair's cost is cut off, so that one that is occluded cannot outvote others.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Tuple

import numpy as np
from numba import njit

from fcsv_stereo.joint.bits import differing_bits
from fcsv_stereo.joint.census import CUT, OFFSETS, RADIUS, census, census_row, unseen_bits
from fcsv_stereo.joint.sweep import LEAST_FALL, Views

POWER = 1.0
_SCALE = 10.0  # volume units per bit
LEVEL_PRICE = 8.0  # volume units by which an upright surface is preferred
_LEAST_TILT = 0.12  # px per row by which a level surface shears the fastest pair; less, and upright windows do
_NO_SKY, _INFINITE = 5, 2  # volume units that a depth counts above the horizon; levels that are as good as infinite
_BAND = 40
_BLOCK = 32


def cost_volume(
    found: Views, w: np.ndarray, nearest: np.ndarray, highest: float, pool: ThreadPoolExecutor
) -> Tuple[np.ndarray, np.ndarray]:
    """HxWxD uint8, tenths of bits: the cost of every inverse depth ``w`` (1/m) at every pixel; and (H,) int64, how many
    levels a row has: none above its ``nearest`` (H, 1/m), there is more to see far away than near.

    The pairs' costs are sorted and the better ones weigh more (4, 3, 2, 1 of four): where some are occluded, the rest
    decides.
    A window may lie in a level plane as well as in an upright one (Gallup et al. 2007: sweeps in several directions):
    the ground shears by the baseline over the height from row to row. ``highest`` (1/m) is the inverse height under the
    camera above which no level planes are tried. Above the horizon, where nothing tells of a depth, there is none.
    """
    height, width = found.shape
    volume, counts = np.empty((height, width, len(w)), np.uint8), np.empty(height, np.int64)
    codes = census(found.reference)
    weights = pair_weights(len(found))
    unseen = unseen_bits(found.reference)
    bands = [(y, min(y + _BAND, height)) for y in range(0, height, _BAND)]

    fastest = float(np.hypot(found.projections[:, 9], found.projections[:, 10]).max())
    heights = np.float32([_LEAST_TILT / max(fastest * float(np.hypot(*found.falling[:2])), 1e-9), highest])

    def run(band):
        count = int(np.searchsorted(w, nearest[slice(*band)].max(), side="right"))
        _sweep_band(
            codes, found.others, found.sizes, found.projections, w[:count], OFFSETS, weights, unseen, *band,
            volume,
        )  # fmt: skip
        counts[slice(*band)] = count
        for y in np.flatnonzero(found.falls[slice(*band)] <= 0.0) + band[0]:
            volume[y, :, _INFINITE:count] += np.uint8(_NO_SKY)
        _sweep_level(
            codes, found.others, found.sizes, found.projections, found.falling.astype(np.float32), w[:count], *heights,
            OFFSETS, weights, unseen, *band, volume,
        )  # fmt: skip

    list(pool.map(run, bands))
    return volume, counts


def pair_weights(pairs: int) -> np.ndarray:
    """(N,) float32 weights of the pairs' costs from the best to the worst at a pixel; their sum is 1."""
    weights = np.arange(pairs, 0, -1, dtype=np.float64) ** POWER
    return (weights / weights.sum()).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _warp_row(image, size, p, w, v, u0, at, out, seen):
    """A row of the reference's pixels (u0 on, at height v) sampled from another picture at inverse depth w.

    First where each is, then what is there: only apart does the first become vector code.
    """
    index, fx, fy = at
    height, width = np.float32(size[0] - 1), np.float32(size[1] - 1)
    last_x, last_y, stride = np.int32(max(size[1] - 2, 0)), np.int32(max(size[0] - 2, 0)), np.int32(image.shape[1])
    zero, one = np.float32(0.0), np.float32(1.0)
    x0 = p[1] * v + p[2] + w * p[9]
    y0 = p[4] * v + p[5] + w * p[10]
    z0 = p[7] * v + p[8] + w * p[11]
    for i in range(out.shape[0]):
        u = np.float32(u0 + i)
        z = p[6] * u + z0
        inverse = one / max(z, np.float32(1e-9))
        x = (p[0] * u + x0) * inverse
        y = (p[3] * u + y0) * inverse
        seen[i] = one if (z > zero) & (x >= zero) & (x <= width) & (y >= zero) & (y <= height) else zero
        x = min(max(x, zero), width)
        y = min(max(y, zero), height)
        xi, yi = min(np.int32(x), last_x), min(np.int32(y), last_y)
        index[i] = yi * stride + xi
        fx[i], fy[i] = x - np.float32(xi), y - np.float32(yi)
    flat, right, down = image.reshape(-1), np.uintp(size[1] > 1), np.uintp(stride if size[0] > 1 else 0)
    for i in range(out.shape[0]):
        k = np.uintp(index[i])
        top = flat[k] + fx[i] * (flat[k + right] - flat[k])
        low = flat[k + down] + fx[i] * (flat[k + down + right] - flat[k + down])
        out[i] = top + fy[i] * (low - top)


@njit(cache=True, nogil=True, fastmath=True)
def _insert(ranked, count, costs):
    """A row of costs into ``count`` sorted ones."""
    for j in range(count):
        row = ranked[j]
        for x in range(costs.shape[0]):
            low, high = min(row[x], costs[x]), max(row[x], costs[x])
            row[x] = low
            costs[x] = high
    ranked[count, :] = costs


@njit(cache=True, nogil=True, fastmath=True)
def _weigh(ranked, weights, total):
    """Mean of sorted costs, the better ones weighing more."""
    total[:] = np.float32(0.0)
    for j in range(ranked.shape[0]):
        for x in range(total.shape[0]):
            total[x] += weights[j] * ranked[j, x]


@njit(cache=True, nogil=True, fastmath=True)
def _rank(reference, others, sizes, projections, w, offsets, unseen, y0, scratch, ranked):
    """The pairs' costs of a band of rows on one plane, sorted, into ``ranked`` (rows, N, W)."""
    warped, seen, at, codes, costs = scratch
    rows, pairs, width = ranked.shape
    for i in range(pairs):
        low, high = width, 0
        for r in range(rows):
            a, b = _in_view(projections[i], sizes[i], w, np.float32(y0 + r), width)
            low, high = min(low, a), max(high, b)
        if low < high:
            for r in range(rows + 2 * RADIUS):
                _warp_row(
                    others[i], sizes[i], projections[i], w, np.float32(y0 - RADIUS + r), low - RADIUS, at,
                    warped[r, low : high + 2 * RADIUS], seen[r, low : high + 2 * RADIUS],
                )  # fmt: skip
        for r in range(rows):
            costs[:] = unseen[y0 + r]
            if low < high:
                census_row(warped, r + RADIUS, low, offsets, codes[low:high])
                inside = seen[r + RADIUS, RADIUS : RADIUS + width]
                for x in range(low, high):
                    bits = differing_bits(codes[x], reference[y0 + r, x])
                    costs[x] = bits if inside[x] > np.float32(0.5) else unseen[y0 + r, x]
            _insert(ranked[r], i, costs)


@njit(cache=True, nogil=True)
def _in_view(p, size, w, v, width):
    """Columns of the reference's row ``v`` from the first to behind the last that another picture sees at inverse
    depth ``w``, and up to two beside them: each of its bounds is a line in the column."""
    z0, slope = p[7] * v + p[8] + w * p[11], p[6]
    low, high = np.float32(-1.0), np.float32(width)
    for k in range(5):
        a, b = slope, z0  # in front of the camera: a u + b >= 0
        if k > 0:
            axis = (k - 1) // 2
            a, b = p[3 * axis], p[3 * axis + 1] * v + p[3 * axis + 2] + w * p[9 + axis]
            if k % 2 == 0:
                last = np.float32(size[1 - axis] - 1)
                a, b = last * slope - a, last * z0 - b
        if a > 0:
            low = max(low, -b / a)
        elif a < 0:
            high = min(high, -b / a)
        elif b < 0:
            return width, 0
    if low > high + np.float32(1.0):
        return width, 0
    return min(max(int(low) - 1, 0), width), max(min(int(high) + 3, width), 0)


@njit(cache=True, nogil=True)
def _scratch(rows, width):
    shape = (rows + 2 * RADIUS, width + 2 * RADIUS)
    at = np.empty(shape[1], np.int32), np.empty(shape[1], np.float32), np.empty(shape[1], np.float32)
    codes, costs = np.empty(width, np.uint32), np.empty(width, np.float32)
    return np.empty(shape, np.float32), np.empty(shape, np.float32), at, codes, costs


@njit(cache=True, nogil=True, fastmath=True)
def _sweep_band(reference, others, sizes, projections, w, offsets, weights, unseen, y0, y1, volume):
    width, rows = reference.shape[1], y1 - y0
    scratch, total = _scratch(rows, width), np.empty(width, np.float32)
    ranked = np.empty((rows, others.shape[0], width), np.float32)
    block = np.empty((rows, width, _BLOCK), np.uint8)
    for k0 in range(0, w.shape[0], _BLOCK):
        k1 = min(k0 + _BLOCK, w.shape[0])
        for k in range(k0, k1):
            _rank(reference, others, sizes, projections, w[k], offsets, unseen, y0, scratch, ranked)
            for r in range(rows):
                _weigh(ranked[r], weights, total)
                for x in range(width):
                    block[r, x, k - k0] = np.uint8(min(total[x], np.float32(CUT)) * np.float32(_SCALE))
        for r in range(rows):
            for x in range(width):
                for k in range(k1 - k0):
                    volume[y0 + r, x, k0 + k] = block[r, x, k]


@njit(cache=True, nogil=True, fastmath=True)
def _sweep_level(
    reference, others, sizes, projections, falling, w, farthest, highest, offsets, weights, unseen, y0, y1, volume
):
    """Lowers the costs of ``_sweep_band`` to those in level planes, whose inverse heights lie in a range.

    A level plane's inverse depth is its inverse height times the fall of the pixel's ray: still a homography. Each is
    taken where the band's lowest row has the inverse depth ``w[k]``; in the rows above, some meet in one of w.
    """
    width, rows = reference.shape[1], y1 - y0
    lowest = falling[0] * np.float32(0.5) * np.float32(width - 1) + falling[1] * np.float32(y1 - 1) + falling[2]
    if lowest < np.float32(LEAST_FALL):
        return
    scratch, total = _scratch(rows, width), np.empty(width, np.float32)
    ranked = np.empty((rows, others.shape[0], width), np.float32)
    planes = projections.copy()
    for k in range(w.shape[0]):
        inverse_height = w[k] / lowest
        if inverse_height < farthest or inverse_height > highest:
            continue
        for i in range(others.shape[0]):
            for a in range(9):
                planes[i, a] = projections[i, a] + projections[i, 9 + a // 3] * falling[a % 3] * inverse_height
        _rank(reference, others, sizes, planes, np.float32(0.0), offsets, unseen, y0, scratch, ranked)
        for r in range(rows):
            _weigh(ranked[r], weights, total)
            _lower(total, inverse_height * falling, y0 + r, w, k, volume[y0 + r])


@njit(cache=True, nogil=True, fastmath=True)
def _lower(total, plane, y, w, k, costs):
    """Costs (WxD) of a row to those on a plane (inverse depth along x, y, 1) at the inverse depths nearest to it."""
    last = w.shape[0] - 1
    for x in range(total.shape[0]):
        at = plane[0] * np.float32(x) + plane[1] * np.float32(y) + plane[2]
        if at < w[1]:
            continue
        while k < last and w[k + 1] - at < at - w[k]:
            k += 1
        while k > 0 and at - w[k - 1] < w[k] - at:
            k -= 1
        value = min(total[x], np.float32(CUT)) * np.float32(_SCALE) + np.float32(LEVEL_PRICE)
        costs[x, k] = min(costs[x, k], np.uint8(value))
