# SPDX-License-Identifier: Apache-2.0
"""A vehicle that follows a robot and reads its tags: where it looks from, and how it gets there."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_guidance.errors import RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.place.tag_follower import (
    FollowingCamera,
    InitialPlace,
    TagFollower,
    TagFollowRules,
)
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.following import RouteToFollow
from fcsv_guidance.route.vantage import Vantage, VantageRules, best_vantage, shown_to

GROUND_Z, STEP_M = -10.0, 5.0  # home is 10 m above the ground
GRID = Grid.around((15, -15), (45, 15), 0.2)
ROBOT_XY = (30.0, 0.0)
WALL = (27.0, 27.5, -6.0, 6.0, 1.5)  # x0, x1, y0, y1, height: before the robot as home sees it


def ground_with(*walls, known=True):
    xy = GRID.middle_of(*np.indices(GRID.shape))
    height = np.full(GRID.shape, GROUND_Z)
    for x0, x1, y0, y1, high_m in walls:
        inside = (xy[..., 0] > x0) & (xy[..., 0] < x1) & (xy[..., 1] > y0) & (xy[..., 1] < y1)
        height[inside] = GROUND_Z + high_m
    nothing, some = np.full(GRID.shape, np.inf), np.full(GRID.shape, 0.05)
    height = np.where(known, height, np.nan)
    zero = np.zeros(GRID.shape)
    return Ground(
        GRID, height, some, height, height, some, nothing, zero + 1.0, zero + 20.0, zero, zero
    )


def camera(xyz_m, yaw_rad=0.0, stamp_s=0.0, reads=False):
    T = transforms.from_xyz_yaw(xyz_m, yaw_rad) @ T_HOME_CAM_AT_HOME
    return FollowingCamera(stamp_s, T, reads)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


class Followed:
    """A follower whose vehicle is where it was told a step later."""

    def __init__(self, robot, ground, at=(-7.0, 0.0, 0.0), reads=lambda vantage: True):
        self.port, self.ground, self.reads = TagFollower(robot), ground, reads
        self.at, self.yaw_rad, self.now_s, self.moves = np.array(at), 0.0, 0.0, []

    def fly(self, steps):
        for _ in range(steps):
            self.now_s += 2.5
            here = Vantage(self.at, self.yaw_rad, 0.0)
            told = camera(self.at, self.yaw_rad, self.now_s, self.reads(here))
            self.port.receive(self.now_s, told)
            move = self.port.step(self.now_s, self.ground)
            if move is not None:
                self.moves.append((move.p_home_cam - self.at, move.p_home_cam))
                self.at, self.yaw_rad = move.p_home_cam, move.yaw_rad
        return here

    def shows(self, xy):
        tag = np.array([[*xy, GROUND_Z + 0.41]])
        return shown_to(self.ground, tag, Vantage(self.at, self.yaw_rad, 0.0), VantageRules())


def test_it_comes_near_step_by_step_and_down_at_the_end_only(rescue):
    followed = Followed(rescue, ground_with(WALL))
    followed.port.receive(0.0, InitialPlace(*ROBOT_XY))
    followed.fly(12)
    assert followed.shows(ROBOT_XY) == 1.0 and followed.port.problem == ""
    level_m = [np.hypot(*off[:2]) for off, _ in followed.moves]
    assert 5 <= len(level_m) <= 9 and max(level_m) <= STEP_M + 1e-6
    heights_m = [at[2] - GROUND_Z for _, at in followed.moves]
    assert set(heights_m[:-1]) == {10.0}
    # 1.5 m above the wall
    assert heights_m[-1] == pytest.approx(3.0) and 8.0 <= np.hypot(*(followed.at[:2] - ROBOT_XY))


def test_a_wall_is_looked_around(rescue):
    """Behind it from home's side, and nobody sees through it."""
    ground, tag = ground_with(WALL), np.array([[29.0, 0.0, GROUND_Z + 0.41]])
    home_side = Vantage(np.array([19.0, 0.0, -7.0]), 0.0, 0.0)
    assert shown_to(ground, tag, home_side, VantageRules()) == 0.0
    assert shown_to(ground_with(), tag, home_side, VantageRules()) == 1.0
    found = best_vantage(ground, tag, home_side)
    assert found.sees == 1.0 and shown_to(ground, tag, found, VantageRules()) == 1.0
    off = tag[0, :2] - found.p_home_cam[:2]
    assert abs(np.arctan2(off[1], off[0]) - found.yaw_rad) < np.radians(23)


def test_it_follows_along_the_route_and_stays_where_it_sees_enough(rescue):
    followed = Followed(rescue, ground_with(WALL))
    followed.port.receive(0.0, InitialPlace(*ROBOT_XY))
    followed.fly(12)
    way = np.array([ROBOT_XY, (30.0, 10.0), (40.0, 10.0)])
    followed.port.receive(followed.now_s, RouteToFollow(way))
    moves, shown = len(followed.moves), []
    along = np.concatenate([np.linspace(way[0], way[1], 15), np.linspace(way[1], way[2], 15)])
    for xy in along:  # 0.7 m each
        followed.port.receive(followed.now_s, RobotPlace(followed.now_s, *xy, 0.0, 0.1))
        followed.fly(1)
        shown.append(followed.shows(xy))
    assert np.mean(shown) > 0.9 and 1 <= len(followed.moves) - moves <= 12


def test_where_nothing_is_read_another_place_is_tried(rescue):
    """Something that no map shows hides the robot from one side."""
    hidden = []

    def reads(here):
        return bool(hidden and abs(here.yaw_rad - hidden[0]) > 0.3)

    followed = Followed(rescue, ground_with(), (20.0, 0.0, -6.9), reads)
    followed.port.receive(0.0, InitialPlace(*ROBOT_XY))
    followed.fly(1)
    hidden.append(followed.yaw_rad)
    assert followed.shows(ROBOT_XY) == 1.0 and not followed.moves
    followed.fly(12)
    assert followed.moves and abs(followed.yaw_rad - hidden[0]) > 0.3
    assert followed.shows(ROBOT_XY) == 1.0
    before = len(followed.moves)
    followed.fly(5)
    assert len(followed.moves) == before  # it reads, and stays


@pytest.mark.parametrize(
    "ground, start, shown, why",
    [
        (None, ROBOT_XY, True, "no map has come"),
        (ground_with(), ROBOT_XY, False, "no picture with a pose has come"),
        (ground_with(), None, True, "give a 2D Pose Estimate"),
        (ground_with((20, 21, 5, 6, 6.0)), ROBOT_XY, True, "no place shows the robot's tags"),
        (ground_with(), (90.0, 0.0), True, "no ground is known there"),
    ],
)
def test_it_says_what_it_lacks(rescue, ground, start, shown, why):
    port = TagFollower(rescue)
    if start is not None:
        port.receive(0.0, InitialPlace(*start))
    if shown:
        port.receive(9.9, camera((0.0, 0.0, 0.0)))
    assert port.step(10.0, ground) is None and why in port.problem


def test_where_it_does_not_go_another_place_is_tried_and_it_is_told_of(rescue):
    """No mission flies it, or the mission refuses the place."""
    port, told, asked = TagFollower(rescue), [], []
    port.receive(0.0, InitialPlace(*ROBOT_XY))
    for now_s in np.arange(1.0, 90.0, 1.0):
        goes = now_s < 10.0
        port.receive(now_s, camera((now_s if goes else 16.0, 0.0, -3.0)))
        move = port.step(now_s, ground_with())
        asked += [] if move is None else [(now_s, move)]
        told.append("is a mission with follow_s flown" in port.problem)
    assert not any(told[:28]) and all(told[38:])
    early, late = (
        {round(m.yaw_rad, 2) for s, m in asked if s0 < s < s1} for s0, s1 in ((10, 28), (35, 60))
    )
    assert len(early) == 1 and late and not early & late
    port.receive(90.0, camera((12.0, 4.0, -3.0)))  # it moves again
    port.step(92.0, ground_with())
    assert port.problem == ""


def test_it_goes_up_before_it_flies_over_what_is_higher(rescue):
    tower = (28.0, 29.0, 10.0, 11.0, 6.0)  # beside its way, not near the robot
    followed = Followed(rescue, ground_with(tower), (24.0, 14.0, -7.0))
    followed.yaw_rad = -1.5
    followed.port.receive(0.0, InitialPlace(44.0, -10.0))
    followed.fly(14)
    (first, at), *_ = followed.moves
    assert np.hypot(*first[:2]) < 1e-6 and at[2] == pytest.approx(-10.0 + 6.0 + 1.5)
    assert followed.shows((44.0, -10.0)) == 1.0 and followed.at[2] < -7.0
    # level, once it is up, and down at the end
    assert all(off[2] < 1e-6 for off, _ in followed.moves[1:])


def test_it_keeps_off_the_line_along_which_others_watch_the_robot(rescue):
    tags = np.array([[30.0, 0.0, GROUND_Z + 0.41]])
    start = Vantage(np.array([20.0, 0.0, -7.0]), 0.0, 0.0)
    eye = np.array([0.0, 0.0, 0.0])
    free, beside = (best_vantage(ground_with(), tags, start, eye_m=e) for e in (None, eye))
    assert abs(free.p_home_cam[1]) < 1.0 < 1.9 < abs(beside.p_home_cam[1]) and beside.sees == 1.0


def test_an_old_route_leads_nobody_away(rescue):
    """The robot was carried to another place, or its goal was dropped."""
    followed = Followed(rescue, ground_with(), (20.0, 0.0, -7.0))
    followed.port.receive(0.0, RouteToFollow(np.array([[40.0, 12.0], [44.0, 12.0]])))
    followed.port.receive(0.0, RobotPlace(0.0, 30.0, -8.0, 0.0, 0.1))
    followed.fly(8)
    assert followed.shows((30.0, -8.0)) == 1.0
    followed.port.receive(0.0, RouteToFollow(np.empty((0, 2))))
    followed.fly(2)
    assert followed.shows((30.0, -8.0)) == 1.0


def test_bad_input_is_refused_and_loses_nothing(rescue):
    port = TagFollower(rescue)
    with pytest.raises(RouteError, match="start is not finite"):
        port.receive(0.0, InitialPlace(np.nan, 0.0))
    with pytest.raises(RouteError, match="pose of the vehicle"):
        port.receive(0.0, FollowingCamera(0.0, np.full((4, 4), np.nan), True))
    with pytest.raises(RouteError, match="a route needs two points"):
        port.receive(0.0, RouteToFollow(np.array([[1.0, 2.0]])))
    with pytest.raises(TypeError, match="does not know str"):
        port.receive(0.0, "robot")
    port.receive(0.0, RobotPlace(0.0, np.nan, 0.0, 0.0, 0.1))  # a lost place: the last one counts
    port.receive(0.0, camera((0.0, 0.0, 0.0)))
    port.step(1.0, ground_with())
    assert "2D Pose Estimate" in port.problem
    with pytest.raises(ValueError, match="nearest_m: 14 must be below farthest_m"):
        VantageRules(nearest_m=14.0)
    with pytest.raises(ValueError, match="step_m"):
        TagFollowRules(step_m=0.0)
