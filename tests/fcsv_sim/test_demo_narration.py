# SPDX-License-Identifier: Apache-2.0
"""What a demo prints while it starts, flies and ends; and that a printed command runs as it was
printed."""

import io
import os
import shlex
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.missions.mission import load_mission
from fcsv_sim.bringup import mission_file
from fcsv_sim.demo import demo, flights
from fcsv_sim.demo.fleet import FleetPlan, Machines
from fcsv_sim.demo.look import look, write_play
from fcsv_sim.demo.narration import Narrator, wait
from fcsv_sim.demo.start_up import NORMAL_S, StartUp

ROOT = Path(__file__).resolve().parents[2]


def red(vehicle, *names):
    return [Line(vehicle, name, Grade.RED, f"{name} is bad", "mend it") for name in names]


def test_the_start_is_one_line_that_counts_the_checks_to_go():
    start = StartUp(100.0)
    assert "not heard yet" in start.status()
    start.check(
        [
            *red("uav1", "origin", "ekf"),
            Line("uav2", "feed", Grade.UNKNOWN, ""),
            *red("uav3", *"abcdefg"),
        ]
    )
    assert start.status() == (
        "starting, normal for about a minute: 10 checks to go "
        "(uav1: origin, ekf; uav2: feed; uav3: a, b, c, d and 3 more)"
    )
    start.check(
        [Line("uav1", "origin", Grade.GREEN, ""), Line("uav1", "disk", Grade.AMBER, "small")]
    )
    assert start.status().endswith("every check has passed")


def test_reasons_come_only_once_the_start_takes_longer_than_is_normal_and_not_too_often():
    start = StartUp(100.0)
    start.check(red("uav1", "origin"))
    start.problems(["flight check: uav1 origin is RED"])
    start.text("uav1", "PreArm: Need Position Estimate")
    assert start.reasons(100.0 + NORMAL_S - 1.0) == []
    said = start.reasons(100.0 + NORMAL_S)
    assert said == [
        "still not ready after 60 s:",
        "    uav1 origin is RED: origin is bad; mend it",
        "    uav1: PreArm: Need Position Estimate",
    ]
    assert (
        start.reasons(100.0 + NORMAL_S + 1.0) == [] and start.reasons(100.0 + NORMAL_S + 15.0) != []
    )
    start.check([])
    assert start.reasons(300.0)[1] == "    flight check: uav1 origin is RED", (
        "without a table: the mission's words"
    )


def test_both_clocks_are_printed_once_they_have_come_apart():
    now = [10.0, 50.0]
    out = io.StringIO()
    say = Narrator(out, lambda: tuple(now))
    now[:] = 12.0, 52.4
    say("early")
    now[:] = 20.0, 75.0
    say("late")
    assert out.getvalue() == "[   2.0 s] early\n[  10.0 s, 25 s of wall time] late\n"


def test_a_quiet_program_is_waited_for_with_a_sign_of_life():
    out = io.StringIO()
    child = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(1.2); raise SystemExit(3)"]
    )
    assert wait(child, Narrator(out, terminal=True), "building the world") == 3
    assert "building the world: 1 s" in out.getvalue()


def test_long_work_shows_what_it_does_until_it_is_over():
    out = io.StringIO()
    with Narrator(out, terminal=True).shown("closing the bags"):
        time.sleep(1.3)
    assert "closing the bags: 1 s" in out.getvalue()
    with pytest.raises(ValueError), Narrator(out, terminal=True).shown("that fails"):
        raise ValueError
    assert "renewed line" not in {t.name for t in threading.enumerate()}


def test_while_it_starts_the_checks_are_shown_then_the_vehicles():
    out = io.StringIO()
    start = StartUp(0.0)
    start.check(red("uav1", "origin"))
    watch = SimpleNamespace(
        starting=True, start_up=start, states={"uav1": 1}, vehicles_line=lambda: "uav1 GUIDED"
    )
    flights._show(watch, Narrator(out, terminal=True))
    watch.starting = False
    flights._show(watch, Narrator(out, terminal=True))
    assert "1 check to go (uav1: origin)" in out.getvalue() and out.getvalue().endswith(
        "uav1 GUIDED"
    )


@pytest.mark.parametrize("mission, minutes", [("short", "2 min"), ("ten", "min")])
def test_at_the_start_it_is_said_what_comes_and_how_long_it_takes(mission, minutes):
    words = demo._what_comes(load_mission(mission_file(mission)), fly_only=False)
    assert (
        f"fly mission '{mission}', about" in words
        and minutes in words
        and "map what was seen" in words
    )
    assert "map" not in demo._what_comes(load_mission(mission_file("short")), fly_only=True)


# ---- printed commands, pasted into a shell that knows nothing of the workspace -------------------


def pasted(words: str, folder) -> subprocess.CompletedProcess:
    """Run as typed in a new shell."""
    bare = {"HOME": str(folder), "PATH": "/usr/bin:/bin"}
    return subprocess.run(
        ["/bin/sh", "-c", words], env=bare, cwd=folder, capture_output=True, text=True, timeout=60
    )


@pytest.fixture
def plan(tmp_path):
    for name in ("run", "session"):
        (tmp_path / "out demo" / name).mkdir(parents=True)
    return FleetPlan(tmp_path / "out demo", tmp_path / "m.yaml", vehicles=("uav1", "uav2"))


def test_a_command_on_a_simulated_machine_runs_from_any_shell(plan, tmp_path):
    machines = object.__new__(Machines)
    machines.plan = plan
    machines.machines = {
        "control": SimpleNamespace(master_uri="http://127.0.0.1:1", folder=tmp_path)
    }
    machines._write_description()
    printed = shlex.quote(str(plan.run_folder / "on_control"))
    done = pasted(f"{printed} rosrun fcsv_console console --help", tmp_path)
    assert done.returncode == 0 and "usage: console" in done.stdout, done.stderr
    done = pasted(f"{printed} printenv ROS_MASTER_URI", tmp_path)
    assert done.stdout == "http://127.0.0.1:1\n"


def test_the_flight_is_played_back_by_the_printed_command(plan, tmp_path, capsys):
    write_play(plan)
    look(plan)
    printed = capsys.readouterr().out.partition("again:")[2].strip()
    done = pasted(f"{printed} console:=false --nodes", tmp_path)
    assert done.returncode == 0 and "/show_map" in done.stdout and "/rviz" in done.stdout, (
        done.stderr
    )
    made = pasted(
        f"OUT={shlex.quote(str(plan.folder))} {ROOT}/tools/run play --nodes console:=false",
        tmp_path,
    )
    assert made.returncode == 0 and "/play" in made.stdout, made.stderr


def test_where_nothing_was_flown_play_says_what_to_do(tmp_path):
    done = pasted(f"OUT={tmp_path}/nowhere {ROOT}/tools/run play", tmp_path)
    assert done.returncode == 2 and "make demo" in done.stderr
    assert os.listdir(tmp_path) == []
