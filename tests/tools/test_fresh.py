# SPDX-License-Identifier: Apache-2.0
"""`make fresh`: what it reads, writes and refuses; and that the container files say what the launch
files know.

The machine itself is made by `make fresh` alone: it takes minutes and gigabytes.
"""

import os
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import fresh
import pytest
import yaml

TARGETS = """\
http://a.example/debian/ bookworm-updates bookworm-updates main
http://b.example/debian/ stable bookworm contrib
http://c.example/debian/ stable bookworm main
"""


RUN = fresh.Run("root", "make demo", 0, 60.0, 10**9, 5, "2026-01-01")


def run(minutes, **more):
    return replace(RUN, took_s=60.0 * minutes, **more)


def test_the_archive_is_the_one_of_debian_12_in_apts_sources():
    assert fresh.mirror_of(TARGETS) == "http://c.example/debian/"
    with pytest.raises(fresh.NotHere, match="--mirror"):
        fresh.mirror_of("http://d.example/ubuntu focal focal main\n")


def test_a_row_takes_the_place_of_the_row_of_the_same_user_and_command():
    page = f"# A\n\n{fresh.HEADER}\n|---|---|\n\nEnd\n"
    once = fresh.with_rows(
        page, [run(1), run(2, who="user"), run(3, command="make test", status=2)]
    )
    assert (
        once.count("\n| ") == 4
        and "| failed, status 2 | 3.0 |" in once
        and once.endswith("\n\nEnd\n")
    )
    again = fresh.with_rows(once, [run(4, who="user")])
    assert again == once.replace(run(2, who="user").row(), run(4, who="user").row())
    with pytest.raises(ValueError, match="no table"):
        fresh.with_rows("# A\n", [run(1)])
    fresh.with_rows(fresh.PAGE.read_text(), [run(1)])  # the page has the table


def test_installed_packages_are_those_that_dpkg_calls_installed(tmp_path):
    status = tmp_path / "var/lib/dpkg/status"
    status.parent.mkdir(parents=True)
    status.write_text(
        "Package: b\nStatus: install ok installed\nVersion: 1\n\n"
        "Package: gone\nStatus: deinstall ok config-files\n\n"
        "Package: a\nStatus: install ok installed\n"
    )
    assert fresh.installed(tmp_path) == ["a", "b"]


def test_where_it_cannot_be_done_it_says_so_with_a_status_of_its_own(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(fresh.os, "geteuid", lambda: 1000)
    assert fresh.main(["--folder", str(tmp_path)]) == fresh.NOT_HERE
    monkeypatch.setattr(fresh.os, "geteuid", lambda: 0)
    monkeypatch.setattr(
        fresh.shutil, "which", lambda tool: None if tool == "debootstrap" else "/bin/" + tool
    )
    assert fresh.main(["--folder", str(tmp_path)]) == fresh.NOT_HERE
    first, second = capsys.readouterr().err.splitlines()
    assert (
        "needs root" in first
        and "debootstrap is not installed: apt-get install debootstrap" in second
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "given, words",
    [
        ("--as nobody", "'nobody' is not one of root, user"),
        ("--commands demo,fly", "'fly' is not one of demo, test"),
    ],
)
def test_a_wrong_argument_is_named(given, words, capsys):
    with pytest.raises(SystemExit) as end:
        fresh.main(given.split())
    assert end.value.code == fresh.WRONG and words in capsys.readouterr().err


FAKE = """#!/bin/sh
case "$(basename "$0")" in
  debootstrap) mkdir -p "$4/etc"; echo "E: no such archive"; exit 1 ;;
  apt-get) echo "http://e.example/debian/ bookworm bookworm main" ;;
esac
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, for a namespace of mounts")
def test_a_failure_leaves_nothing_behind(tmp_path, root):
    if subprocess.run(
        ["unshare", "--mount", "--pid", "--fork", "true"], capture_output=True
    ).returncode:
        pytest.skip("this machine permits no namespaces of mounts")
    tools, folder = tmp_path / "bin", tmp_path / "made"
    tools.mkdir()
    folder.mkdir()
    for name in ("debootstrap", "apt-get"):
        (tools / name).write_text(FAKE)
        (tools / name).chmod(0o755)
    env = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}"}
    command = [sys.executable, str(root / "tools/fresh.py"), "--folder", str(folder)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert (
        done.returncode == fresh.NOT_HERE
        and "debootstrap failed:\nE: no such archive" in done.stderr
    )
    assert not list(folder.iterdir()) and str(folder) not in Path("/proc/mounts").read_text()


# ---- containers ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def services(root):
    return yaml.safe_load((root / "compose.yaml").read_text())["services"]


def arguments(service):
    """(launch file, {argument: value}) of a service's roslaunch."""
    words = shlex.split(service["command"])
    assert words[:2] == ["roslaunch", "-p"] and words[3] == "fcsv_bringup"
    assert service["environment"]["ROS_MASTER_URI"].endswith(f":{words[2]}")
    return words[4], dict(word.split(":=") for word in words[5:])


def test_every_argument_in_the_compose_file_is_one_of_the_launch_file(root, services):
    for service in services.values():
        file, given = arguments(service)
        known = {
            a.get("name") for a in ElementTree.parse(root / "launch" / file).getroot().iter("arg")
        }
        assert set(given) <= known, file


def test_the_two_machines_of_the_compose_file_find_each_other(services):
    (_, control), (_, uav) = arguments(services["control"]), arguments(services["uav1"])
    assert (
        control["peers"] == f"uav1={uav['listen']}"
        and uav["peers"] == f"control={control['listen']}"
    )
    assert control["sim_rc_ports"] == uav["sim_rc_port"] and control["sim_dir"] == uav["sim_dir"]
    assert services["uav1"]["network_mode"] == "service:control"
    assert services["uav1"]["volumes"] == services["control"]["volumes"]


def test_the_container_takes_the_steps_of_a_bare_machine(root):
    text = (root / "Dockerfile").read_text()
    assert "FROM debian:12\n" in text and "RUN tools/setup.sh" in text
    assert set(fresh.INCLUDED.split(",")) <= set(text.split())
