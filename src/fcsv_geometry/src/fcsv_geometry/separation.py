# SPDX-License-Identifier: Apache-2.0
"""How near vehicles are to each other, with their downwash, and where one can go out of the others' way.

The planner, the mission, the guardian and the rehearsals measure with these functions. Positions are (3,), m, in any
one level frame with z up.
"""

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry.config import require_positive

LOST_CLEAR_M = 6.0  # horizontally, from where one was last known that came down without a position: it drifts
_SIGMAS = 3.0
_ANGLES = [0.0, *(sign * k * np.pi / 8.0 for k in range(1, 9) for sign in (1.0, -1.0))]  # the nearest first
_AWAY_M = 0.3  # nearer than this horizontally, "away" has no direction


@dataclass(frozen=True)
class SeparationRules:
    """The air that belongs to a vehicle: an ellipsoid, taller than wide, because its downwash goes far down."""

    horizontal_m: float = 0.6
    vertical_factor: float = 3.0  # vertical over horizontal semi-axis

    def __post_init__(self):
        require_positive(self)


def distance_m(offset_m: np.ndarray, vertical_factor: float = SeparationRules.vertical_factor) -> float:
    """Distance (m) of two vehicles in which height counts for ``1 / vertical_factor``.

    >>> distance_m(np.array([0.0, 0.0, 3.0]), 3.0), distance_m(np.array([0.0, 3.0, 0.0]), 3.0)
    (1.0, 3.0)
    """
    x, y, z = offset_m
    return float((x * x + y * y + (z / vertical_factor) ** 2) ** 0.5)


def margin_m(
    offset_m: np.ndarray, rules: SeparationRules, sigma_m: float = 0.0, age_s: float = 0.0, speed_mps: float = 0.0
) -> float:
    """By how much (m) two vehicles are further apart than they must be; negative: too near.

    ``sigma_m`` is the standard deviation of the offset (both poses), ``age_s`` the age of the older pose,
    ``speed_mps`` how
    fast both can have approached meanwhile.

    >>> margin_m(np.array([2.0, 0.0, 0.0]), SeparationRules(0.8, 3.0), sigma_m=0.1, age_s=0.5, speed_mps=1.0)
    0.4
    """
    needed_m = rules.horizontal_m + _SIGMAS * sigma_m + age_s * speed_mps
    return round(distance_m(offset_m, rules.vertical_factor) - needed_m, 9)


def aside(
    here_m: np.ndarray, others_m: Sequence[np.ndarray], clear_m: float, away_from_m: Optional[np.ndarray] = None,
    side: Optional[np.ndarray] = None,
) -> np.ndarray:  # fmt: skip
    """A place (3,) at the same height whose column of air is ``clear_m`` from all others, by a way that passes
    nobody: away from one of them, else as near as can be to ``side`` ((2,), a direction; to the right by
    default); where none is clear, the one with most room.

    >>> aside(np.array([0.0, 0.0, 8.0]), [np.array([1.0, 0.0, 3.0])], 2.0, np.array([1.0, 0.0, 3.0])).tolist()
    [-4.0, 0.0, 8.0]
    """
    first = np.array([0.0, -1.0]) if side is None else np.asarray(side, float)
    if away_from_m is not None:
        away = here_m[:2] - away_from_m[:2]
        length_m = float(np.linalg.norm(away))
        first = away / length_m if length_m > _AWAY_M else first
    places = [here_m + 2.0 * clear_m * np.array([*_turned(first, angle), 0.0]) for angle in _ANGLES]
    room = [_room_m(here_m, p, others_m, clear_m) for p in places]
    return next((p for p, m in zip(places, room) if m >= 0.0), places[int(np.argmax(room))])


def _turned(direction: np.ndarray, angle_rad: float) -> np.ndarray:
    """(2,), exact for no turn."""
    c, s = (1.0, 0.0) if angle_rad == 0.0 else (np.cos(angle_rad), np.sin(angle_rad))
    return np.array([c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]])


def _room_m(here_m: np.ndarray, place_m: np.ndarray, others_m: Sequence[np.ndarray], clear_m: float) -> float:
    """By how much (m) a way and its end keep clear, horizontally; negative: they do not. Who is near already must not
    come nearer."""
    least_m = np.inf
    a, ab = here_m[:2], place_m[:2] - here_m[:2]
    for other in others_m:
        off = other[:2] - a
        share = min(1.0, max(0.0, float(off @ ab) / max(float(ab @ ab), 1e-12)))
        passes_m = float(np.linalg.norm(off - share * ab))
        needed_m = min(0.8 * clear_m, float(np.linalg.norm(off)) - 1e-6)
        least_m = min(least_m, passes_m - needed_m, float(np.linalg.norm(off - ab)) - clear_m)
    return least_m
