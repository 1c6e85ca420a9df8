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
        self._came_near = False
        #: until he is seen again
        self.may_stand = False

    def observe(self, stamp_s: float, things_m: np.ndarray, off_m: np.ndarray) -> None:
        """A view shows things at ``things_m`` (N,2), ``off_m`` (N,) from the nearest cell in which it
        may show the robot."""
        while self._sightings and stamp_s - self._sightings[0].stamp_s > _KEPT_S:
            self._sightings.popleft()
        nearest_m, comes, leaves = np.inf, False, False
        if len(things_m):
            k = int(np.argmin(off_m))
            at_m = things_m[np.hypot(*(things_m - things_m[k]).T) < _BLOB_M].mean(0)
            new = _Sighting(stamp_s, at_m, float(off_m[k]))
            before = [s.off_m for s in self._sightings if s.may_be(new)]
            nearest_m = new.off_m
            comes = max(before, default=-np.inf) > nearest_m
            leaves = min(before, default=np.inf) < nearest_m
            self._sightings.append(new)
        if nearest_m < _STEP_M:
            self._came_near |= comes
        else:
            self.may_stand |= self._came_near and nearest_m > 2 * _STEP_M
            self._came_near = False
        self.may_stand &= not (leaves and nearest_m <= 2 * _STEP_M)

    def forget(self) -> None:
        """Somebody looked: nobody stands there."""
        self._came_near = self.may_stand = False
        self._sightings.clear()
