# SPDX-License-Identifier: Apache-2.0
"""Nobody is handed over to the mission before the flight check is green, or each amber line was
accepted by name."""

import pytest

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_control.mission.watches.check_gate import CheckGate
from fcsv_geometry.missions.mission import Mission, StereoConfiguration

G, A, R, U = Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN


def line(state, accepted=False, name="battery"):
    return Line("uav2", name, state, "31%", accepted=accepted)


@pytest.mark.parametrize(
    "lines, take_off, begins, resumes",
    [
        ([line(G)], True, True, True),
        ([line(A)], True, False, True),
        ([line(A, True)], True, True, True),
        ([line(A, True), line(A, name="feed")], True, False, True),
        ([line(R)], False, False, False),
        ([line(R, True)], False, False, False),
        ([line(U, True), line(G, name="feed")], False, False, False),
    ],
)
def test_what_locks(lines, take_off, begins, resumes):
    gate = CheckGate()
    gate.tell(10.0, lines, 4.0)
    for now_s in (10.0, 14.0):
        assert (
            not gate.before_take_off(now_s),
            not gate.before_list(now_s),
            not gate.before_resuming(now_s),
        ) == (take_off, begins, resumes)


def test_a_table_that_is_not_heard_any_more_locks():
    gate = CheckGate()
    for now_s in (10.0, 14.1):
        assert "not heard" in gate.before_list(now_s) and "not heard" in gate.before_resuming(now_s)
        assert len(gate.before_take_off(now_s)) == 1
        gate.tell(10.0, [line(G)], 4.0)


def test_a_mission_that_restarts_does_not_wait_until_it_is_heard_itself():
    gate = CheckGate()
    gate.tell(0.0, [Line("control", "mission", R, "not heard"), line(G)], 4.0)
    assert gate.before_list(1.0) == gate.before_resuming(1.0) == ""
    gate.tell(0.0, [Line("uav1", "mission", R, "")], 4.0)
    assert gate.before_list(1.0)


def test_what_it_tells():
    gate = CheckGate()
    gate.tell(0.0, [line(R), *(line(A, name=f"n{k}") for k in range(5))], 4.0)
    assert gate.before_take_off(1.0) == ["flight check: uav2 battery is RED"]
    told = gate.before_list(1.0)
    assert told.startswith("GUIDED is locked: uav2 battery is RED (31%); uav2 n0 is amber")
    assert "2 more: mend it, or accept it" in told


@pytest.fixture
def flown(flight):
    """A flight on paper whose mission has a gate; ``flown.say(state)`` tells it a table that lasts
    for the flight."""
    flown = flight(
        Mission(
            "gate", [StereoConfiguration("horizontal", b_m, record_s=2.0) for b_m in (4.0, 6.0)]
        )
    )
    flown.machine.gate = CheckGate()
    flown.say = lambda *lines: flown.machine.gate.tell(flown.now_s, lines, 1e4)
    return flown


def test_a_mission_waits_on_the_ground_and_names_the_line(flown):
    flown.wait(5.0)
    assert flown.machine.phase == "WAIT_VEHICLES" and "not heard" in flown.machine.problems[0]
    flown.say(line(R))
    flown.wait(1.0)
    assert flown.machine.problems == ["flight check: uav2 battery is RED"]
    flown.say(line(A))
    flown.phase("TAKE_OFF")


def test_execute_is_refused_and_taken_once_the_line_is_accepted(flown):
    flown.say(line(A))
    flown.up_to_home()
    flown.until(lambda: flown.machine.waits_for == "execute")
    flown.wait(1.1)
    ordered = len(flown.orders)
    for refused in (flown.operator.proceed("execute"), flown.operator.execute([0])):
        assert "uav2 battery is amber (31%)" in refused
    flown.wait(3.0)
    assert flown.machine.phase == "SET_HOME" and len(flown.orders) == ordered, (
        "nobody was asked for GUIDED"
    )
    flown.say(line(A, True))
    assert flown.operator.proceed("execute") == ""
    flown.phase("DONE")
    assert flown.captured == [0, 1], "all, not those of the execute that was refused"


def test_a_list_that_was_begun_goes_on_over_amber_and_not_over_red(flown):
    flown.say(line(G))
    flown.up_to_configurations()
    assert flown.operator.control("pause") == ""
    flown.until(lambda: flown.machine.waits_for == "resume")
    flown.wait(1.1)
    flown.say(line(R))
    assert "abort to land" in flown.operator.control("resume")
    flown.say(line(A))
    assert flown.operator.control("resume") == ""
    flown.phase("CONFIGURATIONS")


def test_a_red_line_never_keeps_anybody_from_landing(flown):
    flown.say(line(G))
    flown.up_to_configurations()
    flown.say(line(R))
    assert flown.operator.control("abort") == ""
    flown.phase("ABORTED")
