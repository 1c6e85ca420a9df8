# SPDX-License-Identifier: Apache-2.0
"""Where a match can be relied on: good, unambiguous, unique and part of a surface.

Uniqueness: two places of the reference picture cannot both be what one place of another picture shows. Free space:
where a picture shows something far, nothing near can be in front of it (Kutulakos and Seitz 2000).
"""

from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.surfaces.thin_uprights import thin_uprights
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.winner import Coarse

_MOST_COST = 110  # volume units: eleven bits of 32 differ
_LEAST_MARGIN = 0.03
_SPECKLE_PX, _SPECKLE_LEVELS = 60, 3
_TOLERANCE = 0.06  # of inverse depth: the same surface
_KNOWN, _CERTAIN = 0.2, 0.5  # trust of the pair that agrees best
SEEN_THROUGH = 1.2  # by which something must be nearer, to be denied by what is seen behind it
_BETTER = 0.2  # trust by which that must agree better


def trusted(found: Coarse, unique: np.ndarray) -> np.ndarray:
    """HxW bool: where the match is good, beats the next, is ``unique`` (HxW bool) and part of a surface."""
    good = well_matched(found) & unique
    level = (np.searchsorted(found.levels, found.w) * 16).astype(np.int16)
    level[~good] = -16
    cv2.filterSpeckles(level, -16, _SPECKLE_PX, 16 * _SPECKLE_LEVELS)
    return level >= 0


def well_matched(found: Coarse) -> np.ndarray:
    """HxW bool: where the pictures agree and the next best depth is worse."""
    return (found.cost < _MOST_COST) & (found.margin > _LEAST_MARGIN)


def relied_on(found: Views, w: np.ndarray, r: Residuals) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three masks by the pictures' agreement at ``w``: where (HxW bool) it may be taken over by what is about it, as
    any thin thing that stands; where it is certain enough to hide what is behind it: one wrong surface in front speaks
    all that is right out of court; and what is ``confirmed``."""
    unique, best = consistent(found, w, r), r.trust.max(axis=0)
    certain = unique & (best > _CERTAIN)
    return unique & (best > _KNOWN) | thin_uprights(w), certain, confirmed(certain, r)


def confirmed(certain: np.ndarray, r: Residuals) -> np.ndarray:
    """NxHxW bool: where pair i itself agrees with what is ``certain`` (HxW bool), at the pixel and all about it."""
    about = np.ones((3, 3), np.uint8)
    return np.stack([cv2.erode((certain & (t > _CERTAIN)).astype(np.uint8), about) > 0 for t in r.trust])


def consistent(found: Views, w: np.ndarray, r: Residuals) -> np.ndarray:
    """HxW bool: whether in some pair that sees it no place of another depth matches the same pixel better, and in none
    something far behind it is seen there.

    A surface that was stretched into what it hides is told from what hides it: both land on the same pixels.
    """
    unique, seen_through = np.zeros(found.shape, np.bool_), np.zeros(found.shape, np.bool_)
    for i in range(len(found)):
        _claim(w, found.projections[i], found.sizes[i], r.trust[i], r.seen[i], unique, seen_through)
    return unique & ~seen_through


@njit(cache=True, nogil=True)
def _claim(w, p, size, trust, seen, unique, seen_through):
    height, width = w.shape
    best = np.full((size[0], size[1]), np.float32(-1.0))
    winner = np.zeros((size[0], size[1]), np.float32)
    for turn in range(2):
        for v in range(height):
            for u in range(width):
                if seen[v, u] < 0.5:
                    continue
                z = p[6] * u + p[7] * v + p[8] + w[v, u] * p[11]
                x = int((p[0] * u + p[1] * v + p[2] + w[v, u] * p[9]) / z + 0.5)
                y = int((p[3] * u + p[4] * v + p[5] + w[v, u] * p[10]) / z + 0.5)
                if x < 0 or y < 0 or x >= size[1] or y >= size[0]:
                    continue
                if turn == 0:
                    if trust[v, u] > best[y, x]:
                        best[y, x], winner[y, x] = trust[v, u], w[v, u]
                    continue
                other, own = winner[y, x], w[v, u]
                if abs(other - own) <= np.float32(_TOLERANCE) * max(other, own):
                    unique[v, u] = True
                elif other * np.float32(SEEN_THROUGH) < own:
                    least = max(trust[v, u] + np.float32(_BETTER), np.float32(_CERTAIN))
                    seen_through[v, u] |= best[y, x] > least
