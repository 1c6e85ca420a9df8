# SPDX-License-Identifier: Apache-2.0
"""A simulated robot in its place, without ROS, and whoever sends it to a goal."""

import doctest

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.robot import load_robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot import reaction
from fcsv_sim.robot.closing import ClosingRules, WayCloser
from fcsv_sim.robot.fixes import TagReader
from fcsv_sim.robot.placed import PlacedRobot
from fcsv_sim.robot.reaction import WayClosed, WayWatch
from fcsv_sim.robot.sent import ARRIVED, CONTACT, NO_ROUTE, STANDS, DriveLimits, SentRobot
from fcsv_sim.robot.things import Box
from fcsv_sim.world.town import Town

SEED, WORLD = 29, "low_maze"


@pytest.fixture(scope="module")
def robot_file(root):
    return root / "config" / "robots" / "rescue.yaml"


@pytest.fixture(scope="module")
def town():
    return Town.generate(SEED, WORLD)


def test_the_same_commands_give_the_same_way_and_a_wall_ends_it(town, robot_file):
    def driven():
        robot = PlacedRobot(load_robot(robot_file), town, np.eye(4), SEED)
        senses = []
        for k in range(1200):
            robot.receive(0.05 * k, DriveCommand(0.8, 0.0))
            senses.append(robot.step(0.05 * (k + 1)))
        return senses

    first, second = driven(), driven()
    assert [s.at for s in first] == [s.at for s in second]
    assert first[-1].touched_m and first[-1].at == first[-40].at  # it stands where it touched
    assert all(s.room_m >= 0.0 for s in first if not s.touched_m)


def test_fixes_come_late_in_home_and_say_how_good_they_are(town, robot_file):
    T_world_home = transforms.from_xyz_yaw([3.0, -2.0, 9.0], 0.6)
    robot = PlacedRobot(load_robot(robot_file), town, T_world_home, SEED)
    far_m, ages = [], []
    for k in range(1000):
        sense = robot.step(0.05 * (k + 1))
        at = np.array([*sense.at[:2], 0.0])
        true = transforms.apply(transforms.invert(T_world_home), at)[:2]
        for fix in sense.fixes:
            far_m.append(np.hypot(*(np.array([fix.x_m, fix.y_m]) - true)))
            ages.append(0.05 * (k + 1) - fix.stamp_s)
    assert len(ages) > 50 and 0.29 < min(ages) and max(ages) < 0.4 and max(far_m) < 1.2


def test_fixes_are_as_good_as_they_say():
    """One sigma over many drives; most of it lasts for a whole drive."""
    offs = []
    for seed in range(300):
        reader, of = TagReader(seed), []
        for k in range(60):
            fix = reader.read(0.5 * k, 0.0, 0.0, 0.0)
            if fix is not None:
                L = np.linalg.cholesky(fix.covariance[:2, :2])
                of.append(np.linalg.solve(L, [fix.x_m, fix.y_m]))
        offs.append(of)
    assert 0.9 < np.sqrt(np.mean(np.square(np.concatenate(offs)))) < 1.1
    assert np.mean([np.var(of, axis=0) for of in offs]) < 0.4


def test_no_robot_drives_through_a_street(robot_file):
    with pytest.raises(SimulationError, match="give one of maze"):
        PlacedRobot(load_robot(robot_file), Town.generate(1, "street"), np.eye(4), 1)


class Sent:
    """A robot that is sent to (5, 0), by a time that the test moves on."""

    def __init__(self, **limits):
        self.port, self.now_s, self.goals = SentRobot((5.0, 0.0), DriveLimits(**limits)), 0.0, []

    def until(self, end_s, moves=True):
        while self.now_s < end_s:
            self.now_s += 0.1
            self.port.on_command(self.now_s, 0.5 * moves, 0.0)
            goal, drive = self.port.step(self.now_s)
            self.goals += [] if goal is None else [goal]
            if drive is not None:
                return drive
        return None

    def set_out(self):
        self.port.on_grid()
        self.port.on_place(0.0, 0.0)
        assert self.until(9.0, moves=False) is None and self.goals == [(5.0, 0.0)]
        self.port.on_route(self.now_s, np.array([[0.0, 0.0], [5.0, 0.0]]))


def test_a_sent_robot_arrives_where_it_stands_near_its_goal():
    sent = Sent()
    sent.set_out()
    sent.port.on_place(4.9, 0.0)
    assert sent.until(20.0) is None  # it still moves
    drive = sent.until(30.0, moves=False)
    assert drive.ended == ARRIVED and drive.says_why and len(drive.routes) == 1


def test_a_sent_robot_that_stands_or_has_no_route_must_say_why():
    sent = Sent()
    sent.set_out()
    drive = sent.until(60.0, moves=False)
    assert drive.ended == STANDS and not drive.says_why
    sent = Sent()
    sent.set_out()
    sent.port.on_words(sent.now_s, "status", "no safe route is known: walls close every way")
    sent.port.on_route(sent.now_s, np.empty((0, 2)))
    drive = sent.until(60.0, moves=False)
    assert drive.ended == NO_ROUTE and drive.says_why and "walls close" in drive.text


def test_a_contact_is_no_end_that_words_excuse():
    sent = Sent()
    sent.set_out()
    sent.port.on_words(sent.now_s, "follower/status", "the goal is reached")
    sent.port.on_touched("touches something")
    drive = sent.until(60.0)
    assert drive.ended == CONTACT and not drive.says_why


def test_nothing_is_sent_before_a_grid_and_a_place_are_there():
    sent = Sent(starts_s=10.0)
    sent.port.on_grid()
    drive = sent.until(60.0, moves=False)
    assert not sent.goals and drive.ended == STANDS and "place is not known" in drive.text


def test_a_crate_comes_across_the_way_once_and_goes(town):
    T_world_home = transforms.from_xyz_yaw([3.0, -2.0, 9.0], 0.0)
    closer = WayCloser(town.plan, T_world_home, SEED, ClosingRules(share=0.2, stays_s=5.0))
    closer.on_route(np.empty((0, 2)))
    assert closer.step(0.0, 23.0, -2.0) == ""
    closer.on_route(np.array([[20.0, 0.0], [40.0, 0.0]]))  # in home
    changes = {}
    for k in range(200):  # 0.1 m a step along the world's x
        change = closer.step(0.1 * k, 23.0 + 0.1 * k, -2.0)
        if change:
            changes[change] = (0.1 * k, closer.box, 23.0 + 0.1 * k)
    begun_s, box, x_m = changes["closed"]
    assert begun_s == pytest.approx(4.0, abs=0.11) and 4.4 < box.x_m - x_m < 7.6
    assert box.y_m == pytest.approx(-2.0) and box.yaw_rad == pytest.approx(0.0)
    assert changes["opened"][0] == pytest.approx(begun_s + 5.0, abs=0.11)
    assert changes["opened"][1] is None


def test_no_crate_comes_where_too_little_of_the_way_is_left(town):
    closer = WayCloser(town.plan, np.eye(4), SEED)
    closer.on_route(np.array([[20.0, 0.0], [26.0, 0.0]]))
    assert all(closer.step(0.1 * k, 20.0 + 0.03 * k, 0.0) == "" for k in range(200))


def test_what_came_into_the_way_is_touched_too(town, robot_file):
    robot = PlacedRobot(load_robot(robot_file), town, np.eye(4), SEED)
    x, y, _ = robot.step(0.05).at
    apart = Box(x + 1.0, y, 0.0, (0.3, 0.3), 1.0)
    assert robot.step(0.1, apart).room_m == pytest.approx(0.3, abs=0.05)
    assert robot.step(0.15, Box(x + 0.5, y, 0.0, (0.3, 0.3), 1.0)).touched_m


def test_the_answer_to_a_way_that_closes_counts_from_the_first_picture_that_can_show_it():
    assert doctest.testmod(reaction).failed == 0
    sent = Sent()
    sent.set_out()
    way = sent.port.way
    way.on_way("closed 20.000")
    way.on_depth(20.2, 19.8)  # taken before
    way.on_route(20.3, True)  # by older pictures
    way.on_depth(20.9, 20.3)
    way.on_hold(21.0, "something moves 3.0 m from the robot")
    way.on_route(21.1, False)
    way.on_command(21.2, False)
    way.on_way("opened 45.000")
    way.on_route(46.0, True)
    way.on_command(46.1, True)
    sent.port.on_place(4.9, 0.0)
    closed = sent.until(60.0, moves=False).way_closed
    assert closed == WayClosed(0.3, 0.9, 1.0, 26.0, 1.1, 1.2, 25.0, 26.1)
    assert closed.answer_s == pytest.approx(0.8)


def test_an_answer_counts_though_its_picture_is_heard_of_later():
    """A busy machine brought the depth 0.5 s after the route that rests on it."""
    way = WayWatch()
    way.on_way("closed 20.000")
    way.on_route(20.1, True)  # planned before any picture that shows it
    way.on_route(21.5, False)
    way.on_depth(22.0, 20.8)
    way.on_route(49.0, True)
    assert way.closed.answer_s == pytest.approx(0.7) and way.closed.none_s == 1.5
    assert (way.closed.route_s, way.closed.depth_s) == (29.0, 2.0)
