# SPDX-License-Identifier: Apache-2.0
"""The documents' commands as they are printed: short ones run, of long ones the names and arguments
are checked."""

import argparse
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

import pytest
from support.documented import Command, commands, split_arguments

ROOT = Path(__file__).resolve().parents[2]
FOUND = commands(ROOT)
MAKEFILE = (ROOT / "Makefile").read_text()
# what `make TARGET ARGS=...` hands its arguments to
SCRIPTS = {
    "bench": "tools/bench",
    "bench-tracking": "tools/bench_tracking.py",
    "bench-gimbal": "tools/bench_gimbal.py",
    "bench-link": "tools/bench_link/bench.py",
    "study": "tools/study",
}
NOT_OURS = {"git", "cd", "scp", ".", "export"}
# short and without a master: run as printed, in an empty folder
RUN = re.compile(
    r"rosrun fcsv_stereo plan |rosrun fcsv_multimaster keys (?!revoke)|rosrun \w+ \w+ --help"
)


def named(command):
    return f"{command.where}: {command.text}"


class Parsed(BaseException):
    """The arguments were accepted; nothing else is to happen."""


def parse_only(monkeypatch, path, arguments):
    """Run a program up to the end of its parse_args; SystemExit where that refuses the arguments.

    A node that begins without having parsed its arguments fails.
    """

    def too_far(*_, **__):
        raise AssertionError(f"{path} runs without parsing its arguments")

    import rospy

    monkeypatch.setattr(rospy, "init_node", too_far)
    parse = argparse.ArgumentParser.parse_args

    def stop(self, args=None, namespace=None):
        parse(self, args, namespace)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    monkeypatch.setattr(sys, "argv", [str(path), *arguments])
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(Parsed):
        runpy.run_path(str(path), run_name="__main__")


def node_of(words):
    """The executable that ``rosrun PACKAGE NODE`` starts."""
    return ROOT / "src" / words[1] / "nodes" / words[2]


def check_rosrun(monkeypatch, command):
    words = command.words
    node = node_of(words)
    assert node.is_file(), f"{words[1]} has no node {words[2]}"
    arguments, ros = split_arguments(words[3:])
    source = "".join(p.read_text() for p in (ROOT / "src" / words[1] / "src").rglob("*.py"))
    for name in ros:
        # a field of the node's configuration, or what it asks of the parameter server
        field = rf"^    {name.lstrip('_')}: |\"~?{name.lstrip('_')}\""
        assert re.search(field, source, re.M), f"{words[2]} has no parameter {name}"
    if command.in_block and not ros or arguments:
        parse_only(monkeypatch, node, arguments)


def check_make(monkeypatch, command):
    target, variables = command.words[1], dict(w.split("=", 1) for w in command.words[2:])
    assert subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True).returncode == 0, (
        f"no target {target}"
    )
    allowed = {"ARGS", *re.search(r"^export (.*)$", MAKEFILE, re.M).group(1).split()}
    assert set(variables) <= allowed, f"the Makefile knows no {set(variables) - allowed}"
    arguments = Command("", variables.pop("ARGS", ""), False).words
    if target == "demo":
        check_mission(variables)
        options = [
            word for name, value in variables.items() for word in (f"--{name.lower()}", value)
        ]
        parse_only(monkeypatch, ROOT / "src/fcsv_sim/nodes/demo", options)
    elif target == "rehearse":
        check_mission(variables)
        parse_only(
            monkeypatch,
            ROOT / "src/fcsv_sim/nodes/rehearse",
            [variables.get("MISSION", "short"), *arguments],
        )
    elif target == "test":
        check_pytest(arguments)
    elif arguments:
        check_script(monkeypatch, SCRIPTS[target], arguments)


def check_mission(variables):
    mission = variables.get("MISSION", "short")
    assert (ROOT / "config/missions" / f"{mission}.yaml").is_file(), f"no mission {mission}"


def check_pytest(arguments):
    """Files exist, marks are registered."""
    marks = re.findall(r'"(\w+): ', (ROOT / "pyproject.toml").read_text())
    for option, word in zip(["", *arguments], arguments):
        if option == "-m":
            assert set(re.findall(r"\w+", word)) - {"not", "and", "or"} <= set(marks), word
        elif not word.startswith("-"):
            assert (ROOT / word.split("::")[0]).exists(), f"no file {word}"


def check_script(monkeypatch, script, arguments):
    path = ROOT / script
    assert path.exists(), f"no {script}"
    # what it hands its arguments to
    path = ROOT / "tools/install" if script == "tools/install_vehicle.sh" else path
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    monkeypatch.syspath_prepend(str(path if path.is_dir() else path.parent))
    if script == "tools/run":
        assert f"  {arguments[0]})" in path.read_text(), f"tools/run does no {arguments[0]}"
    elif "ArgumentParser" in (path / "__main__.py" if path.is_dir() else path).read_text():
        parse_only(monkeypatch, path, arguments)


def check_roslaunch(command):
    words = command.words
    path = ROOT / "launch" / words[2]
    assert words[1] == "fcsv_bringup" and path.is_file(), f"no launch file {words[2]}"
    declared = {a.get("name"): a for a in xml.parse(path).getroot().findall("arg")}
    given = set(split_arguments(words[3:])[1])
    assert given <= set(declared), f"{words[2]} has no argument {given - set(declared)}"
    if command.in_block:
        needed = {
            name
            for name, a in declared.items()
            if a.get("default") is None and a.get("value") is None
        }
        assert needed <= given, f"{words[2]} needs {needed - given}"


def check_rosservice(command):
    """``rosservice call NAME``: some node of ours offers a service of this name."""
    words = command.words
    assert words[1] == "call"
    offers = re.compile(rf'rospy\.Service\(\s*"{words[2]}"')
    nodes = [p for p in (ROOT / "src").rglob("*.py") if "ros" in p.parts]
    assert any(offers.search(p.read_text()) for p in nodes), f"nobody offers {words[2]}"


def test_the_documents_print_commands():
    heads = {c.head for c in FOUND}
    assert len(FOUND) > 50 and {"make", "rosrun", "roslaunch", "rosservice"} <= heads
    assert len([c for c in FOUND if c.in_block]) > 15


@pytest.mark.parametrize("command", [c for c in FOUND if not RUN.match(c.text)], ids=named)
def test_names_and_arguments_exist(monkeypatch, tmp_path, command):
    monkeypatch.chdir(tmp_path)
    if command.head == "rosrun":
        check_rosrun(monkeypatch, command)
    elif command.head == "make":
        check_make(monkeypatch, command)
    elif command.head == "roslaunch":
        check_roslaunch(command)
    elif command.head == "rosservice":
        check_rosservice(command)
    elif command.head.startswith("tools/"):
        check_script(monkeypatch, command.head, command.words[1:])
    else:
        assert command.head in NOT_OURS, f"{command.head}: a command that this test does not know"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [c for c in FOUND if RUN.match(c.text)], ids=named)
def test_short_commands_run_as_they_are_printed(tmp_path, command):
    done = subprocess.run(
        ["bash", "-ec", command.text],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=dict(os.environ, HOME=str(tmp_path)),
    )
    assert done.returncode == 0 and done.stdout.strip(), done.stdout + done.stderr


@pytest.mark.parametrize(
    "text",
    [
        "make absent",
        "make demo PLANET=mars",
        "make demo MISSION=absent",
        "make demo WORLD=moon",
        "make bench ARGS=--absent",
        "make test ARGS=tests/absent",
        "make test ARGS=\"-m 'not absent'\"",
        "rosrun fcsv_stereo absent a",
        "rosrun fcsv_stereo map a -o b --absent",
        "rosrun fcsv_stereo live_map _absent:=1",
        "tools/run absent",
        "roslaunch fcsv_bringup absent.launch",
        "roslaunch fcsv_bringup uav.launch absent:=1",
        "roslaunch fcsv_bringup uav.launch",
        "rosservice call /mission/absent",
        "tools/absent.py",
        "absent",
    ],
)
def test_what_does_not_exist_is_found(monkeypatch, tmp_path, text):
    with pytest.raises((AssertionError, SystemExit)):
        test_names_and_arguments_exist(monkeypatch, tmp_path, Command("", text, True))
