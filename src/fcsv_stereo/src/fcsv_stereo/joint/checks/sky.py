# SPDX-License-Identifier: Apache-2.0
"""The sky: what is at infinity for every pair, from the top of the picture down to the skyline."""

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from fcsv_stereo.joint.refine.residuals import Residuals

_MOST_PX = 1.2  # of movement in the fastest pair: infinity, as well as a coarse match can tell
_GROWTH_PX = 12  # by which the match makes what is in front of the sky too large
_STEP = 12.0  # grey levels: the skyline
_LIKENESS = 25.0  # grey levels of colour
_BINS = 16  # of each colour


def sky(w: np.ndarray, r: Residuals, colour: np.ndarray, blind: np.ndarray) -> np.ndarray:
    """HxW bool, from inverse depth (1/m), what pairs make of it, ``colour`` (HxWx3 float32), and where the sky would be
    outside every other picture (``blind``, HxW bool: a tilted pair has wide borders of it).

    The windows of the match carry the skyline into the sky, which has little texture; so the sky grows again over
    pixels that look like it, up to the next edge of the picture. Where pairs are blind, colour alone decides.
    """
    still = (cv2.medianBlur(w.astype(np.float32), 5) * r.speed.max(axis=0) < _MOST_PX) & ~blind
    still = cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    out = _joined(still | blind, _top_rows(still.shape)) & still
    kernel = np.ones((3, 3), np.uint8)
    smooth = np.max(cv2.morphologyEx(colour, cv2.MORPH_GRADIENT, kernel), axis=2) < _STEP
    share = cv2.blur(out.astype(np.float32), (25, 25))
    mean = cv2.blur(colour * out[..., None], (25, 25)) / np.maximum(share, 1e-3)[..., None]
    alike = (np.abs(colour - mean).mean(axis=2) < _LIKENESS) & (share > 0.02)
    for _ in range(_GROWTH_PX):
        out = out | (cv2.dilate(out.astype(np.uint8), kernel) > 0) & smooth & alike
    return out | _joined(out | blind & _coloured_like(out, ~blind, colour), out)


def _top_rows(shape) -> np.ndarray:
    rows = np.zeros(shape, np.bool_)
    rows[:2] = True
    return rows


def _joined(region: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The parts of a region (HxW bool) that have a seed in them."""
    labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)[1]
    return region & np.isin(labels, np.unique(labels[seeds & region]))


def _coloured_like(some: np.ndarray, all_known: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """HxW bool: whose colour is more often ``some``'s than not, of what is known (both HxW bool; histograms' ratio,
    Swain and Ballard 1991)."""
    codes = np.int64(np.clip(colour, 0.0, 255.0) * (_BINS / 256.0)) @ np.array([_BINS**2, _BINS, 1])

    def histogram(of):
        counts = np.bincount(codes[of], minlength=_BINS**3).reshape(_BINS, _BINS, _BINS).astype(np.float32)
        return gaussian_filter(counts, 1.0)

    share = histogram(some & all_known) / np.maximum(histogram(all_known), 1e-3)
    return cv2.medianBlur((share.ravel()[codes] > 0.5).astype(np.uint8), 5) > 0
