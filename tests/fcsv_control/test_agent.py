# SPDX-License-Identifier: Apache-2.0
"""The agent's judgement without ROS: numbered commands, the target that is held, a control PC that
falls silent."""

import numpy as np
import pytest

from fcsv_control.agent.commands import Answer, CommandLog, CommandVerdict
from fcsv_control.agent.holder import Holder, Limits
from fcsv_control.errors import CommandRefused
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

FRAME = "uav1/odom"


def at(x, y, z, yaw=0.0):
    return transforms.from_xyz_yaw([x, y, z], yaw)


# ---- commands ------------------------------------------------------------------------------------


@pytest.fixture
def log():
    return CommandLog("uav1")


def test_a_command_is_executed_once_and_its_answer_repeated(log):
    assert log.decide(10.0, "uav1", "mission", 1, True, 15.0) == (CommandVerdict.EXECUTE, None)
    assert log.decide(10.3, "uav1", "mission", 1, True, 15.0) == (CommandVerdict.WAIT, None)
    log.answered("mission", 1, Answer(0, ""))
    assert log.decide(10.6, "uav1", "mission", 1, True, 15.0) == (
        CommandVerdict.REPEAT,
        Answer(0, ""),
    )
    # done in time: not expired
    assert log.decide(99.0, "uav1", "mission", 1, True, 15.0) == (
        CommandVerdict.REPEAT,
        Answer(0, ""),
    )


def test_another_vehicles_command_is_ignored_and_another_senders_is_another(log):
    assert log.decide(10.0, "uav2", "mission", 1, True, 15.0)[0] == CommandVerdict.IGNORE
    assert log.decide(10.0, "uav1", "mission", 1, True, 15.0)[0] == CommandVerdict.EXECUTE
    assert log.decide(10.0, "uav1", "mission-restarted", 1, True, 15.0)[0] == CommandVerdict.EXECUTE


def test_a_late_command_is_never_executed(log):
    assert log.decide(15.1, "uav1", "mission", 1, True, 15.0)[0] == CommandVerdict.EXPIRED
    log.answered("mission", 1, Answer(2, "late"))
    assert log.decide(15.2, "uav1", "mission", 1, True, 15.0)[0] == CommandVerdict.REPEAT


def test_a_move_that_a_newer_one_overtook_is_not_made(log):
    """Number 1 was lost, number 2 arrived, then the repetition of number 1."""
    assert log.decide(10.0, "uav1", "mission", 2, True, 15.0)[0] == CommandVerdict.EXECUTE
    assert log.decide(10.1, "uav1", "mission", 1, True, 15.0)[0] == CommandVerdict.EXPIRED
    assert log.decide(10.1, "uav1", "mission", 3, True, 15.0)[0] == CommandVerdict.EXECUTE


@pytest.mark.parametrize("clock_s", [21.0, 3600.0])
def test_a_command_to_stop_is_never_late_by_the_clock(log, clock_s):
    """The control PC's clock is seconds behind: it used to be answered with "expired"."""
    assert (
        log.decide(clock_s, "uav1", "mission", 1, True, 15.0, stops=True)[0]
        is CommandVerdict.EXECUTE
    )
    assert log.decide(clock_s, "uav1", "mission", 2, True, 15.0)[0] is CommandVerdict.EXPIRED


def test_recording_is_not_overtaken_by_moves(log):
    assert log.decide(10.0, "uav1", "mission", 5, True, 15.0)[0] == CommandVerdict.EXECUTE
    assert log.decide(10.1, "uav1", "mission", 4, False, 15.0)[0] == CommandVerdict.EXECUTE
    assert log.decide(10.2, "uav1", "mission", 6, False, 15.0)[0] == CommandVerdict.EXECUTE


def test_the_memory_is_bounded(log):
    for number in range(1, 1000):
        log.decide(10.0, "uav1", "mission", number, True, 15.0)
    assert len(log._answers) == 200


# ---- the target ----------------------------------------------------------------------------------


def holder(*, mode=Mode.GUIDED, here=None, **limits):
    h = Holder(FRAME, Limits(**limits))
    h.pose(0.0, at(1.0, 2.0, 3.0, 0.5) if here is None else here)
    h.state(mode, True)
    return h


def test_entering_guided_means_holding_here():
    h = holder(mode=Mode.LOITER)
    assert h.target is None
    h.state(Mode.GUIDED, True)
    assert np.allclose(h.target, at(1.0, 2.0, 3.0, 0.5))
    h.state(Mode.LAND, True)
    assert h.target is None
    h.pose(0.1, at(1.0, 2.0, 2.9, 0.5))
    h.state(Mode.GUIDED, True)  # the pilot gives it back: not to the old place
    assert np.allclose(h.target, at(1.0, 2.0, 2.9, 0.5))


def test_what_is_held_is_level():
    h = holder(here=transforms.from_xyz_rpy([1.0, 2.0, 3.0], [0.2, -0.1, 0.5]))
    assert np.allclose(h.target, at(1.0, 2.0, 3.0, 0.5))


def test_a_restart_in_flight_holds_as_soon_as_the_place_is_known():
    h = Holder(FRAME, Limits())
    h.state(Mode.GUIDED, True)
    assert h.target is None
    with pytest.raises(CommandRefused, match="does not know where it is"):
        h.hold()
    h.pose(0.0, at(5.0, 0.0, 4.0))
    assert np.allclose(h.target, at(5.0, 0.0, 4.0))


def test_going_and_holding():
    h = holder()
    h.go_to(at(4.0, 2.0, 3.0), FRAME)
    assert np.allclose(h.target, at(4.0, 2.0, 3.0))
    h.pose(0.1, at(2.0, 2.0, 3.0))
    h.hold()
    assert np.allclose(h.target, at(2.0, 2.0, 3.0))


def test_a_target_that_may_not_be_flown_to_is_refused_and_the_old_one_stays():
    h = holder()
    before = h.target
    with pytest.raises(CommandRefused, match="frame 'uav2/odom'"):
        h.go_to(at(1.0, 2.0, 3.0), "uav2/odom")
    with pytest.raises(CommandRefused, match="100.0 m away, at most 60 m"):
        h.go_to(at(101.0, 2.0, 3.0), FRAME)
    assert np.allclose(h.target, before)
    h.state(Mode.LOITER, True)
    with pytest.raises(CommandRefused, match="in LOITER, not in GUIDED"):
        h.go_to(at(1.0, 2.0, 3.0), FRAME)


@pytest.mark.parametrize("height_m", [-47.0, 0.0, 0.4, 41.0])
def test_a_target_underground_or_too_high_is_refused(height_m):
    """Heights count from where the vehicle stood disarmed, wherever its odometry has its zero."""
    h = Holder(FRAME, Limits())
    h.state(Mode.STABILIZE, False)
    h.pose(0.0, at(0.0, 0.0, 50.0))
    h.state(Mode.GUIDED, True)
    h.pose(1.0, at(0.0, 0.0, 53.0))
    with pytest.raises(CommandRefused, match="above the take-off place; 0.5 to 40 m are allowed"):
        h.go_to(at(1.0, 0.0, 50.0 + height_m), FRAME)
    h.go_to(at(1.0, 0.0, 51.0), FRAME)


def test_the_ground_moves_along_with_a_jump_of_the_estimate():
    h = Holder(FRAME, Limits())
    h.state(Mode.STABILIZE, False)
    h.pose(0.0, at(0.0, 0.0, 0.0))
    h.state(Mode.GUIDED, True)
    h.pose(1.0, at(0.0, 0.0, 3.0))
    h.pose(1.03, at(0.0, 0.0, 33.0))
    h.go_to(at(1.0, 0.0, 35.0), FRAME)
    with pytest.raises(CommandRefused, match="-27.0 m above"):
        h.go_to(at(1.0, 0.0, 3.0), FRAME)


def test_nothing_is_streamed_during_a_take_off_and_the_place_above_is_held_thereafter():
    h = holder(here=at(0.0, 0.0, 0.0))
    h.take_off(0.0, 3.0)
    assert h.target is None
    with pytest.raises(CommandRefused, match="still taking off"):
        h.go_to(at(1.0, 0.0, 3.0), FRAME)
    for i in range(1, 30):
        h.pose(0.1 * i, at(0.05, 0.0, 0.1 * i))
    assert np.allclose(h.target, at(0.0, 0.0, 3.0))  # above where it stood, not where it drifted to
    h.go_to(at(1.0, 0.0, 3.0), FRAME)


def test_a_take_off_that_does_not_end_becomes_a_hold():
    h = holder(here=at(0.0, 0.0, 0.0))
    h.take_off(0.0, 3.0)
    h.pose(29.0, at(0.0, 0.0, 1.0))
    assert h.target is None
    h.pose(31.0, at(0.0, 0.0, 1.1))
    assert np.allclose(h.target, at(0.0, 0.0, 1.1))


@pytest.mark.parametrize("altitude_m", [0.0, -1.0, 31.0, float("nan"), 2.9])
def test_take_off_to_nowhere_is_refused(altitude_m):
    with pytest.raises(CommandRefused, match="take-off to"):
        holder().take_off(0.0, altitude_m)


def test_a_jump_of_the_estimate_takes_the_target_along():
    """The odometry frame was begun anew 30 m higher (thesis 6.8): flying the difference would be a
    crash."""
    h = holder()
    h.go_to(at(4.0, 2.0, 3.0), FRAME)
    assert h.pose(0.03, at(1.0, 2.0, 33.0, 0.5)) == pytest.approx(30.0)
    assert np.allclose(h.target, at(4.0, 2.0, 33.0))


def test_flying_fast_is_no_jump_and_a_gap_hides_none():
    h = holder()
    h.hold()
    for i in range(1, 60):  # 8 m/s at 30 Hz
        assert h.pose(i / 30.0, at(1.0 + 8.0 * i / 30.0, 2.0, 3.0)) == 0.0
    # after eight seconds of silence it may be anywhere
    assert h.pose(10.0, at(60.0, 2.0, 3.0)) == 0.0


@pytest.mark.parametrize("name", ["furthest_target_m", "highest_takeoff_m", "reset_step_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        Limits(**{name: value})


# ---- a silent control PC -------------------------------------------------------------------------
