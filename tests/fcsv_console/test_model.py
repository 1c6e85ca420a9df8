# SPDX-License-Identifier: Apache-2.0
"""The console's view-model: what is shown, what is enabled and why not, and that bad input never
ends it."""

import dataclasses
import doctest
import importlib
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcsv_console.model import (
    above_view,
    actions,
    air,
    cells,
    facts,
    hearing,
    looking,
    mission_file,
    samples,
    soundness,
    stereo,
)
from fcsv_console.model.console import Console
from fcsv_console.model.events import EventLog
from fcsv_console.model.steady import SteadyVerdict
from fcsv_console.model.stereo import StereoHealth
from fcsv_console.model.vehicles import FAILSAFE, GUARDIAN, MISSION, NOBODY, PILOT, UNKNOWN
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_control.mission.activities.stages import GOES_BACK, HOLDS, MOVES, RECORDS, TURNS
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.vehicles.modes import Mode
from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest

OUTDOOR = Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml"
GREEN = (Line("uav1", "battery", Grade.GREEN, "80 %"), Line("uav2", "battery", Grade.GREEN, "80 %"))


def console():
    c = Console(["uav1", "uav2"], {"uav1": 1, "uav2": 2}, verdict_s=0.0, normal_s=0.0)
    c.load(OUTDOOR)
    return c


def rehearsed(c, state="passed"):
    """Its list was rehearsed."""
    c.tell(0.0, facts.RehearsalProgress(c.file.text, state, words="8 of 8 recorded"))
    return c


def flying(c, now_s, phase="CONFIGURATIONS", waits_for="", lines=GREEN, configuration=1):
    """Both vehicles in the air under the mission, all streams alive."""
    for name, y in (("uav1", 0.0), ("uav2", -4.0)):
        c.tell(now_s, facts.AutopilotReport(name, True, True, Mode.GUIDED))
        c.tell(now_s, facts.GuardianReport(name))
        c.tell(now_s, facts.Agent(name, "mission-12-34"))
        c.tell(now_s, facts.OdometryReport(name, (0.0, y, 8.0)))
        c.tell(now_s, facts.CameraPoseReport(name, (0.0, y, 0.0), 0.0))
        c.tell(now_s, facts.BatteryReport(name, 0.8, 15.2))
        c.tell(now_s, facts.PreviewReport(name, now_s))
        c.tell(now_s, facts.PictureCaptured(name, now_s))
    c.tell(now_s, facts.TagReport("uav2", (1,)))
    c.tell(now_s, facts.FlightCheckReport(tuple(lines)))
    c.tell(now_s, facts.MissionReport(phase, "flies", waits_for, configuration, 8))
    c.tell(now_s, facts.MissionHeartbeat("mission-12-34"))
    return c


def row(c, now_s, name="uav2"):
    return next(v for v in c.view(now_s).vehicles if v.name == name)


@pytest.mark.parametrize(
    "name",
    [
        "hearing",
        "events",
        "air",
        "mission_file",
        "actions",
        "soundness",
        "above_view",
        "rehearsal",
        "planning",
        "poses",
        "goals",
        "looking",
        "ground_views",
        "mission_folder",
        "bags",
        "chronicle",
        "phase_progress",
        "what_next",
    ],
)
def test_examples_in_the_modules_hold(name):
    done = doctest.testmod(importlib.import_module(f"fcsv_console.model.{name}"))
    assert done.attempted and not done.failed


# ---- who flies -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "state, guardian, who, words",
    [
        ((Mode.GUIDED, True, 4), {}, MISSION, "mission"),
        ((Mode.LOITER, True, 4), {}, PILOT, "pilot, LOITER"),
        (
            (Mode.GUIDED, True, 4),
            {"holds": True, "action": "hold", "reasons": ("the poses stopped",)},
            GUARDIAN,
            "guardian: hold: the poses stopped",
        ),
        ((Mode.LAND, True, 5), {}, FAILSAFE, "the autopilot's failsafe, LAND"),
        ((Mode.RTL, True, 4), {}, FAILSAFE, "RTL: by the autopilot or the pilot"),
        (
            (Mode.LAND, True, 4),
            {"uncontrolled": True},
            FAILSAFE,
            "COMES DOWN WITHOUT A POSITION: keep away",
        ),
        ((Mode.LAND, True, 4), {"taken": True}, PILOT, "pilot, LAND"),
        ((Mode.STABILIZE, False, 3), {}, NOBODY, "on the ground, motors off"),
    ],
)
def test_who_flies_is_said_in_words(state, guardian, who, words):
    c = flying(console(), 10.0)
    mode, armed, status = state
    c.tell(10.1, facts.AutopilotReport("uav2", True, armed, mode, status))
    c.tell(10.1, facts.GuardianReport("uav2", **guardian))
    assert (row(c, 10.2).flier.who, row(c, 10.2).flier.words) == (who, words)


def test_a_change_of_who_flies_shows_at_once():
    """Within 0.5 s is wanted; the model itself adds nothing to the message's own way."""
    c = flying(console(), 10.0)
    c.tell(10.3, facts.AutopilotReport("uav2", True, True, Mode.ALT_HOLD))
    assert row(c, 10.3).flier.who == PILOT


def test_brake_after_stop_all_is_named_and_an_agent_without_a_commander():
    c = flying(console(), 10.0)
    c.tell(10.1, facts.StopReport("stop", "stop all (by /console)"))
    c.tell(10.1, facts.AutopilotReport("uav2", True, True, Mode.BRAKE))
    assert row(c, 10.2).flier.words == "BRAKE after stop-all"
    c.tell(10.2, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
    c.tell(10.2, facts.Agent("uav2", ""))
    assert row(c, 10.3).flier.words == "GUIDED, holds: nobody commands it"


def test_a_mission_is_a_mission_before_its_own_sign_of_life_and_another_is_named():
    """A bag never has that sign."""
    c = console()
    c.tell(10.0, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
    for mission, sender, words in (
        ("", "mission-12-34", "mission"),
        ("", "/console", "commanded by /console"),
        ("mission-56-78", "mission-12-34", "commanded by mission-12-34"),
        ("mission-56-78", "mission-56-78", "mission"),
    ):
        if mission:
            c.tell(10.0, facts.MissionHeartbeat(mission))
        c.tell(10.0, facts.Agent("uav2", sender))
        assert row(c, 10.1).flier.words == words


def test_an_agent_that_was_not_heard_yet_is_told_from_one_that_fell_silent():
    """A window that was just opened knows the mode before it knows who commands."""
    c = console()
    for at_s in (10.0, 11.8):
        c.tell(at_s, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
        if at_s == 10.0:
            assert row(c, 10.1).flier.words == "GUIDED, its agent is not heard yet"
            c.tell(10.2, facts.MissionHeartbeat("mission-1"))
            c.tell(10.2, facts.Agent("uav2", "mission-1"))
            assert row(c, 10.3).flier.words == "mission"
    assert (row(c, 11.9).flier.who, row(c, 11.9).flier.words) == (
        UNKNOWN,
        "GUIDED, its agent is not heard for 1.7 s",
    )


# ---- ages ----------------------------------------------------------------------------------------


def test_a_vehicle_that_vanishes_is_stale_within_a_second_and_comes_back():
    c = flying(console(), 10.0)
    assert not row(c, 10.9).pose.stale and not row(c, 10.9).state.stale
    late = row(c, 11.1)
    assert (
        late.pose.stale
        and late.place.stale
        and late.heard.stale
        and late.connection == "NOT HEARD for 1.1 s"
    )
    assert late.flier.who == UNKNOWN and late.flier.words == "not heard for 1.1 s (was GUIDED)"
    assert late.mode == Mode.GUIDED and late.armed, "what was known stays readable"
    assert row(flying(c, 20.0), 20.1).flier.who == MISSION


def test_a_state_once_a_second_does_not_flicker_and_one_that_stops_is_told():
    """As ArduPilot's heartbeat comes; poses thirty times."""
    c = flying(console(), 10.0)
    for k in range(90):
        at_s = 10.0 + k / 30.0
        c.tell(at_s, facts.OdometryReport("uav2", (0.0, 0.0, 8.0)))
        c.tell(at_s, facts.Agent("uav2", "mission-1-2"))
        if k in (30, 60):
            c.tell(at_s, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
        if k < 75:
            assert row(c, at_s).flier.who == MISSION and row(c, at_s).connection == "connected"
    for k in range(90, 150):
        c.tell(10.0 + k / 30.0, facts.OdometryReport("uav2", (0.0, 0.0, 8.0)))
    assert row(c, 14.9).flier.words == "no state for 2.9 s (was GUIDED)"


def test_what_comes_often_is_stale_within_a_second_and_one_lost_message_is_no_alarm():
    """As the flight link tells the state, and a playback's pictures come; poses go on."""
    c = console()
    for k in range(300):
        at_s = 10.0 + k / 30.0
        c.tell(at_s, facts.OdometryReport("uav2", (0.0, 0.0, 8.0)))
        # every 0.4 s until 18.0 s, two of them lost
        if k % 12 == 0 and k not in (120, 204) and k <= 240:
            c.tell(at_s, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
            c.tell(at_s, facts.PreviewReport("uav2", at_s))
        if k <= 240:
            assert not row(c, at_s).state.stale and not row(c, at_s).picture.stale
    assert not row(c, 18.9).state.stale
    late = row(c, 19.05)
    assert late.state.stale and late.picture.stale and late.connection == "no state for 1.1 s"
    c.tell(30.0, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
    assert not row(c, 30.9).state.stale and row(c, 31.1).state.stale


def test_rates_are_of_the_last_seconds():
    h = hearing.AgingFact()
    for k in range(90):
        h.tell(k / 30.0, k)
    assert h.at(2.99).rate_hz == pytest.approx(30.0, rel=0.02)
    assert h.at(5.0).rate_hz < 15.0 and h.at(9.0).rate_hz == 0.0


def test_messages_that_were_held_up_and_come_at_once_are_no_high_rate():
    h = hearing.AgingFact()
    for k in range(3):
        h.tell(10.0 + 0.007 * k, k)
    assert h.at(10.02).rate_hz == pytest.approx(4.0)


# ---- actions -------------------------------------------------------------------------------------


def why(c, now_s, name):
    return c.view(now_s).actions[name].why_not


def test_stop_all_can_always_be_asked_for():
    c = console()
    assert not why(c, 0.0, "stop_all")
    c.tell(0.0, facts.MasterReport("the ROS master does not answer"))
    assert not why(c, 0.1, "stop_all") and why(c, 0.1, "land") == "the ROS master does not answer"
    assert not flying(c, 1.0).view(1.0).actions["stop_all"].why_not


@pytest.mark.parametrize(
    "phase, waits_for, enabled",
    [
        ("WAIT_VEHICLES", "", {"abort", "record"}),
        ("COLUMN", "calibrate", {"abort", "record", "calibrate"}),
        ("MOVE_HOME", "set_home", {"abort", "record", "set_home"}),
        ("SET_HOME", "execute", {"abort", "record", "hand_over", "execute"}),
        ("CONFIGURATIONS", "", {"abort", "pause", "skip", "repeat", "next", "previous"}),
        ("CONFIGURATIONS", "resume", {"abort", "skip", "repeat", "next", "previous", "hand_over"}),
        ("LAND", "", {"abort", "record"}),
        ("DONE", "", {"record"}),
    ],
)
def test_what_is_enabled_in_each_phase(phase, waits_for, enabled):
    view = flying(rehearsed(console()), 10.0, phase, waits_for).view(10.1)
    at_the_desk = set() if phase == "CONFIGURATIONS" else {"rehearse"}
    assert {n for n, a in view.actions.items() if a.enabled} == enabled | at_the_desk | {
        "stop_all",
        "land",
    }
    assert all(a.why_not for a in view.actions.values() if not a.enabled)


def test_the_reason_says_what_is_missing():
    c = flying(console(), 10.0, "COLUMN")
    c.tell(10.0, facts.TagReport("uav2", ()))
    assert why(c, 18.0, "calibrate") == "the mission node is not heard: start it, or mend its file"
    c.tell(18.0, facts.MissionHeartbeat())
    assert why(c, 18.0, "calibrate") == "uav2 does not see the tag of uav1 since 8 s"
    assert why(c, 18.0, "set_home") == "calibrate first (COLUMN)"
    assert why(c, 18.0, "skip") == "it is for vehicles that fly the list; this is COLUMN"


@pytest.mark.parametrize(
    "state, accepted, first, again",
    [
        (Grade.RED, False, "flight check: uav1 battery RED", "flight check: uav1 battery RED"),
        (
            Grade.UNKNOWN,
            False,
            "flight check: uav1 battery unknown",
            "flight check: uav1 battery unknown",
        ),
        (Grade.AMBER, False, "flight check: uav1 battery amber", ""),
        (Grade.AMBER, True, "", ""),
    ],
)
def test_guided_is_locked_by_the_flight_check_as_the_mission_locks_it(
    state, accepted, first, again
):
    line = Line("uav1", "battery", state, "31 %", accepted=accepted)
    assert (
        why(flying(rehearsed(console()), 10.0, "SET_HOME", "execute", [line]), 10.1, "hand_over")
        == first
    )
    assert (
        why(flying(console(), 10.0, "CONFIGURATIONS", "resume", [line]), 10.1, "hand_over") == again
    )


def test_a_flight_check_that_is_not_heard_locks():
    c = flying(console(), 10.0, "SET_HOME", "execute")
    c.tell(15.0, facts.MissionHeartbeat())
    assert (
        why(c, 15.0, "execute") == "the flight check is not heard"
        and c.view(15.0).check_state is Grade.UNKNOWN
    )


def test_only_amber_lines_are_accepted():
    assert actions.accept(Line("uav1", "battery", Grade.AMBER, "")).enabled
    assert (
        actions.accept(Line("uav1", "battery", Grade.RED, "")).why_not
        == "it is RED: only amber lines are accepted"
    )
    assert (
        actions.accept(Line("uav1", "battery", Grade.AMBER, "", accepted=True)).why_not
        == "it is accepted"
    )


def test_what_was_asked_for_is_not_asked_twice_and_its_answer_is_kept():
    c = flying(console(), 10.0)
    number = c.ask(10.0, "pause")
    assert why(c, 10.1, "pause").startswith("it was asked for")
    c.answer(number, "done: pause", True)
    assert not why(c, 10.2, "pause")
    assert [(e.who, e.what, e.answer) for e in c.log.events][-1] == (
        "operator",
        "pause",
        "done: pause",
    )
    c.ask(10.3, "skip")
    assert why(flying(c, 20.5), 20.5, "skip") == "", (
        "an answer that never comes blocks for ten seconds at most"
    )


def test_land_is_for_vehicles_that_fly():
    c = console()
    assert not why(c, 0.0, "land"), "who is not heard may fly"
    for name in ("uav1", "uav2"):
        c.tell(1.0, facts.AutopilotReport(name, True, False, Mode.LOITER))
    assert why(c, 1.1, "land") == "all stand with their motors off" and not why(c, 3.0, "land")


# ---- configurations ------------------------------------------------------------------------------


def test_configurations_have_their_range_and_error_by_the_equations():
    f = console().file
    assert len(f.rows) == 8 and f.error is None
    for r in f.rows:
        z_m = farthest(r.baseline_m, 602.0, ErrorThreshold(0.1, True))
        assert r.farthest_m == pytest.approx(z_m) and r.error_m == pytest.approx(
            depth_error(z_m, r.baseline_m, 602.0)
        )
    assert f.rows[0].goal_m == (0.0, -2.0, 0.0) and f.rows[5].goal_m == (0.0, 0.0, 5.0)


@pytest.mark.parametrize(
    "text, words",
    [
        (
            "name: a\nconfigurations:\n  - {axis: horizontal, baseline_m: 2.0}\n  - axis: up\n    baseline_m: 3.0\n",
            "line 4: configurations[1].axis: 'up' is not one of horizontal, vertical",
        ),
        (
            "name: a\nconfigurations:\n  - {axis: horizontal, baseline_m: 2.0}\n"
            "  -\n    axis: vertical\n    baseline_m: 3.0\n"
            "    tilt_deg: 4\n",
            "line 7: configurations[1].tilt_deg: a hovering multirotor cannot pitch a fixed camera; set "
            "it to 0 for vertical",
        ),
        ("name: a\nheight: 3\n", "line 2: height: is not known"),
        ("name: a\n", "configurations: is missing"),
        ("name: [a\n", "line 2: not YAML: expected ',' or ']', but got '<stream end>'"),
        ("", "must be a mapping"),
        (
            "name: a\nconfigurations: [{axis: horizontal, baseline_m: .nan}]\n",
            "line 2: configurations[0].baseline_m: must be finite, got nan",
        ),
    ],
)
def test_an_error_in_a_mission_file_is_named_with_its_line(text, words):
    f = mission_file.parse(text)
    assert f.mission is None and words in f.error.words
    c = console()
    c.edit(text)
    assert (
        any(words in p for p in c.view(0.0).problems) and not c.view(0.0).vehicles[0].battery_enough
    )


def test_a_sweep_is_shown_as_a_way_that_is_not_dragged():
    c = Console(["uav1", "uav2"], {"uav1": 1, "uav2": 2})
    c.load(OUTDOOR.with_name("sweep.yaml"))
    side, up = c.file.rows
    assert (side.way_m, up.way_m[1]) == (((0.0, -8.0, 0.0), (0.0, -2.0, 0.0)), (0.0, -2.0, 7.0))
    assert [cell.text for cell in cells.configuration_cells(side, False)][1:4] == [
        "hor. 8 to 2 m",
        "0°",
        "0+5 s",
    ]
    assert mission_file.seconds_left(c.file, 0) == pytest.approx(
        5.2 + 1.0 + 5.0 + 1.0 + 6.2, abs=1.0
    )
    scale = above_view.ViewScale(400, 400, 20.0)
    assert above_view.picked(c.file.rows, scale, *scale.to_px(0.0, -8.0)) is None


def test_a_file_that_is_not_there_or_is_no_text(tmp_path):
    assert "cannot be read" in mission_file.load(tmp_path / "none.yaml").error.words
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    assert mission_file.load(tmp_path / "bytes.yaml").error is not None


@given(st.text(max_size=80))
def test_no_text_of_a_mission_file_raises(text):
    f = mission_file.parse(text)
    assert f.mission is None or f.rows


def test_battery_is_compared_with_what_is_left_of_the_mission():
    """outdoor.yaml: 900 s of endurance, 20 % kept; 0.8 leaves 540 s. The list needs less than that
    and more than its recordings (8 times 5 s)."""
    c = flying(console(), 10.0, configuration=0)
    v = row(c, 10.1)
    assert v.endurance_s == pytest.approx(540.0) and 40.0 < v.needed_s < 540.0 and v.battery_enough
    c.tell(10.1, facts.BatteryReport("uav2", 0.22))
    assert row(c, 10.2).endurance_s == pytest.approx(18.0) and row(c, 10.2).battery_enough is False
    late = row(flying(c, 20.0, configuration=7), 20.1)
    assert late.needed_s < v.needed_s
    c.tell(20.1, facts.BatteryReport("uav2", math.nan))
    assert row(c, 20.2).battery_enough is None


# ---- how far it is -------------------------------------------------------------------------------


def doing(c, now_s, stage, configuration=1, detail="", **more):
    told = facts.MissionReport("CONFIGURATIONS", detail, "", configuration, 8, stage=stage)
    c.tell(now_s, dataclasses.replace(told, **more))
    return c.view(now_s)


def test_progress_goes_on_within_the_running_configuration():
    c = console()
    hold_s, record_s = c.file.rows[1].settle_s, c.file.rows[1].record_s
    assert doing(c, 10.0, MOVES).progress == pytest.approx(1 / 8)
    doing(c, 20.0, HOLDS)
    view = c.view(20.0 + 0.5 * hold_s)
    assert (
        view.progress == pytest.approx((1 + 0.5 * hold_s / (hold_s + record_s)) / 8)
        and "held" in view.headline
    )
    doing(c, 30.0, RECORDS)
    view = doing(c, 30.0 + 0.5 * record_s, RECORDS, detail="recording horizontal 4 m")
    assert view.progress == pytest.approx((1 + (hold_s + 0.5 * record_s) / (hold_s + record_s)) / 8)
    assert (
        view.headline == f"2 of 8: recording horizontal 4 m, {0.5 * record_s:.0f} of {record_s:g} s"
    )
    assert doing(c, 99.0, RECORDS).progress == pytest.approx(2 / 8), (
        "late: no more than the file says"
    )
    assert doing(c, 100.0, MOVES, 2).progress == pytest.approx(2 / 8)


def test_a_pause_takes_nothing_of_the_progress_and_says_what_ends_it():
    c = console()
    hold_s, record_s = c.file.rows[1].settle_s, c.file.rows[1].record_s
    doing(c, 10.0, RECORDS)
    before = c.view(10.0 + 0.5 * record_s).progress
    paused = doing(
        c,
        20.0,
        MOVES,
        detail="recording horizontal 4 m",
        waits_for="resume",
        problems=("paused by the operator",),
    )
    assert (
        paused.headline
        == "PAUSED: paused by the operator. Resume is locked: the flight check is not heard"
    )
    c.tell(20.0, facts.FlightCheckReport(GREEN))
    assert c.view(20.0).headline == "PAUSED: paused by the operator. Resume goes on"
    assert (
        paused.progress
        == before
        == pytest.approx((1 + (hold_s + 0.5 * record_s) / (hold_s + record_s)) / 8)
    )
    assert paused.actions["hand_over"].title == "Resume" and paused.actions["hand_over"].key == "G"
    assert "Resume" in paused.actions["pause"].why_not
    again = doing(c, 30.0, RECORDS)
    assert again.progress == before and again.actions["hand_over"].title == "Hand over"
    assert (
        doing(c, 40.0, MOVES, problems=("uav2 is not heard",)).headline
        == "PAUSED: uav2 is not heard"
    )


def test_a_list_that_was_flown_is_shown_as_flown_while_all_land():
    c = console()
    doing(c, 10.0, RECORDS, 7)
    doing(c, 99.0, RECORDS, 7)
    assert doing(c, 100.0, "", 7, "all configurations flown", phase="LAND").progress == 1.0
    assert doing(c, 101.0, MOVES, 0).progress == 0.0, "another flight"
    late = console()
    assert doing(late, 100.0, "", 7, "all configurations flown", phase="LAND").progress == 1.0, (
        "it saw nothing else"
    )
    c = console()
    doing(c, 10.0, MOVES, 7)
    assert doing(c, 11.0, "", 7, "aborted by the operator", phase="LAND").progress == pytest.approx(
        7 / 8
    )


def test_a_hold_is_told_as_exactly_as_its_bound():
    c = console()
    doing(c, 10.0, HOLDS)
    hold_s = c.file.rows[1].settle_s
    assert c.view(10.0 + 0.6 * hold_s).stage.words == f"held {0.6 * hold_s:.1f} of {hold_s:g} s"


def test_a_recording_that_was_interrupted_begins_anew():
    c = console()
    doing(c, 10.0, RECORDS)
    assert doing(c, 14.0, MOVES, waits_for="resume").stage.words == ""
    assert doing(c, 20.0, RECORDS).stage.words.startswith("0 of")


# ---- stereo and air ------------------------------------------------------------------------------


def compared(c, now_s):
    """Its pictures fit their places."""
    c.tell(now_s, facts.EpipolarReport(("uav1", "uav2"), 0.6, 200, 0.4, 1.0))
    return c


def test_stereo_health_says_go_and_why_not():
    c = flying(console(), 10.0)  # configuration 1: horizontal 4 m
    h = c.view(10.1).stereo
    assert not h.judged and h.baseline_m == pytest.approx(4.0), "a place alone is no GO"
    assert h.words == "stereo: the pair is as planned; its pictures are not compared yet"
    h = compared(c, 10.1).view(10.1).stereo
    assert h.go and h.words == "GO: the pair is as planned"
    assert h.error_m == pytest.approx(depth_error(h.target_m, 4.0, 602.0))
    c.tell(10.1, facts.CameraPoseReport("uav2", (0.3, -4.0, 0.0), math.radians(5.0)))
    h = c.view(10.2).stereo
    assert not h.go and h.apart_m == pytest.approx(0.3) and h.turn_deg == pytest.approx(5.0)
    turned = "the cameras are turned 5.0 degrees against the plan"
    assert h.words == f"NO-GO: {turned}; the camera is 0.30 m from its place"


def recorded(c, begin_s, late_s, count=10, vehicle="uav2"):
    """Pictures of a recording, five a second, uav2's ``late_s`` later; the radio brings some of
    uav1's last."""
    for k in range(count):
        now_s = begin_s + 0.2 * k
        doing(c, now_s, RECORDS)
        c.tell(now_s, facts.TagReport(vehicle, (1,), stamp_s=now_s + late_s))
        c.tell(now_s, facts.TagReport("uav1", (), stamp_s=now_s))
    return now_s


def test_a_recording_is_judged_by_the_pictures_that_the_map_takes():
    """One pair that is late, as before its first picture of one instant, decides nothing; a whole
    recording does."""
    c = flying(console(), 10.0)
    c.tell(19.9, facts.PictureCaptured("uav2", 19.7))
    now_s = recorded(c, 20.0, 0.004)
    assert c.view(now_s).stereo.skew_s == pytest.approx(0.004)
    c.tell(now_s + 0.1, facts.PictureCaptured("uav2", now_s - 0.1))
    c.tell(now_s + 0.1, facts.PictureCaptured("uav2", now_s + 0.9))
    assert c.view(now_s + 0.1).stereo.skew_s == pytest.approx(0.004)
    late = flying(console(), 10.0)
    now_s = recorded(late, 20.0, 0.05)
    assert late.view(now_s).stereo.skew_s == pytest.approx(0.05)
    assert "pictures are 50 ms apart" in late.view(now_s).stereo.remarks[0]


def test_pictures_of_a_pair_that_is_flown_at_once_are_of_one_instant():
    aged = hearing.Aged(facts.CameraPoseReport("uav1", (0.0, 0.0, 0.0), 0.0), 0.1, 30.0, False)
    row_ = console().file.rows[0]
    moving = hearing.Aged(facts.CameraPoseReport("uav2", row_.goal_m, 0.0), 0.1, 30.0, False)
    given = (row_, ("uav1", "uav2"), aged, moving, 0.05, 100.0, mission_file.Optics())
    fits = facts.EpipolarReport(("uav1", "uav2"), 0.6, 200, 0.4, 1.0)
    assert stereo.assess(*given, fits).go
    h = stereo.assess(*given, fits, at_once=True)
    assert h.words == ("NO-GO: what moves may be mapped wrongly: pictures are 50 ms apart")


def test_the_first_pictures_of_a_recording_that_come_late_are_no_verdict():
    """As flown: one picture of the time before arrives once it records; held for 3 s that was a
    NO-GO for all of it."""
    c = Console(["uav1", "uav2"], {"uav1": 1, "uav2": 2}, normal_s=0.0)
    c.load(OUTDOOR)
    flying(c, 19.0)
    c.tell(19.0, facts.CameraPoseReport("uav2", (0.0, -3.0, 0.0), 0.0))
    assert not doing(c, 19.5, HOLDS).stereo.go, "it is on its way"
    flying(c, 20.0)
    doing(c, 20.0, RECORDS)
    c.tell(20.0, facts.TagReport("uav1", (), stamp_s=20.0))
    c.tell(20.0, facts.TagReport("uav2", (1,), stamp_s=19.716))
    assert not c.view(20.0).stereo.judged, "there when it records, and no picture is compared"
    assert compared(c, 20.1).view(20.1).stereo.go
    assert c.view(recorded(c, 20.2, 0.0)).stereo.go


def test_what_was_taken_before_a_recording_is_not_of_it():
    c = flying(console(), 10.0)
    recorded(c, 20.0, 0.0)
    doing(c, 22.0, MOVES)
    now_s = recorded(c, 22.2, 0.08, count=4)
    assert c.view(now_s).stereo.skew_s == pytest.approx(0.08)


def test_stereo_health_takes_the_clock_offset_away_and_names_a_lost_place():
    c = flying(console(), 10.0)
    c.tell(10.0, facts.ClockReport("uav2", 5.0, 0.001))
    c.tell(10.0, facts.PictureCaptured("uav2", 15.0))
    assert c.view(10.1).stereo.skew_s == pytest.approx(0.0)
    for k in range(3):
        c.tell(11.0 + k, facts.MissionHeartbeat())
    assert "uav1's place is 3.0 s old" in c.view(13.0).stereo.words


def test_a_window_that_was_opened_a_moment_ago_has_no_verdict():
    c = console()
    c.tell(10.0, facts.CameraPoseReport("uav2", (0.0, -4.0, 0.0), 0.0))
    s = doing(c, 10.0, RECORDS).stereo
    assert not s.judged and s.words == "stereo: uav1's place in home is not known yet"
    c.tell(10.1, facts.OdometryReport("uav1", (0.0, 0.0, 0.0)))
    assert row(c, 10.1, "uav1").connection == "no state yet"


def test_who_goes_back_to_the_column_is_no_bad_pair():
    c = flying(console(), 10.0)
    c.tell(10.1, facts.CameraPoseReport("uav2", (-2.0, -1.0, 0.0), 0.0))
    assert "NO-GO" in c.view(10.1).stereo.words
    assert doing(c, 10.1, GOES_BACK).stereo.words == "stereo: no configuration is flown"
    assert doing(c, 10.1, TURNS).stereo.words == "stereo: no configuration is flown", (
        "who looks round looks elsewhere"
    )


def test_too_near_a_target_has_too_little_overlap():
    row_ = console().file.rows[4]  # 10 m apart
    aged = hearing.Aged(facts.CameraPoseReport("uav1", (0.0, 0.0, 0.0), 0.0), 0.1, 30.0, False)
    moving = hearing.Aged(facts.CameraPoseReport("uav2", (0.0, -10.0, 0.0), 0.0), 0.1, 30.0, False)
    h = stereo.assess(row_, ("uav1", "uav2"), aged, moving, math.nan, 12.0, mission_file.Optics())
    assert "of the picture is seen by both at 12 m" in h.words and not h.go


@pytest.mark.parametrize(
    "axis, place", [("horizontal", (0.0, -4.0, 0.0)), ("vertical", (0.0, 0.0, 4.0))]
)
def test_overlap_of_flown_poses_at_the_planned_places_is_the_plans(axis, place):
    """The plan's closed form along one axis against 48 x 36 pixels that are asked."""
    optics, z_m = mission_file.Optics(), 40.0
    front, moving = (
        facts.CameraPoseReport("uav1", (0.0, 0.0, 0.0), 0.0),
        facts.CameraPoseReport("uav2", place, 0.0),
    )
    shared = looking.seen_by_both(front, moving, z_m, optics)
    size = optics.width if axis == "horizontal" else optics.height
    assert shared == pytest.approx(1.0 - 4.0 * optics.focal_px / z_m / size, abs=1.0 / 36)


def test_lean_is_shown_and_a_camera_that_looks_elsewhere_takes_the_overlap():
    c = flying(console(), 10.0)
    level = c.view(10.1).stereo
    c.tell(
        10.1,
        facts.CameraPoseReport("uav2", (0.0, -4.0, 0.0), 0.0, math.radians(4.0), math.radians(8.0)),
    )
    h = c.view(10.1).stereo
    assert h.reasons and not h.judged
    assert (h.turn_deg, h.pitch_deg, h.roll_deg) == pytest.approx((0.0, 4.0, 8.0))
    assert h.overlap < level.overlap - 0.02
    assert "turned 0.0°, pitched 4.0°, rolled 8.0°" in cells.stereo_cell(c.view(10.1)).text
    c.tell(10.1, facts.CameraPoseReport("uav2", (0.0, -4.0, 0.0), math.radians(-60.0)))
    h = c.view(10.1).stereo
    assert h.overlap == 0.0 and "only 0% of the picture is seen by both" in h.words


def before(c, now_s, **told):
    """Home is set, the mission waits for execute; nothing was recorded."""
    for name in ("uav1", "uav2"):
        c.tell(now_s, facts.PreviewReport(name, now_s - 0.2 + told.get(name, 0.0)))
    c.tell(now_s, facts.MissionReport("SET_HOME", "home is set", "execute", 0, 8))
    return c


def test_stereo_health_is_known_before_the_first_recording():
    h = before(console(), 10.0).view(10.1).stereo
    assert (
        not h.judged
        and h.words == "stereo: no epipolar error yet: no home, or too little in common"
    )
    assert h.pair == ("uav1", "uav2") and h.skew_s == pytest.approx(0.0)
    c = before(console(), 10.0, uav2=0.012)
    c.tell(10.0, facts.EpipolarReport(("uav1", "uav2"), 2.5, 80))
    view = c.view(10.1)
    assert view.stereo.go and view.stereo.words.startswith("GO so far")
    assert "epipolar error 2.5 px, skew 12 ms" in cells.stereo_cell(view).text
    c.tell(10.1, facts.EpipolarReport(("uav1", "uav2"), 30.0, 80))
    c.tell(10.1, facts.ClockReport("uav2", 0.25, 0.001))
    before(c, 11.0, uav2=0.012)
    shown = c.view(11.1).stereo
    assert shown.words == "NO-GO: pictures and places disagree by 30 px across the epipolar lines"
    assert shown.remarks == ("what moves may be mapped wrongly: pictures are 238 ms apart",)


def test_before_the_first_recording_silent_pictures_are_not_known():
    c = before(console(), 10.0)
    c.tell(14.0, facts.MissionReport("SET_HOME", "home is set", "execute", 0, 8))
    assert "no pictures of both yet" in c.view(14.0).stereo.words
    for phase in ("LAND", "DONE", "ABORTED"):
        c.tell(14.0, facts.MissionReport(phase, "", "", 8, 8))
        assert c.view(14.0).stereo.words == "stereo: no configuration is flown"


def test_skew_is_between_pictures_of_the_same_moment_whichever_came_first():
    """uav1's picture of the next second is here already: it is not compared with uav2's of the one
    before."""
    c = console()
    for k in range(3):
        before(c, 10.0 + k, uav2=0.012)
    c.tell(12.5, facts.PreviewReport("uav1", 12.8))
    assert c.view(12.6).stereo.skew_s == pytest.approx(0.012)


def test_a_recorder_that_gets_no_pictures_says_for_how_long():
    c = console()

    def words(now_s):
        return dict(cells.vehicle_rows(c.view(now_s)))["recorder"][0].text

    for second in range(12):
        pictures = 3 * min(second, 4) + (second >= 10)  # none comes between 4 and 10 s
        c.tell(float(second), facts.Recorder("uav1", True, pictures, 0, math.inf))
        assert ("no picture" in words(second + 0.1)) == (7 <= second <= 9)
    c.tell(12.0, facts.Recorder("uav1", False, 13, 0, math.inf))
    c.tell(20.0, facts.Recorder("uav1", True, 13, 0, math.inf))
    assert words(20.1) == "RECORDS", "it waits from when it is on"
    c.tell(23.0, facts.Recorder("uav1", True, 13, 0, math.inf))
    assert words(23.1) == "RECORDS, no picture for 3 s"


def test_the_scripted_flight_of_the_pictures_in_the_docs_is_in_good_order():
    c = samples.console("config/missions/outdoor.yaml")
    samples.flying(c)
    rows = dict(cells.vehicle_rows(c.view(samples.NOW_S)))
    assert not [
        (name, cell.text)
        for name, found in rows.items()
        for cell in found
        if cell.tone in (cells.CARE, cells.BAD)
    ]


def test_the_height_is_above_where_a_vehicle_stood_however_its_odometry_began():
    c = console()
    assert row(c, 0.0).height_m is None
    for now_s, armed, z_m in ((1.0, False, 0.15), (2.0, True, 0.2), (5.0, True, 1.25)):
        c.tell(now_s, facts.AutopilotReport("uav2", True, armed, Mode.LOITER))
        c.tell(now_s, facts.OdometryReport("uav2", (0.0, 0.0, z_m)))
    c.tell(5.0, facts.CameraPoseReport("uav2", (0.0, 0.0, -6.7), 0.0))
    assert row(c, 5.0).height_m == pytest.approx(1.1) and cells.height(row(c, 5.0)) == "1.1 m up"
    assert dict(cells.vehicle_rows(c.view(5.0)))["mode"][1].text == "LOITER, ARMED, 1.1 m up"
    c.tell(5.1, facts.EpochReport("uav2", 2))
    assert cells.height(row(c, 5.2)) == "-6.7 m in home", "its odometry began anew in the air"
    c.tell(6.0, facts.AutopilotReport("uav2", True, False, Mode.LAND))
    c.tell(6.0, facts.OdometryReport("uav2", (0.0, 0.0, -0.3)))
    assert cells.height(row(c, 6.0)) == "on the ground"


def test_above_another_and_where_it_would_come_down():
    c = flying(console(), 10.0)
    c.tell(10.1, facts.CameraPoseReport("uav2", (0.2, -0.1, 5.0), 0.0))
    (found,) = c.view(10.2).above
    assert (found.upper, found.lower, found.down_m) == ("uav2", "uav1", (0.2, -0.1))
    assert found.words == "uav2 is 5.0 m above uav1, 0.2 m aside; it would come down at (0.2, -0.1)"
    c.tell(10.3, facts.AutopilotReport("uav1", True, False, Mode.LOITER))
    assert not c.view(10.3).above, "nobody flies beneath"


@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=2, max_size=4))
def test_who_is_above_is_never_beneath(places):
    named = {f"uav{i}": p for i, p in enumerate(places)}
    for a in air.above(named, SeparationRules(0.95)):
        assert (
            named[a.upper][2] > named[a.lower][2]
            and np.hypot(a.down_m[0] - named[a.lower][0], a.down_m[1] - named[a.lower][1]) < 0.95
        )


# ---- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fact, words",
    [
        (
            facts.OdometryReport("uav2", (math.nan, 0.0, 0.0)),
            "uav2 OdometryReport: p_odom_m holds nan",
        ),
        (facts.CameraPoseReport("uav2", (0.0, 0.0, math.inf), 0.0), "p_home_m holds inf"),
        (facts.CameraPoseReport("uav2", (0.0, 0.0, 0.0), math.nan), "heading_rad holds nan"),
        (facts.CameraPoseReport("uav2", (1e9, 0.0, 0.0), 0.0), "p_home_m"),
        (facts.BatteryReport("uav2", 7.0), "share is 7, not in 0..1"),
        (facts.AutopilotReport("uav9", True, True, Mode.GUIDED), "'uav9' is not one of uav1, uav2"),
        (
            facts.Unusable("uav2", "camera/color/image_raw", "encoding '13UC5' is not known"),
            "encoding '13UC5'",
        ),
    ],
)
def test_bad_input_is_named_and_changes_nothing(fact, words):
    c = flying(console(), 10.0)
    before = row(c, 10.1)
    for _ in range(3):
        c.tell(10.1, fact)
    assert row(c, 10.1) == before
    (said,) = [p for p in c.view(10.1).problems if words in p]
    assert said.endswith("(3 times)")
    assert [e for e in c.log.events if words in e.what][0].level == "warning"
    assert not [p for p in c.view(16.0).problems if words in p]


@given(st.floats(allow_nan=True, allow_infinity=True), st.text(max_size=5))
def test_no_number_and_no_name_ends_it(number, name):
    c = flying(console(), 10.0)
    for fact in (
        facts.OdometryReport(name, (number, number, number)),
        facts.CameraPoseReport("uav1", (number,) * 3, number),
        facts.BatteryReport("uav1", number, number),
        facts.ClockReport("uav2", number, number),
        facts.PictureCaptured("uav2", number),
        facts.Recorder("uav1", True, 0, 0, number),
        facts.RadioReport("uav1", number, number),
        facts.MapReport("x", "", number),
        facts.MissionReport(name, configuration=10**6, configurations=0),
        facts.TagReport("uav1", (-5,)),
        facts.FlightCheckReport((Line(name, "x", Grade.RED, ""),), 1.0),
    ):
        c.tell(10.0, fact)
    assert c.view(10.1).vehicles


def test_what_is_not_known_is_no_fault():
    assert not soundness.unsound(facts.BatteryReport("uav1", math.nan))
    assert not soundness.unsound(facts.Recorder("uav1", False, 0, 0, math.inf))


# ---- events --------------------------------------------------------------------------------------


def test_events_are_told_once_and_exported():
    c = flying(console(), 10.0)
    flying(c, 11.0)
    c.wall_offset_s = 1.7e9
    c.tell(11.1, facts.GuardianReport("uav2", "LAND", reasons=("battery empty",)))
    c.tell(11.2, facts.GuardianReport("uav2", "LAND", reasons=("battery empty",)))
    c.tell(11.3, facts.VehicleText("uav1", "autopilot", "EKF variance, failsafe", 2))
    c.tell(11.4, facts.Answered("uav1", "mission-1", 7, "refused: it is flown by hand"))
    told = [(e.who, e.what, e.level) for e in c.log.events]
    assert told.count(("uav2 guardian", "LAND: battery empty", "warning")) == 1
    assert ("uav1 autopilot", "EKF variance, failsafe", "warning") in told
    rows = c.log.as_csv().splitlines()
    assert rows[0] == "time_utc,who,what,answer,level" and len(rows) == len(told) + 1
    assert '2023-11-14T22:13:31.300+00:00,uav1 autopilot,"EKF variance, failsafe",,warning' in rows


def test_events_do_not_grow_without_bound():
    log = EventLog()
    first = log.add(0.0, "a", "b")
    for k in range(5000):
        log.add(float(k), "a", "b")
    log.answer(first, "too late", True)
    assert len(log.events) == 2000


def test_a_mission_that_dies_is_told_and_locks_its_actions():
    c = flying(console(), 10.0)
    assert c.view(14.0).headline == "THE MISSION IS NOT HEARD (was in CONFIGURATIONS)"
    assert c.view(14.0).actions["pause"].why_not.startswith("the mission node is not heard")


def test_the_epoch_decides_whether_a_calibration_holds():
    c = flying(console(), 10.0)
    assert row(c, 10.1).calibration == "not calibrated"
    c.tell(10.1, facts.EpochReport("uav2", 3))
    c.tell(10.1, facts.Calibrated((("uav1", 1), ("uav2", 3)), 120.0))
    assert row(c, 10.1).calibration == "2 min old"
    c.tell(10.2, facts.EpochReport("uav2", 4))
    assert row(c, 10.3).calibration == "OUTDATED: its odometry began anew"


# ---- a window that is opened in flight -----------------------------------------------------------


def test_a_window_that_is_opened_in_flight_shows_and_can_do_what_the_one_before_could():
    """It hears what is latched at once and what is streamed a moment later; what was rehearsed is
    asked for anew."""
    before, after = (rehearsed(flying(console(), 10.0)), flying(console(), 10.0))
    for c, at_s in ((before, 0.0), (after, 10.0)):
        c.tell(at_s, facts.Calibrated((("uav1", 1), ("uav2", 1)), 10.0 - at_s))
        c.tell(at_s, facts.HomeSet("uav1", 10.0 - at_s))
        c.tell(10.0, facts.MissionFlown(c.file.text))
    old, new = before.view(10.1), after.view(10.1)
    assert (new.headline, new.running, new.progress, new.home_set) == (
        old.headline,
        old.running,
        old.progress,
        True,
    )
    assert [(v.flier, v.armed, v.mode) for v in new.vehicles] == [
        (v.flier, v.armed, v.mode) for v in old.vehicles
    ]
    assert new.running == 1 and new.vehicles[1].flier.who == MISSION
    enabled = [
        {n: a.enabled for n, a in v.actions.items() if n not in ("waive", "rehearse")}
        for v in (old, new)
    ]
    assert (
        enabled[0] == enabled[1]
        and enabled[1]["pause"]
        and enabled[1]["abort"]
        and enabled[1]["land"]
    )
    flying(after, 11.0, waits_for="resume")
    assert after.view(11.1).actions["hand_over"].enabled, (
        "who holds in flight is never locked by a rehearsal"
    )


# ---- poses ---------------------------------------------------------------------------------------


def poses_shown(c, now_s):
    rows = dict(cells.vehicle_rows(c.view(now_s)))
    return [
        [cell.text for cell in rows[label]] for label in ("in odometry", "in home", "from others")
    ]


def test_every_vehicle_s_pose_in_its_odometry_in_home_and_against_the_others():
    c = Console(["uav1", "uav2", "uav3"], normal_s=0.0)
    c.tell(10.0, facts.OdometryReport("uav2", (1.0, 2.0, -0.04), math.radians(-90.0)))
    c.tell(10.0, facts.CameraPoseReport("uav1", (0.0, 0.0, 0.0), math.radians(179.0)))
    c.tell(10.0, facts.CameraPoseReport("uav2", (0.0, -6.0, 8.0), math.radians(-179.0)))
    odometry, home, others = poses_shown(c, 10.1)
    assert odometry == ["not known", "+1.0 +2.0 +0.0 m, -90°", "not known"]
    assert home == ["+0.0 +0.0 +0.0 m, +179°", "+0.0 -6.0 +8.0 m, -179°", "not known"]
    assert others[1] == "uav1: 10.00 m (+0.0 -6.0 +8.0), +2°\nuav3: not known"
    assert others[0].startswith("uav2: 10.00 m (+0.0 +6.0 -8.0), -2°")
    (of_uav1, of_uav3) = c.view(10.1).against_others("uav2")
    assert of_uav1.distance_m == 10.0 and of_uav1.known and not of_uav3.known


def test_a_distance_to_a_place_that_is_stale_is_not_told():
    c = Console(["uav1", "uav2"])
    c.tell(10.0, facts.CameraPoseReport("uav1", (0.0, 0.0, 0.0), 0.0))
    for k in range(20):
        c.tell(10.0 + 0.1 * k, facts.CameraPoseReport("uav2", (0.0, -6.0, 0.0), 0.0))
    assert poses_shown(c, 12.0)[2] == ["uav2: not known", "uav1: not known"]


# ---- what cameras on the ground see --------------------------------------------------------------


LEVEL = ((2.0, 1.0, 2.0), (2.0, -1.0, 2.0), (2.0, -1.0, 0.0), (2.0, 1.0, 0.0))


def test_what_cameras_on_the_ground_see_is_shown_as_long_as_it_is_heard():
    c = console()
    assert c.view(0.0).ground_views == (), "nothing is guessed"
    c.tell(0.0, facts.SeenFrom("", (0.0, 0.0, 1.0), LEVEL))
    c.tell(0.0, facts.SeenFrom("uav2", (0.5, 0.0, 1.0), LEVEL, age_s=1.0))
    mocap, gimbal = c.view(1.0).ground_views
    assert (mocap.words, gimbal.words) == ("mocap", "gimbal of uav2") and gimbal.eye_m == (0.5, 0.0)
    assert sorted(mocap.outline_m) == [(0.0, 0.0), (2.0, -1.0), (2.0, 1.0)]
    assert [v.words for v in c.view(2.0).ground_views] == ["mocap"], (
        "where the gimbal looks was read 3 s ago"
    )
    assert c.view(3.0).ground_views == ()


def test_a_guided_robot_is_shown_with_its_ground_and_route():
    c = console()
    assert c.view(0.0).guided_robot.ground is None
    cells = np.full((2, 3), -1, np.int8)
    c.tell(0.0, facts.RobotGround(5.0, -1.0, 0.5, 2, 3, cells.tobytes()))
    c.tell(0.0, facts.RobotRoute(((5.0, -1.0), (40.0, 2.0))))
    c.tell(0.1, facts.RobotSeen(5.5, -0.5, 0.3))
    c.tell(0.1, facts.RobotStatus("follower", "the robot drives"))
    shown = c.view(0.2).guided_robot
    assert shown.name == "robot" and shown.words == "the robot drives"
    assert above_view.fitted(c.view(0.2), 400.0, 400.0).px_per_m < 12.0, "the route is in it"
    late = c.view(9.0).guided_robot
    assert late.ground is not None and late.name == "robot, 8.9 s old"


def test_a_camera_that_looks_straight_up_is_a_square_about_its_eye():
    up = tuple((x, y, 4.0) for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)))
    c = console()
    c.tell(0.0, facts.SeenFrom("", (0.0, 0.0, 1.0), up))
    assert sorted(c.view(0.0).ground_views[0].outline_m) == [
        (-1.0, -1.0),
        (-1.0, 1.0),
        (1.0, -1.0),
        (1.0, 1.0),
    ]


def test_a_view_with_nan_is_refused_and_the_last_one_stays():
    c = console()
    c.tell(0.0, facts.SeenFrom("", (0.0, 0.0, 1.0), LEVEL))
    before = c.view(0.1).ground_views
    c.tell(0.1, facts.SeenFrom("", (0.0, 0.0, 1.0), ((2.0, math.nan, 2.0), *LEVEL[1:])))
    view = c.view(0.2)
    assert view.ground_views == before and "corners_m holds nan" in view.problems[0]


def test_the_picture_from_above_holds_all_that_cameras_on_the_ground_see():
    c = console()
    narrow = above_view.fitted(c.view(0.0), 400.0, 400.0)
    c.tell(
        0.0, facts.SeenFrom("", (0.0, 0.0, 1.0), tuple((x + 40.0, 9.0 * y, z) for x, y, z in LEVEL))
    )
    view = c.view(0.1)
    scale = above_view.fitted(view, 400.0, 400.0)
    assert scale.px_per_m < narrow.px_per_m
    assert all(0.0 <= px <= 400.0 for p in view.ground_views[0].outline_m for px in scale.to_px(*p))


# ---- diagnostics ---------------------------------------------------------------------------------


def diagnostics_of(c, now_s, name="uav2"):
    return cells.diagnostics(row(c, now_s, name))


def test_the_worst_line_of_a_vehicles_diagnostics_is_shown_and_its_end_too():
    c = console()
    assert diagnostics_of(c, 0.0) == cells.Cell("not heard", cells.GONE)
    c.tell(0.0, facts.Diagnosed("uav2"))
    assert diagnostics_of(c, 0.1) == cells.Cell("well", cells.QUIET)
    wrong = (("uav2/odometry: health", 2, "no poses"), ("", 1, "and 2 more"))
    c.tell(1.0, facts.Diagnosed("uav2", wrong))
    assert diagnostics_of(c, 1.1) == cells.Cell("ERROR odometry: no poses\nand 2 more", cells.BAD)
    c.tell(1.2, facts.Diagnosed("uav1", (("link uav1-control", 1, "slow"),)))
    assert diagnostics_of(c, 1.3, "uav1").text == "WARN link uav1-control: slow"
    c.tell(1.5, facts.Diagnosed("uav2", (("uav2/odometry: health", 1, "slow"), *wrong[1:])))
    assert diagnostics_of(c, 1.6).tone == cells.CARE
    events = [e.what for e in c.view(1.6).events if e.who == "uav2"]
    assert events == ["ERROR odometry: no poses", "WARN odometry: slow"], (
        "once for each change, with what it is"
    )
    assert diagnostics_of(c, 14.0) == cells.Cell("not heard for 12.5 s", cells.GONE)


@pytest.mark.parametrize("recorded", [True, False])
def test_what_the_bags_of_a_playback_do_not_have_is_told_and_in_flight_it_is_not_heard(
    monkeypatch, recorded
):
    hearing_of = pytest.importorskip("fcsv_console.ros.hearing")
    plays = {
        "/uav1/mavros/state",
        "/uav1/clock/offset",
        "/uav2/mavros/state",
        "/uav2/diagnostics/worst",
    }

    def subscriber(topic, *_args, **_kwargs):
        return SimpleNamespace(get_num_connections=lambda: int(topic in plays))

    monkeypatch.setattr(hearing_of.rospy, "Subscriber", subscriber)
    hearing = hearing_of.Hearing(["uav1", "uav2"], recorded)
    hearing._watch = SimpleNamespace(start=lambda: None)
    hearing.subscribe()
    for _ in range(3):
        hearing._look_at_bags()
    c = console()
    for _, fact in hearing.drain():
        c.tell(0.0, fact)
    absent = (
        cells.Cell("not in the bags", cells.QUIET)
        if recorded
        else cells.Cell("not heard", cells.GONE)
    )
    assert (
        diagnostics_of(c, 0.1, "uav1") == absent
        and diagnostics_of(c, 0.1, "uav2").text == "not heard"
    )
    clocks = next(of for label, of in cells.vehicle_rows(c.view(0.1)) if label == "clock")
    assert [cell.text for cell in clocks] == [
        "not known",
        "not in the bags" if recorded else "not known",
    ]
    assert row(c, 0.1, "uav1").connection == "never heard", (
        "that it is played is no sign of the vehicle's life"
    )


# ---- what does not flicker -----------------------------------------------------------------------


def judged(go, reason="", pair=("uav1", "uav2")):
    return StereoHealth(
        pair, go=go, reasons=(reason,) if reason else (), judged=True, skew_s=0.0 if go else 0.2
    )


def test_a_verdict_changes_where_the_other_lasts():
    steady, late = SteadyVerdict(), "the pictures are 200 ms apart"
    assert steady.at(10.0, 1, judged(True)).go
    shown = steady.at(11.0, 1, judged(False, late))
    assert shown.go and shown.reasons == () and shown.skew_s == 0.2, "figures are those of now"
    assert steady.at(12.0, 1, judged(True)).go
    assert steady.at(13.0, 1, judged(False, late)).go and steady.at(15.9, 1, judged(False, late)).go
    assert not steady.at(16.0, 1, judged(False, late)).go
    assert steady.at(17.0, 2, judged(True)).go, "another configuration is judged by itself"


def test_ten_flickering_recordings_have_one_verdict_each():
    steady = SteadyVerdict()
    for index in range(10):
        shown = [steady.at(0.1 * k, index, judged(k % 7 > 1, "late")).go for k in range(7, 100)]
        assert set(shown) == {shown[0]}


def test_a_diagnosis_that_comes_and_goes_is_one_event():
    c = console()
    for k in range(50):
        c.tell(
            10.0 + k, facts.Diagnosed("uav2", (("uav2/tags: health", 1, "slow"),) if k % 2 else ())
        )
    assert [e.what for e in c.view(61.0).events] == ["WARN tags: slow"]
    c.tell(200.0, facts.Diagnosed("uav2"))
    c.tell(201.0, facts.Diagnosed("uav2", (("uav2/tags: health", 1, "slow"),)))
    events = [e.what for e in c.view(201.1).events]
    assert events == ["WARN tags: slow", "diagnostics: well again", "WARN tags: slow"]


def test_an_odometry_that_began_anew_is_told_in_words():
    c = console()
    for now_s, epoch in ((10.0, 1795759387), (10.1, 1795759387), (12.0, 1795759388)):
        c.tell(now_s, facts.EpochReport("uav1", epoch))
    told = [e.what for e in c.view(13.0).events if e.who == "uav1"]
    assert told == ["its odometry began", "its odometry began anew"]


def test_a_recording_says_so_and_commands_nobody():
    c = Console(["uav1", "uav2"], {"uav1": 1, "uav2": 2}, recorded=True)
    c.load(OUTDOOR)
    view = flying(c, 10.0).view(10.1)
    assert view.headline == "RECORDING: 2 of 8: flies" and not view.guide.next
    assert {n for n, a in view.actions.items() if a.enabled} <= {"rehearse", "waive"}
    assert view.actions["stop_all"].why_not == "a recording is played: nobody flies"


def test_a_mission_that_ended_is_not_missed():
    c = flying(console(), 10.0, "DONE")
    c.tell(10.0, facts.MissionReport("DONE", "all configurations flown", "", 7, 8))
    view = c.view(40.0)
    assert view.headline == (
        "DONE: all configurations flown. The flight is over; After [F5] maps what was recorded"
    )
    assert (
        view.actions["land"].why_not
        == view.actions["pause"].why_not
        == "the mission is over (DONE)"
    )
    assert view.actions["stop_all"].enabled and not c.view(40.0).recorded
