# SPDX-License-Identifier: Apache-2.0
"""What must hold at every moment of a rehearsed flight, by the truth."""

import math
from collections import deque
from dataclasses import dataclass
from itertools import combinations
from typing import Deque, Dict, List, Set, Tuple

import numpy as np

from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_control.mission.ways.routes import distance_to_segments
from fcsv_geometry.missions.mission import StereoConfiguration
from fcsv_geometry.missions.separation import SeparationRules, share
from fcsv_sim.autopilot import modes

CONTACT, DOWNWASH, BENEATH, TOUCH_DOWN = "contact", "downwash", "beneath", "touch-down"
FENCE, OVERRULED, NOT_HELD, NO_END = "fence", "overruled", "not held", "no end"
LATE_STOP, NEEDLESS, LATE_FEED = "late stop", "needless", "late feed"
#: Kinds of violations, as tables list them.
KINDS = (
    CONTACT,
    DOWNWASH,
    BENEATH,
    TOUCH_DOWN,
    FENCE,
    OVERRULED,
    NOT_HELD,
    NO_END,
    LATE_STOP,
    NEEDLESS,
    LATE_FEED,
)

_TOUCH = SeparationRules(0.6, 1.0)  # of the centres of two 250 mm vehicles
_AIR = SeparationRules(0.6, 3.0)
_BENEATH_M, _SAME_HEIGHT_M = 1.5, 0.3
_TOUCH_DOWN_MPS = 1.0
_IN_THE_AIR_M = 0.3
_FENCE, _FENCE_S = GuardianRules().fence, 1.0
# standard deviations: of a link (docs/lab/tracking.md), of odometry since then
_LINK_M, _WALK_M = 0.03, 0.1
_REMEMBERED = 4000  # moments

Place = Tuple[float, float, float]


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
        self._out_s: Dict[str, float] = {}
        self._apart: Dict[Tuple[str, str], bool] = {}  # in height
        self._past: Deque[Tuple[float, Dict[str, Place]]] = deque(maxlen=_REMEMBERED)
        self._captures: Set[Tuple[int, float]] = set()  # looked at
        self._begun: Dict[str, Place] = {}
        self.violations: List[Violation] = []
        # of two in the air; as one lands past the other
        self.nearest_m = self.crossing_m = float("inf")
        self.off_m = 0.0  # largest error of a recorded baseline
        self.flew = False

    def check(self, now_s: float) -> None:
        """Distances, the ground, the fence, and what was recorded."""
        fleet = self._flight.fleet
        places = {n: tuple(v.p_world_m.tolist()) for n, v in fleet.items()}
        self._begun = self._begun or places
        self._past.append((now_s, places))
        up = {n: p[2] > _IN_THE_AIR_M for n, p in places.items()}
        self.flew |= any(up.values())
        for a, b in combinations(fleet, 2):
            # who lands on one that stands on the ground meets it there
            if up[a] or up[b] or self._apart.get((a, b)):
                self._pair(now_s, a, b, places[a], places[b], up[a] and up[b])
        for name in fleet:
            self._ground(now_s, name, up[name])
            self._fence(now_s, name, places[name])
        for window in self._flight.control.captures:
            if (window.index, window.start_s) not in self._captures:
                self._captures.add((window.index, window.start_s))
                self._held(now_s, window)

    def end(self, ended: bool) -> None:
        """Every flight has an end."""
        if not ended:
            self.tell(NO_END, "", self._flight.now_s, f"still {self._flight.phase}")

    def tell(self, kind: str, who: str, now_s: float, text: str) -> None:
        """A violation, the first of its kind by ``who``."""
        if (kind, who) not in self._told:
            self._told.add((kind, who))
            self.violations.append(Violation(kind, now_s, text))

    # ---- one by one ------------------------------------------------------------------------------

    def _pair(self, now_s: float, a: str, b: str, p_a: Place, p_b: Place, both_up: bool) -> None:
        offset_m = (p_a[0] - p_b[0], p_a[1] - p_b[1], p_a[2] - p_b[2])
        if both_up:
            distance_m = math.hypot(*offset_m)
            self.nearest_m = min(self.nearest_m, distance_m)
            if share(offset_m, _TOUCH) < 1.0:
                self.tell(CONTACT, f"{a} {b}", now_s, f"{a} and {b} touched: {distance_m:.2f} m")
            if share(offset_m, _AIR) < 1.0:
                self.tell(
                    DOWNWASH, f"{a} {b}", now_s, f"{a} and {b} stand in each other's downwash"
                )
        self._crossing(now_s, a, b, math.hypot(*offset_m[:2]), abs(offset_m[2]))

    def _crossing(self, now_s: float, a: str, b: str, level_m: float, height_m: float) -> None:
        if height_m > _SAME_HEIGHT_M:
            self._apart[a, b] = True
        elif self._apart.get((a, b)) and any(self._lands(n) for n in (a, b)):
            self.crossing_m = min(self.crossing_m, level_m)
            if level_m < _BENEATH_M:
                text = f"{a} and {b} are {level_m:.2f} m apart as one lands past the other"
                self.tell(BENEATH, f"{a} {b}", now_s, text)

    def _lands(self, name: str) -> bool:
        autopilot = self._flight.fleet[name].autopilot
        return autopilot.armed and autopilot.mode == modes.LAND

    def _ground(self, now_s: float, name: str, up: bool) -> None:
        vehicle, before = self._flight.fleet[name], self._sink_mps.get(name, 0.0)
        self._sink_mps[name] = -float(vehicle.body.velocity_mps[2]) if up else 0.0
        his = vehicle.flown_by_hand and vehicle.autopilot.mode != modes.LAND
        if not up and before > _TOUCH_DOWN_MPS and not his:
            self.tell(TOUCH_DOWN, name, now_s, f"{name} met the ground at {before:.1f} m/s")

    def _fence(self, now_s: float, name: str, p: Place) -> None:
        vehicle, begun = self._flight.fleet[name], self._begun[name]
        from_begun, height_m = (p[0] - begun[0], p[1] - begun[1]), max(p[2], _FENCE.floor_m)
        answered = vehicle.flown_by_hand or vehicle.autopilot.mode in (modes.LAND, modes.BRAKE)
        if answered or not _FENCE.outside_m(from_begun, height_m):
            self._out_s.pop(name, None)
        elif now_s - self._out_s.setdefault(name, now_s) > _FENCE_S:
            self.tell(FENCE, name, now_s, f"{name} flies on outside the fence")

    def _held(self, now_s: float, window: CaptureWindow) -> None:
        mission = self._flight.mission
        configuration = mission.configurations[window.index]
        worst_m = 0.0
        for at_s, places in self._past:
            if window.start_s <= at_s <= window.stop_s:
                (x, y, z), (x0, y0, z0) = places[window.vehicle], places[mission.reference]
                level_m, height_m = math.hypot(x - x0, y - y0), z - z0
                worst_m = max(worst_m, _off_m(configuration, level_m, height_m))
        self.off_m = max(self.off_m, worst_m)
        names = list(self._flight.fleet)
        links = abs(names.index(window.vehicle) - names.index(mission.reference))
        most_m = 2.0 * mission.settle.hold_m + 3.0 * math.sqrt(links * _LINK_M**2 + _WALK_M**2)
        if worst_m > most_m:
            self.tell(
                NOT_HELD,
                str(window.index),
                now_s,
                f"{configuration.title} was recorded {worst_m:.2f} m off",
            )


def _off_m(configuration: StereoConfiguration, level_m: float, height_m: float) -> float:
    """How far a moving camera, so far from the reference and so much higher, is from its place or
    its sweep's line."""
    if configuration.sweep is None:
        wanted = (configuration.baseline_m, 0.0)
        wanted = wanted if configuration.axis == "horizontal" else wanted[::-1]
        return math.hypot(level_m - wanted[0], height_m - wanted[1])
    start_m, end_m = (configuration.sweep.place_m(share) for share in (0.0, 1.0))
    return float(distance_to_segments(np.array([0.0, -level_m, height_m]), start_m, end_m[None])[0])
