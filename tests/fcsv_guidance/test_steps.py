# SPDX-License-Identifier: Apache-2.0
"""When a robot among vehicles stands, and which of them follows; whole drives:
tests/fcsv_sim/test_gimbal_rehearsal.py."""

from dataclasses import dataclass, field
from typing import Dict, Tuple

import numpy as np
import pytest

from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.place.cooperative_place import CooperativeState
from fcsv_guidance.place.steps import DriveInSteps, MoveVehicle, StepRules
from fcsv_guidance.place.tracker import LevelPlace, PlaceState

RULES = StepRules()
STEP_S = 0.25


@dataclass
class Walk:
    """A robot and two vehicles as a tracker would state them; vehicles that are told so fly at
    0.5 m/s."""

    wanted: Dict[str, Tuple[float, float]] = field(default_factory=dict)
    now_s: float = 0.0
    x_m: float = 0.0
    sigma_m: float = 0.01
    stood_s: float = 5.0
    drift_mps: float = 0.005
    unseen_s: float = 0.2
    known: bool = True

    def __post_init__(self):
        self.at = {"left": np.array([1.0, 2.0]), "right": np.array([1.0, -2.0])}
        self.told = []
        self.port = DriveInSteps(lambda _state: self.wanted)

    def step(self):
        self.now_s += STEP_S
        robot = RobotPlace(self.now_s, self.x_m, 0.0, 0.0, self.sigma_m) if self.known else None
        state = CooperativeState(
            PlaceState(robot, "" if self.known else "lost", 0.01, 9, 0, ""),
            {n: LevelPlace(self.now_s, *p, 0.0, np.eye(3)) for n, p in self.at.items()},
            self.stood_s,
            self.drift_mps,
            self.unseen_s,
        )
        advice = self.port.step(self.now_s, state)
        self.told += [] if advice.move is None else [(self.now_s, advice.move)]
        for _, move in self.told:
            off = np.array([move.x_m, move.y_m]) - self.at[move.vehicle]
            far = np.hypot(*off)
            self.at[move.vehicle] += off * min(1.0, 0.5 * STEP_S / max(far, 1e-9))
        return advice.hold

    def set_out(self):
        """As far as that: the vehicles are where they should be."""
        wanted, self.wanted = self.wanted, {}
        assert self.step() and RULES.least_s <= self.stand() <= RULES.least_s + 2 * STEP_S
        self.wanted, self.stood_s = wanted, 0.0

    def drive(self, far_m, grows_m=0.0):
        """As far, or until it is to stand."""
        goal_m = self.x_m + far_m
        while self.x_m < goal_m:
            self.x_m, self.stood_s = self.x_m + 0.3 * STEP_S, 0.0
            self.sigma_m = float(np.hypot(self.sigma_m, grows_m))
            if self.step():
                return True
        return False

    def stand(self):
        """Seconds until it may drive on."""
        began_s = self.now_s
        while self.now_s < began_s + 60.0:
            self.stood_s = self.now_s - began_s
            if not self.step():
                return self.now_s - began_s
        return np.inf


def test_a_robot_whose_place_stays_known_drives_on():
    walk = Walk()
    walk.set_out()
    assert not walk.drive(3.0)


def test_it_stands_where_its_place_became_less_sure_until_the_drift_is_known():
    walk = Walk()
    walk.set_out()
    assert walk.drive(6.0, grows_m=0.02)
    assert 0.03 < walk.sigma_m < 0.04
    assert RULES.least_s <= walk.stand() <= RULES.least_s + 2 * STEP_S
    assert not walk.drive(0.2), "growth counts from the last stand"
    walk.drift_mps = 0.02
    assert walk.drive(6.0, grows_m=0.03)
    assert RULES.longest_s <= walk.stand() <= RULES.longest_s + 2 * STEP_S


def test_vehicles_come_beside_its_way_before_it_sets_out():
    walk = Walk({"left": (2.0, 2.0)})
    assert walk.step() and [m for _, m in walk.told] == [MoveVehicle("left", 2.0, 2.0)]
    assert walk.x_m == 0.0 and walk.stand() > RULES.least_s


def test_vehicles_follow_one_after_the_other_while_it_stands():
    walk = Walk({"left": (2.0, 2.0), "right": (3.0, -2.0)})
    walk.set_out()
    assert walk.drive(6.0, grows_m=0.02) and not walk.told, "none moves while the robot does"
    took_s = walk.stand()
    assert [move for _, move in walk.told] == [
        MoveVehicle("right", 3.0, -2.0),
        MoveVehicle("left", 2.0, 2.0),
    ], "the one with the farther way first"
    first_s, second_s = (at_s for at_s, _ in walk.told)
    assert second_s - first_s >= (2.0 - RULES.near_m) / 0.5 - STEP_S
    assert took_s >= (3.0 - 2 * RULES.near_m) / 0.5 + RULES.least_s - 2 * STEP_S
    assert not walk.drive(0.2)


def test_places_not_worth_the_time_are_left():
    walk = Walk({"left": (1.2, 2.0), "right": (1.0, -2.2)})
    walk.set_out()
    assert walk.drive(6.0, grows_m=0.02) and walk.stand() < RULES.least_s + 3 * STEP_S
    assert not walk.told


def test_a_vehicle_that_does_not_come_is_waited_for_not_for_ever():
    walk = Walk({"left": (9.0, 9.0)})
    walk.set_out()
    assert walk.drive(6.0, grows_m=0.02)
    most_s = RULES.move_s + RULES.longest_s
    assert RULES.move_s < walk.stand() <= most_s + 4 * STEP_S


@pytest.mark.parametrize("change", [{"unseen_s": 2.0}, {"at": 4.0}])
def test_it_stands_where_a_vehicle_goes_out_of_sight_once_in_half_a_metre(change):
    walk = Walk()
    walk.set_out()
    if "at" in change:
        walk.at["left"][:] = [0.5, change["at"]]
    walk.unseen_s = change.get("unseen_s", 0.2)
    assert walk.drive(2.0) and 0.5 <= walk.x_m < 0.65
    assert walk.stand() < np.inf and not walk.drive(0.4)
    assert walk.drive(0.4)


def test_without_a_place_it_says_nothing():
    walk = Walk(known=False)
    assert walk.step() == "" and not walk.told
