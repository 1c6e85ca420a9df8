# SPDX-License-Identifier: Apache-2.0
"""The one plan of a robot's way: over free cells, clear of what is not, roomy where there is
room."""

from dataclasses import dataclass
from typing import Tuple, Union

import cv2
import numpy as np

from fcsv_geometry.config import require_positive, require_within
from fcsv_guidance.errors import GoalWithoutRoomError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import tuning
from fcsv_guidance.route.search import NO_ROUTE_KNOWN, NoRoute, Route, route_over

_LARGEST = 1e3  # m, and of a cost
_UNSURE_P = 0.5 * (tuning.FREE_P + tuning.OBSTACLE_P)  # of what is free but too near to what is not


@dataclass(frozen=True)
class RouteRules:
    """A route keeps ``sigmas`` of the robot's place and ``spare_m`` clear of cells that are not
    free, and more where there is room, up to ``comfort_m``: without any of that a metre costs
    ``comfort_cost`` more. It may end ``goal_off_m`` off a goal that is free and has no such room."""

    sigmas: float = 2.0
    spare_m: float = 0.1
    comfort_m: float = 0.7
    comfort_cost: float = 3.0
    goal_off_m: float = 0.25

    def __post_init__(self):
        require_positive(self, but=("spare_m", "comfort_cost", "goal_off_m"))
        require_within(self, 0.0, _LARGEST, "spare_m", "comfort_cost", "goal_off_m")

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
    route_over, and where the goal lacks room.
    """
    free, keep_m = stands >= tuning.FREE_P, rules.keeps_m(place_sigma_m)
    start_has = _near(grid, start_m) < keep_m + grid.cell_m

    def over(open_, explains):
        room_m = grid.clear_m(open_)
        allowed = (room_m > keep_m) | start_has
        goal, cell = goal_m, grid.cell_of(*goal_m) if np.isfinite(goal_m).all() else None
        if cell is not None and free[cell] and not allowed[cell]:
            goal = with_room(grid, free & allowed, goal_m, rules.goal_off_m)
            if goal == goal_m:
                raise GoalWithoutRoomError(
                    f"the goal ({goal[0]:.2f}, {goal[1]:.2f}) m has {max(room_m[cell], 0.0):.2f} m of room, and "
                    f"{keep_m:.2f} m are needed where the robot's place is known to {place_sigma_m:.2f} m"
                )
        p = np.where(free & ~allowed, _UNSURE_P, stands)
        lacking = np.clip(1.0 - (room_m - keep_m) / rules.comfort_m, 0.0, 1.0)
        dearer = 1.0 + rules.comfort_cost * lacking
        return route_over(grid, p, start_m, goal, None, dearer, explains)

    try:
        found = over(free, explains=False)
    except GoalWithoutRoomError:
        found = None
    if isinstance(found, Route):
        return found
    # where unknown cells need no room, a way ends at those that would have to be seen
    nearer = over(free | ~np.isfinite(stands), explains=True)
    if isinstance(nearer, NoRoute):
        return nearer
    to_see = _unknown_beside(grid, stands, nearer, keep_m)
    reason = f"{NO_ROUTE_KNOWN}: {len(to_see)} cells beside the way to the goal were not seen"
    return NoRoute(reason, to_see)


def plan_over(grid: Grid, stands: np.ndarray, start_m, goal_m, place_sigma_m: float = 0.0):
    """The same, a NoRoute also where no robot can stand at start or goal."""
    try:
        return plan_clear(grid, stands, start_m, goal_m, place_sigma_m)
    except RouteError as error:
        return NoRoute(f"{NO_ROUTE_KNOWN}: {error}", np.empty((0, 2), int))


def with_room(grid: Grid, roomy: np.ndarray, goal_m, off_m: float) -> Tuple[float, float]:
    """The goal, or the middle of the nearest ``roomy`` cell (rows, columns), bool, within
    ``off_m``."""
    cell = grid.cell_of(*goal_m)
    off = np.where(roomy, _near(grid, goal_m), np.inf)
    nearest = np.unravel_index(int(np.argmin(off)), off.shape)
    if (cell is not None and roomy[cell]) or not off[nearest] <= off_m:
        return goal_m
    x_m, y_m = map(float, grid.middle_of(*nearest))
    return x_m, y_m


def _near(grid: Grid, place_m) -> np.ndarray:
    """(rows, columns): how far each cell's middle is from a place (m)."""
    xy = grid.middle_of(*np.indices(grid.shape))
    return np.hypot(xy[..., 0] - place_m[0], xy[..., 1] - place_m[1])


def _unknown_beside(grid: Grid, stands: np.ndarray, way: Route, reach_m: float) -> np.ndarray:
    """(N,2) rows and columns of unknown cells within ``reach_m`` of a way."""
    on_way = np.zeros(grid.shape, bool)
    for a, b in zip(way.points_home_m[:-1], way.points_home_m[1:]):
        n = int(np.ceil(np.hypot(*(b - a)) / (0.5 * grid.cell_m))) + 1
        row, column, inside = grid.cells_of(*(a + np.linspace(0, 1, n)[:, None] * (b - a)).T)
        on_way[row[inside], column[inside]] = True
    away = cv2.distanceTransform((~on_way).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.argwhere((away * grid.cell_m <= reach_m) & ~np.isfinite(stands))
