# SPDX-License-Identifier: Apache-2.0
"""How near vehicles are to each other, with their downwash, and where one can go out of the others'
way.

The planner, the mission, the guardian and the rehearsals measure with these functions: ``share``
says for all of them whether two vehicles are far enough apart. Positions are (3,), m, in any one
level frame with z up.
"""

import math
from dataclasses import dataclass
from typing import Callable, Optional, Sequence, Union

import numpy as np

from fcsv_geometry.config import require_positive
from fcsv_geometry.missions.flight_limits import FlightBounds

# horizontally, from where one was last known that comes down without a position: it drifts
LOST_CLEAR_M = 6.0
# what it is off as it is lost, and how fast it drifts: docs/design/guardian.md
_LOST_M, _LOST_MPS = 2.0, 1.2
# one that hears nobody moves 5 m aside of who was above, and lands: 2.5 m must be clear of it
SILENT_REACH_M = 7.5
_SIGMAS = 3.0
# of two places against each other by what both trackers drifted since calibration
_TRACKERS_SIGMA_M = 0.05
# of a pose that comes ten times a second over a radio: ways are planned with room for it
_USUAL_AGE_S = 0.25
_MOST_AGE_S = 1.0  # of a pose in the separation: then it is its silence that counts
_MOST_SPEED_MPS = 2.0
# the nearest first
_ANGLES = [0.0, *(sign * k * np.pi / 8.0 for k in range(1, 9) for sign in (1.0, -1.0))]
_BEYOND_M = 3.0  # the edge of a large circle
_TOLD_S = 0.4  # until a vehicle hears that it is to stop, and does
_AWAY_M = 0.3  # nearer than this horizontally, "away" has no direction

Clear = Union[float, Sequence[float]]  # m, of all others or of each


@dataclass(frozen=True)
class SeparationRules:
    """The air that belongs to a vehicle: an ellipsoid, taller than wide, because its downwash goes
    far down."""

    horizontal_m: float = 0.6  # horizontal semi-axis of the air that is a vehicle's own
    vertical_factor: float = 3.0  # vertical over horizontal semi-axis

    def __post_init__(self):
        require_positive(self)


def flat(points_m: np.ndarray, vertical_factor: float) -> np.ndarray:
    """Points (..., 3) in which height counts for ``1 / vertical_factor``."""
    return points_m / np.array([1.0, 1.0, vertical_factor])


def distance_m(
    offset_m: Union[Sequence[float], np.ndarray],
    vertical_factor: float = SeparationRules.vertical_factor,
) -> Union[float, np.ndarray]:
    """Distance (m) of two vehicles in which height counts for ``1 / vertical_factor``; (N,) of
    offsets (N, 3).

    >>> distance_m(np.array([0.0, 0.0, 3.0]), 3.0), distance_m(np.array([0.0, 3.0, 0.0]), 3.0)
    (1.0, 3.0)
    """
    # plain numbers stay so: vehicles in flight ask for one offset at a time
    x, y, z = offset_m if isinstance(offset_m, (list, tuple)) else offset_m.T
    return (x * x + y * y + (z / vertical_factor) ** 2) ** 0.5


def doubt_m(sigmas_m: Sequence[float] = (), age_s: float = 0.0, speed_mps: float = 0.0) -> float:
    """How much nearer (m) two vehicles may be than they were heard to be.

    ``sigmas_m``: standard deviations of their places in home, as calibration left them; what
    trackers drift comes to it. ``age_s``: of the older pose. ``speed_mps``: how fast they may have
    approached meanwhile.

    >>> round(doubt_m([0.12], age_s=0.75, speed_mps=1.0), 3)
    0.89
    """
    sigma_m = math.sqrt(_TRACKERS_SIGMA_M**2 + sum(s * s for s in sigmas_m))
    unusual_s = min(max(0.0, age_s - _USUAL_AGE_S), _MOST_AGE_S)
    return _SIGMAS * sigma_m + unusual_s * min(speed_mps, _MOST_SPEED_MPS)


def share(
    offset_m: Union[Sequence[float], np.ndarray], rules: SeparationRules, doubt: float = 0.0
) -> Union[float, np.ndarray]:
    """Says, of the distance that two vehicles must keep, how much they keep: from 1 on it is
    enough; (N,) of offsets (N, 3). ``doubt`` (m) is ``doubt_m``, where places were heard and are
    not planned.

    >>> float(share(np.array([2.0, 0.0, 0.0]), SeparationRules(0.8, 3.0), doubt=0.2))
    2.0
    """
    return distance_m(offset_m, rules.vertical_factor) / (rules.horizontal_m + doubt)


def lost_reach_m(flown_s: float) -> float:
    """How far (m) horizontally from where it was last known one may lie that flew for so long (s)
    without a position.

    >>> lost_reach_m(1.0), lost_reach_m(20.0)
    (6.0, 26.0)
    """
    return max(LOST_CLEAR_M, _LOST_M + _LOST_MPS * flown_s)


def stop_m(
    here_m: np.ndarray, velocity_mps: np.ndarray, slows_mps2: float = FlightBounds.acceleration_mps2
) -> np.ndarray:
    """(3,) where a vehicle comes to a stand, horizontally, that is told now to stop or to land.

    >>> stop_m(np.array([0.0, -4.0, 8.0]), np.array([0.0, 1.5, 1.0])).tolist()
    [0.0, -2.65, 8.0]
    """
    speed_mps = float(np.hypot(*velocity_mps[:2]))
    return here_m + np.array([*velocity_mps[:2], 0.0]) * (_TOLD_S + speed_mps / (2.0 * slows_mps2))


def aside(
    here_m: np.ndarray,
    others_m: Sequence[np.ndarray],
    clear_m: Clear,
    away_from_m: Optional[np.ndarray] = None,
    side: Optional[np.ndarray] = None,
    within: Callable[[np.ndarray], bool] = lambda p: True,
) -> np.ndarray:
    """A place (3,) at the same height whose column of air is ``clear_m`` from all others, by a way
    that passes nobody: away from one of them, else as near as can be to ``side`` ((2,), a
    direction; to the right by default); where none is clear, the one with most room. ``clear_m``
    may be given for each of the others; places ``within`` the fence are preferred.

    >>> aside(np.array([0.0, 0.0, 8.0]), [np.array([1.0, 0.0, 3.0])], 2.0, np.array([1.0, 0.0, 3.0])).tolist()
    [-4.0, 0.0, 8.0]
    """
    first = np.array([0.0, -1.0]) if side is None else np.asarray(side, float)
    if away_from_m is not None:
        away = here_m[:2] - away_from_m[:2]
        length_m = float(np.linalg.norm(away))
        first = away / length_m if length_m > _AWAY_M else first
    way_m = _way_m(here_m, others_m, clear_m)
    places = [here_m + way_m * np.array([*_turned(first, angle), 0.0]) for angle in _ANGLES]
    places = [p for p in places if within(p)] or places
    room = [room_m(here_m, p, others_m, clear_m) for p in places]
    return next((p for p, m in zip(places, room) if m >= 0.0), places[int(np.argmax(room))])


def _way_m(here_m: np.ndarray, others_m: Sequence[np.ndarray], clear_m: Clear) -> float:
    """How far to go: twice what must be clear, and no further than it takes out of a large
    circle."""
    needed_m = np.broadcast_to(clear_m, len(others_m))
    out_m = [c - float(np.linalg.norm((o - here_m)[:2])) for c, o in zip(needed_m, others_m)]
    most_m = float(np.max(clear_m))
    return min(2.0 * most_m, max(2.0 * LOST_CLEAR_M, max(out_m, default=0.0) + _BEYOND_M))


def _turned(direction: np.ndarray, angle_rad: float) -> np.ndarray:
    """(2,), exact for no turn."""
    c, s = (1.0, 0.0) if angle_rad == 0.0 else (np.cos(angle_rad), np.sin(angle_rad))
    return np.array([c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]])


def passes_m(here_m: np.ndarray, place_m: np.ndarray, other_m: np.ndarray) -> float:
    """How near (m), horizontally, the straight way to a place comes to another vehicle.

    >>> passes_m(np.zeros(3), np.array([8.0, 0.0, 0.0]), np.array([4.0, 3.0, 7.0]))
    3.0
    """
    off, ab = other_m[:2] - here_m[:2], place_m[:2] - here_m[:2]
    share = min(1.0, max(0.0, float(off @ ab) / max(float(ab @ ab), 1e-12)))
    return float(np.linalg.norm(off - share * ab))


def room_m(
    here_m: np.ndarray, place_m: np.ndarray, others_m: Sequence[np.ndarray], clear_m: Clear
) -> float:
    """Says by how much (m) a way and its end keep clear, horizontally; negative: they do not. Who
    is near already must not come nearer."""
    least_m = np.inf
    for other, room in zip(others_m, np.broadcast_to(clear_m, len(others_m))):
        needed_m = min(0.8 * room, float(np.linalg.norm(other[:2] - here_m[:2])) - 1e-6)
        end_m = float(np.linalg.norm(other[:2] - place_m[:2]))
        least_m = min(least_m, passes_m(here_m, place_m, other) - needed_m, end_m - room)
    return least_m
