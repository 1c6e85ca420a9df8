# SPDX-License-Identifier: Apache-2.0
"""ground_map and route_follower together: from maps to the goal, another way where one closes, and a
stop with its reason for every doubt."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.errors import RouteError
from fcsv_guidance.messages import Goal, RobotPlace, StopRobot
from fcsv_guidance.place.tracker import PlaceState
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.ground_server import GroundRules
from fcsv_sim.robot.rehearsal.guidance_bus import ARRIVED, DRIVING, NO_ROUTE, WAITING, GuidanceBus

RULES = GroundRules(area_m=(8, 20, -6, 6))
STEP_S = 0.05
ABOVE = {"eye": (14.0, 0.0, 14.0), "tilt_rad": np.pi / 2}
WALL = (13.5, 14.0, -9.0, 1.0, 0.0, 0.8)  # a way is left beside it
GATE = (13.5, 14.0, 0.5, 9.0, 0.0, 0.8)


@pytest.fixture(scope="module")
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def view(scene):
    def made(*boxes, seed=0, stamp_s=0.0):
        return scene(boxes, **ABOVE).view(noise=0.3, seed=seed, stamp_s=stamp_s)

    return made


class Drive:
    """A robot that does what it is told, from (10, 0) to (18, 0)."""

    def __init__(self, robot, rules, *maps, sigma_m=0.1):
        self.guide, self.now_s, self.sigma_m = GuidanceBus(robot, rules, maps), 0.0, sigma_m
        self.at = [10.0, 0.0, 0.0]
        self.placed, self.hold, self.way = True, "", []
        self.run(STEP_S)
        self.guide.receive(self.now_s, Goal(18.0, 0.0))

    def watch(self, view):
        """The watch shows what is now, half a second later."""
        self.guide.receive(self.now_s, replace(view, name="watch", stamp_s=self.now_s))

    def run(self, seconds, until=None):
        for _ in range(int(round(seconds / STEP_S))):
            self.now_s += STEP_S
            place = RobotPlace(self.now_s, *self.at, self.sigma_m) if self.placed else None
            reason = "" if self.placed else "no fix"
            self.guide.receive(self.now_s, PlaceState(place, reason, 0.05, 9, 0, "", self.hold))
            told = self.guide.step(self.now_s)
            yaw = self.at[2] + told.command.turning_radps * STEP_S
            self.at = [
                self.at[0] + told.command.speed_mps * STEP_S * np.cos(yaw),
                self.at[1] + told.command.speed_mps * STEP_S * np.sin(yaw),
                yaw,
            ]
            self.way.append(tuple(self.at))
            if told.state == until:
                break
        return told


@pytest.fixture
def drive(rescue, view):
    return Drive(rescue, RULES, view(WALL))


@pytest.fixture
def watched(rescue, view):
    drive = Drive(rescue, replace(RULES, watched=True), view(WALL))
    drive.watch(view(WALL, seed=1))
    return drive


def test_it_drives_to_the_goal_around_the_wall(drive):
    told = drive.run(60.0, ARRIVED)
    assert told.state == ARRIVED and np.hypot(drive.at[0] - 18.0, drive.at[1]) <= 0.31
    way = np.array(drive.way)
    apart = np.maximum(
        np.maximum([WALL[0], WALL[2]] - way[:, :2], way[:, :2] - [WALL[1], WALL[3]]), 0.0
    )
    assert np.hypot(*apart.T).min() > 0.4 + 0.2  # the footprint, and two sigma
    assert drive.run(1.0).state == ARRIVED and drive.run(1.0).command.speed_mps == 0.0


@pytest.mark.parametrize(
    "doubt, words",
    [
        (lambda d: setattr(d, "placed", False), "the robot's place is 0.[56] s old"),
        (lambda d: setattr(d, "hold", "it measures"), "it measures"),
        (lambda d: setattr(d, "sigma_m", 0.9), "place is known to 0.90 m|no safe route is known"),
    ],
)
def test_every_doubt_stops_it_and_it_drives_on(drive, doubt, words):
    assert drive.run(4.0).state == DRIVING
    doubt(drive)
    told = drive.run(0.6)
    assert told.command.speed_mps == 0.0 and told.state in (WAITING, NO_ROUTE)
    assert re.search(words, told.text), told.text
    drive.placed, drive.sigma_m, drive.hold = True, 0.1, ""
    assert drive.run(60.0, ARRIVED).state == ARRIVED


def test_the_operator_stops_it_until_a_goal_is_given(drive):
    drive.run(3.0)
    drive.guide.receive(drive.now_s, StopRobot())
    told = drive.run(2.0)
    assert told.state == WAITING and told.command.speed_mps == 0.0
    assert told.text == "stopped by the operator"
    drive.guide.receive(drive.now_s, Goal(18.0, 0.0))
    assert drive.run(60.0, ARRIVED).state == ARRIVED


def test_a_gate_that_closes_ends_the_way_and_one_that_opens_gives_it_back(watched, view):
    drive = watched
    assert drive.run(2.0).state == DRIVING
    drive.watch(view(WALL, GATE, seed=2))
    told = drive.run(1.1)
    assert told.state == NO_ROUTE and told.text.startswith("no safe route is known")
    assert told.command.speed_mps == 0.0
    for seed in range(3, 6):
        drive.watch(view(WALL, GATE, seed=seed))
        drive.run(1.0)
    assert drive.at[0] < 13.0
    for seed in range(6, 9):  # one alone does not say that nothing more comes
        drive.watch(view(WALL, seed=seed))
        assert drive.run(1.0).state != ARRIVED
    while drive.now_s < 60.0 and drive.run(1.0, ARRIVED).state != ARRIVED:
        drive.watch(view(WALL, seed=int(drive.now_s)))
    assert drive.guide.step(drive.now_s).state == ARRIVED


def test_something_on_the_route_makes_it_plan_another(watched, view):
    drive = watched
    first = drive.run(1.5).route_m
    box = (14.5, 15.0, 0.8, 1.6, 0.0, 1.0)
    while drive.now_s < 60.0 and drive.run(1.0, ARRIVED).state != ARRIVED:
        drive.watch(view(WALL, box, seed=int(drive.now_s)))
    told = drive.guide.step(drive.now_s)
    assert told.state == ARRIVED and told.route_m is not first
    way = np.array(drive.way)
    apart = np.maximum(
        np.maximum([box[0], box[2]] - way[:, :2], way[:, :2] - [box[1], box[3]]), 0.0
    )
    assert np.hypot(*apart.T).min() > 0.4


def test_the_robot_itself_in_the_picture_is_no_obstacle(watched, view):
    drive = watched
    drive.run(2.0)
    x, y = drive.at[:2]
    itself = (x - 0.3, x + 0.3, y - 0.3, y + 0.3, 0.0, 0.7)
    drive.watch(view(WALL, itself, seed=2))
    assert drive.run(1.0).state == DRIVING


def test_who_must_be_watched_stands_when_the_watch_is_silent(rescue, view):
    drive = Drive(rescue, replace(RULES, watched=True), view(WALL))
    told = drive.run(0.5)
    assert told.state == WAITING and "it is not known when the place was seen" in told.text
    drive.watch(view(WALL, seed=1))
    assert drive.run(2.0).state == DRIVING
    told = drive.run(1.5)
    assert told.state == WAITING and told.text.startswith("the place was seen 3.")
    assert told.command.speed_mps == 0.0


@pytest.mark.parametrize(
    "goal, words", [((13.7, -2.0), "at an obstacle"), ((90.0, 0.0), "outside of what was mapped")]
)
def test_a_goal_where_it_cannot_stand_is_no_route_with_the_reason(drive, goal, words):
    drive.guide.receive(0.0, Goal(*goal))
    told = drive.run(1.0)
    assert told.state == NO_ROUTE and words in told.text
    assert told.text.startswith("no safe route is known: the goal")


def test_bad_messages_are_refused(drive):
    with pytest.raises(RouteError, match="not finite"):
        drive.guide.receive(0.0, Goal(np.nan, 0.0))
    with pytest.raises(TypeError, match="hears str"):
        drive.guide.receive(0.0, "go")


def test_a_place_of_40_by_40_m_is_planned_over_in_one_step(rescue, scene):
    """0.2 s of one processor on 2026-11-28; the bound is the new route's one second after the
    picture."""
    view = scene((), eye=(14.0, 0.0, 30.0), tilt_rad=np.pi / 2).view(noise=0.3, sigma_share=0.0005)
    drive = Drive(rescue, GroundRules(area_m=(-6, 34, -20, 20)), view)
    drive.guide.receive(0.0, Goal(20.0, 5.0))
    route_m = drive.run(STEP_S).route_m
    assert np.allclose(route_m[-1], [20.0, 5.0], atol=0.1)
    assert drive.guide.server.known.stands.shape == (400, 400)
