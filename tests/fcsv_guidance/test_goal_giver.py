# SPDX-License-Identifier: Apache-2.0
"""Goals along a route for move_base, and places out of messages."""

import re

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_guidance.errors import DisputedPlaceError, PlaceError, RouteError
from fcsv_guidance.messages import GroundDated, HoldRobot, PlaceLost, RobotPlace, StopRobot
from fcsv_guidance.place.placing import PoseIntake, ReceivedPose, robot_place
from fcsv_guidance.route.following import RouteToFollow
from fcsv_guidance.route.goal_giver import CancelGoal, GiveGoal, GoalEnded, GoalGiver

ROUTE = RouteToFollow(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 5.0]]))


@pytest.fixture
def giver():
    made = GoalGiver()
    made.receive(0.0, at(0.0, 0.0))
    made.receive(0.0, GroundDated(0.0))
    made.receive(0.0, ROUTE)
    return made


def at(x_m, y_m, stamp_s=0.0):
    return RobotPlace(stamp_s, x_m, y_m, 0.0, 0.05)


def test_goals_lie_along_the_route_and_the_last_is_its_end(giver):
    given, now_s = [], 0.0
    for _ in range(20):
        for output in giver.step(now_s):
            given.append(output)
        now_s += 1.0
        giver.receive(now_s, at(given[-1].x_m, given[-1].y_m, now_s))  # the robot goes there
    assert [(g.x_m, g.y_m) for g in given] == [(3, 0), (6, 0), (6, 3), (6, 5)]
    assert [g.number for g in given] == [1, 2, 3, 4]
    assert given[0].yaw_rad == pytest.approx(0.0) and given[-1].yaw_rad == pytest.approx(np.pi / 2)
    assert giver.text == "goal 4: 11.0 of 11.0 m"
    giver.receive(now_s, GoalEnded(4, True, ""))
    assert not giver.step(now_s) and giver.text == "the goal is reached"


def test_the_next_goal_is_given_before_the_robot_stops_at_the_last(giver):
    assert giver.step(0.0) and not giver.step(0.1)
    giver.receive(1.0, at(1.9, 0.0, 1.0))
    assert not giver.step(1.0)
    giver.receive(1.2, at(2.1, 0.0, 1.2))  # less than 1 m before it
    (goal,) = giver.step(1.2)
    assert (goal.x_m, goal.y_m) == (6.0, 0.0)


def test_old_ground_holds_the_robot_until_it_is_seen_again(giver):
    giver.step(0.0)
    giver.receive(70.0, at(0.0, 0.0, 70.0))
    (cancel,) = giver.step(70.0)
    assert "70.0 s ago, oldest_map_s allows 60 s" in cancel.reason
    giver.receive(71.0, at(0.0, 0.0, 71.0))
    assert not giver.step(71.0) and giver.text == cancel.reason
    giver.receive(71.0, GroundDated(70.5))
    (goal,) = giver.step(71.1)
    assert (goal.x_m, goal.y_m) == (3.0, 0.0)


@pytest.mark.parametrize("dated", [(), (GroundDated(-np.inf),)])
def test_no_goal_over_ground_that_nobody_dates(dated):
    giver = GoalGiver()
    for message in (at(0.0, 0.0), *dated, ROUTE):
        giver.receive(0.0, message)
    assert not giver.step(0.0) and re.match("no map has come|it is not known when", giver.text)


def test_a_held_robot_is_given_the_same_goal_again(giver):
    giver.step(0.0)
    giver.receive(0.2, HoldRobot("a vehicle moves", "place"))
    giver.receive(0.2, HoldRobot("something moves", "ground"))
    assert giver.step(0.2) == [CancelGoal("a vehicle moves")]
    giver.receive(0.3, HoldRobot("", "place"))
    assert not giver.step(0.3) and giver.text == "something moves"
    giver.receive(0.4, HoldRobot("", "ground"))
    (goal,) = giver.step(0.4)
    assert (goal.number, goal.x_m, goal.y_m) == (2, 3.0, 0.0)


@pytest.mark.parametrize(
    "message, now_s, words",
    [
        (StopRobot(), 0.5, "stopped by the operator"),
        (StopRobot("no safe route is known"), 0.5, "no safe route is known"),
        (at(np.nan, 0.0), 0.5, "place is not known"),
        (PlaceLost("two publish it"), 0.5, "place is not known: two publish it; plan the route"),
        (at(0.0, 0.0), 1.5, "place is 1.5 s old"),
        (at(0.0, 0.0, 61.0), 1.0, "place is 60.0 s ahead of this computer's clock"),
        (at(1.0, 2.0), 0.5, "2.0 m beside its route"),
        (GoalEnded(1, False, "no path to it"), 0.5, r"move_base gave up \(no path to it\)"),
    ],
)
def test_every_doubt_cancels_once_and_waits_for_a_new_route(giver, message, now_s, words):
    giver.step(0.0)
    giver.receive(now_s, message)
    (output,) = giver.step(now_s)
    assert isinstance(output, CancelGoal)
    assert re.search(words, output.reason)
    assert not giver.step(now_s) and giver.text == output.reason
    giver.receive(now_s, at(0.0, 0.0, now_s))
    giver.receive(now_s, ROUTE)
    assert isinstance(giver.step(now_s)[0], GiveGoal)


def test_a_clock_that_was_set_back_is_a_doubt(giver):
    giver.step(0.0)
    (output,) = giver.step(-60.0)
    assert isinstance(output, CancelGoal)
    assert "place is 60.0 s ahead of this computer's clock" in output.reason


def test_an_end_of_an_older_goal_means_nothing(giver):
    giver.step(0.0)
    giver.receive(0.5, GoalEnded(0, False, "preempted"))
    assert not giver.step(0.5) and giver.text.startswith("goal 1")


def test_wrong_messages_are_refused(giver):
    with pytest.raises(RouteError, match="two points"):
        giver.receive(0.0, RouteToFollow(np.zeros((1, 2))))
    with pytest.raises(TypeError, match="does not know str"):
        giver.receive(0.0, "go")


COVARIANCE = np.zeros(36)
COVARIANCE[[0, 7]] = 0.09, 0.16


def variances(x, y, yaw):
    """A covariance as ROS has it."""
    return np.diag([x, y, 0.0, 0.0, 0.0, yaw]).ravel()


def test_a_place_has_the_covariance_of_its_message_or_what_is_said_of_it():
    T = np.eye(4)
    T[:2, :2], T[:2, 3] = [[0, -1], [1, 0]], (3.0, 4.0)
    place = robot_place(10.0, 9.9, "home", T, COVARIANCE, None)
    assert (place.x_m, place.y_m, place.stamp_s) == (3.0, 4.0, 9.9)
    assert place.sigma_m == pytest.approx(0.5) and place.yaw_rad == pytest.approx(np.pi / 2)
    assert robot_place(10.0, 9.9, "home", T, None, 0.2).sigma_m == 0.2
    for nothing in (np.zeros(36), variances(0.0, 0.0, 0.1)):
        assert robot_place(10.0, 9.9, "home", T, nothing, 0.2).sigma_m == 0.2


@pytest.mark.parametrize(
    "frame, stamp_s, covariance, sigma_m, words",
    [
        ("map", 9.9, COVARIANCE, None, "its frame is 'map', not home"),
        ("home", 12.0, COVARIANCE, None, "2.0 s ahead of this computer's clock: set the clocks"),
        ("home", 9.9, -COVARIANCE, 0.1, "is none"),
        ("home", 9.9, np.full(36, np.nan), 0.1, "is none"),
        ("home", 9.9, None, None, "no sigma_m was given"),
        ("home", 9.9, np.zeros(36), None, "no sigma_m was given"),
        ("home", 9.9, variances(0.0, 0.0, 0.1), None, "no covariance of x and y"),
        ("home", 9.9, variances(0.01, 0.0, 0.1), 0.1, "only half filled in"),
        ("home", 9.9, variances(0.01, 0.01, np.nan), 0.1, r"\(nan rad\^2\) says that the heading"),
        ("home", 9.9, variances(0.01, 0.01, -0.1), 0.1, "heading is not known"),
        ("home", 9.9, variances(0.01, 0.01, 9.0), 0.1, "heading is not known"),
        ("home", 9.9, variances(0.01, 0.01, np.inf), 0.1, "heading is not known"),
    ],
)
def test_a_pose_that_is_no_place_is_refused(frame, stamp_s, covariance, sigma_m, words):
    with pytest.raises(PlaceError, match=words):
        robot_place(10.0, stamp_s, frame, np.eye(4), covariance, sigma_m)


class Publishers:
    """Programs that publish the robot's pose, and what is taken of it."""

    def __init__(self):
        self.intake, self.now_s = PoseIntake(0.05), 100.0

    def pose(self, caller="/a", x_m=0.0, yaw_rad=0.0, behind_s=0.0):
        T = transforms.from_xyz_yaw([x_m, 0.0, 0.0], yaw_rad)
        pose = ReceivedPose(self.now_s - behind_s, "home", T, None, caller)
        return self.intake.receive(self.now_s, pose)

    def run(self, seconds, *poses):
        """Each program in turn at 20 Hz."""
        for _ in range(int(round(seconds / 0.05))):
            self.now_s += 0.05
            for pose in poses:
                self.pose(**pose)


def test_of_two_programs_that_publish_the_pose_none_counts_until_one_is_gone():
    """Also where both say the same now: nobody knows which is right next."""
    publishers = Publishers()
    publishers.run(1.0, {"caller": "/a"})
    for _ in range(5):
        with pytest.raises(DisputedPlaceError, match="^/a and /b publish the robot's pose at once"):
            publishers.pose("/b")
        with pytest.raises(DisputedPlaceError):
            publishers.pose("/a")
        publishers.now_s += 0.05
    publishers.now_s += 1.9  # a program that was started again under another name
    with pytest.raises(DisputedPlaceError):
        publishers.pose("/b")
    publishers.now_s += 0.2
    assert publishers.pose("/b").stamp_s == publishers.now_s
    publishers.run(1.0, {"caller": "/b"})


def test_a_pose_that_is_older_than_the_last_is_dropped_but_for_a_clock_that_was_set_back():
    publishers = Publishers()
    publishers.run(1.0, {})
    assert publishers.pose().stamp_s == publishers.now_s  # twice
    with pytest.raises(PlaceError, match="0.45 s older than the last one's; do two programs"):
        publishers.pose(x_m=-0.4, behind_s=0.45)
    publishers.run(1.0, {})
    publishers.now_s -= 60.0
    assert publishers.pose().stamp_s == publishers.now_s
    publishers.run(1.0, {})


@pytest.mark.parametrize("other", [{"yaw_rad": 1.0}, {"x_m": 2.0}])
def test_places_that_take_turns_are_none_and_one_that_is_found_anew_is(other):
    """Two programs behind one name: a relay, or a bag."""
    publishers = Publishers()
    for _ in range(3):
        publishers.run(0.2, {})
        publishers.run(0.2, other)
    publishers.now_s += 2.1
    publishers.run(1.0, other)
    with pytest.raises(DisputedPlaceError, match="contradict each other"):
        publishers.run(1.0, {}, other)
    publishers.now_s += 2.1
    publishers.run(1.0, other)
