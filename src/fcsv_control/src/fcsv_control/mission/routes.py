# SPDX-License-Identifier: Apache-2.0
"""Ways between places that keep clear of the other vehicles."""

from typing import List, Sequence

import numpy as np
from scipy.sparse.csgraph import dijkstra

from fcsv_geometry.errors import MissionError

_SLACK_M = 0.3  # a goal may be this much nearer to a vehicle that does not stand quite at its place
_SHELL = 1.35  # corners of the way stand at this multiple of the separation; their chords stay outside of it
_DIP_M = 0.2  # a way does not go lower than the lower of its ends by more than this: the ground is not known
_EPSILON_M = 1e-6


def distance_to_segments(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Smallest distances (N,) in m of a point (3,) from the segments of a (3,) to each of b (N, 3).

    >>> distance_to_segments(np.array([1.0, 2.0, 0.0]), np.zeros(3), np.array([[4.0, 0.0, 0.0]])).tolist()
    [2.0]
    """
    ab = b - a
    length2 = np.maximum((ab * ab).sum(1), 1e-12)
    s = np.clip(ab @ (point - a) / length2, 0.0, 1.0)
    return np.linalg.norm(a + s[:, None] * ab - point, axis=1)


def route(start_m, goal_m, others_m: Sequence[np.ndarray], separation_m: float) -> List[np.ndarray]:
    """Way-points from start (excluded) to goal (included); every leg keeps ``separation_m`` from the others.

    The shortest way over corners around the other vehicles (a visibility graph), straight where it can be. A start
    that is already too near is left on a leg that only leads away; a goal up to 0.3 m too near is still flown to (the
    other vehicle does not stand quite at its place). Positions (3,) in one frame with z up. Raises MissionError where
    the goal is too near or no way exists.
    """
    start, goal = np.asarray(start_m, float), np.asarray(goal_m, float)
    others = [np.asarray(o, float) for o in others_m]
    clear_m = [_clearance(goal, other, separation_m) for other in others]
    nodes = np.array([start, goal, *_corners(others, separation_m, min(start[2], goal[2]) - _DIP_M)])
    lengths = np.array([_lengths(a, nodes, others, clear_m) for a in nodes])
    _, before = dijkstra(lengths, indices=0, return_predecessors=True)
    way = [1]
    while way[0] != 0:
        if before[way[0]] < 0:
            raise MissionError(
                f"no way to {_in_words(goal)} keeps {separation_m:g} m from the other vehicles: move them apart"
            )
        way.insert(0, int(before[way[0]]))
    return [nodes[i] for i in way[1:]]


def _clearance(goal: np.ndarray, other: np.ndarray, separation_m: float) -> float:
    distance_m = float(np.linalg.norm(goal - other))
    if distance_m < separation_m - _SLACK_M:
        raise MissionError(
            f"{_in_words(goal)} is {distance_m:.1f} m from another vehicle, at least {separation_m:g} m are needed"
        )
    return min(separation_m, distance_m)


def _corners(others: Sequence[np.ndarray], separation_m: float, lowest_m: float) -> List[np.ndarray]:
    """26 points around every other vehicle."""
    steps = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    points = [other + step * _SHELL * separation_m for other in others for step in steps]
    return [p for p in points if p[2] >= lowest_m]


def _lengths(a: np.ndarray, nodes: np.ndarray, others: Sequence[np.ndarray], clear_m: Sequence[float]) -> np.ndarray:
    """Of the legs from a to every node (N,), infinite where one is not free.

    A leg may start too near (the vehicle stands there) as long as it leads away from its first metre on.
    """
    # every corner costs a stop: rather one metre more than one corner more
    lengths = np.linalg.norm(nodes - a, axis=1) + 1.0
    for other, clear in zip(others, clear_m):
        nearest_m, start_m = distance_to_segments(other, a, nodes), float(np.linalg.norm(a - other))
        least_m = min(clear, start_m) - _EPSILON_M
        lengths[nearest_m < least_m] = np.inf
    return lengths


def _in_words(point: np.ndarray) -> str:
    return f"({point[0]:.1f}, {point[1]:.1f}, {point[2]:.1f}) in home"
