# SPDX-License-Identifier: Apache-2.0
"""The one plan of a way: clear by the place's sigma, roomy where there is room, and what must be
seen first."""

import numpy as np
import pytest

from fcsv_guidance.errors import RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.route.planning import RouteRules, plan_clear
from fcsv_guidance.route.search import NoRoute, Route

GRID = Grid(0.0, 0.0, 0.1, 60, 120)
START_M, GOAL_M = (1.0, 3.0), (11.0, 3.0)


def stands(*parts):
    """All free but the parts: (x0, x1, y0, y1, p)."""
    p = np.full(GRID.shape, 0.99)
    xy = GRID.middle_of(*np.indices(GRID.shape))
    for x0, x1, y0, y1, value in parts:
        inside = (xy[..., 0] > x0) & (xy[..., 0] < x1) & (xy[..., 1] > y0) & (xy[..., 1] < y1)
        p[inside] = value
    return p


def least_m(route, p):
    """Least clearance along a route, without its ends."""
    points = route.points_home_m
    line = np.concatenate([np.linspace(a, b, 50) for a, b in zip(points[:-1], points[1:])])
    row, column, _ = GRID.cells_of(*line.T)
    return GRID.clear_m(p >= 0.98)[row, column].min()


def test_a_way_keeps_to_the_middle_where_there_is_room():
    wall = (5.0, 6.0, 0.0, 3.5, 0.1)
    route = plan_clear(GRID, stands(wall), START_M, GOAL_M, 0.05)
    assert isinstance(route, Route) and least_m(route, stands(wall)) > 0.6
    near = plan_clear(GRID, stands(wall), START_M, GOAL_M, 0.05, RouteRules(comfort_cost=0.0))
    assert near.length_m < route.length_m
    assert 0.2 - 0.1 < least_m(near, stands(wall)) < 0.4  # two sigma and 0.1 m, less a cell


def test_a_gap_is_open_only_to_who_knows_where_he_is():
    p = stands((5.0, 6.0, 0.0, 2.5, 0.1), (5.0, 6.0, 3.5, 6.0, 0.1))
    assert isinstance(plan_clear(GRID, p, START_M, GOAL_M, 0.15), Route)
    found = plan_clear(GRID, p, START_M, GOAL_M, 0.3)
    assert isinstance(found, NoRoute) and "close every way" in found.reason
    assert not len(found.to_see)


@pytest.mark.parametrize("gap", [None, (2.7, 3.3)])
def test_unknown_cells_in_the_way_are_named(gap):
    """A strip that nobody saw; with a gap that is too narrow for the place, what is beside it."""
    unknown = (5.0, 6.0, 0.0, 6.0, np.nan)
    p = stands(unknown, *([(5.0, 6.0, *gap, 0.99)] if gap else []))
    found = plan_clear(GRID, p, START_M, GOAL_M, 0.2)
    assert isinstance(found, NoRoute) and "were not seen" in found.reason and len(found.to_see) >= 8
    x, y = GRID.middle_of(*found.to_see.T).T
    assert ((x > 5.0) & (x < 6.0)).all() and np.abs(y - 3.0).max() < 1.0


def test_a_goal_at_an_obstacle_is_refused():
    with pytest.raises(RouteError, match="the goal .* is at an obstacle"):
        plan_clear(GRID, stands((10.5, 11.5, 2.5, 3.5, 0.1)), START_M, GOAL_M)


def test_a_free_goal_beside_a_wall_is_moved_where_it_has_room_and_no_farther():
    p = stands((11.2, 11.4, 0.0, 6.0, 0.1))  # 0.2 m behind the goal
    route = plan_clear(GRID, p, START_M, GOAL_M, 0.1)
    assert np.hypot(*(route.points_home_m[-1] - GOAL_M)) == pytest.approx(0.15, abs=0.06)
    assert np.allclose(plan_clear(GRID, p, START_M, GOAL_M, 0.0).points_home_m[-1], GOAL_M)
    with pytest.raises(RouteError, match="has 0.15 m of room, and 0.70 m are needed"):
        plan_clear(GRID, p, START_M, GOAL_M, 0.3)


def test_of_a_goal_beside_what_nobody_saw_these_cells_are_named():
    p = stands((11.2, 11.4, 2.0, 4.0, np.nan))
    found = plan_clear(GRID, p, START_M, GOAL_M, 0.3)
    assert isinstance(found, NoRoute) and len(found.to_see) > 10


def test_a_goal_that_is_not_finite_is_refused():
    with pytest.raises(RouteError, match="is not finite"):
        plan_clear(GRID, stands(), START_M, (np.nan, 1.0))
