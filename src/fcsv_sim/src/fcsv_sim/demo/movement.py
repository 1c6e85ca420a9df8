# SPDX-License-Identifier: Apache-2.0
"""How far a vehicle moved, where hovering about a point is no movement."""

from typing import Optional

import numpy as np

_STEP_M = 0.1


class Movement:
    """add() places (3,) m as they come; the step since the last one that counted.

    >>> movement = Movement()
    >>> [round(movement.add((x, 0.0, 0.0)), 2) for x in (5.0, 5.05, 5.2, 5.25)]
    [0.0, 0.0, 0.2, 0.0]
    """

    def __init__(self):
        self.place_m: Optional[np.ndarray] = None

    def add(self, place_m) -> float:
        place = np.asarray(place_m, float)
        if self.place_m is None:
            self.place_m = place
        step_m = float(np.linalg.norm(place - self.place_m))
        if step_m <= _STEP_M:
            return 0.0
        self.place_m = place
        return step_m
