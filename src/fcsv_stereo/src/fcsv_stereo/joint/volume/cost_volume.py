# SPDX-License-Identifier: Apache-2.0
"""The cost volume: how little the reference and the other pictures agree, per pixel and inverse
depth.

Every other picture is warped onto the reference for every plane of inverse depth (plane sweep;
Collins 1996), so that its census code (Zabih and Woodfill 1994) is taken at sub-pixel places and
for any relative pose. All pairs speak in one volume (Okutomi and Kanade 1993); each pair's cost is
cut off, so that one that is occluded cannot outvote others.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Tuple

import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.tuning import VIEWS, VOLUME
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.census import CUT, OFFSETS, census, unseen_bits
from fcsv_stereo.joint.volume.pair_costs import QUARTERS, rank, scratch, weigh

_SCALE = 10  # volume units of a bit: 16 bits of 32 have room in 8
_LEVEL_PRICE = VOLUME.level_price
_LEAST_FALL = VIEWS.least_fall
_BLOCK, _BAND = 32, 40  # levels, rows: time alone


def cost_volume(
    found: Views, w: np.ndarray, nearest: np.ndarray, highest: float, pool: ThreadPoolExecutor
) -> Tuple[np.ndarray, np.ndarray]:
    """HxWxD uint8, tenths of bits: the cost of every inverse depth ``w`` (1/m) at every pixel; and
    (H,) int64, how many levels a row has: none above its ``nearest`` (H, 1/m), there is more to see
    far away than near.

    The pairs' costs are sorted and the better ones weigh more (4, 3, 2, 1 of four): where some are
    occluded, the rest decides. A window may lie in a level plane as well as in an upright one
    (Gallup et al. 2007: sweeps in several directions): the ground shears by the baseline over the
    height from row to row. ``highest`` (1/m) is the inverse height under the camera above which no
    level planes are tried. Above the horizon, where nothing tells of a depth, there is none.
    """
    height, width = found.shape
    volume, counts = np.empty((height, width, len(w)), np.uint8), np.empty(height, np.int64)
    codes = census(found.reference)
    weights = pair_weights(len(found))
    unseen = np.round(QUARTERS * unseen_bits(found.reference)).astype(np.uint8)
    shear = found.fastest_px_m * float(np.hypot(*found.falling[:2]))
    heights = np.float32([VOLUME.least_tilt / max(shear, 1e-9), highest])

    def run(y0, y1):
        count = int(np.searchsorted(w, nearest[y0:y1].max(), side="right"))
        _sweep_band(
            codes,
            found.others,
            found.sizes,
            found.projections,
            w[:count],
            OFFSETS,
            weights,
            unseen,
            y0,
            y1,
            volume,
        )
        counts[y0:y1] = count
        for y in np.flatnonzero(found.falls[y0:y1] <= 0.0) + y0:
            volume[y, :, VOLUME.alike_levels : count] += np.uint8(VOLUME.unlikely)
        _sweep_level(
            codes,
            found.others,
            found.sizes,
            found.projections,
            found.falling.astype(np.float32),
            w[:count],
            *heights,
            OFFSETS,
            weights,
            unseen,
            y0,
            y1,
            volume,
        )

    for_rows(pool, height, run, _BAND)
    return volume, counts


def pair_weights(pairs: int) -> np.ndarray:
    """(N,) float32 weights of the pairs' costs from the best to the worst at a pixel; their sum is
    1."""
    weights = np.arange(pairs, 0, -1, dtype=np.float64)
    return (weights / weights.sum()).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _sweep_band(reference, others, sizes, projections, w, offsets, weights, unseen, y0, y1, volume):
    width, rows = reference.shape[1], y1 - y0
    room, total = scratch(rows, width), np.empty(width, np.float32)
    ranked = np.empty((rows, others.shape[0], width), np.uint8)
    block = np.empty((rows, width, _BLOCK), np.uint8)
    for k0 in range(0, w.shape[0], _BLOCK):
        k1 = min(k0 + _BLOCK, w.shape[0])
        for k in range(k0, k1):
            rank(reference, others, sizes, projections, w[k], offsets, unseen, y0, room, ranked)
            for r in range(rows):
                weigh(ranked[r], weights, total)
                for x in range(width):
                    block[r, x, k - k0] = np.uint8(
                        min(total[x], np.float32(CUT)) * np.float32(_SCALE)
                    )
        for r in range(rows):
            for x in range(width):
                for k in range(k1 - k0):
                    volume[y0 + r, x, k0 + k] = block[r, x, k]


@njit(cache=True, nogil=True, fastmath=True)
def _sweep_level(  # noqa: PLR0913
    reference,
    others,
    sizes,
    projections,
    falling,
    w,
    farthest,
    highest,
    offsets,
    weights,
    unseen,
    y0,
    y1,
    volume,
):
    """Lowers the costs of ``_sweep_band`` to those in level planes, whose inverse heights lie in a
    range.

    A level plane's inverse depth is its inverse height times the fall of the pixel's ray: still a
    homography. Each is taken where the band's lowest row has the inverse depth ``w[k]``; in the
    rows above, some meet in one of w.
    """
    width, rows = reference.shape[1], y1 - y0
    lowest = (
        falling[0] * np.float32(0.5) * np.float32(width - 1)
        + falling[1] * np.float32(y1 - 1)
        + falling[2]
    )
    if lowest < np.float32(_LEAST_FALL):
        return
    room, total = scratch(rows, width), np.empty(width, np.float32)
    ranked = np.empty((rows, others.shape[0], width), np.uint8)
    planes = projections.copy()
    for k in range(w.shape[0]):
        inverse_height = w[k] / lowest
        if inverse_height < farthest or inverse_height > highest:
            continue
        for i in range(others.shape[0]):
            for a in range(9):
                planes[i, a] = (
                    projections[i, a] + projections[i, 9 + a // 3] * falling[a % 3] * inverse_height
                )
        rank(reference, others, sizes, planes, np.float32(0.0), offsets, unseen, y0, room, ranked)
        for r in range(rows):
            weigh(ranked[r], weights, total)
            _lower(total, inverse_height * falling, y0 + r, w, k, volume[y0 + r])


@njit(cache=True, nogil=True, fastmath=True)
def _lower(total, plane, y, w, k, costs):
    """Costs (WxD) of a row to those on a plane (inverse depth along x, y, 1) at the inverse depths
    nearest to it."""
    last = w.shape[0] - 1
    for x in range(total.shape[0]):
        at = plane[0] * np.float32(x) + plane[1] * np.float32(y) + plane[2]
        if at < w[1]:
            continue
        while k < last and w[k + 1] - at < at - w[k]:
            k += 1
        while k > 0 and at - w[k - 1] < w[k] - at:
            k -= 1
        value = min(total[x], np.float32(CUT)) * np.float32(_SCALE) + np.float32(_LEVEL_PRICE)
        costs[x, k] = min(costs[x, k], np.uint8(value))
