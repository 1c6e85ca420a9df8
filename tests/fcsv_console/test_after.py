# SPDX-License-Identifier: Apache-2.0
"""After the flight: gathering and mapping as child processes that can be stopped, the report, and
what is locked."""

import math
import os
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from fcsv_console.children.after import AfterRunner
from fcsv_console.model import after, facts, samples
from fcsv_console.model.console import Console
from fcsv_geometry.vehicles.modes import Mode

OUTDOOR = str(Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml")
PLACES = after.Places("uav1=uav1:fcsv/session control=fcsv/session", "out/flight", "out/map")


def landed():
    c = Console(["uav1", "uav2"])
    c.after.places = PLACES
    c.tell(1.0, facts.PlacesFound(True, True))
    for name in ("uav1", "uav2"):
        c.tell(1.0, facts.AutopilotReport(name, True, False, Mode.LAND))
    return c


def step(c, name):
    return next(s for s in c.view(1.1).after if s.name == name)


def test_all_can_be_done_on_the_ground_and_only_the_report_in_flight():
    c = landed()
    assert [s.why_not for s in c.view(1.1).after] == ["", "", ""]
    c.tell(1.0, facts.AutopilotReport("uav2", True, True, Mode.GUIDED))
    assert (
        step(c, "gather").why_not == "the motors of uav2 run: radio and processor are the flight's"
    )
    assert step(c, "map").why_not == step(c, "gather").why_not and step(c, "report").why_not == ""


@pytest.mark.parametrize(
    "places, name, words",
    [
        (after.Places("", "s", "m"), "gather", "nothing is to be gathered"),
        (after.Places("uav1=a", "", "m"), "gather", "name the session's folder"),
        (after.Places("uav1=a", "s", ""), "map", "name a folder for the map"),
    ],
)
def test_what_is_not_named_locks(places, name, words):
    c = landed()
    c.after.places = places
    assert step(c, name).why_not.startswith(words)


def test_what_is_not_there_locks():
    c = landed()
    c.tell(1.0, facts.PlacesFound(False, False))
    assert (
        step(c, "map").why_not
        == "there is neither session.yaml nor a bag in out/flight: gather first"
    )
    assert (
        step(c, "report").why_not == "there is no report in out/map"
        and step(c, "gather").why_not == ""
    )
    c.after.places = after.Places("", "s", "m")
    assert step(c, "gather").why_not.startswith("name the machines")


def test_one_at_a_time_with_progress_and_each_end_is_one_event():
    c = landed()
    c.tell(1.0, facts.JobProgress("gather", "runs", 0.25))
    c.tell(1.0, facts.JobProgress("gather", "runs", math.nan, "uav1: uav1.bag"))
    gather = step(c, "gather")
    assert (gather.share, gather.why_not, gather.tooltip) == (0.25, "", "Stop it")
    assert step(c, "map").why_not == "'gather' runs"
    c.tell(1.0, facts.JobProgress("gather", "failed", words="uav2: there is no uav2.bag"))
    assert (
        step(c, "gather").summary == "FAILED: uav2: there is no uav2.bag"
        and step(c, "map").why_not == ""
    )
    assert [(e.who, e.what, e.level) for e in c.log.events if e.who == "gather"] == [
        ("gather", "runs", "info"),
        ("gather", "failed: uav2: there is no uav2.bag", "error"),
    ]


def test_where_all_record_into_one_folder_nothing_is_gathered_and_the_map_comes_next():
    c = landed()
    c.after.places = after.Places("", "out/demo/session", "out/demo/map")
    c.tell(1.0, facts.PlacesFound(True, False))
    gather, made, report = c.view(1.1).after
    assert (
        gather.why_not == "nothing is to be gathered: all machines recorded into out/demo/session"
    )
    assert (gather.next, made.next, report.next) == (False, True, False)
    c.tell(1.0, facts.PlacesFound(True, True))
    assert [s.next for s in c.view(1.1).after] == [False, False, True]
    assert c.view(1.1).guide.headline.startswith("Starting"), "no mission was heard here"
    c.tell(1.0, facts.JobProgress("map", "runs", 0.2))
    assert not [s for s in c.view(1.1).after if s.next]


def test_a_session_that_is_still_written_or_mapped_by_another_is_not_mapped():
    c = landed()
    c.tell(1.0, facts.PlacesFound(True, False, recording=True))
    assert step(c, "map").why_not.startswith("a bag in out/flight is still written")
    c.tell(1.0, facts.PlacesFound(True, True, mapping=True))
    assert (
        step(c, "map").why_not == "another command makes a map in out/map just now"
        and step(c, "report").next
    )


def test_places_of_a_simulation_are_those_of_its_one_folder(tmp_path):
    pytest.importorskip("rospy")
    from fcsv_console.ros.shell import shared_places

    assert shared_places(str(tmp_path / "session")) == after.Places(
        "", str(tmp_path / "session"), str(tmp_path / "map")
    )


# ---- child processes -----------------------------------------------------------------------------


@pytest.fixture
def runner(tmp_path):
    """runner(body) -> (AfterRunner, heard, ended): the job is this interpreter with ``body``; it
    ends with the test."""
    made = []

    def make(body):
        heard, over = [], threading.Event()

        def put(fact):
            heard.append(fact)
            if isinstance(fact, facts.PlacesFound):
                over.set()

        path = tmp_path / "job.py"
        path.write_text(f"import os, sys, time\n{body}")
        made.append(
            AfterRunner(
                put, {job: [sys.executable, str(path)] for job in (after.GATHER, after.MAP)}
            )
        )
        return made[-1], heard, lambda: over.wait(20.0)

    yield make
    for one in made:
        one.close()


def jobs(heard):
    return [h for h in heard if isinstance(h, facts.JobProgress)]


def test_a_map_is_made_with_its_progress_and_then_there_is_a_report(runner, tmp_path):
    body = """session, _, out = sys.argv[1:]
from tqdm import tqdm
for _ in tqdm(range(2), disable=None, mininterval=0.0): pass
os.makedirs(out); open(out + "/report.html", "w").close()
print("wrote", os.path.basename(out))
"""
    one, heard, ended = runner(body)
    places = after.Places("", str(tmp_path), str(tmp_path / "my map"))
    one.start("map", places)
    assert ended() and jobs(heard)[-1].state == "done"
    assert jobs(heard)[-1].words == "wrote my map" and {0.0, 0.5, 1.0} <= {
        j.share for j in jobs(heard)
    }
    assert heard[-1] == facts.PlacesFound(False, True)
    (tmp_path / "uav1.bag").write_bytes(b"")
    one.look(places)
    assert heard[-1] == facts.PlacesFound(True, True), "bags alone are mapped too"


def test_a_bag_that_is_still_written_and_a_map_that_another_makes_are_seen(runner, tmp_path):
    one, heard, _ = runner("time.sleep(60)\n")
    places = after.Places("", str(tmp_path), str(tmp_path / "map"))
    (tmp_path / "session.yaml").write_text("")
    (tmp_path / "uav1.bag.active").write_bytes(b"")
    one.look(places)
    assert heard[-1] == facts.PlacesFound(True, False, recording=True)
    (tmp_path / "uav1.bag.active").unlink()
    (tmp_path / ".map.being_made").touch()
    one.look(places)
    assert heard[-1] == facts.PlacesFound(True, False, mapping=True)
    os.utime(tmp_path / ".map.being_made", (0, 0))
    one.look(places)
    assert heard[-1] == facts.PlacesFound(True, False), "left by a command that was killed"
    (tmp_path / ".map.being_made").touch()
    one.start("map", places)
    one.look(places)
    assert heard[-1] == facts.PlacesFound(True, False), "its own"
    one.cancel("map")


def test_machines_are_split_as_a_shell_does(runner, tmp_path):
    one, heard, ended = runner("print(sys.argv[1:])\n")
    one.start("gather", after.Places("uav1=h:a 'control=my folder'", "~/s", ""))
    home = str(Path.home() / "s")
    assert ended() and jobs(heard)[-1].words == f"['{home}', 'uav1=h:a', 'control=my folder']"
    one, heard, ended = runner("")
    one.start("gather", after.Places("uav1='a", "s", ""))
    assert jobs(heard)[-1].state == "failed" and "quotation" in jobs(heard)[-1].words


def test_one_that_fails_says_why_and_one_that_is_stopped_says_so(runner):
    one, heard, ended = runner("sys.exit('map: out/flight: no session.yaml')\n")
    one.start("map", PLACES)
    assert ended() and (jobs(heard)[-1].state, jobs(heard)[-1].words) == (
        "failed",
        "out/flight: no session.yaml",
    )
    one, heard, ended = runner("time.sleep(60)\n")
    one.start("map", PLACES)
    one.cancel("map")
    assert ended() and jobs(heard)[-1].state == "stopped"


def test_a_report_that_no_browser_opens_is_told_with_its_place(monkeypatch, tmp_path):
    pytest.importorskip("python_qt_binding")
    from fcsv_console.ros import window_command
    from fcsv_console.ros.shell import ConsoleShell

    monkeypatch.setattr(ConsoleShell, "_join", lambda self: None)  # no master is looked for
    shell = ConsoleShell(landed(), "console")
    opened = []
    for opens in (False, True):
        answer = SimpleNamespace(
            openUrl=lambda url, opens=opens: opened.append(url.toLocalFile()) or opens
        )
        monkeypatch.setattr(window_command, "QDesktopServices", answer)
        window_command.after(shell, "report", after.Places("", "", str(tmp_path / "my map")))
        told = next(s for s in shell.view().after if s.name == "report").summary
        assert (
            told
            == ("done: " if opens else "FAILED: no browser opens here; the page is ") + opened[-1]
        )
    assert opened == [str(tmp_path / "my map" / "report.html")] * 2
    shell.close()


@pytest.mark.parametrize("closed", [True, False])
def test_a_window_that_is_closed_before_it_joined_the_master_ends_without_a_traceback(
    monkeypatch, closed
):
    pytest.importorskip("rospy")
    from fcsv_console.ros import shell as shells

    def interrupted(*_args, **_kwargs):
        raise shells.rospy.exceptions.ROSInitException("init_node interrupted")

    join = shells.ConsoleShell._join
    monkeypatch.setattr(shells.ConsoleShell, "_join", lambda self: None)
    shell = shells.ConsoleShell(landed(), "console")
    monkeypatch.setattr(shells.rosgraph, "is_master_online", lambda: True)
    monkeypatch.setattr(shells.node, "begin", interrupted)
    if closed:
        shell._over.set()
        join(shell)
        assert shell._commands is None
    else:
        with pytest.raises(shells.rospy.exceptions.ROSInitException):
            join(shell)
    shell.close()


# ---- the dock ------------------------------------------------------------------------------------


@pytest.fixture
def window(app, opened):
    c = samples.console(OUTDOOR)
    samples.on_the_ground(c)
    c.after.places = PLACES
    c.tell(samples.NOW_S, facts.PlacesFound(True, False))
    made = opened(c)
    made.console = c
    made.show()
    made.show_after.click()
    app.processEvents()
    return made


def test_the_dock_shows_what_can_be_done_and_asks_for_it(window):
    dock, asked, typed = window.after, [], []
    dock.asked.connect(lambda name, places: asked.append((name, places)))
    dock.changed.connect(typed.append)
    assert (
        dock.isVisible()
        and dock.buttons["map"].isEnabled()
        and not dock.buttons["report"].isEnabled()
    )
    assert "there is no report in out/map" in dock.buttons["report"].toolTip()
    dock.buttons["map"].click()
    assert asked == [("map", PLACES)]
    dock.fields["out"].setText("elsewhere")
    assert typed[-1].out == "elsewhere"
    window.console.tell(samples.NOW_S, facts.JobProgress("map", "runs", 0.4))
    window.show_view(window.console.view(samples.NOW_S))
    assert dock.buttons["map"].text() == "Stop" and dock.bars["map"].value() == 40
    dock.buttons["map"].click()
    assert asked[-1][0] == "map"
    window.console.tell(samples.NOW_S, facts.JobProgress("map", "done", words="wrote out/map"))
    window.show_view(window.console.view(samples.NOW_S))
    assert dock.bars["map"].value() == 100 and dock.words["map"].toolTip() == "done: wrote out/map"
