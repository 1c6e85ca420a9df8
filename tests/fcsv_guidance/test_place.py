# SPDX-License-Identifier: Apache-2.0
"""The robot's place from fixes and wheels: honest, delayed fixes at their time, outliers refused,
doubt said."""

import re

import numpy as np
import pytest

from fcsv_guidance.place.tracker import PlaceFix, RobotTracker, WheelOdometry
from fcsv_guidance.place.wheels import WheelReader, WheelRules, between
from fcsv_guidance.robot import load_robot

C = np.diag([0.2**2, 0.2**2, np.radians(4) ** 2])
STEP_S = 0.05
NO_START = "no fixes that agree have come while the robot stood: let it stand for a moment"


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
    doubt = "3 fixes and more in a row contradict the wheels: let the robot stand for 8 s"
    assert walk.state().place is None and walk.state().reason == doubt
    walk.run(1.0, off=(4.0, 0.0, 0.0))
    assert walk.state().reason == doubt  # told once
    walk.run(3.0)
    assert walk.state().place is not None and walk.off_m() < 0.5


def test_it_begins_only_where_fixes_agree_and_moves_elsewhere_only_while_it_stands():
    walk = Walk()
    assert walk.state().reason == "no fix has come"
    for k in range(6):  # two robots with one tag: no two fixes in a row agree
        walk.run(STEP_S, 0.0, 0.0, fixes=False)
        walk.tracker.receive(walk.now_s, walk.fix((8.0 * k, 0.0, 0.0), 0.1))
    assert walk.state().place is None and walk.state().reason == NO_START
    walk.run(3.0, 0.0, 0.0)
    assert walk.off_m() < 0.5
    walk.true[:2] += 5.0  # carried away
    walk.run(6.0, 0.0, 0.0)
    assert walk.state().place is None
    walk.run(5.0, 0.0, 0.0)
    assert walk.off_m() < 0.5


def test_who_begins_while_the_robot_drives_is_told_steadily_to_let_it_stand():
    walk = Walk()
    walk.run(1.0)
    reasons = set()
    for _ in range(80):
        walk.run(STEP_S)
        reasons.add(walk.state().reason)
    assert reasons == {NO_START}
    walk.run(16.0, fixes=False)
    assert walk.state().reason == "no fix has come"
    walk.run(2.0, 0.0, 0.0)
    assert walk.state().reason == "" and walk.off_m() < 0.5


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"x_m": np.nan}, "not finite"),
        ({"yaw_rad": np.inf}, "not finite"),
        ({"covariance": np.full((3, 3), np.nan)}, "not finite"),
        ({"covariance": -C}, "covariance that is none"),
        ({"covariance": C[:2, :2]}, r"shape \(2, 2\)"),
        ({"stamp_s": 99.0}, "ahead of this computer's clock"),
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


@pytest.mark.parametrize("jump", [(2.0, 0.0, 0.0), (-0.9, 0.5, 0.0), (0.0, 0.0, 1.2)])
def test_a_jump_of_the_odometry_is_no_motion(jump):
    """A driver that started again: what was driven in that step is unknown, and a fix tells it."""
    walk = Walk()
    walk.run(4.0, 0.0, 0.0)
    walk.run(5.0)
    before = walk.state()
    walk.wheels += jump
    walk.run(STEP_S, fixes=False)
    state = walk.state()
    assert "wheel odometry jumped by" in state.last_refusal
    assert "has its driver started again?" in state.last_refusal
    assert walk.off_m() < 2 * state.place.sigma_m and walk.off_m() < 0.3
    # 5 m/s and 6 rad/s in 0.05 s
    assert state.place.sigma_m == pytest.approx(np.hypot(before.place.sigma_m, 0.25), abs=0.02)
    assert state.yaw_sigma_rad == pytest.approx(np.hypot(before.yaw_sigma_rad, 0.3), abs=0.02)
    walk.run(10.0)
    assert walk.state().place.sigma_m < 1.2 * before.place.sigma_m and walk.off_m() < 0.3


def test_of_a_robot_that_is_known_smaller_jumps_are_told(root):
    """4 m/s: no robot of 0.8 m/s has driven so far."""
    rescue = load_robot(root / "config/robots/rescue.yaml")
    a, b = WheelOdometry(1.0, 0.0, 0.0, 0.0), WheelOdometry(1.05, 0.2, 0.0, 0.0)
    for rules, jumped in ((WheelRules(), False), (WheelRules().of_robot(rescue), True)):
        reader = WheelReader(rules)
        reader.read(1.0, a)
        reader.read(1.05, b)
        assert bool(reader.jump) is jumped
    assert WheelRules(fastest_mps=0.5).of_robot(rescue).fastest_mps == 0.5


def test_a_driver_that_was_away_and_begins_at_0_says_nothing_of_the_way_between():
    """2 m in 3 s are no speed that tells of a jump."""
    walk = Walk()
    walk.run(3.0, 0.0, 0.0)
    walk.run(4.0, turning=0.0)
    walk.now_s += 3.0
    walk.wheels[:2] = 0.0
    walk.run(STEP_S, 0.0, 0.0, fixes=False)
    assert walk.state().place.sigma_m > 10.0 and walk.off_m() < 0.3
    walk.run(2.0, 0.0, 0.0)
    assert walk.state().place.sigma_m < 0.4 and walk.off_m() < 0.4


def test_what_a_jump_leaves_unknown_is_shared_by_its_parts():
    reader = WheelReader()
    a, b = WheelOdometry(1.0, 0.0, 0.0, 0.0), WheelOdometry(1.1, 9.0, 0.0, 0.0)
    assert reader.read(1.0, a) == a and reader.read(1.1, b).x_m == pytest.approx(0.0)
    middle = between(a, b, 1.03)
    parts = reader.unknown(0.5, middle.stamp_s) + reader.unknown(middle.stamp_s, 2.0)
    assert parts == pytest.approx(reader.unknown(1.0, 1.1))
    assert parts == pytest.approx([0.5 * 0.5**2, 0.5 * 0.5**2, 0.6**2])
    turned = reader.read(1.2, WheelOdometry(1.2, 9.0, 0.2, 0.1))
    assert (turned.x_m, turned.y_m, turned.yaw_rad) == pytest.approx((0.0, 0.2, 0.1))
    assert not reader.unknown(1.1, 1.2).any()


@pytest.mark.parametrize(
    "off_s, words", [(1000.0, "1000.0 s ahead"), (-60.0, "60.0 s behind"), (0.3, "0.3 s ahead")]
)
def test_wheels_stamped_by_another_clock_cost_nothing_but_themselves(off_s, words):
    walk = Walk()
    walk.run(4.0, 0.0, 0.0)
    tracker, now_s = walk.tracker, walk.now_s
    for _ in range(6):
        tracker.receive(now_s, WheelOdometry(now_s + off_s, *walk.wheels))
    before = walk.state()
    assert before.place.stamp_s == pytest.approx(now_s)
    assert words in before.last_refusal and "this computer's clock: set the" in before.last_refusal
    walk.run(3.0)
    assert walk.state().place is not None and walk.off_m() < 0.4
    later_s = walk.now_s + 1.5  # for so long all wheels are stamped so
    tracker.receive(later_s, WheelOdometry(later_s + off_s, *walk.wheels))
    assert tracker.step(later_s).place is None
    assert tracker.step(later_s).reason.startswith(f"wheel odometry is {words}")
    walk.run(STEP_S)
    assert walk.state().place is not None


def test_of_an_old_fix_the_clock_is_told():
    walk = Walk()
    walk.tracker.receive(100.0, PlaceFix(40.0, 1.0, 2.0, 0.0, C))
    assert "a fix is 60.0 s behind this computer's clock" in walk.tracker.step(100.0).last_refusal


def test_after_a_clock_that_was_set_back_it_begins_anew():
    walk = Walk()
    walk.now_s = 100.0
    walk.run(3.0, 0.0, 0.0)
    walk.now_s -= 60.0
    walk.run(STEP_S, 0.0, 0.0, fixes=False)
    assert walk.state().place is None
    walk.run(3.0, 0.0, 0.0)
    assert walk.state().place.stamp_s == pytest.approx(walk.now_s) and walk.off_m() < 0.4
