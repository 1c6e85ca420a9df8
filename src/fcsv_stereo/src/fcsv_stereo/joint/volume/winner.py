# SPDX-License-Identifier: Apache-2.0
"""Inverse depth at a reduced size from the whole cost volume, and which pixels it can be trusted at."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.views import LEAST_FALL, Views, inverse_depths
from fcsv_stereo.joint.volume.census import census
from fcsv_stereo.joint.volume.cost_volume import cost_volume
from fcsv_stereo.joint.volume.sgm import aggregate

P1, P2 = 40.0, 330.0
_CONFIDENT = 60  # volume units: a match whose better pairs differ in no more than six of 32 bits
_TEXTURE = 9.0  # variance of grey levels in 5x5
_LEAST_LEVELS = 8
_LEAST_GOOD = 50  # px
_REACH = 0.08  # of the picture's height
_CLEAR_FALL = 0.05  # of a ray, per metre of depth: it clearly meets the ground
_LOW, _ABOVE_GROUND = 25, 1.5  # percentile of a row's inverse depths, share of inverse height
_LEAST_BITS = 5  # set in a census code that tells something


@dataclass(frozen=True)
class Coarse:
    """``w`` HxW float32 (1/m); ``cost`` HxW uint8 there; ``margin`` HxW float32: next best over best, less one."""

    w: np.ndarray
    cost: np.ndarray
    margin: np.ndarray
    levels: np.ndarray


def coarse(
    found: Views, nearest: np.ndarray, highest: float, most_levels: int, pool: ThreadPoolExecutor, step_px: float = 1.0
) -> Coarse:
    """By semi-global matching in the volume of all pairs; none above a row's ``nearest`` inverse depth (H, 1/m), no
    level windows above an inverse height of ``highest`` (1/m) under the camera. A level moves the fastest pair by
    ``step_px``."""
    levels = inverse_depths(found, step_px, most_levels, float(nearest.max()))
    volume, counts = cost_volume(found, levels, nearest, highest, pool)
    total = aggregate(volume, counts, found.reference, (P1, P2), level_drift(found, levels), pool)
    w = np.empty(found.shape, np.float32)
    cost = np.empty(found.shape, np.uint8)
    margin = np.empty(found.shape, np.float32)
    _minima(total, volume, counts, levels, w, cost, margin)
    return Coarse(w, cost, margin, levels)


def highest_level(found: Coarse, small: Views) -> float:
    """Inverse height under the camera (1/m) above which no level surfaces are to be looked for: half as high again as
    what lies lowest in a smaller picture's rows, inf where no row is below the horizon."""
    falls = small.falls
    below = falls > _CLEAR_FALL
    if not below.any():
        return np.inf
    return float(_ABOVE_GROUND * np.median(np.percentile(found.w[below], _LOW, axis=1) / falls[below]))


def level_drift(found: Views, levels: np.ndarray) -> np.ndarray:
    """(2,H,D) float32: how many levels a level surface of each row and level differs in the row above, and below.

    A level plane at height h under the camera has inverse depth ``s / h``, where ``s`` is by how much the pixel's ray
    falls per metre of depth. Rows at and above the horizon have none.
    """
    falls = found.falls
    out = np.zeros((2, len(falls), len(levels)), np.float32)
    for k, neighbour in enumerate((np.roll(falls, 1), np.roll(falls, -1))):
        ratio = np.where((falls > LEAST_FALL) & (neighbour > LEAST_FALL), neighbour / np.maximum(falls, 1e-9), 1.0)
        there = np.interp(ratio[:, None] * levels, levels, np.arange(len(levels)))
        out[k] = there - np.arange(len(levels))
    out[0, 0] = out[1, -1] = 0.0
    return out


def nearest_inverse_depth(found: Coarse, grey: np.ndarray, height: int) -> np.ndarray:
    """(height,) upper bounds of the inverse depth in the rows of the picture, from what has texture and was matched
    well in a smaller one."""
    steady = np.abs(found.w - cv2.medianBlur(found.w, 5)) <= 0.05 * found.w
    variance = cv2.blur(np.square(grey), (5, 5)) - np.square(cv2.blur(grey, (5, 5)))
    brighter = np.unpackbits(census(grey).view(np.uint8).reshape(*grey.shape, 4), axis=2).sum(axis=2)
    good = steady & (found.cost <= _CONFIDENT) & (variance > _TEXTURE) & (brighter >= _LEAST_BITS)
    if good.sum() < _LEAST_GOOD:
        return np.full(height, found.levels[-1])
    least = found.levels[min(_LEAST_LEVELS, len(found.levels) - 1)]
    whole = float(np.clip(1.3 * np.percentile(found.w[good], 99.8), least, found.levels[-1]))
    rows = np.clip(1.5 * np.where(good, found.w, 0.0).max(axis=1), least, whole).astype(np.float32)
    reach = int(_REACH * len(rows))  # things stand higher than where they are matched well
    rows = cv2.dilate(rows[:, None], np.ones((2 * reach + 1, 1), np.uint8))[:, 0]
    return np.interp(np.linspace(0.0, len(rows) - 1.0, height), np.arange(len(rows)), rows)


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
                if abs(d - k) > 2:
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
