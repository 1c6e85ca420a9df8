# SPDX-License-Identifier: Apache-2.0
"""The route follower, driven by an exact unicycle: it arrives, keeps to its route, and stops for
every doubt."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.errors import RouteError
from fcsv_guidance.grid import Grid
from fcsv_guidance.messages import ClearanceMap, HoldRobot, PlaceLost, RobotPlace, StopRobot
from fcsv_guidance.robot import load_robot
from fcsv_guidance.route.following import RouteFollower, RouteToFollow

STEP_S = 0.05
CORNERS = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 5.0]])
GRID = Grid.around((-3, -5), (12, 10), 0.1)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


def clear(value_m=1.0, stamp_s=0.0):
    return ClearanceMap(stamp_s, GRID, np.full(GRID.shape, value_m))


def with_wall(x_m):
    """What is clear before a wall across the way at x."""
    x = GRID.middle_of(*np.indices(GRID.shape))[..., 0]
    return ClearanceMap(0.0, GRID, np.maximum(x_m - x, 0.0))


class Drive:
    """The follower with a robot that does what it is told."""

    def __init__(self, robot, yaw_rad=0.0, sigma_m=0.05):
        self.follower, self.at, self.now_s, self.way = (
            RouteFollower(robot),
            [0.0, 0.0, yaw_rad],
            0.0,
            [],
        )
        self.sigma_m = sigma_m
        self.follower.receive(0.0, clear())
        self.follower.receive(0.0, RouteToFollow(CORNERS))

    def place(self):
        return RobotPlace(self.now_s, *self.at, self.sigma_m)

    def run(self, seconds, place=True):
        for _ in range(int(round(seconds / STEP_S))):
            if place:
                self.follower.receive(self.now_s, self.place())
            (command,) = self.follower.step(self.now_s)
            x, y, yaw = self.at
            turned = yaw + command.turning_radps * STEP_S
            middle = 0.5 * (yaw + turned)
            self.at = [
                x + command.speed_mps * STEP_S * np.cos(middle),
                y + command.speed_mps * STEP_S * np.sin(middle),
                turned,
            ]
            self.now_s += STEP_S
            self.way.append((*self.at, command.speed_mps, command.turning_radps))
        return command


@pytest.mark.parametrize("yaw_rad", [0.0, np.pi, -1.5])
def test_it_arrives_near_its_route_within_its_bounds(rescue, yaw_rad):
    drive = Drive(rescue, yaw_rad)
    command = drive.run(40.0)
    assert command.reason == "the goal is reached" and command.speed_mps == 0.0
    way = np.array(drive.way)
    assert np.hypot(*(way[-1, :2] - CORNERS[-1])) <= 0.3
    off = np.minimum(
        np.abs(way[:, 1]) + np.maximum(way[:, 0] - 6, 0),
        np.abs(way[:, 0] - 6) + np.maximum(-way[:, 1], 0),
    )
    assert off.max() < 0.45  # the corner is cut by less than the distance that is looked ahead
    assert (
        way[:, 3].max() <= rescue.speed_mps
        and np.abs(way[:, 4]).max() <= rescue.turning_rate_radps + 1e-9
    )
    assert np.diff(way[:, 3]).max() <= rescue.acceleration_mps2 * STEP_S + 1e-9


def test_a_place_that_is_lost_old_or_not_finite_stops_it(rescue):
    drive = Drive(rescue)
    assert drive.run(3.0).speed_mps > 0.3
    assert drive.run(0.4, place=False).speed_mps > 0.0
    stopped = drive.run(0.3, place=False)
    assert stopped.speed_mps == 0.0 and "s old" in stopped.reason
    assert drive.run(1.0).speed_mps > 0.0  # it drives on
    drive.follower.receive(drive.now_s, replace(drive.place(), x_m=np.nan))
    assert drive.follower.step(drive.now_s)[0].reason == "the robot's place is not known"
    assert drive.run(1.0).speed_mps > 0.0
    drive.follower.receive(drive.now_s, PlaceLost("two programs publish it"))
    stopped = drive.run(STEP_S, place=False)
    assert stopped.reason == "the robot's place is not known: two programs publish it"
    assert drive.run(1.0).speed_mps > 0.0


def test_nothing_counts_as_new_that_lies_ahead_of_a_clock_that_was_set_back(rescue):
    drive = Drive(rescue)
    drive.now_s = 1000.0
    drive.follower.receive(1000.0, clear(stamp_s=930.0))
    drive.follower.receive(1000.0, clear(stamp_s=1000.5))  # another computer's, and within bounds
    assert drive.run(1.0).speed_mps > 0.0
    drive.now_s -= 60.0
    stopped = drive.run(10.0, place=False)
    assert stopped.speed_mps == 0.0 and drive.way[-200][3] == 0.0
    assert "the robot's place is 60.0 s ahead of this computer's clock" in stopped.reason
    drive.now_s = 1000.8
    assert drive.run(0.5, place=False).speed_mps == 0.0
    drive.now_s = 950.0
    drive.follower.receive(drive.now_s, clear(stamp_s=drive.now_s + 3600.0))
    stopped = drive.run(10.0)
    assert stopped.speed_mps == 0.0
    assert stopped.reason.startswith("it is not known when the place was seen: its stamp is 3590")
    drive.follower.receive(drive.now_s, clear(stamp_s=drive.now_s))
    assert drive.run(1.0).speed_mps > 0.0


def test_a_place_no_better_known_than_what_is_clear_stops_it(rescue):
    drive = Drive(rescue, sigma_m=0.6)
    command = drive.run(0.1)
    assert (
        command.speed_mps == 0.0
        and command.reason == "the robot's place is known to 0.60 m, and 1.00 m are clear"
    )


def with_wall_behind(x_m):
    """What is clear beyond a wall across the way at x."""
    x = GRID.middle_of(*np.indices(GRID.shape))[..., 0]
    return ClearanceMap(0.0, GRID, np.maximum(x - x_m, 0.0))


def test_a_robot_too_near_to_a_wall_creeps_where_its_route_leads_out(rescue):
    drive = Drive(rescue, sigma_m=0.2)
    drive.follower.receive(0.0, with_wall_behind(-0.15))  # 0.4 m are needed
    drive.run(1.0)
    assert 0.05 < drive.at[0] <= 0.16 and max(speed for *_, speed, _ in drive.way) <= 0.15
    assert drive.run(9.0).speed_mps > 0.5 and drive.at[0] > 2.0


def test_it_stands_where_its_route_leads_on_along_a_wall_or_nearer_or_not_far_enough(rescue):
    for clear_map, sigma_m in (
        (clear(0.15), 0.2),  # along
        (with_wall(0.2), 0.2),  # nearer
        (with_wall_behind(-0.15), 0.6),  # 1.2 m are needed, 0.9 m are clear after 0.8 m
    ):
        drive = Drive(rescue, sigma_m=sigma_m)
        drive.follower.receive(0.0, clear_map)
        assert "are clear" in drive.run(1.0).reason and drive.at[:2] == [0.0, 0.0]


def test_who_cannot_turn_on_the_spot_is_not_led_out(rescue):
    drive = Drive(replace(rescue, turning_radius_m=1.0), sigma_m=0.2)
    drive.follower.receive(0.0, with_wall_behind(-0.15))
    assert "are clear" in drive.run(1.0).reason and drive.at[:2] == [0.0, 0.0]


def test_a_goal_that_is_reached_by_guess_is_not_reached(rescue):
    drive = Drive(rescue, sigma_m=0.45)
    assert "may be at the goal: its place is known to 0.45 m" in drive.run(30.0).reason
    drive.sigma_m = 0.1
    assert drive.run(3.0).reason == "the goal is reached"


def test_an_old_map_and_the_operator_stop_it(rescue):
    drive = Drive(rescue)
    drive.run(1.0)
    drive.follower.receive(drive.now_s, clear(stamp_s=-100.0))
    assert "the place was seen 10" in drive.run(0.1).reason
    drive.follower.receive(drive.now_s, clear(stamp_s=-np.inf))
    assert "not known when the place was seen" in drive.run(0.1).reason
    drive.follower.receive(drive.now_s, clear())
    assert drive.run(0.2).speed_mps > 0.0
    drive.follower.receive(drive.now_s, StopRobot())
    assert drive.run(5.0).reason == "stopped by the operator"
    drive.follower.receive(drive.now_s, RouteToFollow(CORNERS))
    assert drive.run(0.2).speed_mps > 0.0


@pytest.mark.parametrize("closed_after_s", [0.1, 3.0])
def test_it_stands_before_what_closes_its_way(rescue, closed_after_s):
    """The wall appears ahead: the robot brakes and its middle stays out of where it must not be."""
    drive = Drive(rescue)
    drive.run(closed_after_s)
    drive.follower.receive(drive.now_s, with_wall(drive.at[0] + 1.4))
    wall_m = drive.at[0] + 1.4
    assert drive.run(10.0).speed_mps == pytest.approx(0.0, abs=0.02)
    assert wall_m - 1.0 < drive.at[0] < wall_m - 2 * drive.sigma_m


def test_narrow_bends_are_driven_slower(rescue):
    drive = Drive(rescue)
    drive.run(40.0)
    way = np.array(drive.way)
    straight, bend = (
        way[(way[:, 0] > 3) & (way[:, 0] < 5)],
        way[(way[:, 0] > 5.4) & (way[:, 1] < 0.6)],
    )
    assert bend[:, 3].min() < 0.9 * straight[:, 3].max()


def test_wrong_messages_are_refused(rescue):
    follower = RouteFollower(rescue)
    assert follower.step(0.0)[0].reason == "no route has come"
    with pytest.raises(RouteError, match="a route needs two points"):
        follower.receive(0.0, RouteToFollow(np.array([[0.0, np.nan], [1, 1]])))
    with pytest.raises(TypeError, match="does not know str"):
        follower.receive(0.0, "stop")


def test_who_is_held_keeps_the_route(rescue):
    drive = Drive(rescue)
    drive.run(2.0)
    drive.follower.receive(drive.now_s, HoldRobot("something moves 1.0 m from the robot"))
    (command,) = drive.follower.step(drive.now_s)
    assert command.speed_mps == 0.0 and command.reason.startswith("something moves")
    drive.follower.receive(drive.now_s, HoldRobot(""))
    (command,) = drive.follower.step(drive.now_s + 0.1)
    assert command.speed_mps > 0.0 and not command.reason
