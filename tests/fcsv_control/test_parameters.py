# SPDX-License-Identifier: Apache-2.0
"""The command `parameters`: over lines that lose messages, against a simulated autopilot, and
files."""

import os

os.environ.setdefault("MAVLINK20", "1")

import socket

import numpy as np
import pytest
from pymavlink import mavutil
from support.autopilots import PROFILE, PROFILE_FILE, Served

from fcsv_control.flight.mavlink import firmware
from fcsv_control.flight.settings import parameter_files
from fcsv_control.parameters import cli, vehicle
from fcsv_control.parameters.transfer import NamedRead, WholeRead, Write
from fcsv_sim.machines.machines import free_port

M = mavutil.mavlink


# ---- the decisions, over a line that loses 20 % each way -----------------------------------------


class Lossy:
    def __init__(self, seed):
        self.random, self.now_s = np.random.default_rng(seed), 0.0

    def gets_through(self):
        return self.random.random() > 0.2

    def run(self, asked):
        """Steps of 20 ms until it is over."""
        while not asked.over(self.now_s):
            yield self.now_s
            self.now_s += 0.02
            assert self.now_s < 120.0


@pytest.mark.parametrize("seed", range(5))
def test_a_whole_list_comes_over_a_line_that_loses(seed):
    stored = {f"P{i}": float(i) for i in range(300)}
    line, reading = Lossy(seed), WholeRead()
    for now_s in line.run(reading):
        whole, indices = reading.due(now_s)
        for index in [*range(300)] * (whole and line.gets_through()) + [
            i for i in indices if line.gets_through()
        ]:
            if line.gets_through():
                reading.receive(now_s, f"P{index}", stored[f"P{index}"], 9, 300, index)
    assert reading.complete and {n: v for n, (v, _) in reading.values.items()} == stored


def test_a_list_that_nobody_sends_ends():
    line, reading = Lossy(0), WholeRead()
    asked = sum(reading.due(now_s)[0] for now_s in line.run(reading))
    assert asked == 8 and not reading.complete


@pytest.mark.parametrize("seed", range(5))
def test_values_are_set_and_heard_back_and_what_is_not_taken_is_named(seed):
    stored, line = {"A": 1.0, "FIXED": 5.0}, Lossy(seed)
    writing = Write({"A": 0.2, "FIXED": 6.0, "NONE": 1.0})
    for now_s in line.run(writing):
        for name, value in writing.due(now_s):
            if line.gets_through() and name in stored:
                stored[name] = float(np.float32(value)) if name == "A" else stored[name]
                if line.gets_through():
                    writing.receive(name, stored[name])
    assert set(writing.failed) == {"FIXED 6: it keeps 5", "NONE 1: no answer"}


def test_a_name_that_is_not_known_ends_the_reading():
    line, reading = Lossy(1), NamedRead(["A", "NONE"])
    for now_s in line.run(reading):
        for name in reading.due(now_s):
            if name == "A":
                reading.receive(name, 1.0, 9)
    assert reading.values == {"A": (1.0, 9)} and reading.unknown == ["NONE"]


@pytest.mark.parametrize(
    "autopilot, kind, name",
    [
        (3, 2, "ArduCopter"),
        (3, 13, "ArduCopter"),
        (3, 1, "ArduPlane"),
        (3, 20, "ArduPlane"),
        (3, 10, "ArduRover"),
        (12, 2, "PX4"),
        (0, 2, "GENERIC"),
        (99, 2, "autopilot 99"),
    ],
)
def test_firmware_is_named(autopilot, kind, name):
    assert firmware.name_of(M.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 0, 3)) == name


# ---- the command, against a simulated autopilot --------------------------------------------------


@pytest.fixture
def served(monkeypatch):
    # loopback answers within 0.01 s: a parameter that is not there is given up sooner
    monkeypatch.setattr("fcsv_control.parameters.transfer._PATIENCE_S", 0.3)
    served = Served()
    yield served
    served.close()


def parameters(*words):
    return cli.main(
        [*map(str, words), *(() if words[0] == "save" else ("--profile", str(PROFILE_FILE)))]
    )


def test_compare_write_save_and_compare_again(served, tmp_path, capsys):
    assert parameters("compare", served.url) == 0
    assert "0 that must be otherwise, 0 that should be" in capsys.readouterr().out

    before = dict(served.parameters)
    served.parameters.update(VISO_TYPE=(0, 2), FS_CRASH_CHECK=(0, 2), EK3_SRC1_POSZ=(1, 2))
    served.parameters.pop("FENCE_RADIUS")
    assert parameters("compare", served.url) == 1
    said = capsys.readouterr().out
    assert "MUST     VISO_TYPE is 0, not 2 or 3: without it poses are dropped" in said
    assert (
        "advised  FS_CRASH_CHECK is 0, not 1" in said
        and "advised  FENCE_RADIUS is not known there" in said
    )
    assert "1 that must be otherwise, 2 that should be" in said

    saved = tmp_path / "saved.params"
    assert parameters("save", served.url, "-o", saved) == 0
    assert "\t1\tVISO_TYPE\t0\t2" in saved.read_text() and saved.read_text().startswith(
        "# Onboard parameters"
    )
    assert set(parameter_files.read(saved)) == set(served.parameters)
    assert parameters("compare", saved) == 1
    capsys.readouterr()

    assert parameters("write", served.url, "--dry-run") == 0
    assert (
        "2 would be written" in capsys.readouterr().out and served.parameters["VISO_TYPE"][0] == 0
    )
    assert parameters("write", served.url) == 0
    said = capsys.readouterr().out
    assert (
        "VISO_TYPE 0 -> 2" in said
        and "FENCE_RADIUS is not known there: left out" in said
        and "wrote 2 of 2" in said
    )
    # fits as well
    assert served.parameters["VISO_TYPE"][0] == 2 and served.parameters["EK3_SRC1_POSZ"][0] == 1

    mission_planner = tmp_path / "before.param"
    mission_planner.write_text(parameter_files.mission_planner(before))
    assert parameters("compare", mission_planner) == 0
    served.parameters["FENCE_RADIUS"] = (77.0, 9)
    # as it was saved, exactly
    assert parameters("write", served.url, "--values", mission_planner) == 0
    assert {n: v for n, (v, _) in served.parameters.items()} == pytest.approx(
        {n: v for n, (v, _) in before.items()}
    )


def test_single_values_are_written_for_a_mission_that_is_slower_and_the_profile_leaves_them(
    served, capsys
):
    assert (
        parameters("write", served.url, "--set", "WPNAV_SPEED=100", "--set", "WPNAV_SPEED_UP=80")
        == 0
    )
    assert "WPNAV_SPEED 200 -> 100" in capsys.readouterr().out
    assert (
        served.parameters["WPNAV_SPEED"][0] == 100 and served.parameters["WPNAV_SPEED_UP"][0] == 80
    )
    assert parameters("compare", served.url) == 0 and parameters("write", served.url) == 0
    assert (
        "0 that should be" in capsys.readouterr().out and served.parameters["WPNAV_SPEED"][0] == 100
    )
    for wrong in ("WPNAV_SPEED", "WPNAV_SPEED=fast", "=1", "A=nan"):
        with pytest.raises(SystemExit):
            parameters("write", served.url, "--set", wrong)
        assert f"'{wrong}' is not NAME=VALUE" in capsys.readouterr().err


def test_parameters_are_not_written_while_it_is_armed(served, capsys):
    served.pilot.armed = True
    served.parameters["VISO_TYPE"] = (0, 2)
    assert parameters("write", served.url) == 2
    assert "it is armed" in capsys.readouterr().err and served.parameters["VISO_TYPE"][0] == 0


def test_another_firmware_is_named_and_refused(request, capsys, monkeypatch):
    # what the peer says it is
    monkeypatch.setattr(M, "MAV_AUTOPILOT_ARDUPILOTMEGA", M.MAV_AUTOPILOT_PX4, raising=True)
    monkeypatch.setattr(
        firmware, "_M", type("Other", (), {**vars(M), "MAV_AUTOPILOT_ARDUPILOTMEGA": 3})
    )
    # its first heartbeat says so already
    assert parameters("compare", request.getfixturevalue("served").url) == 2
    assert "PX4 speaks; only ArduCopter is flown" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, said",
    [
        (("compare", "none.param"), "'none.param' is neither a file nor a line"),
        (("compare", "tcp:nowhere"), "cannot be opened"),
        (("save", "udpin:127.0.0.1:1", "-o", "/no/such/folder/x.param"), "there is no folder"),
    ],
)
def test_wrong_arguments_are_named(capsys, words, said):
    assert parameters(*words) == 2
    shown = capsys.readouterr().err
    assert said in shown and shown.count("\n") == 1


def test_where_nobody_speaks_it_says_so(monkeypatch):
    port = free_port(socket.SOCK_DGRAM)
    with pytest.raises(vehicle.LinkError, match="no autopilot with system id 7"):
        vehicle.Vehicle(f"udpin:127.0.0.1:{port}", 7, patience_s=0.3)


def test_after_writing_the_profile_every_rule_fits(served):
    served.parameters.update({name: (value + 1000.0, 9) for name, value in PROFILE.values.items()})
    assert parameters("write", served.url) == 0
    assert not [rule.name for rule in PROFILE if rule.complaint(served.parameters[rule.name][0])]
