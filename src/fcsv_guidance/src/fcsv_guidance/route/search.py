# SPDX-License-Identifier: Apache-2.0
"""The way of least expected risk over known free cells, or which cells would have to be seen
first."""

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from fcsv_guidance.errors import EndNotSeenError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import standing, tuning
from fcsv_guidance.ground.model import Ground, stand_probability
from fcsv_guidance.robot import Robot

#: How a sentence begins that says why the robot stands.
NO_ROUTE_KNOWN = "no safe route is known"
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True)
class Route:
    """``points_home_m`` (N,2) from start to goal; ``length_m``; ``risk``: probability that its
    worst seen cell is not free; ``unknown_cells`` (M,2) rows and columns that it crosses unseen."""

    points_home_m: np.ndarray
    length_m: float
    risk: float
    unknown_cells: np.ndarray


@dataclass(frozen=True)
class NoRoute:
    """No safe route is known. ``to_see`` (M,2): rows and columns of the unknown cells that a way
    would cross; empty where what is known closes every way."""

    reason: str
    to_see: np.ndarray


def plan_route(
    ground: Ground,
    robot: Robot,
    start_m: Tuple[float, float],
    goal_m: Tuple[float, float],
    place_sigma_m: float = 0.0,
    through_unknown: Optional[float] = None,
    stands: Optional[np.ndarray] = None,
):
    """A Route, or a NoRoute. Minimum-cost path of Dijkstra over eight neighbours (scipy), then
    straight pieces.

    Cost of a metre: 1 + RISK_M * -log(p) of the cell. ``through_unknown`` is the cost of a metre of
    unknown cells; None forbids them. The way keeps two ``place_sigma_m`` clear of cells that are not
    free by ``stands`` (rows, columns), stand_probability unless it is known already. Raises
    RouteError where start or goal is not finite, outside of the grid, at an obstacle, or unknown.
    """
    if through_unknown is not None and not 1 <= through_unknown < np.inf:
        raise RouteError(
            f"the cost of a metre of unknown ground must be at least 1, got {through_unknown}"
        )
    if not 0 <= place_sigma_m < np.inf:
        raise RouteError(f"the sigma of the robot's place must be 0 m or more, got {place_sigma_m}")
    across_m = ground.grid.cell_m * min(ground.grid.shape)
    if 2 * (robot.radius_m + 2 * place_sigma_m) > across_m:
        raise RouteError(
            f"{robot.name} and two sigma ({place_sigma_m:g} m) of its place on each side are wider than what was "
            f"mapped, {across_m:.0f} m: tell its place better, or map more"
        )
    if stands is None:
        stands = stand_probability(ground, robot)
    if place_sigma_m > 0:
        stands = _kept_clear(ground.grid, stands, 2 * place_sigma_m)
    return route_over(ground.grid, stands, start_m, goal_m, through_unknown)


def _kept_clear(grid: Grid, stands: np.ndarray, keep_m: float) -> np.ndarray:
    """The probabilities ``stands`` (rows, columns), unsure within ``keep_m`` of what is known not to
    be free, unknown within that of what is unknown."""
    around = standing.disk(keep_m, grid.cell_m)
    known, free = np.isfinite(stands), stands >= tuning.FREE_P
    near = standing.most(known & ~free, around) > 0
    unsure = np.where(free & near, np.minimum(stands, tuning.CONTRADICTED_P), stands)
    return np.where(free & ~near & (standing.least(known, around, 0.0) <= 0), np.nan, unsure)


def route_over(
    grid: Grid,
    p: np.ndarray,
    start_m,
    goal_m,
    through_unknown: Optional[float] = None,
    dearer: Optional[np.ndarray] = None,
    explains: bool = True,
):
    """The same over probabilities ``p`` (rows, columns) that are known already; ``dearer`` (rows,
    columns), 1 and more, multiplies the cost of a metre. ``explains``: a NoRoute names the cells,
    which takes as long again."""
    ends = [
        _end(grid, p, xy, name, through_unknown)
        for xy, name in ((start_m, "start"), (goal_m, "goal"))
    ]
    cost = _cost(p, through_unknown)
    cost = cost if dearer is None else cost * dearer
    way = cheapest(cost, *ends)
    if way is None:
        return _no_route(p, ends) if explains else NoRoute(NO_ROUTE_KNOWN, np.empty((0, 2), int))
    corners = _straightened(cost, way)
    points = grid.middle_of(*corners.T)
    points[0], points[-1] = start_m, goal_m
    cells = np.concatenate(
        [_cells_between(a, b) for a, b in zip(corners[:-1], corners[1:])] or [way]
    )
    crossed = p[tuple(cells.T)]
    unseen = ~np.isfinite(crossed)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    risk = 1.0 - float(np.min(crossed[~unseen], initial=1.0))
    return Route(points, length, risk, cells[unseen])


def _end(grid: Grid, p: np.ndarray, xy, name: str, through_unknown) -> Tuple[int, int]:
    if not np.isfinite(xy).all():
        raise RouteError(f"the {name} ({xy[0]}, {xy[1]}) is not finite; give x and y in home (m)")
    cell = grid.cell_of(*xy)
    where = f"the {name} ({xy[0]:.2f}, {xy[1]:.2f}) m"
    if cell is None:
        x0, x1, y0, y1 = grid.extent_m
        raise RouteError(
            f"{where} lies outside of what was mapped (x {x0:.1f} to {x1:.1f}, y {y0:.1f} to {y1:.1f}); map it first"
        )
    if not np.isfinite(p[cell]):
        if through_unknown is None:
            raise EndNotSeenError(
                f"{where} is not known: it, or ground below the robot's footprint, was not seen",
                cell,
            )
    elif p[cell] < tuning.FREE_P:
        words = "is at an obstacle" if p[cell] <= tuning.OBSTACLE_P else "is not surely free"
        raise RouteError(
            f"{where} {words} (the robot can stand there with p = {_probability_in_words(float(p[cell]))}, free is "
            f"{tuning.FREE_P} and more); choose another place"
        )
    return cell


def _probability_in_words(p: float) -> str:
    """A probability that is not free, in so many digits that it is not rounded to one that is.

    >>> _probability_in_words(0.5), _probability_in_words(0.9791), _probability_in_words(0.979999)
    ('0.50', '0.979', 'just below 0.98')
    """
    words = (f"{p:.{digits}f}" for digits in (2, 3, 4))
    below = (w for w in words if float(w) < tuning.FREE_P)
    return next(below, f"just below {tuning.FREE_P}")


def _cost(p: np.ndarray, through_unknown: Optional[float]) -> np.ndarray:
    """Gives the cost of a metre in every cell; inf where the robot may not drive."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cost = np.where(p >= tuning.FREE_P, 1.0 - tuning.RISK_M * np.log(p), np.inf)
    return cost if through_unknown is None else np.where(np.isfinite(p), cost, through_unknown)


def cheapest(cost: np.ndarray, start, goal) -> Optional[np.ndarray]:
    """(N,2) rows and columns of the cheapest way from cell to cell over ``cost`` (of a metre; inf:
    closed), by Dijkstra over eight neighbours; None where there is none."""
    rows, columns = cost.shape
    index = np.arange(cost.size).reshape(cost.shape)
    edges = []
    for dy, dx in _NEIGHBOURS:
        a = (slice(0, rows - dy), slice(max(0, -dx), columns - max(0, dx)))
        b = (slice(dy, rows), slice(max(0, dx), columns - max(0, -dx)))
        price = np.hypot(dy, dx) * 0.5 * (cost[a] + cost[b])
        ok = np.isfinite(price)
        edges.append((price[ok], index[a][ok], index[b][ok]))
    price, i, j = (np.concatenate(part) for part in zip(*edges))
    graph = coo_matrix((price, (i, j)), (cost.size, cost.size)).tocsr()
    _, before = dijkstra(graph, directed=False, indices=index[start], return_predecessors=True)
    way = [index[goal]]
    while way[-1] != index[start]:
        if before[way[-1]] < 0:
            return None
        way.append(before[way[-1]])
    return np.stack(np.unravel_index(way[::-1], cost.shape), -1)


def _straightened(cost: np.ndarray, way: np.ndarray) -> np.ndarray:
    """The corners that stay when a straight piece is no dearer than the way between its ends (any
    angle)."""
    pieces = (
        np.hypot(*np.diff(way, axis=0).T) * 0.5 * (cost[tuple(way[:-1].T)] + cost[tuple(way[1:].T)])
    )
    so_far = np.concatenate([[0.0], np.cumsum(pieces)])
    kept, at = [0], 0
    while at < len(way) - 1:
        step = len(way) - 1 - at
        while step > 1 and not _is_cheaper(
            cost, way[at], way[at + step], so_far[at + step] - so_far[at]
        ):
            step = step // 2
        at += step
        kept.append(at)
    return way[kept]


def _is_cheaper(cost: np.ndarray, a: np.ndarray, b: np.ndarray, bound: float) -> bool:
    prices = cost[tuple(_cells_between(a, b).T)]
    return bool(np.isfinite(prices).all() and prices.mean() * np.hypot(*(b - a)) <= 1.001 * bound)


def _cells_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N,2): the cells that the straight piece between two middles crosses, sampled at a quarter of
    a cell."""
    n = int(np.ceil(4 * np.hypot(*(b - a)))) + 1
    line = np.asarray(a) + np.linspace(0, 1, n)[:, None] * (np.asarray(b) - a)
    return np.unique(np.rint(line).astype(int), axis=0)


def _no_route(p: np.ndarray, ends) -> NoRoute:
    way = cheapest(_cost(p, 10.0), *ends)
    if way is None:
        return NoRoute(
            f"{NO_ROUTE_KNOWN}: obstacles close every way to the goal", np.empty((0, 2), int)
        )
    unseen = way[~np.isfinite(p[tuple(way.T)])]
    return NoRoute(
        f"{NO_ROUTE_KNOWN}: {len(unseen)} cells on the way to the goal were not seen", unseen
    )
