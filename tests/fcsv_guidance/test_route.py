# SPDX-License-Identifier: Apache-2.0
"""Routes on drawn ground: around what stands there, and why there is none."""

import numpy as np
import pytest

from fcsv_guidance.errors import RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.search import NoRoute, Route, plan_route

GRID = Grid.around((5, -8), (26, 8), 0.1)
BOX = (13.0, 14.0, -2.0, 1.0, 0.0, 0.6)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def ground(scene):
    return ground_from([scene([BOX]).view(noise=0.3)], grid=GRID)


def clearance(points, box):
    """Least distance (m) of a polyline (N,2) to a rectangle."""
    line = np.concatenate(
        [a + np.linspace(0, 1, 400)[:, None] * (b - a) for a, b in zip(points[:-1], points[1:])]
    )
    apart = np.maximum(np.maximum([box[0], box[2]] - line, line - [box[1], box[3]]), 0)
    return np.hypot(*apart.T).min()


def test_a_route_leads_around_and_keeps_the_footprint_clear(ground, rescue):
    found = plan_route(ground, rescue, (10.0, 0.0), (18.0, 0.0))
    assert isinstance(found, Route) and not len(found.unknown_cells)
    assert clearance(found.points_home_m, BOX) >= rescue.radius_m
    assert 8.0 < found.length_m < 12.0 and found.risk < 0.05
    assert len(found.points_home_m) < 15  # any angle: not a corner a cell
    assert (found.points_home_m[0] == (10, 0)).all() and (found.points_home_m[-1] == (18, 0)).all()


def test_an_uncertain_place_keeps_farther_away(ground, rescue):
    found = plan_route(ground, rescue, (10.0, 0.0), (18.0, 0.0), place_sigma_m=0.3)
    assert clearance(found.points_home_m, BOX) >= rescue.radius_m + 0.6 - 0.05  # half a cell


def test_where_the_way_was_not_seen_there_is_none_but_its_cells_are_named(scene, rescue):
    ground = ground_from([scene(blank=[(13, 16, -9, 9)]).view()], grid=GRID)
    found = plan_route(ground, rescue, (10.0, 0.0), (20.0, 0.0))
    assert isinstance(found, NoRoute) and found.reason.startswith("no safe route is known")
    x = GRID.middle_of(*found.to_see.T)[:, 0]
    assert len(x) and x.min() > 12.0 and x.max() < 17.0
    dear = plan_route(ground, rescue, (10.0, 0.0), (20.0, 0.0), through_unknown=5.0)
    assert isinstance(dear, Route) and len(dear.unknown_cells)


def test_a_goal_beyond_closed_walls_has_no_route_and_nothing_to_see(scene, rescue):
    """A ditch without bottom would be unknown; a low wall across the whole grid is seen on both
    sides and on top."""
    ground = ground_from(
        [scene([(13.0, 15.0, -30, 30, 0.0, 0.4)], eye=(14.0, 0, 12), tilt_rad=np.pi / 2).view()],
        grid=Grid.around((10, -6), (18, 6), 0.1),
    )
    found = plan_route(ground, rescue, (11.5, 0.0), (16.5, 0.0))
    assert isinstance(found, NoRoute)


@pytest.mark.parametrize(
    "goal, words",
    [
        ((60.0, 0.0), r"outside of what was mapped \(x [-0-9.]+ to [0-9.]+, y "),
        ((13.2, 0.0), "at an obstacle"),
        ((14.6, -0.5), "not known|at an obstacle"),
        ((np.nan, 0.0), "not finite"),
    ],
)
def test_a_goal_where_no_robot_can_stand_is_refused(ground, rescue, goal, words):
    with pytest.raises(RouteError, match=words):
        plan_route(ground, rescue, (10.0, 0.0), goal)


def test_a_place_that_is_known_worse_than_the_map_is_wide_is_refused_at_once(ground, rescue):
    with pytest.raises(RouteError, match="wider than what was mapped"):
        plan_route(ground, rescue, (10.0, 0.0), (18.0, 0.0), place_sigma_m=50.0)


def test_a_cost_below_that_of_known_ground_is_refused(ground, rescue):
    with pytest.raises(RouteError, match="at least 1"):
        plan_route(ground, rescue, (10.0, 0.0), (18.0, 0.0), through_unknown=0.5)
