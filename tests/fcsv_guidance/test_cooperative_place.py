# SPDX-License-Identifier: Apache-2.0
"""The robot among vehicles that its gimbals see: honest over a drive past vehicles that drift, and
what is wrong is said."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.place.cooperative_place import (
    CooperativeTracker,
    RobotStart,
    UntrackedOdometry,
    VehicleSighting,
)
from fcsv_guidance.place.tracker import WheelOdometry

STEP_S = 0.05
C = np.diag([0.005**2, 0.005**2, np.radians(0.5) ** 2])
START = RobotStart(0.0, 1.0, -2.0, 0.4, np.diag([0.005**2, 0.005**2, np.radians(0.3) ** 2]))
HELD = {"left": (2.0, 1.5, 0.1), "right": (4.0, -3.0, -0.2)}


class Place:
    """A robot that drives truly, wheels that are wrong, and vehicles that drift in a way that
    their odometry does not know."""

    def __init__(self, seed=1, drift_mps=0.02, odometry=True, late_s=0.1):
        self.tracker, self.random = CooperativeTracker(), np.random.default_rng(seed)
        self.late_s, self.with_odometry = late_s, odometry
        self.now_s, self.wheels = 0.0, np.zeros(3)
        start = np.array([START.x_m, START.y_m, START.yaw_rad])
        self.true = start + self.random.normal(size=3) * np.sqrt(np.diag(START.covariance))
        self.scale = self.random.normal(1.0, 0.02)
        self.vehicles = {n: np.array(place) for n, place in HELD.items()}
        self.drift = {n: drift_mps * self.random.normal(size=2) for n in HELD}
        self.coming = []
        self.tracker.receive(0.0, START)

    def state(self):
        return self.tracker.step(self.now_s)

    def sighting(self, name, off=(0.0, 0.0, 0.0)):
        away = self.vehicles[name] - self.true
        c, s = np.cos(self.true[2]), np.sin(self.true[2])
        seen = np.array([c * away[0] + s * away[1], c * away[1] - s * away[0], away[2]])
        seen = seen + off + self.random.normal(size=3) * np.sqrt(np.diag(C))
        return VehicleSighting(self.now_s, name, *map(float, seen), C)

    def run(self, seconds, speed=0.0, turning=0.0, seen=tuple(HELD), off=(0.0, 0.0, 0.0)):
        for _ in range(int(round(seconds / STEP_S))):
            self.now_s += STEP_S
            slip = 1.0 + 0.02 * self.random.normal()
            for pose, share in ((self.true, 1.0), (self.wheels, self.scale * slip)):
                way, turn = speed * STEP_S * share, turning * STEP_S * share
                pose += [way * np.cos(pose[2] + turn / 2), way * np.sin(pose[2] + turn / 2), turn]
            self._send(WheelOdometry(self.now_s, *map(float, self.wheels)), 0.01)
            for name, place in self.vehicles.items():
                place[:2] += STEP_S * self.drift[name]
                if self.with_odometry:
                    self._send(UntrackedOdometry(self.now_s, name, 3.0, -1.0, 0.7), 0.05)
                if name in seen:
                    self._send(self.sighting(name, off), self.late_s)
            for _, message in [m for m in self.coming if m[0] <= self.now_s + 1e-9]:
                self.tracker.receive(self.now_s, message)
            self.coming = [m for m in self.coming if m[0] > self.now_s + 1e-9]
            self.tracker.step(self.now_s)

    def _send(self, message, late_s):
        self.coming.append((self.now_s + late_s, message))

    def off_m(self):
        place = self.state().robot.place
        return float(np.hypot(place.x_m - self.true[0], place.y_m - self.true[1]))


def drive(seed, **kwargs):
    """Standing, a way of 6 m with turns, and its errors over sigma."""
    walk = Place(seed, **kwargs)
    walk.run(6.0)
    found = []
    for speed, turning in ((0.3, 0.3), (0.3, -0.4), (0.0, 1.0), (0.3, 0.1), (0.3, -0.1)):
        walk.run(4.0, speed, turning)
        state = walk.state().robot
        turned = np.arctan2(*(f(state.place.yaw_rad - walk.true[2]) for f in (np.sin, np.cos)))
        found.append((walk.off_m(), state.place.sigma_m, abs(float(turned)), state.yaw_sigma_rad))
    return np.array(found)


def test_the_place_is_known_although_vehicles_drift_and_its_sigma_is_honest():
    """20 drives of 25 s past vehicles that drift by 0.5 m meanwhile."""
    off_m, sigma_m, off_rad, sigma_rad = np.concatenate([drive(seed) for seed in range(20)]).T
    assert np.sqrt(np.mean(off_m**2)) < 0.05 and np.degrees(np.sqrt(np.mean(off_rad**2))) < 1.5
    assert np.mean(off_m < 2 * sigma_m) >= 0.95 and np.mean(off_rad < 2 * sigma_rad) >= 0.92
    assert np.median(sigma_m) < 0.15, "and it says so"


def test_wheels_alone_would_be_far_off():
    """What the sightings are worth: without them the same robot is lost after five seconds."""
    walk = Place(3)
    walk.run(6.0)
    walk.run(10.0, 0.3, 0.3, seen=())
    state = walk.state().robot
    assert state.place is None and "no vehicle seen for 10 s" in state.reason


def test_one_vehicle_is_enough_for_a_while():
    walk = Place(4)
    walk.run(6.0)
    walk.run(8.0, 0.3, 0.1, seen=("left",))
    state = walk.state()
    assert state.robot.place is not None and walk.off_m() < 3 * state.robot.place.sigma_m
    assert set(state.vehicles) == {"left", "right"}


def test_vehicles_without_odometry_wander_and_the_place_says_so():
    known, held = Place(5), Place(5, drift_mps=0.0, odometry=False)
    for walk in (known, held):
        walk.run(6.0)
        walk.run(8.0, 0.3, 0.1)
    assert held.state().robot.place.sigma_m > 1.5 * known.state().robot.place.sigma_m


def test_vehicles_are_placed_in_home_too():
    walk = Place(6)
    walk.run(8.0)
    walk.run(6.0, 0.3, 0.2)
    for name, place in walk.state().vehicles.items():
        off = np.array([place.x_m, place.y_m]) - walk.vehicles[name][:2]
        assert np.linalg.norm(off) < 0.1
        assert np.linalg.eigvalsh(place.covariance)[0] > 0.0


def test_it_says_what_is_missing():
    tracker = CooperativeTracker()
    assert "set home" in tracker.step(0.0).robot.reason
    tracker.receive(0.0, START)
    assert "wheel odometry" in tracker.step(0.1).robot.reason
    tracker.receive(0.1, WheelOdometry(0.1, 0.0, 0.0, 0.0))
    assert "no vehicle has been seen" in tracker.step(0.5).robot.reason


def test_sightings_that_contradict_the_wheels_are_refused_and_stop_it():
    walk = Place(7)
    walk.run(6.0)
    used = walk.state().robot.used
    walk.run(2.0, off=(0.8, 0.0, 0.0))
    state = walk.state().robot
    assert state.place is None and "contradict the wheels" in state.reason
    assert "sigma away" in state.last_refusal and state.used < used + 6
    walk.run(2.0)
    assert walk.state().robot.place is not None, "it goes on where they agree again"


def test_a_robot_that_stands_is_not_averaged_into_certainty():
    """Errors of a tag last: after a minute the vehicles are known no better than a sighting
    allows."""
    walk = Place(8, drift_mps=0.0)
    walk.run(60.0)
    for place in walk.state().vehicles.values():
        assert np.sqrt(place.covariance[0, 0]) > 0.004


@pytest.mark.parametrize(
    "message, words",
    [
        (WheelOdometry(1.0, np.nan, 0.0, 0.0), "not finite"),
        (replace(START, yaw_rad=np.inf), "not finite"),
        (UntrackedOdometry(np.nan, "left", 0.0, 0.0, 0.0), "not finite"),
        (VehicleSighting(1.0, "left", 1.0, 0.0, 0.0, np.zeros((3, 3))), "covariance that is none"),
        (VehicleSighting(1.0, "left", 1.0, 0.0, 0.0, np.eye(2)), "covariance that is none"),
        (
            VehicleSighting(1.0, "left", 1.0, 0.0, 0.0, np.diag([1.0, np.nan, 1.0])),
            "covariance that is none",
        ),
        (VehicleSighting(9.0, "left", 1.0, 0.0, 0.0, C), "ahead of this computer's clock"),
    ],
)
def test_what_is_none_is_refused(message, words):
    tracker = CooperativeTracker()
    tracker.receive(1.0, START)
    tracker.receive(1.0, message)
    assert words in tracker.step(1.0).robot.last_refusal


def test_what_comes_too_late_is_refused_and_an_unknown_message_is_a_defect():
    walk = Place(9)
    walk.run(6.0)
    walk.tracker.receive(walk.now_s, WheelOdometry(1.0, 0.0, 0.0, 0.0))
    assert "too late" in walk.state().robot.last_refusal
    with pytest.raises(TypeError, match="does not know str"):
        walk.tracker.receive(0.0, "here")


def test_a_new_start_forgets():
    walk = Place(10)
    walk.run(6.0)
    walk.tracker.receive(walk.now_s, replace(START, stamp_s=walk.now_s))
    assert walk.state().vehicles == {} and walk.state().robot.place is None


def test_a_jump_of_the_odometry_is_no_motion_among_vehicles():
    place = Place()
    place.run(5.0)
    place.wheels += [2.0, 0.0, 1.0]  # its driver started again
    place.run(0.4, seen=())
    state = place.state().robot
    off_m = np.hypot(state.place.x_m - place.true[0], state.place.y_m - place.true[1])
    assert off_m < 0.1 and 0.2 < state.place.sigma_m < 0.4
    assert "wheel odometry jumped by 2.0 m and 57 degrees" in state.last_refusal
    place.run(3.0)
    assert place.state().robot.place.sigma_m < 0.15


def test_wheels_stamped_by_another_clock_are_refused_among_vehicles():
    place = Place()
    place.run(5.0)
    place.tracker.receive(place.now_s, WheelOdometry(place.now_s + 997.0, 0.0, 0.0, 0.0))
    place.run(1.0)
    assert place.state().robot.place.stamp_s == pytest.approx(place.now_s, abs=0.1)
    told = place.state().robot.last_refusal
    assert (
        told == "wheel odometry is 997.0 s ahead of this computer's clock: set the clocks (chrony)"
    )


def test_after_a_clock_that_was_set_back_home_is_set_again():
    place = Place()
    place.now_s = 100.0
    place.run(3.0)
    place.now_s, place.coming = 40.0, []
    place.run(1.0)
    assert "set home while it stands" in place.state().robot.reason
    place.tracker.receive(place.now_s, replace(START, stamp_s=place.now_s))
    place.run(2.0)
    assert place.state().robot.place is not None
