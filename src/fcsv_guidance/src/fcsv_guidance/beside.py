# SPDX-License-Identifier: Apache-2.0
"""Whether somebody who came up to the robot may stand beside it, where a view from far away does not
tell him from the robot."""

from collections import deque
from typing import Deque, NamedTuple

import numpy as np

WALKS_MPS = 1.5  # of who comes
_VIEWS_APART_S = 1.0
_MOVED_M = 0.5  # from one sighting to another; less may be noise
_BLOB_M = 1.0  # about the nearest cell, and error of its middle: one thing
_KEPT_S = 2.5  # of sightings: one view between may miss him
_STEP_M = WALKS_MPS * _VIEWS_APART_S


class _Sighting(NamedTuple):
    """Where the thing nearest to the robot's cells was, and how far from them."""

    stamp_s: float
    at_m: np.ndarray
    off_m: float

    def may_be(self, later: "_Sighting") -> bool:
        """Whether it went on to where a later one shows it; what comes from nowhere is a wrong
        depth."""
        way_m = float(np.hypot(*(later.at_m - self.at_m)))
        return _MOVED_M < way_m < WALKS_MPS * (later.stamp_s - self.stamp_s) + _BLOB_M


class BesideWatch:
    """Follows from view to view what moves near the cells in which the robot itself may be seen:
    they reach farther along the line of sight than across."""

    def __init__(self):
        self._sightings: Deque[_Sighting] = deque()
        #: somebody came up, and was not seen to leave
        self.may_stand = False

    def observe(self, stamp_s: float, new_m: np.ndarray, off_m: np.ndarray) -> None:
        """A view shows things at ``new_m`` (N,2), where the one before showed none, ``off_m`` (N,)
        from the nearest cell in which it may show the robot."""
        while self._sightings and stamp_s - self._sightings[0].stamp_s > _KEPT_S:
            self._sightings.popleft()
        if not len(new_m):
            return
        k = int(np.argmin(off_m))
        at_m = new_m[np.hypot(*(new_m - new_m[k]).T) < _BLOB_M].mean(0)
        new = _Sighting(stamp_s, at_m, float(off_m[k]))
        before_m = [s.off_m for s in self._sightings if s.may_be(new)]
        self._sightings.append(new)
        if new.off_m < _STEP_M:
            self.may_stand |= max(before_m, default=0.0) > new.off_m + _MOVED_M
        elif min(before_m, default=np.inf) < new.off_m - _MOVED_M:
            self.may_stand = False

    def forget(self) -> None:
        """Somebody looked: nobody stands there."""
        self.may_stand = False
        self._sightings.clear()
