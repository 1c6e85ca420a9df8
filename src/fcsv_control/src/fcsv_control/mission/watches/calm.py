# SPDX-License-Identifier: Apache-2.0
"""Whether vehicles stand calmly at their places: which settle bound is not met, by whom, and by how
much."""

import math
from dataclasses import dataclass
from typing import Dict, Iterable, Iterator, Mapping, Tuple

import numpy as np

from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.places import heading_error_rad
from fcsv_geometry.missions.mission import SettleBounds

_SAID_S = 1.0  # so often the figures that are said change at most


@dataclass(frozen=True)
class Unmet:
    """A bound that a vehicle does not meet; ``what`` has a place for the value."""

    vehicle: str
    what: str
    value: float
    bound: float

    def __str__(self) -> str:
        """
        >>> str(Unmet("uav2", "is {} deg off its heading", 4.126, 3.0))
        'uav2 is 4.1 deg off its heading, 3 at most'
        """
        return f"{self.vehicle} {self.what.format(_short(self.value))}, {self.bound:g} at most"

    @property
    def share(self) -> float:
        """Gives the share of the bound."""
        return self.value / self.bound


class CalmCheck:
    """One wait at ``places`` (T_home_cam by vehicle); ``look`` with every snapshot."""

    def __init__(self, bounds: SettleBounds, places: Mapping[str, np.ndarray]):
        self._bounds, self._places = bounds, dict(places)
        self._looks = 0
        self._counts: Dict[Tuple[str, str], int] = {}
        self._latest: Dict[Tuple[str, str], Unmet] = {}
        self._said_s = -math.inf
        self.said = ""  # the bound that is missed most now; "" where none is

    def look(self, snapshot: Snapshot) -> bool:
        """Whether all are calm."""
        unmet = [u for n in self._places for u in self._of(snapshot, n) if not u.value < u.bound]
        self._looks += 1
        for each in unmet:
            key = each.vehicle, each.what
            self._counts[key] = self._counts.get(key, 0) + 1
            self._latest[key] = each
        if not unmet:
            self.said = ""
        elif not self.said or snapshot.now_s - self._said_s >= _SAID_S:
            self._said_s, self.said = snapshot.now_s, str(max(unmet, key=lambda u: u.share))
        return not unmet

    @property
    def in_the_way(self) -> str:
        """What was not met most often, and by how much when it last was not; "" where all was
        met."""
        if not self._counts:
            return ""
        key = max(self._counts, key=self._counts.get)
        return f"{self._latest[key]} (in {self._counts[key] / self._looks:.0%} of the time)"

    def error_m(self, snapshot: Snapshot, names: Iterable[str]) -> float:
        """Largest distance (m) of these vehicles' cameras from their places."""
        return max(self._off_m(snapshot, n) for n in names)

    def _off_m(self, snapshot: Snapshot, name: str) -> float:
        return float(np.linalg.norm(snapshot.p_home_cam(name) - self._places[name][:3, 3]))

    def _of(self, snapshot: Snapshot, name: str) -> Iterator[Unmet]:
        b, view = self._bounds, snapshot.vehicles[name]
        turned_rad = heading_error_rad(view.T_home_cam, self._places[name])
        yield Unmet(name, "is {} m off its place", self._off_m(snapshot, name), b.position_m)
        yield Unmet(name, "is {} deg off its heading", math.degrees(turned_rad), b.heading_deg)
        yield Unmet(name, "moves by {} m/s", view.speed_mps, b.speed_mps)
        yield Unmet(name, "has a pose that is {} s old", view.pose_age_s, b.pose_age_s)


def _short(value: float) -> str:
    """
    >>> _short(4.126), _short(0.1234), _short(0.00123)
    ('4.1', '0.12', '0.0012')
    """
    return f"{value:.2g}"
