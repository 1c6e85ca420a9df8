# SPDX-License-Identifier: Apache-2.0
"""Trackers that freeze, run off, or leave the autopilot's estimate; and those that only shake."""

import numpy as np
import pytest

from fcsv_control.flight.pose_feed.feed_check import PoseCheck, PoseCheckRules
from fcsv_geometry import transforms

HZ = 30.0


class Air:
    """A vehicle that hovers or flies, its noisy tracker and the autopilot's view of it."""

    def __init__(self, seed=1):
        self.random = np.random.default_rng(seed)
        self.check = PoseCheck()
        self.now_s, self.p, self.v = 100.0, np.zeros(3), np.zeros(3)

    def run(self, seconds, acc=(0.0, 0.0), tracker=lambda p, since_s: p):
        """Fly with an acceleration; what ``tracker`` makes of the place is fed. When doubt came
        (s), or None."""
        begun_s = self.now_s
        while self.now_s < begun_s + seconds:
            self.now_s += 1.0 / HZ
            self.v[:2] += np.array(acc) / HZ
            self.p = self.p + self.v / HZ
            lean = [-np.arctan2(acc[1], 9.81), np.arctan2(acc[0], 9.81), 0.0]
            T, felt = (
                transforms.from_xyz_rpy(self.p, lean),
                self.v + self.random.normal(0.0, 0.03, 3),
            )
            self.check.estimate(self.now_s, T, felt)
            p = tracker(self.p, self.now_s - begun_s)
            noise_m, noise_rad = (
                self.random.normal(0.0, 0.0015, 3),
                np.radians(self.random.normal(0.0, 0.03, 3)),
            )
            T = transforms.from_xyz_rpy(p + noise_m, np.array(lean) + noise_rad)
            if p is FROZEN:
                T = np.eye(4)
            self.check.passes_in_flight(self.now_s, 1.7e9 + self.now_s, T)
            if self.check.doubt:
                return self.now_s - begun_s
        return None


FROZEN = np.zeros(3)


@pytest.mark.parametrize("seed", range(5))
def test_hovering_and_flying_raise_no_doubt(seed):
    air = Air(seed)
    assert air.run(20.0) is None
    for acc in ([3.0, 0.0], [-3.0, 0.0], [0.0, 2.0], [0.0, -2.0], [0.0, 0.0]):
        assert air.run(1.5, acc) is None, acc
    assert air.run(10.0) is None


def test_a_frozen_tracker_is_doubted_within_half_a_second():
    air = Air()
    air.run(3.0)
    assert air.run(3.0, tracker=lambda p, since_s: FROZEN) < 0.5
    assert "frozen" in air.check.doubt


@pytest.mark.parametrize("speed_mps", [0.5, 2.5, 4.0, 9.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_tracker_that_runs_off_is_doubted_within_a_second(speed_mps, seed):
    air = Air(seed)
    air.run(3.0)
    assert (
        air.run(3.0, tracker=lambda p, since_s: p + np.array([speed_mps * since_s, 0.0, 0.0])) < 1.0
    )


def test_a_tracker_that_leaves_the_autopilots_estimate_is_doubted():
    """The autopilot rejects a jump and flies on by its own."""
    air = Air()
    air.run(3.0)
    took_s = air.run(3.0, tracker=lambda p, since_s: p + np.array([0.0, 1.2, 0.0]))
    assert took_s is not None and took_s < 1.0


def test_doubt_stays_until_the_vehicle_is_disarmed():
    air = Air()
    air.run(3.0)
    air.run(1.0, tracker=lambda p, since_s: FROZEN)
    assert air.run(5.0) is not None, "come to itself again, but where is it?"
    air.check.begin_again()
    assert air.run(5.0) is None


def test_a_clock_that_is_set_raises_no_doubt():
    air = Air()
    air.v[0] = 2.0
    for k in range(90):
        T = transforms.from_xyz_rpy(
            [2.0 * k / HZ, 0.0, 3.0], np.radians(air.random.normal(0.0, 0.1, 3))
        )
        air.check.estimate(k / HZ, T, air.v)
        air.check.passes_in_flight(
            k / HZ, 1.7e9 + k / HZ + (0.4 if k > 40 else 0.0) - (2.0 if k > 70 else 0.0), T
        )
        assert air.check.doubt == ""


@pytest.mark.parametrize("name", ["frozen_s", "noise_m", "apart_m"])
def test_rules_out_of_range_are_refused(name):
    with pytest.raises(ValueError, match=name):
        PoseCheckRules(**{name: -1.0})


def test_a_tracker_that_comes_and_goes_is_doubted():
    air = Air()
    air.run(3.0)
    for _ in range(3):
        assert air.check.doubt == ""
        air.now_s += 0.7
        air.run(2.0)
    assert air.check.doubt == "the tracker comes and goes"


@pytest.mark.parametrize(
    "gap_s, sunk_m, tells", [(2.0, 1.0, True), (2.0, 0.1, False), (0.3, 1.0, False)]
)
def test_a_tracker_that_returns_elsewhere_is_told_as_a_reset(gap_s, sunk_m, tells):
    """It goes on from where it fell silent, and the vehicle sank meanwhile. Once: what follows is
    no reset."""
    air = Air()
    air.run(3.0)
    air.now_s += gap_s
    air.p = air.p - [0.0, 0.0, sunk_m]
    told = []
    for k in range(60):
        air.check.estimate(air.now_s, transforms.from_xyz_yaw(air.p, 0.0), np.zeros(3))
        T = transforms.from_xyz_yaw(air.p + [0.001 * (k % 2), 0.0, sunk_m], 0.001 * (k % 3))
        if air.check.passes_in_flight(air.now_s, 1.7e9 + air.now_s, T) and air.check.came_back:
            told.append(k)
        air.now_s += 1.0 / HZ
    assert told == ([0] if tells else [])


@pytest.mark.parametrize("ground_seen", [True, False])
def test_a_link_that_starts_in_flight_tells_a_reset_where_the_place_is_another(ground_seen):
    """Nobody fed while its process was gone, and the tracker drifts."""
    check = PoseCheck()
    if ground_seen:
        check.on_ground()
    check.estimate(50.0, transforms.from_xyz_yaw([0.0, 0.0, 8.0], 0.0), np.zeros(3))
    told = []
    for k in range(20):
        T = transforms.from_xyz_yaw([0.8 + 0.001 * (k % 2), 0.0, 8.0], 0.001 * (k % 3))
        told += (
            [k]
            if check.passes_in_flight(50.0 + k / HZ, 1.7e9 + k / HZ, T) and check.came_back
            else []
        )
    assert told == ([] if ground_seen else [0])


def test_a_link_that_just_started_holds_poses_back_until_it_knows_whether_it_flies():
    check = PoseCheck()
    assert check.waits(50.0, None) and check.waits(50.1, True)
    assert not check.waits(50.1, False)
    check.estimate(50.2, np.eye(4), np.zeros(3))
    assert check.waits(50.2, None) and not check.waits(50.2, True)
    assert not check.waits(51.6, None), "an autopilot that never says is fed all the same"


def test_time_on_the_ground_is_no_silence():
    air = Air()
    for _ in range(5):
        air.run(1.0)
        air.check.on_ground()
        air.now_s += 60.0
        air.p = air.p + [3.0, 0.0, 0.0]
    assert air.run(5.0) is None and not air.check.came_back
