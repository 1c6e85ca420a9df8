# SPDX-License-Identifier: Apache-2.0
"""A baseline that grows while pictures are taken: a straight way that is flown without a stop."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fcsv_geometry.missions.flight_limits import FlightBounds

AXES = ("horizontal", "vertical")
# ten times the thesis's longest; beyond, a metre was meant as something else
MOST_BASELINE_M = 100.0
_LEAST_WAY_M = 0.5
_SLOWEST_MPS = 0.1


@dataclass(frozen=True)
class Sweep:
    """The moving camera's way from ``from_m`` to ``to_m`` right of the reference (horizontal) or
    above it (vertical).

    ``across_m`` is kept on the other axis all the way: above the reference for a horizontal sweep,
    right of it for a vertical one, which then may begin at 0.
    """

    axis: str  # horizontal: to the right of the reference; vertical: above it
    from_m: float  # where the way begins on that axis
    to_m: float  # where it ends, at least 0.5 m away
    speed_mps: float  # along the way; at most what `flight` allows
    across_m: float = 0.0  # kept on the other axis all the way

    def __post_init__(self):
        if self.axis not in AXES:
            raise ValueError(f"axis: '{self.axis}' is not one of {', '.join(AXES)}")
        for name in ("from_m", "to_m", "across_m"):
            if not 0.0 <= getattr(self, name) <= MOST_BASELINE_M:
                raise ValueError(
                    f"{name}: {getattr(self, name)} is not in 0..{MOST_BASELINE_M:g} m; the axis says the direction"
                )
        if self.length_m < _LEAST_WAY_M:
            raise ValueError(
                f"to_m: {self.to_m} is less than {_LEAST_WAY_M:g} m from from_m {self.from_m}; a place to stand at is "
                "{axis, baseline_m}"
            )
        if not self.speed_mps >= _SLOWEST_MPS:
            raise ValueError(f"speed_mps: {self.speed_mps} is under {_SLOWEST_MPS:g} m/s")

    @property
    def length_m(self) -> float:
        """Measures the length of the way."""
        return abs(self.to_m - self.from_m)

    @property
    def longest_m(self) -> float:
        """The longest baseline on the way (m)."""
        return math.hypot(max(self.from_m, self.to_m), self.across_m)

    @property
    def shortest_m(self) -> float:
        """The shortest baseline on the way (m)."""
        return math.hypot(min(self.from_m, self.to_m), self.across_m)

    @property
    def title(self) -> str:
        """Says it in words.

        >>> Sweep("vertical", 0.0, 7.0, 1.0, across_m=8.0).title
        'sweep vertical 0 to 7 m at 8 m'
        """
        aside = f" at {self.across_m:g} m" if self.across_m else ""
        return f"sweep {self.axis} {self.from_m:g} to {self.to_m:g} m{aside}"

    def place_m(self, share: float) -> np.ndarray:
        """Position (3,) in home of the moving camera after a share 0..1 of the way.

        >>> Sweep("horizontal", 2.0, 8.0, 1.0).place_m(0.5).tolist()
        [0.0, -5.0, 0.0]
        """
        along = self.from_m + share * (self.to_m - self.from_m)
        right, up = (along, self.across_m) if self.axis == "horizontal" else (self.across_m, along)
        return np.array([0.0, -right, up])

    def bounds(self, flight: FlightBounds) -> FlightBounds:
        """Gives the bounds of a flight that goes no faster than the sweep."""
        slow = {
            n: min(self.speed_mps, getattr(flight, n))
            for n in ("speed_mps", "climb_mps", "sink_mps")
        }
        return replace(flight, **slow)

    def takes_s(self, flight: FlightBounds) -> float:
        """Time (s) from standing to standing."""
        way = self.place_m(1.0) - self.place_m(0.0)
        return self.bounds(flight).leg_s(float(np.hypot(way[0], way[1])), float(way[2]))

    def most_mps(self, flight: FlightBounds) -> float:
        """How fast the mission's bounds let a vehicle fly this way."""
        if self.axis == "horizontal":
            return flight.speed_mps
        return flight.climb_mps if self.to_m > self.from_m else flight.sink_mps
