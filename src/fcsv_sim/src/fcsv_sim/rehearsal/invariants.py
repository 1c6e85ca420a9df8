# SPDX-License-Identifier: Apache-2.0
"""What must hold at every moment of a rehearsed flight, by the truth."""

from dataclasses import dataclass
from itertools import combinations
from typing import Dict, List, Set, Tuple

import numpy as np

_CONTACT_M = 0.6  # between centres of two 250 mm vehicles
_DOWNWASH = 3.0  # vertical over horizontal semi-axis of the ellipsoid about a vehicle
_TOUCH_DOWN_MPS = 1.0
_IN_THE_AIR_M = 0.3


@dataclass(frozen=True)
class Violation:
    """One that happened, and when (s of the flight)."""

    kind: str
    at_s: float
    text: str


class Invariants:
    """Looks at the truth; every kind of violation is told once per flight and vehicle."""

    def __init__(self, flight):
        self._flight = flight
        self._told: Set[Tuple[str, str]] = set()
        self._sink_mps: Dict[str, float] = {}
        self.violations: List[Violation] = []
        self.nearest_m = float("inf")
        self.flew = False

    def check(self, now_s: float) -> None:
        """Distances, and the speed with which the ground is met."""
        fleet = self._flight.fleet
        places = {n: v.p_world_m for n, v in fleet.items()}
        up = {n: places[n][2] > _IN_THE_AIR_M for n in fleet}
        self.flew |= any(up.values())
        for a, b in combinations(fleet, 2):
            if up[a] and up[b]:
                self._pair(now_s, a, b, places[a] - places[b])
        for name, vehicle in fleet.items():
            before = self._sink_mps.get(name, 0.0)
            self._sink_mps[name] = -float(vehicle.body.velocity_mps[2]) if up[name] else 0.0
            if not up[name] and before > _TOUCH_DOWN_MPS:
                self._tell("touch-down", name, now_s, f"{name} met the ground at {before:.1f} m/s")

    def _pair(self, now_s: float, a: str, b: str, offset: np.ndarray) -> None:
        distance_m = float(np.linalg.norm(offset))
        self.nearest_m = min(self.nearest_m, distance_m)
        if distance_m < _CONTACT_M:
            self._tell("contact", f"{a} {b}", now_s, f"{a} and {b} touched: {distance_m:.2f} m")
        ellipsoid_m = float(np.linalg.norm(offset / [1.0, 1.0, _DOWNWASH]))
        if ellipsoid_m < _CONTACT_M:
            self._tell("downwash", f"{a} {b}", now_s, f"{a} and {b} stand in each other's downwash")

    def end(self, ended: bool) -> None:
        """Every flight has an end."""
        if not ended:
            self._tell("no end", "", self._flight.now_s, f"still {self._flight.phase}")

    def _tell(self, kind: str, who: str, now_s: float, text: str) -> None:
        if (kind, who) not in self._told:
            self._told.add((kind, who))
            self.violations.append(Violation(kind, now_s, text))
