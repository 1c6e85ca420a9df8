# SPDX-License-Identifier: Apache-2.0
"""Thin things that stand: posts, masts, trunks.

Most of what is about each of their pixels is background, often of the same grey, and would outvote them wherever
surroundings decide. What flies must not lose them: a narrow stripe that is nearer than what is about it and goes on
upwards is held as it was matched.
"""

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.surfaces.candidates import Candidates

_WIDEST, _TALL = 9, 9  # px: narrower than, and at least as high as
_NEARER = 1.3  # by which its inverse depth is above what is about it
_LEAVE = 3.0  # what another surface than the own place's costs there
_FARTHEST = 1e-4  # 1/m


def thin_uprights(w: np.ndarray) -> np.ndarray:
    """HxW bool: pixels of inverse depth ``w`` (HxW, 1/m) that belong to one."""
    about = cv2.morphologyEx(w, cv2.MORPH_OPEN, np.ones((_WIDEST, _WIDEST), np.uint8))
    narrow = (w > _NEARER * np.maximum(about, _FARTHEST)).astype(np.uint8)
    return cv2.morphologyEx(narrow, cv2.MORPH_OPEN, np.ones((_TALL, 1), np.uint8)) > 0


def add_leaving(coarser: np.ndarray, given: Candidates, cost: np.ndarray) -> None:
    """Adds to the ``cost`` (N,) of candidates what it costs to leave a thin upright of the ``coarser`` map (hxw, 1/m);
    in place."""
    thin = thin_uprights(coarser).astype(np.uint8)
    size = given.start.shape[::-1]
    _add_leaving(cv2.resize(thin, size, interpolation=cv2.INTER_NEAREST) > 0, given.start, given.count, cost)


@njit(cache=True, nogil=True)
def _add_leaving(thin, start, count, cost):
    for y in range(thin.shape[0]):
        for x in range(thin.shape[1]):
            if thin[y, x]:
                for k in range(start[y, x] + 1, start[y, x] + count[y, x]):  # the first is the own place's
                    cost[k] += np.float32(_LEAVE)
