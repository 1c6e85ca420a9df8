# SPDX-License-Identifier: Apache-2.0
"""Ways between places that keep clear of the other vehicles."""

from dataclasses import dataclass
from functools import cached_property
from typing import List, Optional, Sequence, Tuple

import numpy as np
from scipy.sparse.csgraph import dijkstra

from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions import separation
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.separation import SeparationRules

_SLACK = 0.2  # a goal may keep this share less of a vehicle that does not stand quite at its place
# corners of the way stand at this multiple of the separation; their chords stay outside of it
_SHELL = 1.35
# a way does not go lower than the lower of its ends by more than this: the ground is not known
_DIP_M = 0.2
_SHELL_AIR = 1.15  # likewise above and below, of its air
_EPSILON = 1e-6


def distance_to_segments(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Smallest distances (N,) in m of a point (3,) from the segments of a (3,) to each of b (N, 3).

    >>> distance_to_segments(np.array([1.0, 2.0, 0.0]), np.zeros(3), np.array([[4.0, 0.0, 0.0]])).tolist()
    [2.0]
    """
    ab = b - a
    length2 = np.maximum((ab * ab).sum(1), 1e-12)
    s = np.clip(ab @ (point - a) / length2, 0.0, 1.0)
    return np.linalg.norm(a + s[:, None] * ab - point, axis=1)


@dataclass(frozen=True)
class Keep:
    """What ways keep from other vehicles: a sphere, and the air below and above them (None: no
    downwash)."""

    separation_m: float
    air: Optional[SeparationRules] = None

    @classmethod
    def of(cls, mission: Mission) -> "Keep":
        """What all ways of a mission keep."""
        return cls(mission.min_separation_m, mission.air)

    def share(self, offset_m: np.ndarray, doubt_m: float = 0.0) -> float:
        """Says, of what is to be kept, how much is: 1 and more is enough. ``doubt_m``:
        separation.doubt_m of its air."""
        offset = offset_m.tolist()
        return min(separation.share(offset, *kept) for kept in self._kept(doubt_m))

    def shares_of(self, offsets_m: np.ndarray) -> np.ndarray:
        """``share`` (N,) of each of many offsets (N, 3)."""
        return np.min([separation.share(offsets_m, *kept) for kept in self._kept()], axis=0)

    def shares(self, other: np.ndarray, a: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """The least share (N,) on the legs from a (3,) to each of nodes (N, 3)."""
        least = []
        for rules, _ in self._kept():
            flat = [separation.flat(p, rules.vertical_factor) for p in (other, a, nodes)]
            least.append(distance_to_segments(*flat) / rules.horizontal_m)
        return np.min(least, axis=0)

    def _kept(self, doubt_m: float = 0.0) -> List[Tuple[SeparationRules, float]]:
        """The sphere, and the air: each with what is to be added for doubt. The sphere's size has
        room for it."""
        return [(self._sphere, 0.0)] + ([] if self.air is None else [(self.air, doubt_m)])

    @cached_property
    def _sphere(self) -> SeparationRules:
        return SeparationRules(self.separation_m, 1.0)

    @property
    def shell_m(self) -> np.ndarray:
        """(3,) semi-axes of the shell on which ways go around."""
        level_m = _SHELL * self.separation_m
        tall_m = (
            0.0
            if self.air is None
            else _SHELL_AIR * self.air.horizontal_m * self.air.vertical_factor
        )
        return np.array([level_m, level_m, max(level_m, tall_m)])

    def needed(self, offset_m: np.ndarray) -> str:
        """What is needed at least, in words, where ``share`` is too little."""
        if self.air is None or float(np.linalg.norm(offset_m)) < self.separation_m:
            return f"at least {self.separation_m:g} m are needed"
        tall_m = self.air.horizontal_m * self.air.vertical_factor
        return f"in the downwash of the upper one: {tall_m:.2g} m straight above are needed"


def route(start_m, goal_m, others_m: Sequence[np.ndarray], keep: Keep) -> List[np.ndarray]:
    """Way-points from start (excluded) to goal (included); every leg keeps what is to be kept from
    the others.

    The shortest way over corners around the other vehicles (a visibility graph), straight where it
    can be. A start that is already too near is left on a leg that only leads away; a goal up to a
    fifth too near is still flown to (the other vehicle does not stand quite at its place).
    Positions (3,) in one frame with z up. Raises MissionError where the goal is too near or no way
    exists.
    """
    start, goal = np.asarray(start_m, float), np.asarray(goal_m, float)
    others = [np.asarray(o, float) for o in others_m]
    clear = [_clearance(goal, other, keep) for other in others]
    nodes = np.array([start, goal, *_corners(others, keep, min(start[2], goal[2]) - _DIP_M)])
    lengths = np.array([_lengths(a, nodes, others, clear, keep) for a in nodes])
    _, before = dijkstra(lengths, indices=0, return_predecessors=True)
    way = [1]
    while way[0] != 0:
        if before[way[0]] < 0:
            raise MissionError(
                f"no way to {_in_words(goal)} keeps {keep.separation_m:g} m from the other vehicles: move them apart"
            )
        way.insert(0, int(before[way[0]]))
    return [nodes[i] for i in way[1:]]


def _clearance(goal: np.ndarray, other: np.ndarray, keep: Keep) -> float:
    share = keep.share(goal - other)
    if share < 1.0 - _SLACK:
        away_m = float(np.linalg.norm(goal - other))
        raise MissionError(
            f"{_in_words(goal)} is {away_m:.1f} m from another vehicle, {keep.needed(goal - other)}"
        )
    return min(1.0, share)


def _corners(others: Sequence[np.ndarray], keep: Keep, lowest_m: float) -> List[np.ndarray]:
    """26 points around every other vehicle."""
    steps = np.array(
        [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z],
        float,
    )
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    points = [other + step * keep.shell_m for other in others for step in steps]
    return [p for p in points if p[2] >= lowest_m]


def _lengths(
    a: np.ndarray,
    nodes: np.ndarray,
    others: Sequence[np.ndarray],
    clear: Sequence[float],
    keep: Keep,
) -> np.ndarray:
    """Measures the lengths of the legs from a to every node (N,), infinite where one is not free.

    A leg may start too near (the vehicle stands there) as long as it leads away from its first
    metre on.
    """
    # every corner costs a stop: rather one metre more than one corner more
    lengths = np.linalg.norm(nodes - a, axis=1) + 1.0
    for other, least in zip(others, clear):
        lengths[keep.shares(other, a, nodes) < min(least, keep.share(a - other)) - _EPSILON] = (
            np.inf
        )
    return lengths


def _in_words(point: np.ndarray) -> str:
    return f"({point[0]:.1f}, {point[1]:.1f}, {point[2]:.1f}) in home"
