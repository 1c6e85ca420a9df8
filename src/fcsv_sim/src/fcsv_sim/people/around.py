# SPDX-License-Identifier: Apache-2.0
"""How a pilot keeps clear of the other vehicles that he sees: he goes around them, waits, and lands
beside them."""

from typing import Optional, Sequence

import numpy as np

from fcsv_geometry.missions import airspace
from fcsv_geometry.missions.airspace import HorizontalClearance, Occupant

CLEAR_M = 2.5  # horizontally
_HEIGHT_M = 3.0  # and above or below: nearer than both is too near
_SLOWS_M = 1.0  # he slows down from so far before
_AROUND_MPS = 0.8
_BELOW_M = 0.5


def kept_clear(
    v_mps: np.ndarray, p_m: np.ndarray, goal_m: np.ndarray, others: Sequence[np.ndarray]
) -> np.ndarray:
    """(3,) the velocity that he wants (world), without what would bring him too near to somebody,
    and with a way around where the goal is behind. Where the goal itself is too near to somebody he
    waits.

    >>> kept_clear(np.array([1.0, 0.0, 0.0]), np.zeros(3), np.array([9.0, 0.0, 0.0]), [np.array([2.5, 0.0, 0.0])])
    array([0. , 0.8, 0. ])
    >>> kept_clear(np.array([1.0, 0.0, 0.0]), np.zeros(3), np.array([2.0, 0.0, 0.0]), [np.array([2.5, 0.0, 0.0])])
    array([0., 0., 0.])
    """
    v = np.array(v_mps, float)
    for other in others:
        off, height_m = other[:2] - p_m[:2], float(other[2] - p_m[2])
        away_m = float(np.hypot(*off))
        if away_m > CLEAR_M + _SLOWS_M or abs(height_m) > _HEIGHT_M + _SLOWS_M:
            continue
        if away_m < CLEAR_M and v[2] * height_m > 0:
            v[2] = np.sign(height_m) * min(abs(v[2]), max(0.0, abs(height_m) - _HEIGHT_M))
        towards = off / away_m if away_m > 0.0 else np.array([0.0, 1.0])
        speed_mps, most_mps = float(v[:2] @ towards), away_m - CLEAR_M
        if speed_mps > most_mps:
            v[:2] += (most_mps - speed_mps) * towards
            if np.hypot(*(goal_m[:2] - other[:2])) > CLEAR_M:
                side = np.array([-towards[1], towards[0]])
                v[:2] += (
                    _AROUND_MPS if (goal_m[:2] - p_m[:2]) @ side >= 0.0 else -_AROUND_MPS
                ) * side
    return v


def beside(p_m: np.ndarray, others: Sequence[np.ndarray]) -> Optional[np.ndarray]:
    """(3,) a place beside somebody on whom he would come down, in the air or on the ground; None:
    nobody."""
    own, seen = Occupant([p_m]), {str(k): Occupant([o]) for k, o in enumerate(others)}
    below = [n for n, o in seen.items() if airspace.comes_down_on(own, o, CLEAR_M, _BELOW_M)]
    if not below:
        return None
    left = np.array([0.0, 1.0])
    return airspace.aside(own, seen, below[0], HorizontalClearance(CLEAR_M), side=left)
