# SPDX-License-Identifier: Apache-2.0
"""The headline of each phase, the one button that comes next, and what is normal at the start and
after the end."""

import dataclasses
import math
from pathlib import Path

import pytest

from fcsv_console.model import cells, facts, guide, samples
from fcsv_console.model.console import Console
from fcsv_console.model.what_next import calibration_words
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.vehicles.modes import Mode

OUTDOOR = Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml"
NAMES = ("uav1", "uav2")
GREEN = tuple(Line(name, "battery", Grade.GREEN, "80 %") for name in NAMES)


def console(rehearsed=True, **more):
    c = Console(NAMES, {"uav1": 1, "uav2": 2}, **more)
    c.load(OUTDOOR)
    if rehearsed:
        c.tell(0.0, facts.RehearsalProgress(c.file.text, "passed", words="8 of 8 recorded"))
    return c


def told(c, now_s, phase, waits_for="", detail="", lines=GREEN, problems=()):
    for name in NAMES:
        c.tell(now_s, facts.AutopilotReport(name, True, True, Mode.LOITER))
        c.tell(now_s, facts.BatteryReport(name, 0.8, 15.2))
    c.tell(now_s, facts.TagReport("uav2", (1,)))
    c.tell(now_s, facts.FlightCheckReport(tuple(lines)))
    c.tell(now_s, facts.MissionReport(phase, detail, waits_for, 0, 8, tuple(problems)))
    return c.view(now_s).guide


def lines(*states, since_s=5.0):
    return [
        Line("uav1", f"line{k}", state, "not so", since_s=since_s) for k, state in enumerate(states)
    ]


# ---- each phase ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "phase, waits_for, detail, words, button",
    [
        (
            "TAKE_OFF",
            "",
            "operators: take off in ALT_HOLD, then LOITER",
            "Operators: take off in ALT_HOLD",
            "",
        ),
        (
            "COLUMN",
            "calibrate",
            "operators: line up",
            "The column stands, every tag is in view. Hold still and Calibrate",
            "calibrate",
        ),
        ("CALIBRATE", "", "running", "Calibrating: hold still", ""),
        (
            "MOVE_HOME",
            "set_home",
            "ready",
            "Ready. Fly uav1 to its view, then Set home [H]",
            "set_home",
        ),
        ("SET_HOME", "", "running", "Setting home: hold still", ""),
        (
            "SET_HOME",
            "execute",
            "home is set",
            "Home is set. Execute [X] flies 8 configurations in about 1:24, batteries last 9:00",
            "execute",
        ),
        (
            "GUIDED",
            "",
            "handing over to the mission",
            "Handing over: handing over to the mission",
            "",
        ),
        (
            "CONFIGURATIONS",
            "",
            "uav2 on its way to horizontal 2 m",
            "1 of 8: uav2 on its way to horizontal 2 m",
            "",
        ),
        ("LAND", "", "all configurations flown", "Landing: All configurations flown", ""),
        (
            "DONE",
            "",
            "all configurations flown",
            "DONE: all configurations flown. The flight is over; After [F5] maps what",
            "after",
        ),
        (
            "ABORTED",
            "",
            "aborted by the operator",
            "ABORTED: aborted by the operator. The flight is over",
            "after",
        ),
    ],
)
def test_each_phase_has_a_headline_in_words_and_at_most_one_next_button(
    phase, waits_for, detail, words, button
):
    found = told(console(), 10.0, phase, waits_for, detail)
    assert found.headline.startswith(words) and found.next == button


def test_a_list_that_is_not_rehearsed_is_rehearsed_while_people_fly():
    c = console(rehearsed=False)
    assert told(c, 10.0, "TAKE_OFF").next == "rehearse"
    for phase in ("TAKE_OFF", "COLUMN"):
        lost = told(c, 10.5, phase, problems=("uav2: lost its position: land it by hand",))
        assert (lost.next, lost.sort) == ("", guide.CARE), (
            "who must land by hand has no time to rehearse"
        )
    home = told(c, 11.0, "SET_HOME", "execute")
    assert (
        home.next == "rehearse" and "Execute is locked: the list is not rehearsed" in home.headline
    )
    c.tell(12.0, facts.RehearsalProgress(c.file.text, "runs", 0.4))
    runs = told(c, 12.0, "SET_HOME", "execute")
    assert (runs.next, runs.sort) == ("", guide.WAITS)
    assert runs.headline == "Home is set. Execute is locked: the list is being rehearsed: 40 %"
    assert c.view(12.0).rehearsal.summary == "is being rehearsed: 40 %"


def test_the_calibration_is_told_with_its_figures_and_what_comes_then():
    c = console()
    told(c, 10.0, "CALIBRATE", detail="running")
    link = facts.CalibratedLink("uav2", "uav1", 25, 0, 0.012, math.radians(0.13))
    c.tell(10.5, facts.CalibrationReport((link,)))
    found = told(c, 11.0, "MOVE_HOME", "set_home", "uav2 against uav1: 25 detections (0 rejected)")
    assert (
        found.headline
        == "Calibrated well: 25 views, 0.13°. Fly uav1 to its view, then Set home [H]"
    )
    assert (found.next, found.sort) == ("set_home", guide.WELL)
    told(c, 12.0, "SET_HOME", detail="running")
    again = told(c, 13.0, "MOVE_HOME", "set_home", "the odometry of uav1 is 2.1 s old")
    assert (
        again.headline.startswith("The odometry of uav1 is 2.1 s old. Fly uav1")
        and again.sort == guide.CARE
    )


@pytest.mark.parametrize(
    "used, rejected, yaw_deg, sort, words",
    [
        (25, 0, 0.13, guide.WELL, "Calibrated well: 25 views, 0.13°"),
        (25, 0, 0.6, guide.CARE, "Calibrated poorly: 25 views, 0.60°; the map counts on 0.3°"),
        (10, 15, 0.1, guide.CARE, "Calibrated poorly: 10 views, 0.10°, 15 views disagreed"),
        (25, 0, math.nan, guide.CARE, "Calibrated poorly: 25 views, nan°; the map counts on 0.3°"),
    ],
)
def test_a_calibration_is_judged_by_what_the_map_counts_on(used, rejected, yaw_deg, sort, words):
    link = facts.CalibratedLink("uav2", "uav1", used, rejected, 0.01, math.radians(yaw_deg))
    assert calibration_words(facts.CalibrationReport((link,))) == (sort, words)
    better = dataclasses.replace(link, child="uav3", used=90, rejected=0, yaw_std_rad=0.0001)
    assert "(uav2)" in calibration_words(facts.CalibrationReport((better, link)))[1] or math.isnan(
        yaw_deg
    )


def test_a_calibration_that_is_refused_says_why():
    c = console()
    told(c, 10.0, "CALIBRATE")
    found = told(c, 11.0, "COLUMN", "calibrate", "only 3 detections of uav1")
    assert found.headline.startswith("Calibration refused: only 3 detections of uav1. Hold still")
    c.tell(12.0, facts.TagReport("uav2", ()))
    for _ in range(40):
        c.tell(20.0, facts.TagReport("uav2", ()))
    blind = told(console(), 20.0, "COLUMN", "", "operators: line up, every tag in view")
    assert blind.next == "" and blind.headline.startswith("Operators: line up, every tag in view. ")


def test_amber_lines_alone_are_accepted_next():
    amber = [Line("uav2", "disk", Grade.AMBER, "1.2 GB left")]
    found = told(console(), 10.0, "WAIT_VEHICLES", lines=(*GREEN, *amber))
    assert (found.headline, found.next) == (
        "1 amber line to accept or mend: uav2 disk",
        guide.ACCEPT,
    )
    home = told(console(), 10.0, "SET_HOME", "execute", lines=(*GREEN, *amber))
    assert home.next == guide.ACCEPT


def test_a_mission_that_falls_silent_and_a_pause_keep_their_words():
    c = console()
    told(c, 10.0, "CONFIGURATIONS")
    assert (
        c.view(20.0).headline == "THE MISSION IS NOT HEARD (was in CONFIGURATIONS)"
        and not c.view(20.0).guide.next
    )
    paused = told(c, 21.0, "CONFIGURATIONS", "resume", problems=("paused by the operator",))
    assert (paused.headline, paused.next) == (
        "PAUSED: paused by the operator. Resume goes on",
        "hand_over",
    )


# ---- what is normal at the start -----------------------------------------------------------------


def shown(c, now_s):
    """(state, tone) of each line of the flight check as the table shows it."""
    view = c.view(now_s)
    return [
        (found[2].text, found[2].tone)
        for found in (cells.check_cells(li, view.waits(li)) for li in cells.check_lines(view))
    ]


def test_lines_that_are_red_at_every_start_wait_for_a_minute_and_are_red_after_it():
    c = console()
    early = told(c, 10.0, "WAIT_VEHICLES", lines=(*GREEN, *lines(Grade.RED, Grade.UNKNOWN)))
    assert (
        early.headline
        == "Starting, normal for about a minute: 2 checks of 4 to go (uav1 line0, uav1 line1)"
    )
    assert early.sort == guide.WAITS and set(shown(c, 10.0)) == {("waiting", cells.QUIET)}
    assert cells.check_words(c.view(10.0)) == cells.Cell(
        "flight check: starting, 2 of 4 lines green", cells.QUIET
    )
    c.tell(10.0, facts.Diagnosed("uav1", (("uav1/tags: health", 2, "no pictures"),)))
    assert rows(c, 10.0)["diagnostics"][0] == cells.Cell("ERROR tags: no pictures", cells.QUIET)
    assert cells.problems_tone(c.view(10.0)) == cells.QUIET and c.log.events[-1].level == "info"
    late = told(
        c, 66.0, "WAIT_VEHICLES", lines=(*GREEN, *lines(Grade.RED, Grade.UNKNOWN, since_s=61.0))
    )
    assert (
        late.headline == "Not ready: uav1 line0: not so; 2 checks of 4 left"
        and late.sort == guide.CARE
    )
    assert shown(c, 66.0) == [("RED", cells.BAD), ("unknown", cells.GONE)]
    c.tell(66.0, facts.Diagnosed("uav1", (("uav1/tags: health", 2, "no pictures"),)))
    assert (
        rows(c, 66.0)["diagnostics"][0].tone == cells.BAD
        and cells.problems_tone(c.view(66.0)) == cells.CARE
    )


def test_a_line_that_had_passed_is_red_at_once_and_nothing_waits_once_people_fly():
    c = console()
    told(c, 10.0, "WAIT_VEHICLES", lines=lines(Grade.GREEN, Grade.RED))
    told(c, 12.0, "WAIT_VEHICLES", lines=lines(Grade.RED, Grade.RED))
    assert shown(c, 12.0) == [("RED", cells.BAD), ("waiting", cells.QUIET)]
    told(c, 13.0, "TAKE_OFF", lines=lines(Grade.RED, Grade.RED))
    assert shown(c, 13.0) == [("RED", cells.BAD)] * 2


def test_a_window_that_is_opened_late_sees_how_long_a_line_has_been_red():
    c = console()
    told(c, 500.0, "WAIT_VEHICLES", lines=lines(Grade.RED, since_s=300.0))
    assert shown(c, 500.0) == [("RED", cells.BAD)]


def rows(c, now_s):
    return dict(cells.vehicle_rows(c.view(now_s)))


def test_what_was_not_heard_yet_waits_and_what_stopped_does_not():
    c = Console(NAMES)
    assert {
        found[0].text for label, found in rows(c, 0.0).items() if found[0].tone == cells.QUIET
    } >= {"waiting"}
    assert not [
        cell
        for found in rows(c, 1.0).values()
        for cell in found
        if cell.tone in (cells.GONE, cells.BAD)
    ]
    assert rows(c, 1.0)["in home"][0].text == "home is not set yet"
    c.tell(2.0, facts.OdometryReport("uav1", (0.0, 0.0, 0.0)))
    assert rows(c, 9.0)["pose"][0] == cells.Cell("stopped 7.0 s ago", cells.GONE)
    assert rows(c, 61.0)["pose"][1] == cells.Cell("never", cells.GONE)


# ---- and after the end ---------------------------------------------------------------------------


def test_after_the_end_machines_that_are_switched_off_are_nothing_to_worry_about():
    c = console()
    told(c, 100.0, "DONE", detail="all configurations flown")
    for name in NAMES:
        c.tell(100.0, facts.AutopilotReport(name, True, False, Mode.LAND))
    c.tell(104.0, facts.MasterReport("the ROS master does not answer"))
    view = c.view(160.0)
    assert view.ended and view.problems == () and view.progress == 1.0
    assert not [
        cell for _, found in cells.vehicle_rows(view) for cell in found if cell.tone != cells.QUIET
    ]
    assert rows(c, 160.0)["connection"][0].text == "off for 1 min"
    assert cells.check_words(view) == cells.Cell("flight check: the flight is over", cells.QUIET)
    assert [(e.what, e.level) for e in view.events][-1] == ("the flight's machines are off", "info")


def test_a_vehicle_whose_motors_were_not_seen_to_stop_stays_conspicuous():
    c = console()
    told(c, 100.0, "DONE")
    assert rows(c, 160.0)["flown by"][0].tone == cells.GONE


@pytest.mark.parametrize("name", samples.SAMPLES)
def test_events_of_every_situation_are_in_order_of_time(name):
    c = samples.console(str(OUTDOOR))
    samples.SAMPLES[name](c)
    times = [e.wall_s for e in c.view(samples.NOW_S).events]
    assert times and times == sorted(times)
