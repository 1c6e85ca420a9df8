# SPDX-License-Identifier: Apache-2.0
"""What the colours about a pixel tell of the surface that it belongs to."""

from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.candidates import Candidates, for_rows
from fcsv_stereo.joint.census import OFFSETS

_COLOUR, _MOST_COLOUR, _NO_COLOUR = 0.1, 40.0, 10.0  # per grey level from the plane's place; at most; where it has none
_ALIKE, _LEAST_ALIKE = 20.0, 4  # grey levels between colours of one surface; census bits
_SETTLE_PX, _SETTLE_COLOUR = 5, 25.0  # radius, and grey levels of colour, of the surroundings whose surface wins
_ONE_AT_A_TIME = Lock()  # OpenCV's weighted median writes beyond its memory where two threads run it
_OTHER = 1.1  # by which an inverse depth is another surface's


def alike_bits(image: np.ndarray, pool: ThreadPoolExecutor) -> Tuple[np.ndarray, np.ndarray]:
    """Which bits of a pixel's census code compare it with pixels of its colour (HxW uint32 mask), and what each of
    those counts (HxW float32), in ``image`` (HxWx3 float32): others may be of another surface."""
    mask, scale = np.zeros(image.shape[:2], np.uint32), np.zeros(image.shape[:2], np.float32)
    for_rows(pool, len(image), lambda y0, y1: _alike(image, OFFSETS, y0, y1, mask, scale))
    return mask, scale


def add_likeness(
    image: np.ndarray, shape: Tuple[int, int], given: Candidates, pool: ThreadPoolExecutor, cost: np.ndarray
) -> None:
    """Adds to the candidates' ``cost`` (N,) how unlike a pixel is to the place in the coarser map (``shape``) that the
    candidate's plane is from; in place."""
    near = cv2.medianBlur(cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA), 3).reshape(-1, 3)
    planes = given.start, given.count, given.source
    for_rows(pool, len(image), lambda y0, y1: _add_likeness(image, near, *planes, y0, y1, cost))


def settle(image: np.ndarray, given: Candidates, best: np.ndarray) -> None:
    """Gives a pixel the candidate nearest to what those about it of its colour have; in place."""
    _nearest(given.start, given.count, given.w, _of_its_colour(image, best), best)


def settled(image: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Inverse depth (HxW, 1/m), where another surface's, as those about a pixel of its colour in ``image`` have it."""
    target = _of_its_colour(image, w)
    return np.where((w > _OTHER * target) | (target > _OTHER * w), target, w)


def _of_its_colour(image: np.ndarray, w: np.ndarray) -> np.ndarray:
    """HxW float32, 1/m: the median of ``w`` about each pixel weighted by likeness of colour (Ma et al. 2013).

    Windows take up more than one surface where these meet; the pixels' colours tell them apart.
    """
    log_w = np.log(np.maximum(w, 1e-5))
    low, scale = log_w.min(), 255.0 / max(float(np.ptp(log_w)), 1e-6)
    steps = np.round((log_w - low) * scale).astype(np.uint8)
    guide = np.clip(image, 0.0, 255.0).astype(np.uint8)
    with _ONE_AT_A_TIME:
        cv2.setRNGSeed(0)  # it draws the start of its clusters of colours: the same pictures shall give the same map
        median = cv2.ximgproc.weightedMedianFilter(guide, steps, _SETTLE_PX, _SETTLE_COLOUR, cv2.ximgproc.WMF_EXP)
    return np.exp(median / scale + low).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _alike(image, offsets, y0, y1, mask, scale):
    """Where few bits are left, all count; fewer bits weigh more each, but tell less together."""
    height, width = mask.shape
    most = np.float32(3.0 * _ALIKE)
    for y in range(y0, y1):
        for x in range(width):
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
