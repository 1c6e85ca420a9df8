# SPDX-License-Identifier: Apache-2.0
"""A list is rehearsed before Execute is enabled, in a child process; and planned from range and
error."""

import math
import sys
import threading
from pathlib import Path

import pytest
from support.waiting import within

from fcsv_console.children import child as children
from fcsv_console.children.rehearse import Rehearser
from fcsv_console.model import actions, facts, planning
from fcsv_console.model.console import Console
from fcsv_console.model.rehearsal import judged
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_stereo.equations import ErrorThreshold, farthest

OUTDOOR = Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml"
FLOWN = {
    "violations": [],
    "captures": 8,
    "wanted": 8,
    "flown_s": 190.0,
    "nearest_m": 1.66,
    "phase": "DONE",
}


def waiting(configurations=8):
    """The mission waits for execute; the flight check is green; nothing was rehearsed."""
    c = Console(["uav1", "uav2"])
    c.load(OUTDOOR)
    c.tell(10.0, facts.FlightCheckReport((Line("uav1", "battery", Grade.GREEN, "80 %"),)))
    c.tell(10.0, facts.MissionReport("SET_HOME", "home is set", "execute", 0, configurations))
    return c


def why(c, name="execute"):
    return c.view(10.1).actions[name].why_not


def told(c, state, share=math.nan, words="", text=None):
    c.tell(
        10.0, facts.RehearsalProgress(c.file.text if text is None else text, state, share, words)
    )


# ---- what it locks -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["execute", "hand_over"])
def test_the_list_is_not_handed_over_before_it_was_rehearsed(name):
    c = waiting()
    assert why(c, name) == "the list is not rehearsed: rehearse it [V]"
    told(c, "runs", 0.25)
    told(c, "runs")
    assert why(c, name) == "the list is being rehearsed: 25 %", (
        "a line without a share keeps the one before"
    )
    told(c, "broken", words="fence at 31 s (uav2 is outside)")
    assert why(c, name) == "REHEARSAL BROKE: fence at 31 s (uav2 is outside)"
    told(c, "stopped")
    assert why(c, name) == "the list is not rehearsed: rehearse it [V]; the last one was stopped"
    told(c, "passed", words="8 of 8 recorded in 3:10")
    assert (
        why(c, name) == ""
        and c.view(10.1).rehearsal.summary == "rehearsed: 8 of 8 recorded in 3:10"
    )


def test_an_outcome_holds_for_the_text_that_was_flown():
    c = waiting()
    told(c, "passed")
    before = c.file.text
    c.drag(0, 3.0)
    assert why(c).startswith("the list is not rehearsed")
    told(c, "passed", text="another")
    assert why(c).startswith("the list is not rehearsed")
    c.edit(before)
    assert why(c) == ""


def test_vehicles_that_hold_in_flight_are_handed_over_unrehearsed():
    c = waiting()
    c.tell(10.0, facts.MissionReport("CONFIGURATIONS", "", "resume", 2, 8))
    assert why(c, "hand_over") == "" and why(c, "rehearse") == "the mission flies its list"


def test_another_list_than_the_mission_s_is_not_executed():
    c = waiting(configurations=7)
    told(c, "passed")
    assert (
        why(c)
        == "the mission has 7 configurations, the list shown 8: it reads its file when it starts"
    )
    c.edit(c.file.text + "pa: 1\n")
    assert why(c) == why(c, "rehearse") == "mission file: line 13: pa: is not known"


@pytest.mark.parametrize(
    "before, after, words",
    [
        (
            "baseline_m: 6.0",
            "baseline_m: 6.5",
            "configuration 3: baseline_m is 6.0 there, 6.5 here",
        ),
        (
            "axis: vertical, baseline_m: 7.0",
            "axis: horizontal, baseline_m: 7.0",
            "configuration 7: axis is vertical there",
        ),
        ("name: ", "flight: {speed_mps: 1.0}\nname: ", "other flight"),
    ],
)
def test_another_list_of_the_same_length_is_not_executed(before, after, words):
    c = waiting()
    c.tell(10.0, facts.MissionFlown(c.file.text))
    told(c, "passed")
    assert why(c) == ""
    assert c.file.text.count(before) == 1
    c.edit(c.file.text.replace(before, after))
    told(c, "passed")
    assert why(c).startswith(
        f"the mission flies another file: {words}"
    ) and "when it starts" in why(c)
    c.tell(10.0, facts.MissionFlown(c.file.text))  # the node was started again
    assert why(c) == ""


def test_a_comment_or_another_name_is_no_other_list():
    c = waiting()
    c.tell(10.0, facts.MissionFlown(c.file.text))
    c.edit(c.file.text.replace("name: ", "name: my_") + "# mine\n")
    told(c, "passed")
    assert why(c) == ""


def test_where_no_file_is_named_the_mission_s_own_is_shown():
    text = waiting().file.text
    c = Console(["uav1", "uav2"])
    c.tell(10.0, facts.MissionFlown("configurations: ["))
    assert c.file.error is not None and c.file.mission is None
    c = Console(["uav1", "uav2"])
    c.tell(10.0, facts.MissionFlown(text))
    assert len(c.file.rows) == 8 and c.file.source == ""
    c.drag(0, 3.0)
    c.tell(11.0, facts.MissionFlown(text))
    assert c.file.rows[0].baseline_m == 3.0, "what is edited stays"


def test_the_operator_may_fly_it_unrehearsed_and_that_is_told():
    c = waiting()
    told(c, "impossible", words="rosrun: is not installed here")
    assert why(c, "waive") == "" and "cannot be rehearsed" in why(c)
    c.waive(10.0)
    assert why(c) == "" and why(c, "waive") == "the list may be flown"
    assert [(e.who, e.what) for e in c.log.events][-1] == ("operator", "fly the list unrehearsed")
    c.drag(0, 3.0)
    assert "not rehearsed" in why(c), "for this text alone"
    assert next(a for a in actions.TABLE if a[0] == "waive")[4] == 1.0, "held for a second"


def test_what_became_of_it_is_an_event_once():
    c = waiting()
    told(c, "runs", 0.5)
    told(c, "broken", words="contact at 3 s (both)")
    assert [(e.who, e.what, e.level) for e in c.log.events if e.who == "rehearsal"] == [
        ("rehearsal", "broken: contact at 3 s (both)", "warning")
    ]


@pytest.mark.parametrize(
    "status, last, flown, state, words",
    [
        (0, "", [FLOWN], "passed", "8 of 8 recorded in 3:10, never nearer than 1.7 m"),
        (
            0,
            "",
            [{**FLOWN, "captures": 3, "phase": "LAND", "detail": "battery empty"}],
            "broken",
            "3 of 8 recorded, then LAND: battery empty",
        ),
        (
            1,
            "",
            [{**FLOWN, "violations": [{"kind": "fence", "at_s": 31.2, "text": "uav2"}]}],
            "broken",
            "fence at 31 s (uav2)",
        ),
        (1, "", [FLOWN], "broken", "exit status 1"),
        (
            3,
            "rehearse: mission 'a' cannot be flown: too near",
            None,
            "broken",
            "mission 'a' cannot be flown: too near",
        ),
        (127, "rosrun: command not found", None, "impossible", "rosrun: command not found"),
        (-9, "", None, "impossible", "it told nothing"),
        (0, "wrote", None, "impossible", "wrote"),
    ],
)
def test_what_a_rehearsal_tells_is_judged(status, last, flown, state, words):
    found = judged("text", status, last, flown)
    assert (found.state, found.words) == (state, words)


# ---- the child process ---------------------------------------------------------------------------


def program(tmp_path, body):
    """A stand-in for the command ``rehearse``, run by this interpreter; argv[1] is the mission."""
    path = tmp_path / "program.py"
    path.write_text(f"import json, sys, time\nout = sys.argv[sys.argv.index('--json') + 1]\n{body}")
    return [sys.executable, str(path)]


@pytest.fixture
def rehearser():
    """rehearser(command) -> (Rehearser, what it told, wait for its end); its child ends with the
    test."""
    made = []

    def make(command, vehicles=("uav1", "uav2")):
        heard, over = [], threading.Event()

        def put(fact):
            heard.append(fact)
            if fact.state != "runs":
                over.set()

        made.append(Rehearser(put, vehicles, command))
        return made[-1], heard, lambda: over.wait(20.0)

    yield make
    for one in made:
        one.close()


def test_it_is_flown_in_a_child_process_with_its_progress(rehearser, tmp_path):
    body = f"""assert "baseline_m: 7.0" in open(sys.argv[1]).read()
assert sys.stderr.isatty(), "else no progress is shown"
from tqdm import tqdm
with tqdm(total=4, disable=None, mininterval=0.0) as bar:
    [bar.update(1) for _ in range(4)]
open(out, "w").write(json.dumps([{FLOWN!r}]))
"""
    one, heard, ended = rehearser(program(tmp_path, body))
    one.start("baseline_m: 7.0")
    assert ended() and heard[-1].state == "passed" and heard[-1].text == "baseline_m: 7.0"
    assert [t.share for t in heard if not math.isnan(t.share)][:4] == [0.0, 0.25, 0.5, 0.75]


def lives(pid):
    """Whether a process runs; one that ended and was not fetched does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


until = within(10.0)


def test_one_that_is_stopped_ends_with_all_that_it_started():
    body = "import subprocess, time\nprint(subprocess.Popen(['sleep', '60']).pid, flush=True)\ntime.sleep(60)\n"
    lines, ends = [], []
    one = children.Child(
        [sys.executable, "-c", body],
        lambda _share, line: lines.append(line),
        lambda status, _last: ends.append(status),
    )
    until(lambda: lines, what="its line")
    assert lives(lines[0])
    one.cancel()
    one.wait()
    until(lambda: not lives(lines[0]), what="its own child ends")
    assert not one.runs and ends and ends[0] != 0


def test_a_rehearsal_that_is_stopped_says_so(rehearser, tmp_path):
    one, heard, ended = rehearser(program(tmp_path, "time.sleep(60)"))
    one.start("a")
    one.cancel()
    assert ended() and heard[-1].state == "stopped"


@pytest.mark.parametrize(
    "body, words",
    [
        ("sys.exit('rehearse: no such mission')", "no such mission"),
        ("open(out, 'w').write('{')", "it told nothing"),
    ],
)
def test_one_that_fails_says_why(rehearser, tmp_path, body, words):
    one, heard, ended = rehearser(program(tmp_path, body))
    one.start("a")
    assert ended() and (heard[-1].state, heard[-1].words) == ("impossible", words)


def test_what_cannot_be_started_is_told(rehearser):
    one, heard, ended = rehearser(["no-such-program"])
    one.start("a")
    assert ended() and heard[-1].state == "impossible" and "no-such-program: " in heard[-1].words
    one, heard, ended = rehearser(["true"], ["left", "right"])
    one.start("a")
    assert heard[-1].words == "it flies uav1, uav2 only, these are left, right"


# ---- planning ------------------------------------------------------------------------------------


def test_a_plan_stands_in_place_of_the_list_and_all_else_stays():
    c = waiting()
    c.edit(
        "name: mine # keep\nconfigurations:\n  - axis: vertical\n    baseline_m: 5.0  # up\n# fence of the field\n"
        "fence: {radius_m: 40.0}\n"
    )
    assert c.file.mission is not None
    done = c.plan(planning.Wanted(300.0, "10%", 3, "horizontal", False))
    assert done.problem == "" and any("3 configurations, to 300 m" in note for note in done.notes)
    assert c.file.text.startswith("name: mine # keep\nconfigurations:\n  - {axis: horizontal,")
    assert (
        c.file.text.endswith("# fence of the field\nfence: {radius_m: 40.0}\n")
        and c.file.error is None
    )
    longest = c.file.rows[-1].baseline_m
    assert len(c.file.rows) == 3
    assert farthest(longest, 602.0, ErrorThreshold(0.1, True)) == pytest.approx(300.0, rel=1e-3), (
        "baselines are in mm"
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "name: a\n",
        "name: a\nconfigurations:\n",
        "name: a\nconfigurations: []",
        "configurations: [{axis: up}]\nname: a\n",
        "name: [a\n",
    ],
)
def test_a_plan_fits_into_any_file(text):
    c = waiting()
    c.edit(text)
    assert c.plan(planning.Wanted()).problem == "" and c.file.error is None and c.file.rows


@pytest.mark.parametrize(
    "wanted, words",
    [
        (planning.Wanted(-1.0), "--range-m -1 must be positive"),
        (planning.Wanted(400.0, "much"), "error threshold 'much' is not understood"),
        (planning.Wanted(400.0, "10%", 0), "--number 0 is not in 1..50"),
        (planning.Wanted(400.0, "10%", 2, "up"), "--axis"),
        (planning.Wanted(2.0, "10%", 4, "horizontal", False), "the mission could not be flown"),
        (planning.Wanted(math.nan), "must be positive"),
    ],
)
def test_a_plan_that_cannot_be_says_why_and_changes_nothing(wanted, words):
    c = waiting()
    before = c.file
    assert words in c.plan(wanted).problem and c.file is before


def test_a_file_in_braces_keeps_its_text():
    c = waiting()
    c.edit("{name: a, configurations: [{axis: vertical, baseline_m: 5.0}]}")
    before = c.file.text
    assert "without braces" in c.plan(planning.Wanted()).problem and c.file.text == before
