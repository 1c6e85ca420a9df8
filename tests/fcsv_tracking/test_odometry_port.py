# SPDX-License-Identifier: Apache-2.0
"""The odometry's port: what goes on of the tracker's samples, and what must outlive the process."""

import math

import numpy as np
import pytest

from fcsv_geometry.home import OdomLink
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_tracking.odometry import EpochBegan, Rebase
from fcsv_tracking.odometry_port import BodySample, OdometryPort, TrackerSample

FRAMES = ("uav1/t265_odom_frame", "uav1/t265_pose_frame")
WALL_S = 1.7e9


class Tracker:
    """A port, and 200 samples a second of a tracker that stands at ``x_m``."""

    def __init__(self, **before):
        self.port = OdometryPort("uav1", np.eye(4), T265_PROFILE, 30.0, **before)
        self.now_s, self.x_m, self.set_s = 50.0, 0.0, 0.0  # set_s: by what its clock was set
        self.first = self.port.step(self.now_s)

    def sample(self, frames=FRAMES):
        p_m, still = (self.x_m, 0.0, 0.0), (0.0, 0.0, 0.0)
        stamp_s = WALL_S + self.now_s + self.set_s
        self.port.receive(
            self.now_s,
            TrackerSample(frames, stamp_s, p_m, (0.0, 0.0, 0.0, 1.0), still, still, (0.1,)),
        )
        return list(self.port.step(self.now_s))

    def run(self, seconds):
        out = []
        for _ in range(int(round(200 * seconds))):
            self.now_s += 0.005
            out += self.sample()
        return out


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


@pytest.fixture
def tracker():
    return Tracker()


def test_all_samples_are_given_and_thirty_a_second_go_on(tracker):
    samples = of(tracker.run(2.0), BodySample)
    assert len(samples) == 400 and sum(s.goes_on for s in samples) == pytest.approx(60, abs=1)
    assert samples[-1].covariance == (0.1,) and samples[-1].pose.stamp_s == WALL_S + tracker.now_s


@pytest.mark.parametrize("set_s", [-60.0, -2.0, -0.9, -0.4, -0.1, 0.4, 60.0])
def test_a_clock_that_is_set_holds_no_pose_back(tracker, set_s):
    """Samples that are older than the last by up to 0.1 s may have changed places, and are no
    step."""
    tracker.run(1.0)
    tracker.set_s = set_s
    held_s = 0.1 if set_s == -0.1 else 0.0
    went_on = sum(s.goes_on for s in of(tracker.run(0.5), BodySample))
    assert went_on == pytest.approx(30 * (0.5 - held_s), abs=1.5)


def test_its_epoch_is_told_once_at_the_start_and_before_the_first_pose_after_a_gap(tracker):
    assert tracker.first == [tm.OdometryEpoch("uav1", "", 0, "start")]
    assert not of(tracker.run(1.0), tm.OdometryEpoch)
    tracker.now_s += 2.0
    out = tracker.sample()
    assert [type(o) for o in out] == [tm.OdometryEpoch, BodySample]
    assert (out[0].number, out[0].reason) == (1, "the tracker was silent for 2.0 s")


def test_what_was_before_a_restart_is_gone_on_with():
    tracker = Tracker(
        rebase=Rebase(0.0, (3.0, 0.0, 0.0)), epoch=EpochBegan(7, "the odometry was started")
    )
    assert tracker.first[0].number == 7
    assert of(tracker.run(0.1), BodySample)[-1].pose.p_odom_body == pytest.approx((3.0, 0.0, 0.0))


def test_a_jump_is_undone_and_its_rebase_must_be_kept(tracker, caplog):
    tracker.run(1.0)
    tracker.x_m = 5.0
    out = tracker.run(0.1)
    assert of(out, BodySample)[-1].pose.p_odom_body == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    [rebase] = of(out, Rebase)
    assert (
        rebase.p_m == pytest.approx((-5.0, 0.0, 0.0), abs=1e-6)
        and "odometry jumped (number 1" in caplog.text
    )


def test_samples_of_another_tracker_are_dropped_and_counted(tracker):
    tracker.run(0.1)
    [dropped] = tracker.sample(("uav2/t265_odom_frame", "uav2/t265_pose_frame"))
    assert isinstance(dropped, tm.Dropped) and "expected ('uav1/t265_odom_frame'" in dropped.why
    health = tracker.port.health(tracker.now_s, 0.3)
    assert health.error == "" and health.warning == "odometry samples were rejected"
    assert (
        dict(health.values)["rejected: frames"] == 1
        and dict(health.values)["samples in the last period"] == 21
    )


def test_its_health_tells_silence_and_a_jump_until_the_next_calibration(tracker):
    assert "no odometry" in tracker.port.health(tracker.now_s, 0.3).error
    tracker.run(0.5)
    assert tracker.port.health(tracker.now_s, 0.3).error == ""
    tracker.x_m = 5.0
    tracker.run(0.1)
    for link, error in (("uav9", "odometry jumped: calibrate again"), ("uav1", "")):
        found = tm.CalibrationFound(
            WALL_S + tracker.now_s, [OdomLink("uav2", link, np.eye(4), np.zeros((4, 4)))]
        )
        tracker.port.receive(tracker.now_s, found)
        assert tracker.port.health(tracker.now_s, 0.3).error == error
    assert "no odometry" in tracker.port.health(tracker.now_s + 1.0, 0.3).error
    assert math.isfinite(dict(tracker.port.health(tracker.now_s, 0.3).values)["jumps"])


def test_what_it_does_not_know_is_refused(tracker):
    with pytest.raises(TypeError, match="an odometry takes no MissionPhase"):
        tracker.port.receive(0.0, tm.MissionPhase("LAND"))
