# SPDX-License-Identifier: Apache-2.0
"""A vehicle that lost its position: a problem in every phase, and no step of the mission goes on
with it."""

import pytest

from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode

_BY_HAND = ("COLUMN", "CALIBRATE", "MOVE_HOME", "SET_HOME")


def mission():
    return Mission("test", [StereoConfiguration("horizontal", 4.0, record_s=2.0)])


def up_to(f, phase):
    """By what people do."""
    f.line_up()
    f.wait(0.2)
    if phase == "COLUMN":
        return f
    f.press("calibrate")
    if phase == "CALIBRATE":
        return f
    f.machine.answer("calibrate", True, "good")
    if phase == "MOVE_HOME":
        return f
    f.press("set_home")
    f.home_known = True
    f.machine.answer("set_home", True, "set")
    if phase in ("GUIDED", "CONFIGURATIONS"):
        f.press("execute")
        f.phase(phase)
    return f


def said(f, name="uav2"):
    return [p for p in f.machine.problems if p.startswith(name) and "lost its position" in p]


@pytest.mark.parametrize("phase", [*_BY_HAND, "GUIDED", "CONFIGURATIONS"])
def test_it_is_a_problem_in_every_phase(flight, phase):
    """Before, up to GUIDED nobody said so."""
    f = up_to(flight(mission()), phase)
    assert not f.machine.problems
    f.fleet["uav2"].lost = True
    f.wait(0.2)
    [line] = said(f)
    assert Mode.ALT_HOLD in line and len(line) < 80


@pytest.mark.parametrize("phase", ["WAIT_VEHICLES", "TAKE_OFF"])
def test_before_the_column_too_where_it_flies(flight, phase):
    f = flight(mission())
    f.fleet["uav2"].lost = True
    if phase == "TAKE_OFF":
        f.phase("TAKE_OFF")
        f.wait(0.2)
        assert not said(f), "on the ground it waits for its next take-off"
    f.take_off()
    f.wait(3.0)
    assert said(f) and f.machine.phase == phase


@pytest.mark.parametrize(
    "phase, step", [("COLUMN", "calibrate"), ("MOVE_HOME", "set_home"), ("SET_HOME", "execute")]
)
def test_calibrate_set_home_and_execute_are_refused(flight, phase, step):
    """Before, both were calibrated and the other one was handed over to GUIDED."""
    f = up_to(flight(mission()), phase)
    f.fleet["uav2"].lost = True
    f.wait(2.0)
    answers = [f.operator.proceed(step)] + ([f.operator.execute([])] if step == "execute" else [])
    for refusal in answers:
        assert "uav2 lost its position" in refusal and "abort" in refusal
        assert Mode.LOITER not in refusal and "GUIDED" not in refusal
    assert f.machine.phase == phase and not f.machine.wants
    f.fleet["uav2"].lost = False
    f.wait(2.0)
    assert f.operator.proceed(step) == ""


@pytest.mark.parametrize("phase", _BY_HAND)
def test_once_it_is_down_everybody_lands(flight, phase):
    """Nobody knows where it lies, and without it nothing is flown: before, the others stayed up for
    300 s."""
    f = up_to(flight(mission()), phase)
    f.fleet["uav2"].lost, f.fleet["uav2"].armed = True, False
    f.wait(0.3)
    assert (
        f.machine.phase == "LAND"
        and f.machine.detail == "uav2: lost its position and is down: landing everybody"
    )


@pytest.mark.parametrize("phase, back", [("CALIBRATE", "COLUMN"), ("SET_HOME", "MOVE_HOME")])
def test_what_a_service_answers_while_one_is_lost_does_not_count(flight, phase, back):
    f = up_to(flight(mission()), "CALIBRATE" if phase == "CALIBRATE" else "MOVE_HOME")
    if phase == "SET_HOME":
        f.press("set_home")
    f.fleet["uav1"].lost = True
    f.wait(0.2)
    f.machine.answer("calibrate" if phase == "CALIBRATE" else "set_home", True, "good")
    assert f.machine.phase == back and "uav1 lost its position" in f.machine.detail


def test_nobody_is_handed_over_beside_one_that_is_lost(flight):
    f = up_to(flight(mission()), "SET_HOME")
    f.fleet["uav1"].refuses = f.fleet["uav2"].refuses = {"SET_MODE": "not yet"}
    f.press("execute")
    f.wait(1.0)
    f.fleet["uav2"].lost = True
    f.fleet["uav1"].refuses = {}
    f.wait(5.0)
    assert f.machine.phase == "GUIDED" and f.fleet["uav1"].mode == Mode.LOITER and said(f)


@pytest.mark.parametrize("mode", [Mode.ALT_HOLD, Mode.LOITER, Mode.STABILIZE])
def test_who_flies_one_that_is_lost_is_not_told_to_give_it_back(flight, mode):
    """In LOITER and GUIDED it would follow a position that is wrong."""
    f = up_to(flight(mission()), "CONFIGURATIONS")
    f.fleet["uav2"].lost, f.fleet["uav2"].mode = True, mode
    f.wait(1.0)
    told = "; ".join(f.machine.problems)
    assert (
        "land it in ALT_HOLD, or abort" in told
        and "give it back" not in told
        and "confirm" not in told
    )
    assert f.machine.waits_for == "" and "uav2 lost its position" in f.operator.proceed("resume")
