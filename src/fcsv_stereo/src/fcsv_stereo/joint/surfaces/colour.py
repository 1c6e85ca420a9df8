# SPDX-License-Identifier: Apache-2.0
"""What the colours about a pixel tell of the surface that it belongs to."""

from concurrent.futures import ThreadPoolExecutor
from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.surfaces.candidates import Candidates
from fcsv_stereo.joint.tuning import COLOUR, FARTHEST_1_M, SHARED
from fcsv_stereo.joint.volume.census import OFFSETS

# grey levels: what counts where a plane has no place of its own is that of another surface; census
# bits beyond twice that are of another one for certain; more than four times tells no more
_COLOUR, _NO_COLOUR = COLOUR.per_grey, SHARED.surface_grey
_ALIKE, _MOST_COLOUR = 2 * SHARED.surface_grey, 4 * SHARED.surface_grey
_LEAST_ALIKE = COLOUR.least_alike
_SETTLE_PX = COLOUR.settle_px
# a table of weights by squared distance, as far as they count
_LIKENESS_SHIFT, _LIKENESS_BINS = 4, 512
_OTHER = 1.0 + SHARED.step


def alike_bits(
    image: np.ndarray, given: Candidates, pool: ThreadPoolExecutor
) -> Tuple[np.ndarray, np.ndarray]:
    """Which bits of a pixel's census code compare it with pixels of its colour (HxW uint32 mask),
    and what each of those counts (HxW float32), in ``image`` (HxWx3): others may be of another
    surface. 0 where there is no choice."""
    mask, scale = np.zeros(image.shape[:2], np.uint32), np.zeros(image.shape[:2], np.float32)
    for_rows(
        pool, len(image), lambda y0, y1: _alike(image, OFFSETS, given.count, y0, y1, mask, scale)
    )
    return mask, scale


def add_likeness(
    image: np.ndarray,
    shape: Tuple[int, int],
    given: Candidates,
    pool: ThreadPoolExecutor,
    cost: np.ndarray,
) -> None:
    """Adds to the candidates' ``cost`` (N,) how unlike a pixel is to the place in the coarser map
    (``shape``) that the candidate's plane is from; in place."""
    small = cv2.resize(image.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
    near = cv2.medianBlur(small, 3).reshape(-1, 3)
    planes = given.start, given.count, given.source
    for_rows(pool, len(image), lambda y0, y1: _add_likeness(image, near, *planes, y0, y1, cost))


def settle(
    image: np.ndarray, given: Candidates, best: np.ndarray, pool: ThreadPoolExecutor
) -> None:
    """Gives a pixel the candidate nearest to what those about it of its colour have; in place."""
    _nearest(given.start, given.count, given.w, _of_its_colour(image, best, pool), best)


def settled(image: np.ndarray, w: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """Inverse depth (HxW, 1/m), where another surface's, as those about a pixel of its colour in
    ``image`` have it."""
    target = _of_its_colour(image, w, pool)
    return np.where((w > _OTHER * target) | (target > _OTHER * w), target, w)


def _of_its_colour(image: np.ndarray, w: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """HxW float32, 1/m: the median of ``w`` about each pixel weighted by likeness of colour (Ma et
    al. 2013), where more than one surface is about it.

    Windows take up more than one surface where these meet; the pixels' colours tell them apart.
    (OpenCV has this filter, of the whole picture on one core; where two threads call it, it writes
    beyond its memory.)
    """
    log_w = np.maximum(w, FARTHEST_1_M)
    np.log(log_w, out=log_w)  # in place: large pictures
    low, scale = log_w.min(), 255.0 / max(float(np.ptp(log_w)), 1e-6)
    about = np.ones((2 * _SETTLE_PX + 1,) * 2, np.uint8)
    step = cv2.dilate(log_w, about)
    step -= cv2.erode(log_w, about)
    mixed = step > np.log(_OTHER)
    log_w -= low
    log_w *= scale
    steps = np.round(log_w, out=log_w).astype(np.uint8)
    del log_w, step
    colours = image if image.dtype == np.int16 else np.clip(image, 0.0, 255.0).astype(np.int16)
    squares = np.arange(_LIKENESS_BINS) << _LIKENESS_SHIFT
    likeness = np.exp(squares / (-2.0 * COLOUR.settle_grey**2)).astype(np.float32)
    median = steps.copy()
    for_rows(pool, len(w), lambda y0, y1: _median(colours, steps, mixed, likeness, y0, y1, median))
    of_step = np.exp(np.arange(256, dtype=np.uint8) / scale + low).astype(np.float32)
    return np.where(mixed, of_step[median], w)


@njit(cache=True, nogil=True)
def _median(colours, steps, mixed, likeness, y0, y1, out):
    """Weighted medians of 8-bit ``steps``; ``likeness`` by squared distance of colour."""
    height, width = steps.shape
    weights = np.zeros(256, np.float32)
    for y in range(y0, y1):
        for x in range(width):
            if not mixed[y, x]:
                continue
            weights[:] = np.float32(0.0)
            total = np.float32(0.0)
            for r in range(max(y - _SETTLE_PX, 0), min(y + _SETTLE_PX + 1, height)):
                for c in range(max(x - _SETTLE_PX, 0), min(x + _SETTLE_PX + 1, width)):
                    distance = 0
                    for i in range(3):
                        step = colours[y, x, i] - colours[r, c, i]
                        distance += step * step
                    k = distance >> _LIKENESS_SHIFT
                    if k < _LIKENESS_BINS:
                        weights[steps[r, c]] += likeness[k]
                        total += likeness[k]
            k, below = 0, weights[0]
            while below < np.float32(0.5) * total:
                k += 1
                below += weights[k]
            out[y, x] = k


@njit(cache=True, nogil=True, fastmath=True)
def _alike(image, offsets, candidates, y0, y1, mask, scale):
    """Where few bits are left, all count; fewer bits weigh more each, but tell less together."""
    height, width = mask.shape
    most = np.float32(3.0 * _ALIKE)
    for y in range(y0, y1):
        for x in range(width):
            if candidates[y, x] < 2:
                continue
            bits, count = np.uint32(0), 0
            for k in range(offsets.shape[0]):
                r = min(max(y + offsets[k, 0], 0), height - 1)
                c = min(max(x + offsets[k, 1], 0), width - 1)
                step = np.float32(0.0)
                for i in range(3):
                    step += abs(image[y, x, i] - image[r, c, i])
                if step < most:
                    bits |= np.uint32(1) << np.uint32(k)
                    count += 1
            if count < _LEAST_ALIKE:
                bits, count = np.uint32(0xFFFFFFFF), 32
            mask[y, x], scale[y, x] = bits, np.sqrt(np.float32(32.0) / np.float32(count))


@njit(cache=True, nogil=True, fastmath=True)
def _add_likeness(image, near, start, count, source, y0, y1, cost):
    """A plane is likely whose place looks like the pixel."""
    for y in range(y0, y1):
        for x in range(image.shape[1]):
            if count[y, x] < 2:
                continue
            for k in range(start[y, x], start[y, x] + count[y, x]):
                step = np.float32(_NO_COLOUR)
                if source[k] >= 0:
                    step = np.float32(0.0)
                    for c in range(3):
                        step += abs(np.float32(image[y, x, c]) - np.float32(near[source[k], c]))
                    step /= np.float32(3.0)
                cost[k] += np.float32(_COLOUR) * min(step, np.float32(_MOST_COLOUR))


@njit(cache=True, nogil=True)
def _nearest(start, count, values, target, best):
    """The candidate nearest to ``target`` (HxW), where what was chosen is of another surface."""
    other = np.float32(_OTHER)
    for y in range(best.shape[0]):
        for x in range(best.shape[1]):
            wanted = target[y, x]
            if best[y, x] < other * wanted and wanted < other * best[y, x]:
                continue
            for k in range(start[y, x], start[y, x] + count[y, x]):
                if abs(values[k] - wanted) < abs(best[y, x] - wanted):
                    best[y, x] = values[k]
