# SPDX-License-Identifier: Apache-2.0
"""The agent's core by hand: what it asks of the flight link, in which order, and what it
answers."""

import numpy as np
import pytest

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.duplicate_agents import DuplicateAgentGuard
from fcsv_control.agent.messages import (
    BY_HAND,
    DONE,
    REFUSED,
    TOO_LATE,
    Ack,
    Ask,
    Instruction,
    Kind,
    SetPoint,
)
from fcsv_control.agent.sender_clocks import SenderClocks
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

STEP_S = 0.02
SENDER_S = -6e4  # the sender's monotonic clock has another zero


class Board:
    """An agent on board, its time, and what it put out."""

    def __init__(self, duplicates=None, guardian=False, **rules):
        self.core = AgentCore(
            "uav1",
            AgentRules(guardian=guardian, **rules),
            duplicates or DuplicateAgentGuard("agent-1", -np.inf),
        )
        self.now_s, self.number = 100.0, 0
        self.core.state(self.now_s, Mode.STABILIZE, False)
        self.core.pose(self.now_s, np.eye(4))
        self.core.state(self.now_s, Mode.GUIDED, True)
        self.core.pose(self.now_s + 1.0, transforms.from_xyz_yaw([0.0, 0.0, 3.0], 0.0))

    def order(self, kind, sender="mission", lifetime_s=5.0, **fields):
        """A new order, as it is sent now."""
        self.number += 1
        now_s = SENDER_S + self.now_s
        return Instruction("uav1", sender, self.number, kind, now_s, now_s, lifetime_s, **fields)

    def tell(self, kind, **fields):
        """A new command; its number."""
        self.core.receive(self.now_s, self.order(kind, **fields))
        return self.number

    def answer(self, kind, **fields):
        """(result, reason) of a new command's acknowledgement; None where none came."""
        number = self.tell(kind, **fields)
        return next(((a.result, a.reason) for a in of(self.run(), Ack) if a.number == number), None)

    def run(self, seconds=STEP_S):
        out = []
        for _ in range(int(round(seconds / STEP_S))):
            self.core.step(self.now_s)
            out += self.core.outgoing()
            self.now_s += STEP_S
        return out


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


def test_land_is_asked_for_at_once_while_guided_is_not_answered():
    board = Board()
    guided = board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    [first] = of(board.run(), Ask)
    arm = board.tell(Kind.ARM, flag=True)
    assert not of(board.run(1.0), Ask), "one job at a time"
    land = board.tell(Kind.LAND)
    out = board.run()
    [stop] = of(out, Ask)
    assert (stop.kind, stop.mode) == (Kind.SET_MODE, Mode.LAND)
    assert [(a.number, a.result) for a in of(out, Ack)] == [(arm, REFUSED)]
    board.core.finished(stop, "")
    board.core.finished(first, "mode GUIDED was overtaken by a newer command")
    assert [(a.number, a.result) for a in of(board.run(), Ack)] == [(land, DONE), (guided, REFUSED)]


def test_hold_is_done_at_once_while_a_job_runs():
    board = Board()
    board.tell(Kind.ARM, flag=True)
    board.run()
    hold = board.tell(Kind.HOLD)
    assert [(a.number, a.result) for a in of(board.run(), Ack)] == [(hold, DONE)]


def test_a_command_that_waited_too_long_is_not_done():
    board = Board()
    board.tell(Kind.ARM, flag=True)
    [ask] = of(board.run(), Ask)
    late = board.tell(Kind.SET_MODE, mode=Mode.GUIDED, lifetime_s=0.5)
    board.run(1.0)
    board.core.finished(ask, "")
    assert (late, TOO_LATE) in [(a.number, a.result) for a in of(board.run(), Ack)]


@pytest.mark.parametrize(
    "mode", [Mode("ACRO"), Mode("FLIP"), Mode.LOITER, Mode.STABILIZE, Mode("HOVER"), Mode.UNHEARD]
)
def test_modes_of_pilots_are_refused(mode):
    board = Board()
    board.tell(Kind.SET_MODE, mode=mode)
    out = board.run()
    assert not of(out, Ask) and "is for pilots" in of(out, Ack)[0].reason
    board = Board(maintenance=True)
    board.tell(Kind.SET_MODE, mode=mode)
    assert of(board.run(), Ask)


def test_a_take_off_waits_a_moment_and_streams_nothing():
    board = Board()
    board.run(1.0)
    board.tell(Kind.TAKEOFF, altitude_m=5.0)
    assert not of(board.run(0.1), Ask)
    board.core.pose(board.now_s, transforms.from_xyz_yaw([0.0, 0.0, 3.5], 0.0))
    out = board.run(1.0)
    [ask] = of(out, Ask)
    assert ask.altitude_m == 5.0 and not of(out, SetPoint)
    board.core.finished(ask, "take-off refused")
    assert of(board.run(1.0), Ack)[0].result == REFUSED


def test_set_points_come_at_their_rate_for_ever():
    board = Board()
    points = of(board.run(10.0), SetPoint)
    assert len(points) == pytest.approx(100, abs=2)
    assert np.allclose(points[-1].T_odom_body[:3, 3], 0.0), "where it was when GUIDED began"


def test_while_the_guardian_holds_the_agent_is_quiet_and_then_holds_where_it_is():
    board = Board()
    board.core.guarded(board.now_s, "hold", True, "uav2 comes down", ())
    out = board.run(3.0)
    assert not of(out, SetPoint)
    board.tell(Kind.GOTO, target=transforms.from_xyz_yaw([9.0, 0.0, 3.0], 0.0), frame="uav1/odom")
    assert "the guardian flies: uav2 comes down" in of(board.run(0.5), Ack)[0].reason
    board.core.pose(board.now_s, transforms.from_xyz_yaw([4.0, 0.0, 3.0], 0.0))
    board.core.guarded(board.now_s, "", False, "", ())
    assert np.allclose(of(board.run(0.5), SetPoint)[-1].T_odom_body[:3, 3], [4.0, 0.0, 3.0])


def test_who_is_moved_aside_is_not_stopped_on_the_way():
    board = Board()
    board.core.guarded(board.now_s, "aside", True, "uav2 comes down", ())
    assert "moves it aside: uav2 comes down" in board.answer(Kind.SET_MODE, mode=Mode.BRAKE)[1]
    assert "moves it aside" in board.answer(Kind.LAND)[1], "beneath the other"
    board.core.guarded(board.now_s, "", False, "", ())
    board.tell(Kind.SET_MODE, mode=Mode.BRAKE)
    assert of(board.run(0.5), Ask)


def test_what_the_guardian_forbids_is_not_handed_over():
    board = Board()
    board.core.guarded(board.now_s, "", False, "", ("the throttle stick is not in the middle",))
    for kind, fields in ((Kind.SET_MODE, {"mode": Mode.GUIDED}), (Kind.ARM, {"flag": True})):
        board.tell(kind, **fields)
        out = board.run(0.5)
        assert "throttle" in of(out, Ack)[0].reason and not of(out, Ask)
    board.tell(Kind.LAND)
    assert of(board.run(0.5), Ask), "stopping is never forbidden"


def test_without_a_living_guardian_nothing_is_handed_over():
    board = Board(guardian=True)
    for kind, fields in ((Kind.SET_MODE, {"mode": Mode.GUIDED}), (Kind.ARM, {"flag": True})):
        assert "its guardian is not heard" in board.answer(kind, **fields)[1]
    board.tell(Kind.LAND)
    assert of(board.run(0.5), Ask), "stopping needs none"
    board.core.guarded(board.now_s, "", False, "", ())
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    assert of(board.run(0.5), Ask)
    board.run(3.0)
    assert "its guardian is not heard" in board.answer(Kind.ARM, flag=True)[1]


def test_a_landing_of_the_guardians_is_no_pilots():
    board = Board()
    board.core.guarded(board.now_s, "LAND", False, "", ())
    board.core.state(board.now_s, Mode.LAND, True)
    board.tell(Kind.LAND)
    assert of(board.run(0.5), Ask)


# ---- stopping ------------------------------------------------------------------------------------


def test_brake_of_anybody_holds_at_once_and_asks_for_the_mode():
    board = Board()
    board.tell(Kind.GOTO, target=transforms.from_xyz_yaw([9.0, 0.0, 3.0], 0.0), frame="uav1/odom")
    board.run(1.0)
    board.core.pose(board.now_s, transforms.from_xyz_yaw([2.0, 0.0, 3.0], 0.0))
    board.core.receive(board.now_s, board.order(Kind.SET_MODE, sender="stop_all", mode=Mode.BRAKE))
    out = board.core.outgoing()
    [point], [ask] = of(out, SetPoint), of(out, Ask)
    assert ask.mode == Mode.BRAKE and np.allclose(point.T_odom_body[:3, 3], [2.0, 0.0, 3.0])


@pytest.mark.parametrize(
    "kind, fields", [(Kind.SET_MODE, {"mode": Mode.GUIDED}), (Kind.ARM, {"flag": True})]
)
def test_what_was_ordered_before_a_stop_of_somebody_else_is_not_done_after_it(kind, fields):
    """It was on its way while the stop overtook it on the radio; what is ordered after it is
    done."""
    board = Board()
    before = board.order(kind, **fields)
    board.run(1.0)
    board.core.receive(board.now_s, board.order(Kind.SET_MODE, sender="stop_all", mode=Mode.BRAKE))
    board.run(0.1)
    board.core.receive(board.now_s, before)
    out = board.run()
    [ack] = of(out, Ack)
    assert ack.result == REFUSED and "was stopped by stop_all" in ack.reason and not of(out, Ask)
    board.run(1.0)
    board.tell(kind, **fields)
    assert of(board.run(), Ask)


def test_what_was_ordered_before_a_pilot_took_over_is_not_done_after_it():
    """The radio held it up; what is ordered once he gives it back is done."""
    board = Board()
    board.core.sender_lives(board.now_s, "mission", SENDER_S + board.now_s)
    before = board.order(Kind.SET_MODE, mode=Mode.GUIDED)
    board.run(0.5)
    board.core.state(board.now_s, Mode.LOITER, True)
    board.run(0.5)
    board.core.receive(board.now_s, before)
    out = board.run()
    [ack] = of(out, Ack)
    assert ack.result == REFUSED and "LOITER was chosen on it after" in ack.reason
    assert not of(out, Ask)
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    assert of(board.run(), Ask)


@pytest.mark.parametrize("mode", [Mode.STABILIZE, Mode.ALT_HOLD, Mode.RTL])
def test_nobody_is_handed_over_in_a_mode_that_does_not_give_back(mode):
    board = Board()
    board.core.state(board.now_s, mode, True)
    board.run(2.0)
    result, reason = board.answer(Kind.SET_MODE, mode=Mode.GUIDED)
    assert result == REFUSED and f"flown by hand ({mode}); its pilot gives it back" in reason


def test_hold_is_where_it_comes_to_rest_and_not_behind_it():
    board = Board()
    board.run(2.0)
    for k in range(5):  # at 2 m/s
        board.core.pose(board.now_s, transforms.from_xyz_yaw([0.2 * k, 0.0, 3.0], 0.0))
        board.run(0.1)
    assert board.answer(Kind.HOLD) == (DONE, "")
    (held,) = {tuple(np.round(s.T_odom_body[:3, 3], 6)) for s in of(board.run(1.0), SetPoint)}
    assert held == pytest.approx((0.8 + 2.0**2 / (2 * 2.5), 0.0, 3.0))
    # the estimate jumps: no way to there
    board.core.pose(board.now_s, transforms.from_xyz_yaw([9.8, 0.0, 3.0], 0.0))
    assert board.answer(Kind.HOLD) == (DONE, "")
    assert {tuple(s.T_odom_body[:3, 3]) for s in of(board.run(1.0), SetPoint)} == {(9.8, 0.0, 3.0)}


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.ALT_HOLD, Mode.BRAKE, Mode.LAND, Mode.RTL])
@pytest.mark.parametrize(
    "stop", [(Kind.LAND, {}), (Kind.SET_MODE, {"mode": Mode.BRAKE}), (Kind.HOLD, {})]
)
def test_a_vehicle_that_is_flown_by_hand_is_stopped_by_nobody(mode, stop):
    board = Board()
    board.core.state(board.now_s, mode, True)
    number = board.tell(stop[0], sender="stop_all", **stop[1])
    out = board.run(1.0)
    [ack] = of(out, Ack)
    assert (ack.number, ack.result) == (number, BY_HAND) and not of(out, Ask) + of(out, SetPoint)
    assert f"uav1 is flown by hand ({mode}); tell its pilot" in ack.reason


def test_a_mode_that_was_asked_for_on_board_is_not_a_pilots():
    board = Board()
    board.tell(Kind.SET_MODE, sender="stop_all", mode=Mode.BRAKE)
    board.core.state(board.now_s, Mode.BRAKE, True)
    board.run()
    board.tell(Kind.LAND, sender="stop_all")
    assert [a.mode for a in of(board.run(), Ask)] == ["LAND"]
    board.core.state(board.now_s, Mode.LOITER, True)  # the pilot, after all
    board.core.state(board.now_s, Mode.BRAKE, True)
    assert "flown by hand" in board.answer(Kind.LAND)[1]


def test_a_refused_mode_that_a_pilot_chooses_later_is_his():
    board = Board()
    board.tell(Kind.SET_MODE, mode=Mode.BRAKE)
    [ask] = of(board.run(), Ask)
    board.core.finished(ask, "mode BRAKE refused: requires position")
    board.core.state(board.now_s, Mode.BRAKE, True)
    assert "flown by hand" in board.answer(Kind.LAND)[1]


# ---- one commander -------------------------------------------------------------------------------

AHEAD = {"target": transforms.from_xyz_yaw([1.0, 0.0, 3.0], 0.0), "frame": "uav1/odom"}


def test_a_second_commander_is_refused_and_told_who_commands():
    board = Board()
    assert board.answer(Kind.GOTO, sender="mission-123", **AHEAD) == (DONE, "")
    result, reason = board.answer(Kind.GOTO, sender="mission-124", **AHEAD)
    assert result == REFUSED and "uav1 is commanded by mission-123" in reason
    assert board.answer(Kind.HOLD, sender="mission-124") == (DONE, "")
    assert board.answer(Kind.RECORD, sender="mission-124", flag=True) == (DONE, "")
    for mode in (Mode.BRAKE, Mode.LAND):
        board.tell(Kind.SET_MODE, sender="mission-124", mode=mode)
        assert [a.mode for a in of(board.run(), Ask)] == [mode]


def test_the_lease_lasts_as_long_as_its_holder_is_heard():
    board = Board()
    assert board.answer(Kind.GOTO, sender="mission-123", **AHEAD) == (DONE, "")
    for _ in range(50):
        board.run(0.2)
        board.core.sender_lives(board.now_s, "mission-123", SENDER_S + board.now_s)
    assert board.answer(Kind.GOTO, sender="mission-124", **AHEAD)[0] == REFUSED
    # it is not the holder
    board.core.sender_lives(board.now_s, "mission-124", SENDER_S + board.now_s)
    board.run(1.9)
    assert board.answer(Kind.GOTO, sender="mission-124", **AHEAD)[0] == REFUSED
    board.run(0.2)
    assert board.answer(Kind.GOTO, sender="mission-124", **AHEAD) == (DONE, "")
    assert "mission-124" in board.answer(Kind.GOTO, sender="mission-123", **AHEAD)[1]


def test_what_comes_without_a_name_does_not_renew_the_lease_of_a_mission_that_is_dead():
    """A message without a sender kept the lease of the mission before."""
    board = Board()
    assert board.answer(Kind.GOTO, sender="mission-123", **AHEAD) == (DONE, "")
    for _ in range(12):
        board.run(0.2)
        board.core.sender_lives(board.now_s, "", SENDER_S + board.now_s)
    assert board.answer(Kind.GOTO, sender="mission-124", **AHEAD) == (DONE, "")


def test_of_two_agents_the_younger_does_nothing_until_the_older_is_gone():
    board = Board(duplicates=DuplicateAgentGuard("agent-2", 100.0))
    board.core.duplicates.agent_lives(100.2, "agent-1", 60.0)
    assert board.answer(Kind.GOTO, **AHEAD) is None, "the older one answers"
    board.core.duplicates.agent_lives(board.now_s, "agent-1", 60.0)
    board.tell(Kind.LAND)
    assert not board.run(0.9)
    board.run(0.5)
    assert board.answer(Kind.GOTO, **AHEAD) == (DONE, "")
    assert of(board.run(0.5), SetPoint)


def test_an_agent_that_was_just_started_listens_first_but_stops_at_once():
    board = Board(duplicates=DuplicateAgentGuard("agent-2", 100.0))
    assert board.answer(Kind.GOTO, **AHEAD) is None
    board.tell(Kind.LAND)
    out = board.run()
    assert [a.mode for a in of(out, Ask)] == ["LAND"]
    assert not of(board.run(0.5), SetPoint)


def test_of_two_agents_that_were_started_together_one_acts():
    acting = []
    for mine, other in (("agent-1", "agent-2"), ("agent-2", "agent-1")):
        duplicates = DuplicateAgentGuard(mine, 50.0)
        duplicates.agent_lives(60.0, other, 10.1)
        duplicates.agent_lives(60.0, mine, 10.0)  # itself
        acting.append(not duplicates.older(60.1))
    assert sorted(acting) == [False, True]


# ---- time ----------------------------------------------------------------------------------------


def test_a_way_point_that_the_radio_held_up_is_not_flown_to():
    """Its sender was heard before, so that it is known how late it comes, whatever anybody's clock
    says."""
    board = Board()
    board.core.sender_lives(board.now_s, "mission", SENDER_S + board.now_s)
    late = board.order(Kind.GOTO, lifetime_s=2.0, **AHEAD)
    board.run(2.5)
    board.core.receive(board.now_s, late)
    assert [a.result for a in of(board.run(), Ack)] == [TOO_LATE]


def test_repetitions_of_an_old_order_are_not_flown_to_although_they_come_at_once():
    """The first copies were lost: the sixth is fresh, the order is not."""
    board = Board()
    order = board.order(Kind.GOTO, lifetime_s=2.0, **AHEAD)
    board.run(2.5)
    copy = Instruction(**{**vars(order), "sent_s": SENDER_S + board.now_s})
    board.core.receive(board.now_s, copy)
    assert [a.result for a in of(board.run(), Ack)] == [TOO_LATE]


def test_a_stop_is_obeyed_however_late_it_comes():
    board = Board()
    board.core.sender_lives(board.now_s, "stop_all", SENDER_S + board.now_s)
    late = board.order(Kind.SET_MODE, sender="stop_all", lifetime_s=2.0, mode=Mode.BRAKE)
    board.run(60.0)
    board.core.receive(board.now_s, late)
    assert [a.mode for a in of(board.run(), Ask)] == [Mode.BRAKE]


def test_a_sender_whose_clock_has_another_rate_is_followed():
    clocks, rate = SenderClocks(), 1.0 + 200e-6  # more than quartzes differ by
    late_s = [
        k * 0.2 - clocks.sent_here_s(k * 0.2, "mission", k * 0.2 * rate) for k in range(18_000)
    ]
    assert max(map(abs, late_s)) < 10.0 * 200e-6 + 1e-9  # what it gains in the window of 10 s


# ---- the odometry's epoch ------------------------------------------------------------------------


def test_an_odometry_that_began_anew_holds_and_refuses_guided_until_it_is_calibrated():
    board = Board()
    board.core.epoch(7, "start")
    board.core.rights.frame.calibrated(7)
    assert board.answer(Kind.GOTO, **AHEAD) == (DONE, "")
    board.core.pose(board.now_s, transforms.from_xyz_yaw([0.5, 0.0, 3.0], 0.0))
    board.core.epoch(8, "the tracker was silent for 0.7 s")
    [point] = of(board.core.outgoing(), SetPoint)
    assert np.allclose(point.T_odom_body[:3, 3], [0.5, 0.0, 3.0])
    result, reason = board.answer(Kind.SET_MODE, mode=Mode.GUIDED)
    assert (
        result == REFUSED
        and "uav1: its odometry began anew" in reason
        and "silent for 0.7 s" in reason
    )
    board.core.rights.frame.calibrated(8)
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    assert of(board.run(), Ask)
