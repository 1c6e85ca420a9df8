# SPDX-License-Identifier: Apache-2.0
"""The ground server: grids and what changed in them, routes to a goal, and why there is none."""

import doctest
from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance import clock
from fcsv_guidance.errors import GroundError, RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import model, occupancy, standing
from fcsv_guidance.ground.live_views import LiveViews
from fcsv_guidance.ground.model import cell_probability
from fcsv_guidance.ground.occupancy import FREE_PERCENT
from fcsv_guidance.ground.own_pixels import robot_pixels
from fcsv_guidance.messages import Goal, OwnVehicle, RobotPlace
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route import ground_server
from fcsv_guidance.route.grid_regions import Region, changed_region, clearance_map, with_region
from fcsv_guidance.route.ground_server import (
    GoalDropped,
    GridChanged,
    GridMessage,
    GroundRules,
    GroundServer,
    MapSeen,
    NoRouteMessage,
    RobotHold,
    RouteMessage,
)
from fcsv_guidance.route.search import NoRoute, Route

AREA_M = (5.0, 22.0, -6.0, 6.0)
RULES = GroundRules(area_m=AREA_M)
BOX = (13.0, 14.0, -2.0, 1.0, 0.0, 0.6)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def server(rescue, scene):
    """With the map of a place with a box in it; what it said of that is taken."""
    made = GroundServer(rescue, RULES)
    made.receive(0.0, MapSeen(scene([BOX]).view(stamp_s=5.0)))
    (said,) = made.step(0.0)
    assert isinstance(said, GridMessage)
    return made


def at(x_m, y_m, stamp_s=0.0):
    return RobotPlace(stamp_s, x_m, y_m, 0.0, 0.05)


@pytest.mark.parametrize("module", [clock, model, occupancy, ground_server])
def test_names(module):
    done = doctest.testmod(module)
    assert done.attempted and not done.failed


def test_the_grid_of_a_map_says_free_obstacle_and_unknown(server):
    said = server.whole_grid
    assert said.stamp_s == 5.0 and said.grid == Grid.around((5, -6), (22, 6), 0.1)
    cell = said.grid.cell_of
    assert (
        0 <= said.stands[cell(10, 3)] <= FREE_PERCENT
        and 0 <= said.occupied[cell(10, 3)] <= FREE_PERCENT
    )
    assert said.occupied[cell(13.05, -0.5)] >= 50 and said.occupied[cell(14.6, -0.5)] == -1
    # no room for the footprint
    assert said.stands[cell(12.8, -0.5)] > FREE_PERCENT >= said.occupied[cell(12.5, -0.5)]


def test_a_goal_becomes_a_route_once_the_robots_place_is_known(server):
    server.receive(1.0, Goal(18.0, 0.0))
    (said,) = server.step(1.0)
    assert (
        isinstance(said, NoRouteMessage)
        and said.reason == "no safe route is known: the robot's place is not known"
    )
    assert not server.step(2.5)  # said once
    server.receive(3.0, at(10.0, 0.0))
    (said,) = server.step(3.0)
    assert isinstance(said, RouteMessage) and np.allclose(
        said.points_home_m[[0, -1]], [(10, 0), (18, 0)]
    )
    assert not server.step(5.0)


def test_who_leaves_the_route_gets_another_and_who_arrived_none(server):
    server.receive(1.0, at(10.0, 0.0))
    server.receive(1.0, Goal(18.0, 0.0))
    server.step(1.0)
    server.receive(1.2, at(10.0, -3.0))
    assert not server.step(1.2)  # not more often than replan_s
    (said,) = server.step(2.2)
    assert np.allclose(said.points_home_m[0], (10, -3))
    server.receive(9.0, at(18.0, 0.1))
    assert not server.step(9.0)


def test_who_has_no_route_gets_one_once_the_place_is_known_better(server):
    doubtful = RobotPlace(0.0, 10.0, 0.0, 0.0, 3.0)
    server.receive(1.0, doubtful)
    server.receive(1.0, Goal(18.0, 0.0))
    (said,) = server.step(1.0)
    assert isinstance(said, NoRouteMessage)
    server.receive(6.4, doubtful)
    assert not server.step(3.0) and not server.step(6.5)  # planned again, and nothing new to say
    server.receive(7.0, at(10.0, 0.0))
    assert not server.step(7.0)
    server.receive(11.9, at(10.0, 0.0))
    (said,) = server.step(12.0)
    assert isinstance(said, RouteMessage)


def test_from_where_the_robot_was_before_it_was_lost_nobody_plans(server):
    server.receive(1.0, at(10.0, 0.0))
    server.receive(1.0, Goal(18.0, 0.0))
    assert isinstance(server.step(1.0)[0], RouteMessage)
    assert not server.step(9.0)  # it stands on its route
    server.receive(9.5, Goal(18.0, 0.0))
    (said,) = server.step(9.5)
    assert said.waits and said.reason == "no safe route is known: the robot's place is not known"
    server.receive(12.0, at(10.0, -2.0))
    (said,) = server.step(12.0)
    assert np.allclose(said.points_home_m[0], (10, -2))


def test_after_a_clock_that_was_set_back_routes_are_planned_as_before(server):
    server.receive(101.0, at(10.0, 0.0))
    server.receive(101.0, Goal(18.0, 0.0))
    assert isinstance(server.step(101.0)[0], RouteMessage)
    server.receive(41.0, Goal(18.0, 0.0))
    (said,) = server.step(41.0)
    assert said.reason == "no safe route is known: the robot's place is not known"
    server.receive(42.5, at(10.0, -2.0))
    assert isinstance(server.step(42.5)[0], RouteMessage)
    server.receive(43.0, at(10.0, 2.0))
    assert not server.step(43.0) and server.step(43.6)  # beside its route, once a second
    server.receive(13.0, at(10.0, -2.0))
    assert isinstance(server.step(13.0)[0], RouteMessage)  # not after 30 s


def test_who_stands_on_the_route_gets_another(server):
    server.receive(1.0, at(10.0, 0.0))
    server.receive(1.0, Goal(18.0, 0.0))
    server.step(1.0)
    server.receive(5.0, at(10.05, 0.0))  # noise
    assert not server.step(5.0)
    (said,) = server.step(6.5)
    assert isinstance(said, RouteMessage)
    a, b = said.points_home_m[:2]
    server.receive(8.0, at(*(a + 0.6 * (b - a) / np.hypot(*(b - a)))))  # it drives
    assert not server.step(12.0)


def test_a_way_that_closes_is_answered_at_once(server, scene):
    """Not only after replan_s."""
    server.receive(1.0, at(10.0, 3.0))
    server.receive(1.0, Goal(18.0, 3.0))
    assert server.step(1.0)
    thing = (13.0, 14.0, 2.0, 5.0, 0.0, 0.8)
    server.receive(1.2, MapSeen(scene([BOX, thing]).view(stamp_s=1.1, name="live"), live=True))
    assert any(isinstance(said, RouteMessage) for said in server.step(1.2))
    assert not any(isinstance(said, RouteMessage) for said in server.step(1.4))


def test_a_live_map_changes_cells_and_the_route(server, scene):
    server.receive(1.0, at(10.0, 3.0))
    server.receive(1.0, Goal(18.0, 3.0))
    (first,) = server.step(1.0)
    straight = np.hypot(*np.diff(first.points_home_m, axis=0).T).sum()
    thing = (13.0, 14.0, 2.0, 5.0, 0.0, 0.8)
    server.receive(7.2, at(10.0, 3.0))
    server.receive(7.2, MapSeen(scene([BOX, thing]).view(stamp_s=7.0, name="live"), live=True))
    changed, said, held = server.step(7.2)
    assert isinstance(changed, GridChanged) and changed.stamp_s == 7.0 == server.whole_grid.stamp_s
    assert held == RobotHold("something moves 2.4 m from the robot")
    rows, columns = changed.stands.percents.shape
    whole = server.whole_grid.stands[changed.stands.row :, changed.stands.column :][:rows, :columns]
    assert (
        np.array_equal(whole, changed.stands.percents)
        and rows * columns < 0.7 * server.whole_grid.stands.size
    )
    assert (
        isinstance(said, RouteMessage)
        and np.hypot(*np.diff(said.points_home_m, axis=0).T).sum() > straight + 0.5
    )
    assert not server.step(9.6)  # time alone is no reason to drive on
    for stamp_s in (10.0, 11.0):
        there = scene([BOX, thing]).view(stamp_s=stamp_s, name="live")
        server.receive(stamp_s, MapSeen(there, live=True))
        said = server.step(stamp_s)
    assert said[-1] == RobotHold("")  # two views show that nothing more comes
    cell = server.whole_grid.grid.cell_of(12.8, 3.0)
    for stamp_s in (12.0, 13.0, 14.0):  # it went: three views must show the ground
        assert server.whole_grid.stands[cell] > FREE_PERCENT
        gone = scene([BOX]).view(stamp_s=stamp_s, name="live")
        server.receive(stamp_s, MapSeen(gone, live=True))
        server.step(stamp_s)
    assert 0 <= server.whole_grid.stands[cell] <= FREE_PERCENT


def test_a_watch_that_shows_the_same_says_only_its_time(server, scene):
    server.receive(1.0, at(10.0, 3.0))
    for k in range(3):
        view = scene([BOX]).view(stamp_s=10.0 + k, name="live")
        server.receive(10.0 + k, MapSeen(view, watching=True))
        (said,) = server.step(10.0 + k)
        one = (1, 1)
        assert said.stamp_s == 10.0 + k == server.whole_grid.stamp_s
        assert said.stands.percents.shape == said.occupied.percents.shape == one


def test_who_must_be_watched_gets_grids_as_old_as_the_watch(rescue, scene):
    server = GroundServer(rescue, replace(RULES, watched=True))
    view = scene([BOX]).view(stamp_s=100.0)
    with pytest.raises(GroundError, match="watches a place that has no map"):
        server.receive(0.0, MapSeen(view, watching=True))
    server.receive(0.0, MapSeen(view))
    assert server.whole_grid.stamp_s == -np.inf  # nobody watches
    with pytest.raises(GroundError, match="the robot's place is not known"):
        server.receive(1.0, MapSeen(view, watching=True))
    server.receive(2.0, at(10.0, 3.0))
    server.receive(2.0, MapSeen(replace(view, stamp_s=102.0), watching=True))
    server.step(2.0)
    assert server.whole_grid.stamp_s == 102.0


def test_the_robot_and_what_it_hides_are_no_thing_that_came(server, scene):
    """The edge of the robot lies in the picture where the ground behind it would be."""
    server.receive(1.0, at(10.0, 3.0, 2.0))
    server.receive(1.0, Goal(18.0, 3.0))
    server.step(1.0)
    itself = (9.7, 10.3, 2.7, 3.3, 0.0, 0.7)
    view = scene([BOX, itself]).view(stamp_s=2.0, name="live")
    server.receive(2.2, MapSeen(view, watching=True))
    (said,) = server.step(2.2)
    assert isinstance(said, GridChanged)
    assert 0 <= server.whole_grid.stands[server.whole_grid.grid.cell_of(10.0, 3.0)] <= FREE_PERCENT


def test_a_thing_behind_the_robot_is_told_by_its_pixels_beside_the_robot(server, scene):
    """On the ground that the robot hides, and higher than it: nothing of the robot is seen there."""
    server.receive(1.0, at(11.0, 4.0, 2.0))
    server.receive(1.0, Goal(18.0, 4.0))
    server.step(1.0)
    itself, crate = (10.7, 11.3, 3.7, 4.3, 0.0, 0.7), (12.1, 12.4, 3.4, 4.9, 0.0, 1.3)
    view = scene([BOX, itself, crate]).view(stamp_s=2.0, name="live")
    server.receive(2.2, MapSeen(view, watching=True))
    said = server.step(2.2)
    assert any(isinstance(each, RobotHold) and "something moves" in each.reason for each in said)
    grid, closed = server.whole_grid.grid, server.known.closed
    assert closed[grid.cell_of(12.2, 4.2)] and not closed[grid.cell_of(11.0, 4.0)]


def test_the_robots_pixels_are_known_where_it_is_before_the_camera(scene, rescue):
    view = scene([]).view()
    own = robot_pixels(view, at(12.0, 0.0), rescue, 0.0)
    itself = scene([(11.7, 12.3, -0.3, 0.3, 0.0, 0.7)]).view().depth < view.depth - 0.05
    assert own[itself].all() and 1.5 < own.sum() / itself.sum() < 8.0
    assert robot_pixels(view, at(-5.0, 0.0), rescue, 0.0) is None


def is_free(server):
    """(rows, columns) bool of its grid."""
    stands = server.whole_grid.stands
    return (stands >= 0) & (stands <= FREE_PERCENT)


@pytest.mark.parametrize("is_told", [True, False])
def test_a_vehicle_of_ours_before_the_ground_is_no_thing_that_came(server, scene, is_told):
    """It hides ground 12 m away from a camera that looks past it."""
    server.receive(1.0, at(10.0, 3.0, 2.0))
    free = is_free(server)
    if is_told:
        server.receive(1.9, OwnVehicle(1.9, "uav3", np.array([12.0, 0.0, 3.6])))
        server.receive(1.0, OwnVehicle(0.5, "uav3", np.array([14.0, 3.0, 0.0])))  # long ago
    flying = (11.8, 12.2, -0.3, 0.3, 3.5, 3.7)
    view = scene([BOX, flying]).view(stamp_s=2.0, name="live")
    server.receive(2.2, MapSeen(view, watching=True))
    server.step(2.2)
    lost = (free & ~is_free(server)).sum()
    assert (lost == 0) == is_told, lost


def test_a_vehicle_of_ours_that_hides_the_robot_ends_the_watch(server, scene):
    """Who comes up to the robot would not be seen: the view counts for none."""
    server.receive(1.0, at(14.0, 3.0, 2.0))
    view = scene([BOX]).view(stamp_s=2.0, name="live")
    on_the_line = np.array([0.5 * 14.0, 0.5 * 3.0, 0.5 * (8.0 + 0.35)])
    server.receive(1.9, OwnVehicle(1.9, "uav3", on_the_line))
    with pytest.raises(GroundError, match="uav3 hides the robot"):
        server.receive(2.2, MapSeen(view, watching=True))
    behind = OwnVehicle(3.0, "uav3", np.array([2.0 * 14.0, 2.0 * 3.0, -6.0]))
    server.receive(3.0, behind)
    server.receive(3.2, MapSeen(scene([BOX]).view(stamp_s=3.0, name="live"), watching=True))
    assert server.eye_m.tolist() == [0.0, 0.0, 8.0]


def test_maps_of_other_stations_stay_and_one_that_grew_takes_its_place(server, scene):
    half = scene(blank=[(13, 15, -9, 9)])
    server.receive(1.0, MapSeen(half.view(stamp_s=1.0)))
    maps = len(server.ground.maps)
    server.receive(2.0, MapSeen(half.view(stamp_s=1.0)))
    assert len(server.ground.maps) == maps, "the same reference picture: in place of the first"
    server.receive(3.0, MapSeen(scene().view(stamp_s=3.0, name="next")))
    assert len(server.ground.maps) == maps + 1


def test_a_live_map_alone_is_enough(rescue, scene):
    server = GroundServer(rescue, RULES)
    for k in (1, 2):
        server.receive(k, MapSeen(scene([BOX]).view(stamp_s=k, name="live"), live=True))
    whole, changed = server.step(2.0)
    assert isinstance(whole, GridMessage) and isinstance(changed, GridChanged)
    assert server.ground.views == ("live",)
    server.receive(3.0, MapSeen(scene([BOX]).view(stamp_s=0.5)))  # a finished one comes, too
    server.step(3.0)
    assert server.ground.views == ("drawn",) and server.whole_grid.stamp_s == 2.0


def test_where_there_is_no_route_its_cells_are_named(rescue, scene):
    server = GroundServer(rescue, RULES)
    server.receive(0.0, MapSeen(scene(blank=[(13, 15, -9, 9)]).view()))
    server.receive(0.0, at(10.0, 0.0))
    server.receive(0.0, Goal(18.0, 0.0))
    said = server.step(0.0)[-1]
    assert isinstance(said, NoRouteMessage) and len(said.to_see_m) and "; look at (1" in said.reason
    assert said.to_see_m[:, 0].min() > 12 and said.to_see_m[:, 0].max() < 16
    server.receive(2.0, MapSeen(scene().view(name="second")))  # another map shows them
    assert isinstance(server.step(2.0)[-1], RouteMessage)


def test_a_service_gets_a_route_a_goal_nearby_or_a_sentence(server):
    found = server.plan((10.0, 0.0), (18.0, 0.0))
    assert isinstance(found, Route)
    with pytest.raises(RouteError, match="at an obstacle|not surely free"):
        server.plan((10.0, 0.0), (12.9, 0.0))
    near = server.plan((10.0, 0.0), (12.9, 0.0), tolerance_m=1.0)
    assert 0.1 < np.hypot(*(near.points_home_m[-1] - (12.9, 0.0))) <= 1.0
    with pytest.raises(RouteError, match="outside of what was mapped"):
        server.plan((10.0, 0.0), (90.0, 0.0), tolerance_m=1.0)
    for tolerance_m in (np.nan, -5.0, np.inf):
        with pytest.raises(RouteError, match="the tolerance .* is none; give 0 or more"):
            server.plan((10.0, 0.0), (18.0, 0.0), tolerance_m)
    with pytest.raises(RouteError, match="the goal .* is not finite"):
        server.plan((10.0, 0.0), (np.inf, 0.0), tolerance_m=1.0)
    none = server.in_words(NoRoute("no safe route is known: 7 cells", np.array([[0, 0]] * 7)))
    assert (
        none.reason.startswith("no safe route is known: 7 cells; look at (5.")
        and len(none.to_see_m) == 7
    )
    assert none.reason.endswith(" and 2 more")


def test_a_goal_that_is_dropped_ends_its_route_and_wrong_ones_are_refused(server, rescue):
    server.receive(1.0, at(10.0, 0.0))
    server.receive(1.0, Goal(18.0, 0.0))
    server.step(1.0)
    server.receive(2.0, GoalDropped("stopped by the operator"))
    (said,) = server.step(2.0)
    assert said.reason == "stopped by the operator" and not server.step(9.0)
    with pytest.raises(RouteError, match="not finite"):
        server.receive(3.0, Goal(np.nan, 0.0))
    with pytest.raises(TypeError, match="does not know str"):
        server.receive(3.0, "go")
    with pytest.raises(RouteError, match="no map has come"):
        GroundServer(rescue).plan((0, 0), (1, 1))


def test_a_map_without_ground_leaves_what_is_known(server, scene):
    before = server.whole_grid
    view = scene([BOX]).view()
    server.receive(1.0, at(10.0, 3.0))
    with pytest.raises(GroundError, match="no pixel has a depth"):
        server.receive(
            1.0, MapSeen(replace(view, sigma=np.full_like(view.sigma, np.nan)), live=True)
        )
    with pytest.raises(GroundError, match="no pixel has a depth"):
        server.receive(1.0, MapSeen(replace(view, sigma=np.full_like(view.sigma, np.nan))))
    assert server.whole_grid is before and not server.step(1.0)
    server.receive(2.0, MapSeen(scene([BOX]).view(name="good")))
    assert server.ground.views == ("drawn", "good")


def test_regions_are_found_put_in_place_and_refused_outside():
    before = np.zeros((5, 6), np.int8)
    after = before.copy()
    after[1, 2] = after[3, 4] = 9
    region = changed_region(before, after)
    assert (region.row, region.column, region.percents.shape) == (1, 2, (3, 3))
    assert (
        np.array_equal(with_region(before, region), after) and changed_region(after, after) is None
    )
    for row, column in ((3, 2), (1, 4), (-1, 0)):
        with pytest.raises(GroundError, match="outside of the grid"):
            with_region(before, Region(row, column, region.percents))


def test_clearance_is_the_distance_to_where_the_robot_must_not_stand():
    grid = Grid(0.0, 0.0, 0.1, 21, 41)
    stands = np.zeros(grid.shape, np.int8)
    stands[:, 30] = 100
    stands[:, :5] = -1
    clear = clearance_map(3.0, grid, stands)
    assert (
        clear.stamp_s == 3.0
        and (clear.clear_m[:, 30] == 0).all()
        and (clear.clear_m[:, :5] == 0).all()
    )
    assert clear.clear_m[10, 25] == pytest.approx(0.45, abs=0.01)  # to the edge of that cell
    assert clear.clear_m[0, 15] == pytest.approx(0.05, abs=0.01)  # the grid ends


def test_parts_of_a_live_map_become_a_view_by_their_stamp(scene):
    view, views = scene().view(), LiveViews()
    parts = {
        "depth": view.depth,
        "sigma": view.sigma,
        "kind": view.kind,
        "camera": view.camera,
        "T_home_cam": view.T_home_cam,
    }
    for stamp_s in range(20):  # incomplete ones are forgotten
        assert views.add(stamp_s, "depth", view.depth) is None
    for part, value in list(parts.items())[1:]:
        assert views.add(3.0, part, value) is None
    for part, value in list(parts.items())[1:]:
        made = views.add(19.0, part, value)
    assert made.stamp_s == 19.0 and np.array_equal(made.sigma, view.sigma, equal_nan=True)
    with pytest.raises(GroundError, match="sigma has shape"):
        [
            views.add(30.0, part, value if part != "sigma" else value[:9])
            for part, value in parts.items()
        ]
    for camera, words in (
        (replace(view.camera, width=1280, height=960), "of 1280 x 960 px, its depth of 640 x 480"),
        (replace(view.camera, distortion=(0.3, 0.1, 0.0, 0.0, 0.0)), "has a distortion"),
    ):
        with pytest.raises(GroundError, match=words):
            for part, value in {**parts, "camera": camera}.items():
                views.add(31.0, part, value)
    with pytest.raises(ValueError, match="has no part 'colour'"):
        views.add(1.0, "colour", None)


def test_what_is_judged_in_a_window_is_what_the_whole_grid_gives(server, scene, rescue):
    """The time to the answer hangs on it: only cells near a change are judged anew."""
    server.receive(1.0, at(10.0, 3.0))
    server.receive(1.0, MapSeen(scene([BOX]).view(stamp_s=1.0, name="live"), watching=True))
    thing = (15.0, 15.6, 2.0, 4.0, 0.0, 0.8)
    view = scene([BOX, thing]).view(stamp_s=2.0, name="live")
    server.receive(2.0, MapSeen(view, watching=True))
    whole = cell_probability(server.ground, rescue)
    assert np.allclose(server._alone, whole, equal_nan=True)
    near = standing.most(server._known.changed, standing.disk(0.6, 0.1)) > 0
    seen = server._known._watching["live"].ground
    p, below = server._known._stands["live"]
    assert near.sum() > 100
    judged, all_below = standing.by_one(seen, rescue)
    assert np.allclose(p[near], judged[near], equal_nan=True, atol=1e-5)
    assert np.array_equal(below[near], all_below[near])
    server.receive(3.0, MapSeen(scene([BOX]).view(stamp_s=3.0, name="live"), watching=True))
    assert np.allclose(server._alone, cell_probability(server.ground, rescue), equal_nan=True)
