# SPDX-License-Identifier: Apache-2.0
"""Where vehicles hold that gimbals on a robot see, and how they follow it."""

from pathlib import Path

import numpy as np
import pytest

from fcsv_guidance.errors import RouteError
from fcsv_guidance.place.cooperative_place import RobotStart, UntrackedOdometry, VehicleSighting
from fcsv_guidance.place.hold_places import hold_places
from fcsv_guidance.place.stepped_place import PlaceInSteps
from fcsv_guidance.place.tracker import WheelOdometry
from fcsv_guidance.route.following import RouteToFollow
from fcsv_tracking.gimbal.config import load_ground_robot

ROBOT = Path(__file__).parents[2] / "config" / "gimbal" / "ground_robot.yaml"
GIMBALS = load_ground_robot(ROBOT).gimbals


def test_vehicles_hold_beside_the_way_and_near_all_of_it():
    zigzag = np.array([[3.4, 0.7], [5.0, 0.7], [5.0, -1.5], [7.5, -1.5]])
    way = zigzag[:3]
    found = hold_places(way, GIMBALS, np.pi)
    fine = np.concatenate([np.linspace(a, b, 40) for a, b in zip(way[:-1], way[1:])])
    for held_m in found.places_m:
        assert np.hypot(*(fine - held_m).T).min() >= 0.55
    assert np.hypot(*np.subtract(*found.places_m)) >= 1.2
    assert found.seen == 1.0 and found.seen_twice <= found.seen
    # where it drives on, both are behind it, out of the gimbals' limits: told, not hidden
    assert 0.5 < hold_places(zigzag, GIMBALS, np.pi).seen < 1.0
    assert "one seen along" in found.in_words()


def test_vehicles_that_follow_keep_off_the_robot_and_each_other():
    way, now = np.array([[0.0, 0.0], [2.0, 0.0]]), [(2.5, 1.6), (-0.5, -2.0)]
    found = hold_places(way, GIMBALS, 0.0, now)
    assert found.seen_twice == 1.0
    for k, held_m in enumerate(found.places_m):
        flown = np.linspace(now[k], held_m, 50)
        assert np.hypot(*flown.T).min() > 0.99
        assert np.hypot(*(flown - now[1 - k]).T).min() > 0.99


class Standing:
    """A robot that stands 3 m and more from its vehicles, and is heard for some seconds."""

    def __init__(self):
        self.port, self.now_s = PlaceInSteps(GIMBALS), 0.0
        self.at = {g.vehicle: (3.8, y) for g, y in zip(GIMBALS, (0.8, -0.8))}
        self.port.receive(0.0, RobotStart(0.0, 0.0, 0.0, 0.0, np.eye(3) * 1e-4))

    def hear(self, until_s, x_m=0.0):
        while self.now_s < until_s:
            self.now_s += 0.1
            self.port.receive(self.now_s, WheelOdometry(self.now_s, x_m, 0.0, 0.0))
            for name, (x, y) in self.at.items():
                seen = (self.now_s, name, x - x_m, y, 0.0, np.eye(3) * 1e-4)
                self.port.receive(self.now_s, VehicleSighting(*seen))
                self.port.receive(self.now_s, UntrackedOdometry(self.now_s, name, x, y, 0.0))
            found = self.port.step(self.now_s)
            if found.move is not None:
                return found
        return found


def test_nobody_follows_before_there_is_a_route():
    found = Standing().hear(8.0)
    assert found.robot.place is not None and not found.robot.hold and found.move is None


def test_a_vehicle_that_the_robot_leaves_behind_follows_it():
    robot = Standing()
    robot.at = {GIMBALS[0].vehicle: (1.5, 2.0), GIMBALS[1].vehicle: (1.5, -2.0)}
    robot.port.receive(0.0, RouteToFollow(np.array([[0.0, 0.0], [6.0, 0.0]])))
    assert not robot.hear(6.0).robot.hold, "both are near"
    for x_m in np.arange(0.0, 4.6, 0.05):
        found = robot.hear(robot.now_s + 0.1, float(x_m))
        if found.robot.hold:
            break
    assert "stands among its vehicles" in found.robot.hold
    found = found if found.move else robot.hear(robot.now_s + 6.0, float(x_m))
    assert found.move.vehicle in robot.at and found.move.x_m > robot.at[found.move.vehicle][0]


def test_a_route_that_is_none_is_refused():
    with pytest.raises(RouteError):
        PlaceInSteps(GIMBALS).receive(0.0, RouteToFollow(np.array([[0.0, np.nan], [1.0, 0.0]])))
