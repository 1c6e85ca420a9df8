# SPDX-License-Identifier: Apache-2.0
"""The agent's core by hand: what it asks of the flight link, in which order, and what it answers."""

import numpy as np
import pytest

from fcsv_control.agent.core import (
    DONE,
    REFUSED,
    TOO_LATE,
    Ack,
    AgentCore,
    AgentRules,
    Ask,
    Instruction,
    Kind,
    SetPoint,
)
from fcsv_geometry import transforms

STEP_S = 0.02
WALL_S = 1.7e9  # the wall clock is far from monotonic time


class Board:
    """An agent on board, its time, and what it put out."""

    def __init__(self, **rules):
        self.core = AgentCore("uav1", AgentRules(**rules))
        self.now_s, self.number = 100.0, 0
        self.core.state("STABILIZE", False)
        self.core.pose(self.now_s, np.eye(4))
        self.core.state("GUIDED", True)
        self.core.pose(self.now_s + 1.0, transforms.from_xyz_yaw([0.0, 0.0, 3.0], 0.0))

    def tell(self, kind, sender="mission", lifetime_s=5.0, **fields):
        """A new command; its number."""
        self.number += 1
        expires_s = WALL_S + self.now_s + lifetime_s
        self.core.take(WALL_S + self.now_s, Instruction("uav1", sender, self.number, kind, expires_s, **fields))
        return self.number

    def run(self, seconds=STEP_S):
        out = []
        for _ in range(int(round(seconds / STEP_S))):
            self.core.step(self.now_s, WALL_S + self.now_s)
            out += self.core.outgoing()
            self.now_s += STEP_S
        return out


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


def test_land_is_asked_for_at_once_while_guided_is_not_answered():
    board = Board()
    guided = board.tell(Kind.SET_MODE, mode="GUIDED")
    [first] = of(board.run(), Ask)
    arm = board.tell(Kind.ARM, flag=True)
    assert not of(board.run(1.0), Ask), "one job at a time"
    land = board.tell(Kind.LAND)
    out = board.run()
    [stop] = of(out, Ask)
    assert (stop.kind, stop.mode) == (Kind.SET_MODE, "LAND")
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
    late = board.tell(Kind.SET_MODE, mode="GUIDED", lifetime_s=0.5)
    board.run(1.0)
    board.core.finished(ask, "")
    assert (late, TOO_LATE) in [(a.number, a.result) for a in of(board.run(), Ack)]


@pytest.mark.parametrize("mode", ["ACRO", "FLIP", "LOITER", "STABILIZE", "HOVER", ""])
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


def test_a_silent_control_pc_lands_where_asked_to():
    board = Board(link_loss_land_s=10.0)
    board.core.control_heard(board.now_s)
    assert not of(board.run(9.5), Ask)
    [ask] = of(board.run(1.0), Ask)
    assert (ask.kind, ask.mode) == (Kind.SET_MODE, "LAND")
    board.core.finished(ask, "")
    assert not of(board.run(1.0), Ack), "nobody asked for it"
