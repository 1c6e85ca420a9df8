# SPDX-License-Identifier: Apache-2.0
"""Inverse depth at a reduced size from the whole cost volume, and which pixels it can be trusted
at."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.tuning import LEAST_LEVELS, SGM, SHARED, VIEWS, VOLUME, WINNER
from fcsv_stereo.joint.views import Views, inverse_depths
from fcsv_stereo.joint.volume.census import census
from fcsv_stereo.joint.volume.cost_volume import cost_volume
from fcsv_stereo.joint.volume.sgm import aggregate

_BESIDE = VOLUME.alike_levels
_TEXTURE = (4 * SHARED.noise_grey) ** 2  # grey levels squared: far above noise


@dataclass(frozen=True)
class VolumeMatch:
    """``w`` HxW float32 (1/m); ``cost`` HxW uint8 there; ``margin`` HxW float32: next best over
    best, less one."""

    w: np.ndarray
    cost: np.ndarray
    margin: np.ndarray
    levels: np.ndarray


def match_volume(
    found: Views,
    nearest: np.ndarray,
    highest: float,
    most_levels: int,
    pool: ThreadPoolExecutor,
    step_px: float = 1.0,
) -> VolumeMatch:
    """Matches by semi-global matching in the volume of all pairs; none above a row's ``nearest``
    inverse depth (H, 1/m), no level windows above an inverse height of ``highest`` (1/m) under the
    camera. A level moves the fastest pair by ``step_px``."""
    levels = inverse_depths(found, step_px, most_levels, float(nearest.max()))
    volume, counts = cost_volume(found, levels, nearest, highest, pool)
    total = aggregate(
        volume, counts, found.reference, (SGM.p1, SGM.p2), level_drift(found, levels), pool
    )
    w = np.empty(found.shape, np.float32)
    cost = np.empty(found.shape, np.uint8)
    margin = np.empty(found.shape, np.float32)
    _minima(total, volume, counts, levels, w, cost, margin)
    return VolumeMatch(w, cost, margin, levels)


def highest_level(found: VolumeMatch, small: Views) -> float:
    """Inverse height under the camera (1/m) above which no level surfaces are to be looked for:
    half as high again as what lies lowest in a smaller picture's rows, inf where no row is below
    the horizon."""
    falls = small.falls
    # well below the horizon: the rows that tell the ground's height
    below = falls > 5 * VIEWS.least_fall
    if not below.any():
        return np.inf
    low = np.percentile(found.w[below], WINNER.low_percentile, axis=1)
    return float(WINNER.room * np.median(low / falls[below]))


def level_drift(found: Views, levels: np.ndarray) -> np.ndarray:
    """(2,H,D) float32: how many levels a level surface of each row and level differs in the row
    above, and below.

    A level plane at height h under the camera has inverse depth ``s / h``, where ``s`` is by how
    much the pixel's ray falls per metre of depth. Rows at and above the horizon have none.
    """
    falls = found.falls
    out = np.zeros((2, len(falls), len(levels)), np.float32)
    for k, neighbour in enumerate((np.roll(falls, 1), np.roll(falls, -1))):
        below = (falls > VIEWS.least_fall) & (neighbour > VIEWS.least_fall)
        ratio = np.where(below, neighbour / np.maximum(falls, 1e-9), 1.0)
        there = np.interp(ratio[:, None] * levels, levels, np.arange(len(levels)))
        out[k] = there - np.arange(len(levels))
    out[0, 0] = out[1, -1] = 0.0
    return out


def nearest_inverse_depth(found: VolumeMatch, grey: np.ndarray, height: int) -> np.ndarray:
    """(height,) upper bounds of the inverse depth in the rows of the picture, from what has texture
    and was matched well in a smaller one."""
    window = (SHARED.window_px,) * 2
    steady = (
        np.abs(found.w - cv2.medianBlur(found.w, SHARED.window_px)) <= SHARED.one_surface * found.w
    )
    variance = cv2.blur(np.square(grey), window) - np.square(cv2.blur(grey, window))
    brighter = np.unpackbits(census(grey).view(np.uint8).reshape(*grey.shape, 4), axis=2).sum(
        axis=2
    )
    tells = (variance > _TEXTURE) & (brighter >= WINNER.least_bits)
    good = steady & (found.cost <= WINNER.most_cost // 2) & tells
    if good.sum() < SHARED.least_pixels:
        return np.full(height, found.levels[-1])
    least = found.levels[min(LEAST_LEVELS, len(found.levels) - 1)]
    nearest = np.percentile(found.w[good], WINNER.nearest_percentile)
    whole = float(np.clip(WINNER.nearest_picture * nearest, least, found.levels[-1]))
    rows = np.clip(WINNER.room * np.where(good, found.w, 0.0).max(axis=1), least, whole).astype(
        np.float32
    )
    reach = int(WINNER.reach * len(rows))  # things stand higher than where they are matched well
    rows = cv2.dilate(rows[:, None], np.ones((2 * reach + 1, 1), np.uint8))[:, 0]
    return np.interp(np.linspace(0.0, len(rows) - 1.0, height), np.arange(len(rows)), rows)


def well_matched(found: VolumeMatch) -> np.ndarray:
    """HxW bool: where the pictures agree and the next best depth is worse."""
    return (found.cost < WINNER.most_cost) & (found.margin > WINNER.least_margin)


@njit(cache=True, nogil=True)
def _minima(total, volume, counts, levels, w, cost, margin):
    """Least sum per pixel, between the levels by a parabola."""
    height, width, _ = total.shape
    for y in range(height):
        depth = counts[y]
        for x in range(width):
            sums = total[y, x]
            k = 0
            for d in range(1, depth):
                if sums[d] < sums[k]:
                    k = d
            second = np.float32(1e9)
            for d in range(depth):
                if abs(d - k) > _BESIDE:
                    second = min(second, np.float32(sums[d]))
            w[y, x] = levels[k]
            if 0 < k < depth - 1:
                a, b, c = np.float32(sums[k - 1]), np.float32(sums[k]), np.float32(sums[k + 1])
                bend = a - b - b + c
                if bend > 0:
                    shift = (a - c) / (bend + bend)
                    step = levels[k + 1] - levels[k] if shift > 0 else levels[k] - levels[k - 1]
                    w[y, x] += shift * step
            cost[y, x] = volume[y, x, k]
            margin[y, x] = second / max(np.float32(sums[k]), np.float32(1.0)) - np.float32(1.0)
