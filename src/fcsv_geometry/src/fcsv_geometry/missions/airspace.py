# SPDX-License-Identifier: Apache-2.0
"""The airspace: what each vehicle occupies, who is in whose way, and where one can go aside.

Mission, guardian, simulated pilots and rehearsals judge by these functions. Two volumes belong to a
vehicle: the ellipsoid of its own air (``conflicts``), and the column that it may come down
(``comes_down_on``), which one that lies nobody knows where fills at every height
(``may_lie_beneath``). Positions are (3,), m, in any one level frame with z up.
"""

import math
from dataclasses import dataclass
from typing import Callable, Mapping, Optional, Sequence

import numpy as np

from fcsv_geometry.frozen import frozen
from fcsv_geometry.missions import separation
from fcsv_geometry.missions.separation import LOST_CLEAR_M, SeparationRules


@frozen
class Occupant:
    """One vehicle in the airspace; the status of one that is flown, stands or lands: the defaults.

    ``places_m``: where it may be, as it was heard first, then where it may have flown on to.
    ``stop_m``: where it comes to a stand if it is told to land now. ``astray``: it drifts without a
    position, or has done so. ``reach_m``: so far horizontally from its place it may be, that is lost
    or silent; ``lies``: then at any height.
    """

    places_m: Sequence[np.ndarray]
    stop_m: Optional[np.ndarray] = None
    astray: bool = False
    reach_m: float = 0.0
    lies: bool = False

    @property
    def here_m(self) -> np.ndarray:
        """The place as it was heard."""
        return self.places_m[0]


@dataclass(frozen=True)
class HorizontalClearance:
    """How far away horizontally (m) others must be for one to come down: those that are known, and
    those without a position.

    >>> lost = Occupant([np.zeros(3)], astray=True, reach_m=9.0)
    >>> HorizontalClearance(2.5).of(lost), HorizontalClearance(2.5).to_land(lost)
    (6.0, 9.0)
    """

    clear_m: float
    astray_m: float = LOST_CLEAR_M

    def of(self, other: Occupant) -> float:
        """What is kept of another vehicle in flight."""
        return max(self.clear_m, self.astray_m) if other.astray else self.clear_m

    def to_land(self, other: Occupant) -> float:
        """What is kept of it by one that lands."""
        return max(self.of(other), other.reach_m)


def conflicts(a: Occupant, b: Occupant, rules: SeparationRules, doubt_m: float = 0.0) -> bool:
    """Whether one stands in the other's own air; ``doubt_m`` is separation.doubt_m.

    >>> a, b = (Occupant([np.array([0.0, 0.0, z])]) for z in (4.0, 2.5))
    >>> conflicts(a, b, SeparationRules(0.6, 3.0)), conflicts(a, b, SeparationRules(0.6, 1.0))
    (True, False)
    """
    return separation.share((a.here_m - b.here_m).tolist(), rules, doubt_m) < 1.0


def comes_down_on(
    upper: Occupant, lower: Occupant, clear_m: float, above_m: float = 0.0, beside_m: float = 0.0
) -> bool:
    """Whether one that comes down from where it may be, on its way to a stand, passes another
    within ``clear_m`` that is lower by more than ``above_m``, or within ``beside_m`` at its height.

    >>> upper, lower = (Occupant([np.array([x, 0.0, z])]) for x, z in ((2.0, 8.0), (0.0, 4.0)))
    >>> comes_down_on(upper, lower, 2.5), comes_down_on(lower, upper, 2.5)
    (True, False)
    """
    lows = lower.places_m if lower.stop_m is None else [*lower.places_m, lower.stop_m]
    for high in upper.places_m:
        for low in lows:
            drop_m = high[2] - low[2]
            needed_m = clear_m if drop_m > above_m else beside_m if drop_m > -above_m else 0.0
            if needed_m > 0.0 and _passes_m(high, upper.stop_m, low) < needed_m:
                return True
    return False


def may_lie_beneath(upper: Occupant, lower: Occupant) -> bool:
    """Whether another that lies nobody knows where may be beneath the place and the way to a
    stand."""
    return lower.lies and _passes_m(upper.here_m, upper.stop_m, lower.here_m) < lower.reach_m


def aside(
    own: Occupant,
    others: Mapping[str, Occupant],
    away_from: str,
    clearance: HorizontalClearance,
    lands: bool = True,
    side: Optional[np.ndarray] = None,
    agreed: bool = False,
    within: Callable[[np.ndarray], bool] = lambda p: True,
) -> np.ndarray:
    """(3,) a place at the same height, clear of everybody, away from one of the others; ``lands``:
    to land there, outside of where a lost one may lie.

    ``side`` (2,) is the direction where "away" has none, and ``agreed`` takes it in any case: one
    that the other vehicle, which does not hear this one, does not take. ``within``: as
    separation.aside.
    """
    least_m = clearance.of(others[away_from])
    places_m, clears_m = [], []
    for other in others.values():
        places_m += other.places_m
        needed_m = max(least_m, clearance.to_land(other)) if lands else least_m
        clears_m += [needed_m] * len(other.places_m)
    away_m = None if agreed else nearest_m(own, others[away_from])
    return separation.aside(own.here_m, places_m, clears_m, away_m, side, within)


def nearest_m(own: Occupant, other: Occupant) -> np.ndarray:
    """(3,) of the places where another may be, the nearest horizontally."""
    return min(other.places_m, key=lambda p: math.dist(p[:2], own.here_m[:2]))


def _passes_m(here_m: np.ndarray, stop_m: Optional[np.ndarray], other_m: np.ndarray) -> float:
    if stop_m is None:
        return math.hypot(other_m[0] - here_m[0], other_m[1] - here_m[1])
    return separation.passes_m(here_m, stop_m, other_m)
