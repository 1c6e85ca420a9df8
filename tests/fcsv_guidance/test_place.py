# SPDX-License-Identifier: Apache-2.0
"""The robot's place from fixes and wheels: honest, delayed fixes at their time, outliers refused,
doubt said."""

import re

import numpy as np
import pytest

from fcsv_guidance.place.tracker import PlaceFix, RobotTracker, WheelOdometry

C = np.diag([0.2**2, 0.2**2, np.radians(4) ** 2])
STEP_S = 0.05


class Walk:
    """A robot that drives circles truly; its wheels are wrong by ``scale``, its fixes by noise."""

    def __init__(self, scale=1.0, seed=1, delay_s=0.0):
        self.tracker, self.scale, self.delay_s = RobotTracker(), scale, delay_s
        self.random = np.random.default_rng(seed)
        self.now_s, self.true, self.wheels, self.late = (
            0.0,
            np.array([1.0, 2.0, 0.5]),
            np.zeros(3),
            [],
        )

    def state(self):
        return self.tracker.step(self.now_s)

    def off_m(self):
        place = self.state().place
        return float(np.hypot(place.x_m - self.true[0], place.y_m - self.true[1]))

    def fix(self, off=(0.0, 0.0, 0.0), noise=1.0, covariance=C):
        error = np.asarray(off) + noise * self.random.normal(size=3) * np.sqrt(np.diag(C))
        return PlaceFix(self.now_s, *(self.true + error), covariance)

    def run(self, seconds, speed=0.5, turning=0.1, fixes=True, off=(0.0, 0.0, 0.0)):
        for _ in range(int(round(seconds / STEP_S))):
            self.now_s += STEP_S
            for pose, share in ((self.true, 1.0), (self.wheels, self.scale)):
                way, turn = speed * STEP_S * share, turning * STEP_S
                pose += [way * np.cos(pose[2] + turn / 2), way * np.sin(pose[2] + turn / 2), turn]
            self.tracker.receive(self.now_s, WheelOdometry(self.now_s, *self.wheels))
            if fixes and round(self.now_s / STEP_S) % 10 == 0:
                self.late.append((self.now_s + self.delay_s, self.fix(off)))
            for _, fix in [item for item in self.late if item[0] <= self.now_s + 1e-9]:
                self.tracker.receive(self.now_s, fix)
            self.late = [item for item in self.late if item[0] > self.now_s + 1e-9]


@pytest.mark.parametrize("delay_s", [0.0, 0.4])
def test_place_is_better_than_a_fix_and_its_sigma_is_honest(delay_s):
    """25 drives: of errors within two sigma in 98 % (a round normal law), three beyond have a
    chance of 1 %."""
    off, beyond = [], 0
    for seed in range(25):
        walk = Walk(1.03, seed, delay_s)
        walk.run(4.0, 0.0, 0.0)
        walk.run(20.0)
        off.append(walk.off_m())
        beyond += off[-1] > 2 * walk.state().place.sigma_m
    assert np.sqrt(np.mean(np.square(off))) < 0.2 and beyond <= 2


def test_a_delayed_fix_counts_at_its_own_time():
    """At 0.8 m/s a fix that is 0.5 s late and counted as of now would pull the place back by up to
    0.4 m."""
    prompt, late = Walk(delay_s=0.0, seed=3), Walk(delay_s=0.5, seed=3)
    for walk in (prompt, late):
        walk.run(4.0, 0.0, 0.0)
        walk.run(15.0, 0.8, 0.0)
    assert abs(prompt.off_m() - late.off_m()) < 0.1


def test_between_fixes_sigma_grows_and_then_the_place_is_lost():
    walk = Walk(1.02)
    walk.run(2.0, 0.0, 0.0)
    sigma_m = walk.state().place.sigma_m
    walk.run(5.5, fixes=False)
    place = walk.state().place
    assert place.sigma_m > 1.2 * sigma_m and walk.off_m() < 2 * place.sigma_m
    walk.run(1.0, fixes=False)
    assert walk.state().place is None
    assert re.fullmatch("no fix for 3.[1-4] m of its way", walk.state().reason)
    walk.run(2.0)
    assert walk.state().place is not None


def test_of_a_robot_that_stands_the_place_is_lost_with_time():
    walk = Walk()
    walk.run(3.0, 0.0, 0.0)
    walk.run(14.0, 0.0, 0.0, fixes=False)
    assert walk.state().place is not None
    walk.run(2.0, 0.0, 0.0, fixes=False)
    assert walk.state().place is None and walk.state().reason == "no fix for 16 s"


def test_outliers_are_refused_and_a_row_of_them_is_doubt():
    walk = Walk()
    walk.run(3.0, 0.0, 0.0)
    walk.tracker.receive(walk.now_s, walk.fix((4.0, 0.0, 0.0)))
    state = walk.state()
    assert state.place is not None and state.refused == 1 and "sigma away" in state.last_refusal
    walk.run(1.6, off=(4.0, 0.0, 0.0))
    assert walk.state().place is None and "in a row contradict the wheels" in walk.state().reason
    walk.run(3.0)
    assert walk.state().place is not None and walk.off_m() < 0.5


def test_it_begins_only_where_fixes_agree_and_moves_elsewhere_only_while_it_stands():
    walk = Walk()
    assert walk.state().reason == "no fix has come"
    for k in range(6):  # two robots with one tag: no two fixes in a row agree
        walk.run(STEP_S, 0.0, 0.0, fixes=False)
        walk.tracker.receive(walk.now_s, walk.fix((8.0 * k, 0.0, 0.0), 0.1))
    assert walk.state().place is None and walk.state().reason == "no fixes that agree have come"
    walk.run(3.0, 0.0, 0.0)
    assert walk.off_m() < 0.5
    walk.true[:2] += 5.0  # carried away
    walk.run(6.0, 0.0, 0.0)
    assert walk.state().place is None
    walk.run(5.0, 0.0, 0.0)
    assert walk.off_m() < 0.5


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"x_m": np.nan}, "not finite"),
        ({"yaw_rad": np.inf}, "not finite"),
        ({"covariance": np.full((3, 3), np.nan)}, "not finite"),
        ({"covariance": -C}, "covariance that is none"),
        ({"covariance": C[:2, :2]}, r"shape \(2, 2\)"),
        ({"stamp_s": 99.0}, "in the future"),
        ({"stamp_s": 0.1}, "too late"),
    ],
)
def test_a_fix_that_is_none_is_refused(wrong, words):
    walk = Walk()
    walk.run(5.0, 0.0, 0.0)
    before = walk.state()
    fields = {**vars(walk.fix()), **wrong}
    walk.tracker.receive(walk.now_s, PlaceFix(**fields))
    after = walk.state()
    assert after.place == before.place and after.refused == before.refused + 1
    assert re.search(words, after.last_refusal)


def test_wheels_that_are_not_finite_or_old_change_nothing():
    walk = Walk()
    walk.run(3.0, 0.0, 0.0)
    before = walk.state().place
    walk.tracker.receive(walk.now_s, WheelOdometry(walk.now_s + 1, np.nan, 0.0, 0.0))
    walk.tracker.receive(walk.now_s, WheelOdometry(walk.now_s - 1, 9.0, 0.0, 0.0))
    assert walk.state().place == before


def test_a_position_without_yaw_helps_and_cannot_begin():
    walk = Walk()
    flat = np.diag([0.01, 0.01, np.inf])
    for _ in range(5):
        walk.run(STEP_S, 0.0, 0.0, fixes=False)
        walk.tracker.receive(walk.now_s, walk.fix(covariance=flat))
    assert walk.state().place is None
    walk.run(3.0, 0.0, 0.0)
    sigma_m = walk.state().place.sigma_m
    walk.tracker.receive(walk.now_s, walk.fix(noise=0.1, covariance=flat))
    assert walk.state().place.sigma_m < sigma_m


def test_without_wheels_the_last_fix_is_the_place_until_wheels_come():
    tracker = RobotTracker()
    tracker.receive(1.0, PlaceFix(1.0, 3.0, 4.0, 0.0, C))
    place = tracker.step(1.1).place
    assert (place.stamp_s, place.x_m, place.y_m) == (
        1.0,
        3.0,
        4.0,
    ) and place.sigma_m == pytest.approx(0.2 * 2**0.5)
    tracker.receive(1.2, WheelOdometry(1.2, 50.0, 50.0, 1.0))
    tracker.receive(
        1.3, WheelOdometry(1.3, 50.0 + 0.1 * np.cos(1.0), 50.0 + 0.1 * np.sin(1.0), 1.0)
    )
    assert tracker.step(1.3).place.x_m == pytest.approx(3.1)
    with pytest.raises(TypeError, match="does not know str"):
        tracker.receive(1.0, "here")
