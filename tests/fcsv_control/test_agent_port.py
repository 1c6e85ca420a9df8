# SPDX-License-Identifier: Apache-2.0
"""The agent's port: which services it calls when, how a request ends, and when it shows that it
lives."""

import numpy as np
import pytest

from fcsv_control.agent.core import AgentRules
from fcsv_control.agent.messages import (
    DONE,
    REFUSED,
    Ack,
    AgentAlive,
    Ask,
    AskAnswered,
    Instruction,
    Kind,
    SetPoint,
)
from fcsv_control.agent.port import AgentPort
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import (
    EstimateMoved,
    HomeReceived,
    ModeAsked,
    PoseEstimated,
    Refused,
    TextReceived,
)
from fcsv_control.guardian.messages import GuardianVerdict
from fcsv_geometry import transforms
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode

STEP_S, BEGAN_S = 0.02, 50.0


class Board:
    """An agent that has listened for others, its time, and what it gave."""

    def __init__(self, **rules):
        self.port = AgentPort("uav1", AgentRules(guardian=False, **rules), "agent-1", BEGAN_S)
        self.now_s, self.number, self.shows = BEGAN_S + 2.0, 0, ("GUIDED", True)
        self.hear(PoseEstimated(transforms.from_xyz_yaw([0.0, 0.0, 3.0], 0.0)))
        self.show(*self.shows)
        self.run()

    def hear(self, *messages):
        for message in messages:
            self.port.receive(self.now_s, message)

    def show(self, mode, armed=True):
        self.hear(tm.VehicleState("uav1", "", mode, armed, True))

    def tell(self, kind, sender="mission", **fields):
        self.number += 1
        self.hear(
            Instruction("uav1", sender, self.number, kind, self.now_s, self.now_s, 5.0, **fields)
        )
        return self.number

    def run(self, seconds=STEP_S):
        out = []
        for _ in range(int(round(seconds / STEP_S))):
            out += self.port.step(self.now_s)
            self.now_s += STEP_S
        return out


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


@pytest.fixture
def board():
    return Board()


def test_a_mode_is_told_to_others_before_the_service_is_called_and_done_when_it_shows(board):
    number = board.tell(Kind.SET_MODE, mode=Mode.BRAKE)
    told, call = [o for o in board.run() if isinstance(o, (ModeAsked, Ask))]
    assert told == ModeAsked(Mode.BRAKE) and call.mode == Mode.BRAKE
    assert not of(board.run(1.0), Ask), "a call is under way"
    board.hear(AskAnswered(call.number, True))
    assert not of(board.run(0.1), Ack)
    board.show(Mode.BRAKE)
    assert of(board.run(), Ack) == [Ack("mission", number, DONE, "")]


def test_a_stop_that_was_taken_but_does_not_show_is_called_again(board):
    """As with MAVROS, which answers a mode when it is sent."""
    board.tell(Kind.LAND)
    calls = []
    for _ in range(50):
        out = board.run()
        calls += of(out, Ask)
        board.hear(*(AskAnswered(a.number, True) for a in of(out, Ask)))
        assert len(of(out, ModeAsked)) == (1 if len(calls) == 1 and of(out, Ask) else 0), (
            "told once"
        )
    assert len(calls) == 5 and {a.mode for a in calls} == {"LAND"}


def test_the_reason_of_a_refusal_may_come_after_the_answer(board):
    number = board.tell(Kind.ARM, flag=True)
    board.show("GUIDED", False)
    [call] = of(board.run(), Ask)
    board.hear(AskAnswered(call.number, False))
    assert not of(board.run(0.2), Ack)
    board.hear(Refused("arming refused: the EKF is not ready"))
    assert of(board.run(), Ack) == [
        Ack("mission", number, REFUSED, "arming refused: the EKF is not ready")
    ]


def test_without_a_reason_the_autopilots_last_warning_is_one(board):
    for severity, reason in (
        (6, "the flight link refused without a reason"),
        (4, "PreArm: compass"),
    ):
        board.tell(Kind.ARM, flag=True)
        board.show("GUIDED", False)
        [call] = of(board.run(), Ask)
        board.hear(TextReceived(severity, "PreArm: compass"), AskAnswered(call.number, False))
        [ack] = of(board.run(0.6), Ack)
        assert (ack.result, ack.reason) == (REFUSED, reason)


def test_a_refusal_of_before_is_none_of_the_next_request(board):
    board.tell(Kind.ARM, flag=True)
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    board.show("GUIDED", False)
    [arm] = of(board.run(), Ask)
    board.hear(Refused("not ready"), AskAnswered(arm.number, False))
    out = board.run()
    assert of(out, Ack)[0].reason == "not ready" and [a.mode for a in of(out, Ask)] == ["GUIDED"]
    assert not of(board.run(1.0), Ack)


def test_a_service_that_is_not_there_ends_the_request_and_frees_the_next(board):
    first, second = board.tell(Kind.ARM, flag=True), board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    [call] = of(board.run(), Ask)
    board.hear(AskAnswered(call.number, False, "timeout exceeded while waiting for service"))
    out = board.run()
    assert [(a.number, a.reason) for a in of(out, Ack)] == [
        (first, "timeout exceeded while waiting for service")
    ]
    assert [a.mode for a in of(out, Ask)] == ["GUIDED"] and second == 2
    board.hear(AskAnswered(call.number, True))  # of a request that is over
    assert not of(board.run(), Ack)


def test_a_landing_ends_the_mode_before_it_once_that_call_returns(board):
    guided, land = board.tell(Kind.SET_MODE, mode=Mode.GUIDED), None
    [first] = of(board.run(), Ask)
    land = board.tell(Kind.LAND)
    [second] = of(board.run(), Ask)
    assert (first.mode, second.mode) == ("GUIDED", "LAND")
    board.show("LAND")
    board.hear(AskAnswered(first.number, True), AskAnswered(second.number, True))
    acks = {a.number: a for a in of(board.run(), Ack)}
    assert (
        acks[land].result == DONE
        and acks[guided].reason == "mode GUIDED was overtaken by a newer command"
    )


def test_a_take_off_counts_from_the_home_that_mavros_tells(board):
    board.hear(HomeReceived(0.75))
    number = board.tell(Kind.TAKEOFF, altitude_m=5.0)
    [call] = of(board.run(0.3), Ask)
    assert call.altitude_m == pytest.approx(4.25)
    board.hear(AskAnswered(call.number, True))
    assert of(board.run(), Ack) == [Ack("mission", number, DONE, "")]


def test_it_shows_that_it_lives_and_whom_it_obeys(board):
    board.tell(
        Kind.GOTO,
        sender="mission-7",
        target=transforms.from_xyz_yaw([1.0, 0.0, 3.0], 0.0),
        frame="uav1/odom",
    )
    lives = of(board.run(1.0), AgentAlive)
    assert len(lives) == 5 and {(m.instance, m.started_s, m.problem) for m in lives} == {
        ("agent-1", BEGAN_S, "")
    }
    assert lives[-1].commander == "mission-7" and lives[-1].sent_s == pytest.approx(
        board.now_s, abs=0.25
    )


def test_beside_an_older_agent_it_says_so_and_does_nothing(board):
    board.hear(AgentAlive("agent-0", 0.0, 1000.0))
    board.tell(Kind.LAND)
    out = board.run(0.5)
    assert not of(out, Ask) + of(out, Ack) + of(out, SetPoint)
    assert (
        "agent-0 is its agent already; this second one does nothing"
        in of(out, AgentAlive)[-1].problem
    )


def test_the_calibration_of_another_epoch_forbids_to_hand_over(board):
    board.hear(
        tm.OdometryEpoch("uav1", "", 8, "the tracker was silent"),
        tm.EpochsFound(tm.HOME, 0.0, {"uav1": 7}),
    )
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    assert of(board.run(), Ask), "home's epoch is not the calibration's"
    board.hear(
        tm.EpochsFound(tm.CALIBRATION, 0.0, {"uav2": 3}),
        tm.EpochsFound(tm.CALIBRATION, 0.0, {"uav1": 7}),
    )
    board.tell(Kind.SET_MODE, mode=Mode.GUIDED)
    [ack] = of(board.run(), Ack)
    assert "began anew after the calibration (the tracker was silent)" in ack.reason


def test_a_target_moves_along_with_the_estimate_and_the_guardian_silences_it(board):
    board.run(1.0)
    board.hear(EstimateMoved(np.array([2.0, 0.0, 0.0])))
    assert np.allclose(of(board.run(0.2), SetPoint)[-1].T_odom_body[:3, 3], [2.0, 0.0, 3.0])
    board.hear(GuardianVerdict("hold", True, reasons=("uav2 comes down",)))
    assert not of(board.run(1.0), SetPoint)


def test_the_lease_lasts_as_long_as_the_mission_lives(board):
    there = {"target": transforms.from_xyz_yaw([1.0, 0.0, 3.0], 0.0), "frame": "uav1/odom"}
    board.tell(Kind.GOTO, sender="mission-1", **there)
    for _ in range(15):
        board.run(0.2)
        board.hear(MissionAlive("mission-1", board.now_s))
    number = board.tell(Kind.GOTO, sender="mission-2", **there)
    assert [a.result for a in of(board.run(), Ack) if a.number == number] == [REFUSED]


def test_what_it_does_not_know_is_refused(board):
    with pytest.raises(TypeError, match="an agent takes no MissionPhase"):
        board.hear(tm.MissionPhase("LAND"))
