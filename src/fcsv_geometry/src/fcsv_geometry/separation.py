# SPDX-License-Identifier: Apache-2.0
"""How near vehicles are to each other, with their downwash, and where one can go out of the others' way.

The planner, the mission, the guardian and the rehearsals measure with these functions. Positions are (3,), m, in any
one level
frame with z up.
"""

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry.config import require_positive

_SIGMAS = 3.0
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
    """A place (3,) at the same height whose column of air is ``clear_m`` from all others: away from one of them, else
    to
    either ``side`` ((2,), a direction), forwards or backwards; where none is clear, the one with most room.

    >>> aside(np.array([0.0, 0.0, 8.0]), [np.array([1.0, 0.0, 3.0])], 2.0, np.array([1.0, 0.0, 3.0])).tolist()
    [-4.0, 0.0, 8.0]
    """
    first = np.array([0.0, -1.0]) if side is None else np.asarray(side, float)
    across = np.array([-first[1], first[0]])
    directions = [first, -first, -across, across]
    if away_from_m is not None:
        away = here_m[:2] - away_from_m[:2]
        length_m = float(np.linalg.norm(away))
        if length_m > _AWAY_M:
            directions.insert(0, away / length_m)
    places = [here_m + 2.0 * clear_m * np.array([*d, 0.0]) for d in directions]
    room_m = [min((float(np.linalg.norm((p - o)[:2])) for o in others_m), default=np.inf) for p in places]
    return next((p for p, m in zip(places, room_m) if m > clear_m), places[int(np.argmax(room_m))])
