# SPDX-License-Identifier: Apache-2.0
"""Thin things that stand: posts, masts, trunks.

Most of what is about each of their pixels is background, often of the same grey, and would outvote
them wherever surroundings decide. What flies must not lose them: a narrow stripe that is nearer
than what is about it and goes on upwards is held as it was matched.
"""

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.surfaces.candidates import Candidates
from fcsv_stereo.joint.tuning import FARTHEST_1_M, SHARED, THIN_UPRIGHTS

_LEAVE = np.float32(THIN_UPRIGHTS.leave)
_NEARER = 1.0 + 3 * SHARED.step  # times inverse depth, than what is about it


def thin_uprights(w: np.ndarray) -> np.ndarray:
    """HxW bool: pixels of inverse depth ``w`` (HxW, 1/m) that belong to one."""
    size = THIN_UPRIGHTS.size_px
    about = cv2.morphologyEx(w, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))
    narrow = w > _NEARER * np.maximum(about, 10 * FARTHEST_1_M)
    return (
        cv2.morphologyEx(narrow.astype(np.uint8), cv2.MORPH_OPEN, np.ones((size, 1), np.uint8)) > 0
    )


def add_leaving(coarser: np.ndarray, given: Candidates, cost: np.ndarray) -> None:
    """Adds to the ``cost`` (N,) of candidates what it costs to leave a thin upright of the
    ``coarser`` map (hxw, 1/m); in place."""
    thin = thin_uprights(coarser).astype(np.uint8)
    size = given.start.shape[::-1]
    _add_leaving(
        cv2.resize(thin, size, interpolation=cv2.INTER_NEAREST) > 0, given.start, given.count, cost
    )


@njit(cache=True, nogil=True)
def _add_leaving(thin, start, count, cost):
    for y in range(thin.shape[0]):
        for x in range(thin.shape[1]):
            if thin[y, x]:
                # the first is the own place's
                for k in range(start[y, x] + 1, start[y, x] + count[y, x]):
                    cost[k] += _LEAVE
