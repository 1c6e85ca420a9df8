# SPDX-License-Identifier: Apache-2.0
"""The operator's window of a demo outlives the flight's machines, and ends when it is closed or by
Ctrl-C."""

import os
import signal
import sys
import threading
from types import SimpleNamespace

import pytest
from support.waiting import within

from fcsv_sim.demo import demo, interrupt, look
from fcsv_sim.demo.fleet import CONTROL, FleetPlan, Machines
from fcsv_sim.demo.interrupt import Interrupted
from fcsv_sim.demo.window import OperatorWindow

until = within(20.0)

WAITS = "import sys, time; print(sys.argv[1:], flush=True); time.sleep({0})"


@pytest.fixture
def window():
    """window(seconds): open for so long."""
    made = []

    def make(seconds):
        made.append(OperatorWindow([sys.executable, "-c", WAITS.format(seconds)]))
        return made[-1]

    yield make
    for one in made:
        one.close()


class Fleet(Machines):
    """Machines without masters."""

    def __init__(self, plan):
        super().__init__(plan, [CONTROL])

    def _launch(self):
        self.launches[CONTROL] = self.control.run(
            [sys.executable, "-c", "import time; time.sleep(60)"], "launch"
        )


@pytest.fixture
def plan(tmp_path, monkeypatch, window):
    """plan(seconds) -> a plan whose window is open for so long once its machines are up."""
    monkeypatch.setattr("fcsv_sim.machines.machines.Machine.start_master", lambda self: self)
    return lambda seconds: FleetPlan(tmp_path, tmp_path / "mine.yaml", window=window(seconds))


def test_the_window_stays_when_the_machines_stop_and_knows_where_they_recorded(plan, tmp_path):
    made = plan(60)
    fleet = Fleet(made)
    fleet.start()
    fleet.stop()
    assert fleet.launches[CONTROL].returncode is not None and made.window.is_open
    log = tmp_path / "run" / "control" / "console.log"
    until(log.read_text, what="the window's own words")
    assert log.read_text().split()[-2:] == ["'--session',", f"'{tmp_path / 'session'}']"]
    made.window.close()
    made.window.close()
    assert not made.window.is_open


def test_a_demo_waits_until_the_window_is_closed_and_says_so(plan, capsys):
    made = plan(0.3)
    Fleet(made).start()
    look.stay(made)
    said = capsys.readouterr().out
    assert "window stays open" in said and str(made.session_folder) in said and "Ctrl-C" in said
    assert not made.window.is_open
    look.stay(made)
    look.stay(FleetPlan(made.folder, made.mission_file))
    assert capsys.readouterr().out == "", "where none is open nobody is kept waiting"


def test_ctrl_c_closes_the_window_that_stays(plan, signals_as_before):
    interrupt.listen()
    made = plan(60)
    Fleet(made).start()
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    look.stay(made)
    assert not made.window.is_open


@pytest.mark.parametrize("ends", [0, Interrupted()])
def test_a_demo_that_is_interrupted_leaves_no_window_and_one_that_ends_waits_for_it(
    plan, monkeypatch, signals_as_before, ends
):
    made, stayed = plan(60), []
    Fleet(made).start()

    def run(*_):
        if ends:
            raise ends
        return 0

    monkeypatch.setattr(demo, "_run", run)
    monkeypatch.setattr(demo, "stay", lambda told: stayed.append(told.window.is_open))
    if ends:
        with pytest.raises(Interrupted):
            demo.run(None, made, print)
    else:
        assert demo.run(None, made, print) == 0
    assert stayed == ([] if ends else [True]) and not made.window.is_open


def test_while_the_demo_maps_the_window_knows(plan, tmp_path, monkeypatch):
    """By a hidden file beside the map's folder."""
    from fcsv_sim.demo.systems import MapRun

    seen = []

    def child(*_args, **_kwargs):
        return SimpleNamespace(
            wait=lambda: seen.append(sorted(p.name for p in tmp_path.glob(".map.*"))) or 0
        )

    monkeypatch.setattr(demo.subprocess, "Popen", child)
    demo._map(FleetPlan(tmp_path, tmp_path / "mine.yaml"), MapRun(), lambda _line: None)
    assert seen == [[".map.being_made"]] and not list(tmp_path.glob(".map.*"))
