# SPDX-License-Identifier: Apache-2.0
"""The one plan of a robot's way: over free cells, clear of what is not, roomy where there is
room."""

from dataclasses import dataclass
from typing import Tuple, Union

import cv2
import numpy as np

from fcsv_guidance import tuning
from fcsv_guidance.ground import Grid
from fcsv_guidance.route import NO_ROUTE_KNOWN, NoRoute, Route, route_over

_UNSURE_P = 0.5 * (tuning.FREE_P + tuning.OBSTACLE_P)  # of what is free but too near to what is not


@dataclass(frozen=True)
class RouteRules:
    """A route keeps ``sigmas`` of the robot's place and ``spare_m`` clear of cells that are not
    free, and more where there is room, up to ``comfort_m``: without any of that a metre costs
    ``comfort_cost`` more."""

    sigmas: float = 2.0
    spare_m: float = 0.1
    comfort_m: float = 0.7
    comfort_cost: float = 3.0

    def keeps_m(self, place_sigma_m: float) -> float:
        """How far its middle keeps from cells in which it must not stand."""
        return self.sigmas * place_sigma_m + self.spare_m


def plan_clear(
    grid: Grid,
    stands: np.ndarray,
    start_m: Tuple[float, float],
    goal_m: Tuple[float, float],
    place_sigma_m: float = 0.0,
    rules: RouteRules = RouteRules(),
) -> Union[Route, NoRoute]:
    """A Route, or a NoRoute that names the cells to be seen. ``stands`` (rows, columns):
    probability that the robot can stand with its middle in a cell; NaN where unknown.

    Near the start the way may be as near to obstacles as the robot already is. Raises RouteError as
    route_over.
    """
    free = stands >= tuning.FREE_P
    ends = start_m, goal_m, place_sigma_m, rules
    found = _over(grid, stands, grid.clear_m(free), *ends, explains=False)
    if isinstance(found, Route):
        return found
    # where unknown cells need no room, a way ends at those that would have to be seen
    open_ = free | ~np.isfinite(stands)
    nearer = _over(grid, stands, grid.clear_m(open_), *ends)
    if isinstance(nearer, NoRoute):
        return nearer
    to_see = _unknown_beside(grid, stands, nearer, rules.keeps_m(place_sigma_m))
    reason = f"{NO_ROUTE_KNOWN}: {len(to_see)} cells beside the way to the goal were not seen"
    return NoRoute(reason, to_see)


def _over(grid, stands, clear_m, start_m, goal_m, place_sigma_m, rules, explains=True):
    keep_m = rules.keeps_m(place_sigma_m)
    xy = grid.middle_of(*np.indices(grid.shape))
    leaving = np.hypot(xy[..., 0] - start_m[0], xy[..., 1] - start_m[1]) < keep_m + grid.cell_m
    allowed = (clear_m > keep_m) | leaving
    p = np.where((stands >= tuning.FREE_P) & ~allowed, _UNSURE_P, stands)
    lacking = np.clip(1.0 - (clear_m - keep_m) / rules.comfort_m, 0.0, 1.0)
    return route_over(grid, p, start_m, goal_m, None, 1.0 + rules.comfort_cost * lacking, explains)


def _unknown_beside(grid: Grid, stands: np.ndarray, way: Route, reach_m: float) -> np.ndarray:
    """(N,2) rows and columns of unknown cells within ``reach_m`` of a way."""
    on_way = np.zeros(grid.shape, bool)
    for a, b in zip(way.points_home_m[:-1], way.points_home_m[1:]):
        n = int(np.ceil(np.hypot(*(b - a)) / (0.5 * grid.cell_m))) + 1
        row, column, inside = grid.cells_of(*(a + np.linspace(0, 1, n)[:, None] * (b - a)).T)
        on_way[row[inside], column[inside]] = True
    away = cv2.distanceTransform((~on_way).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.argwhere((away * grid.cell_m <= reach_m) & ~np.isfinite(stands))
