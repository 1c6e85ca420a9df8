# SPDX-License-Identifier: Apache-2.0
"""Where a match can be relied on: good, unambiguous, unique and part of a surface.

Uniqueness: two places of the reference picture cannot both be what one place of another picture
shows. Free space: where a picture shows something far, nothing near can be in front of it
(Kutulakos and Seitz 2000).
"""

from typing import Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.projecting import place, ray
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.surfaces.data_cost import SEEN_THROUGH
from fcsv_stereo.joint.surfaces.thin_uprights import thin_uprights
from fcsv_stereo.joint.tuning import RELIABILITY, SHARED
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.winner import VolumeMatch, well_matched

_CERTAIN, _BETTER, _TOLERANCE = RELIABILITY.certain, RELIABILITY.tells, SHARED.one_surface
_PARTS = 16  # of a level, for OpenCV's whole numbers


def trusted(match: VolumeMatch, found: Views, r: Residuals) -> np.ndarray:
    """HxW bool: where a match is good, beats the next, is ``consistent`` and part of a surface."""
    good = well_matched(match) & consistent(found, match.w, r)
    level = (np.searchsorted(match.levels, match.w) * _PARTS).astype(np.int16)
    level[~good] = -_PARTS
    cv2.filterSpeckles(level, -_PARTS, RELIABILITY.speckle_px, _PARTS * RELIABILITY.speckle_levels)
    return level >= 0


def relied_on(
    found: Views, w: np.ndarray, r: Residuals
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three masks by the pictures' agreement at ``w``: where (HxW bool) it may be taken over by
    what is about it, as any thin thing that stands; where it is certain enough to hide what is
    behind it (one wrong near surface hides all correct ones behind it); and what is
    ``confirmed``."""
    unique, best = consistent(found, w, r), r.trust.max(axis=0)
    certain = unique & (best > _CERTAIN)
    return unique & (best > RELIABILITY.tells) | thin_uprights(w), certain, confirmed(certain, r)


def is_certain(found: Views, w: np.ndarray, r: Residuals) -> np.ndarray:
    """The second mask of ``relied_on`` alone."""
    return consistent(found, w, r) & (r.trust.max(axis=0) > _CERTAIN)


def confirmed(certain: np.ndarray, r: Residuals) -> np.ndarray:
    """NxHxW bool: where pair i itself agrees with what is ``certain`` (HxW bool), at the pixel and
    all about it."""
    about = np.ones((3, 3), np.uint8)
    return np.stack(
        [cv2.erode((certain & (t > _CERTAIN)).astype(np.uint8), about) > 0 for t in r.trust]
    )


def consistent(found: Views, w: np.ndarray, r: Residuals) -> np.ndarray:
    """HxW bool: whether in some pair that sees it no place of another depth matches the same pixel
    better, and in none something far behind it is seen there.

    A surface that was stretched into what it hides is told from what hides it: both land on the
    same pixels.
    """
    unique, seen_through = np.zeros(found.shape, np.bool_), np.zeros(found.shape, np.bool_)
    for i in range(len(found)):
        _claim(w, found.projections, i, found.sizes[i], r.trust[i], r.seen[i], unique, seen_through)
    return unique & ~seen_through


@njit(cache=True, nogil=True)
def _claim(w, projections, i, size, trust, seen, unique, seen_through):
    height, width = w.shape
    best = np.full((size[0], size[1]), np.float32(-1.0))
    winner = np.zeros((size[0], size[1]), np.float32)
    for turn in range(2):
        for v in range(height):
            for u in range(width):
                if seen[v, u] < 0.5:
                    continue
                a, b, c = ray(projections, i, u, v)
                across, down, _, _ = place(a, b, c, projections, i, w[v, u])
                x, y = int(across + 0.5), int(down + 0.5)
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
