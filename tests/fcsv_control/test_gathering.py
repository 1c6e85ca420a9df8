# SPDX-License-Identifier: Apache-2.0
"""A flight's bags gathered by rsync, from folders and through a remote shell that breaks; what is
missing is said."""

import shutil
import sys

import pytest
from support.bags import write_strings

from fcsv_control import gathering
from fcsv_control.commands.gather_session import main
from fcsv_control.session import load_session, new_session, save_session
from fcsv_geometry.bags.repair import check
from fcsv_geometry.missions.mission import load_mission


@pytest.fixture
def machines(tmp_path, root):
    """Folders of two vehicles and the control PC, as after a flight; uav1 recorded in two parts."""
    for name in ("uav1", "uav2", "control"):
        (tmp_path / name).mkdir()
        write_strings(tmp_path / name / f"{name}.bag")
    write_strings(tmp_path / "uav1" / "uav1.1.bag")
    write_strings(tmp_path / "uav1" / "uav1.20260102T030405Z.bag")  # of an earlier flight
    (tmp_path / "uav1" / "notes.txt").write_text("not a bag")
    mission = load_mission(root / "config/missions/short.yaml")
    save_session(
        tmp_path / "control", new_session(mission, ["uav1", "uav2"], "2026-01-02T03:04:05Z")
    )
    return tmp_path


def gather(folder, *names, **places):
    sources = [f"{n}={places.get(n, folder / n)}" for n in names or ("uav1", "uav2", "control")]
    return main(
        [
            str(folder / "out"),
            *sources,
            *(["--rsh", str(folder / "rsh")] if (folder / "rsh").exists() else []),
        ]
    )


def shell(folder, script):
    """A remote shell: what it is given after the host runs here."""
    path = folder / "rsh"
    path.write_text(f"#!/bin/sh\nshift\n{script}\n")
    path.chmod(0o755)


def test_all_parts_of_all_machines_and_a_session_that_loads(machines, capsys):
    assert gather(machines) == 0, capsys.readouterr().err
    out = machines / "out"
    assert sorted(p.name for p in out.iterdir()) == [
        "control.bag",
        "session.yaml",
        "uav1.1.bag",
        "uav1.bag",
        "uav2.bag",
    ]
    assert load_session(out).parts == {"uav1": ["uav1.1.bag"]}
    for machine, name in (("uav1", "uav1.bag"), ("uav1", "uav1.1.bag"), ("uav2", "uav2.bag")):
        assert (out / name).read_bytes() == (machines / machine / name).read_bytes()
    before = {p: p.stat().st_ino for p in out.glob("*.bag")}
    assert gather(machines) == 0 and {p: p.stat().st_ino for p in out.glob("*.bag")} == before, (
        "nothing comes twice"
    )


def test_the_operator_s_events_come_with_the_session(machines, capsys):
    """A window that was started twice keeps two; what is still being written stays where it is."""
    for name in (
        "console_events_20260102T030405Z.csv",
        "console_events_20260102T040506Z.csv",
        "other.csv",
        "console_events_20260102T050607Z.csv.partial",
    ):
        (machines / "control" / name).write_text(f"time_utc,who\n,{name}\n")
    assert gather(machines) == 0, capsys.readouterr().err
    came = sorted((machines / "out").glob("*.csv*"))
    assert [p.name for p in came] == [
        "console_events_20260102T030405Z.csv",
        "console_events_20260102T040506Z.csv",
    ]
    assert came[0].read_text().endswith(f",{came[0].name}\n")
    assert gather(machines, "uav1") == 0 and not (machines / "uav1" / came[0].name).exists()


def test_a_transfer_that_is_cut_off_goes_on_where_it_ended(machines, capsys):
    big = machines / "uav2" / "uav2.bag"
    write_strings(big, messages=60, size=6_000_000)  # long enough to be cut in the middle
    shell(machines, f'"$@" | "{sys.executable}" -c "{LIMITED}" {machines}/count 3000000')
    assert gather(machines, uav2=f"uav2.local:{machines}/uav2") == 1
    said = capsys.readouterr().err
    assert "uav2: " in said and "what has come is kept: gather again" in said
    assert "uav2: uav2.bag is missing; gather it from its machine" in said
    partial = machines / "out" / ".gathering" / "uav2.bag"
    assert partial.stat().st_size > 1_000_000 and not (machines / "out" / "uav2.bag").exists()
    assert (machines / "out" / "uav1.bag").exists(), "the others are there"

    shell(machines, f'"$@" | "{sys.executable}" -c "{LIMITED}" {machines}/count 1000000000')
    (machines / "count").write_text("0")
    assert gather(machines, uav2=f"uav2.local:{machines}/uav2") == 0, capsys.readouterr().err
    assert (machines / "out" / "uav2.bag").read_bytes() == big.read_bytes()
    assert int((machines / "count").read_text()) < big.stat().st_size - 1_000_000, (
        "what had come did not come again"
    )


#: Passes on what comes from the other side, up to so many bytes, and counts them.
LIMITED = """
import os, sys
count, most, here = 0, int(sys.argv[2]), 0
try: count = int(open(sys.argv[1]).read())
except OSError: pass
while True:
    data = os.read(0, 65536)
    if not data: break
    here += len(data)
    open(sys.argv[1], 'w').write(str(count + here))
    if here > most: sys.exit(1)
    os.write(1, data)
""".strip()


def test_a_bag_that_was_not_closed_is_repaired_and_is_not_fetched_again(machines, capsys):
    (machines / "uav2" / "uav2.bag").unlink()
    write_strings(machines / "uav2" / "uav2.bag.active", close=False)
    assert gather(machines) == 1
    assert (
        "uav2: uav2.bag.active was not closed or is damaged: repaired, 20 messages"
        in capsys.readouterr().err
    )
    out = machines / "out"
    assert check(out / "uav2.bag") and load_session(out)
    assert (out / "uav2.bag.broken").read_bytes() == (
        machines / "uav2" / "uav2.bag.active"
    ).read_bytes()
    assert gather(machines) == 0 and not list(out.glob("*.active"))


def test_what_is_missing_or_no_bag_is_said_and_the_rest_is_gathered(machines, capsys):
    (machines / "uav1" / "uav1.1.bag").write_bytes(b"#ROSBAG V1.2\n" + b"x" * 100)
    shutil.rmtree(machines / "uav2")
    assert gather(machines) == 1
    said = capsys.readouterr()
    assert "uav1.1.bag: is a bag of version 1.2, only 2.0 is read" in said.err
    assert (
        "uav2: " in said.err
        and "No such file" in said.err
        and "uav2: uav2.bag is missing" in said.err
    )
    assert said.err.endswith("uav2: uav2.bag is missing; gather it from its machine\n"), (
        "what the window shows"
    )
    assert "uav1: uav1.bag\n" in said.out and "control: control.bag\n" in said.out


def test_a_full_disk_is_said_before_anything_comes(machines, capsys, monkeypatch):
    monkeypatch.setattr(gathering.shutil, "disk_usage", lambda _: type("U", (), {"free": 10 << 20}))
    assert gather(machines) == 2
    assert "MiB are needed, 10 are free; make room first" in capsys.readouterr().err
    assert not list((machines / "out").iterdir())


@pytest.mark.parametrize(
    "source, words",
    [
        ("uav1", "is not NAME=HOST:FOLDER"),
        ("uav1=", "is not NAME=HOST:FOLDER"),
        ("uav1=--rsh=evil", "is not NAME=HOST:FOLDER"),
        ("a b=/x", "is not NAME=HOST:FOLDER"),
    ],
)
def test_a_source_that_is_none_is_named(tmp_path, capsys, source, words):
    (tmp_path / "file").write_text("in the session's place")
    assert (
        main([str(tmp_path / "file"), f"uav1={tmp_path}"]) == 2
        and "file: a file stands" in capsys.readouterr().err
    )
    assert main([str(tmp_path / "out"), source]) == 2 and words in capsys.readouterr().err
    assert (
        main([str(tmp_path / "out"), "uav1=/x", "uav1=/y"]) == 2
        and "named twice" in capsys.readouterr().err
    )
