# SPDX-License-Identifier: Apache-2.0
"""Whether somebody who came up to the robot may stand beside it, where a view from far away does not
tell him from the robot."""

from typing import Optional

import numpy as np

WALKS_MPS = 1.5  # of who comes
_VIEWS_APART_S = 1.0
_MOVED_M = 0.5  # between two views; less may be noise
_STEP_M = WALKS_MPS * _VIEWS_APART_S


class BesideWatch:
    """Follows what moves near the robot from view to view."""

    def __init__(self):
        self._last_m: Optional[np.ndarray] = None
        self._came_near = False
        #: until he is seen again
        self.may_stand = False

    def observe(self, things_m: np.ndarray, robot_m, hidden_m: float) -> None:
        """A view shows things at ``things_m`` (N,2) and nothing nearer than ``hidden_m`` to the
        robot at ``robot_m`` (2,)."""
        off_m = np.hypot(*(things_m - robot_m).T) if len(things_m) else np.array([np.inf])
        k, last_m = int(np.argmin(off_m)), self._last_m
        self._last_m = things_m[k] if len(things_m) else None
        if off_m[k] < hidden_m + _STEP_M:
            # what comes from nowhere is a wrong depth
            way_m = np.inf if last_m is None else float(np.hypot(*(things_m[k] - last_m)))
            self._came_near |= _MOVED_M < way_m < 2 * _STEP_M
            self.may_stand = False
        else:
            vanished = off_m[k] > hidden_m + 2 * _STEP_M
            self.may_stand = vanished and (self.may_stand or self._came_near)
            self._came_near = False

    def forget(self) -> None:
        """Somebody looked: nobody stands there."""
        self._came_near = self.may_stand = False
