# SPDX-License-Identifier: Apache-2.0
"""Who is above whom, and where he would come down."""

from dataclasses import dataclass
from itertools import permutations
from typing import List, Mapping, Tuple

from fcsv_geometry.missions.separation import SeparationRules, distance_m


@dataclass(frozen=True)
class Above:
    """``upper`` would come down on ``lower``, at ``down_m`` (x, y in home)."""

    upper: str
    lower: str
    height_m: float
    level_m: float
    down_m: Tuple[float, float]

    @property
    def words(self) -> str:
        x, y = self.down_m
        return (
            f"{self.upper} is {self.height_m:.1f} m above {self.lower}, {self.level_m:.1f} m aside; "
            f"it would come down at ({x:.1f}, {y:.1f})"
        )


def above(places: Mapping[str, Tuple[float, float, float]], rules: SeparationRules) -> List[Above]:
    """Pairs whose horizontal distance is under the rules' semi-axis; places in home (m), only of
    those in the air.

    >>> found = above({"uav1": (0.0, 0.0, 0.0), "uav2": (0.3, 0.0, 5.0)}, SeparationRules(0.95))
    >>> [(a.upper, a.lower, a.height_m) for a in found]
    [('uav2', 'uav1', 5.0)]
    """
    found = []
    for (upper, u), (lower, w) in permutations(places.items(), 2):
        level_m = distance_m((u[0] - w[0], u[1] - w[1], 0.0))
        if level_m < rules.horizontal_m and u[2] > w[2]:
            found.append(Above(upper, lower, u[2] - w[2], level_m, (u[0], u[1])))
    return found
