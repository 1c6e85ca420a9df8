# SPDX-License-Identifier: Apache-2.0
"""Ports of machines that share a computer, and the end of what was started on them."""

import signal
import socket
import subprocess
import sys

import psutil
import pytest
from support.waiting import within

from fcsv_sim.machines import machines

until = within(10.0)


def test_a_port_is_given_once_though_nobody_listens_yet(monkeypatch):
    monkeypatch.setattr(machines, "_PORTS", (20000, 20004))
    monkeypatch.setattr(machines, "_given", set())
    given = []
    with pytest.raises(machines.MachineError, match="20000 to 20004"):
        for _ in range(5):
            given.append(machines.free_port(socket.SOCK_DGRAM))
    assert len(set(given)) == len(given) >= 1


def test_a_port_that_someone_listens_on_is_not_given(monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        monkeypatch.setattr(machines, "_PORTS", (port, port + 1))
        with pytest.raises(machines.MachineError, match="no free port"):
            machines.free_port()


@pytest.mark.parametrize(
    "end", [lambda p: p.stop(grace_s=5.0), lambda p: p.kill()], ids=["stop", "kill"]
)
def test_what_a_process_started_in_a_session_of_its_own_ends_with_it(tmp_path, end):
    process = machines.Process(["sh", "-c", "setsid sleep 60 & echo begun; wait"], tmp_path / "log")
    until(lambda: "begun" in process.tail(), what="the shell")
    children = until(
        lambda: psutil.Process(process.pid).children(recursive=True), what="what it started"
    )
    end(process)
    assert process.returncode is not None
    psutil.wait_procs(children, timeout=5.0)
    assert not [c for c in children if c.is_running() and c.status() != psutil.STATUS_ZOMBIE]
    process.stop()  # safe to call again


def test_what_a_program_in_the_background_starts_is_ended_by_sigint(tmp_path):
    """A shell starts it with SIGINT ignored, which its programs would inherit."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    process = machines.Process(["sleep", "60"], tmp_path / "log")
    try:
        process.signal(signal.SIGINT)
        assert process.wait(10.0) == -signal.SIGINT
    finally:
        process.kill()


def test_a_node_of_a_machine_is_found_by_its_name_and_the_machines_folder(tmp_path):
    """Two machines of one computer run a node of the same name each."""
    sleeps = [sys.executable, "-c", "import time; time.sleep(60)", "__name:=camera"]
    started = {
        n: subprocess.Popen([*sleeps, f"__log:={tmp_path}/{n}/log/camera.log"])
        for n in ("uav1", "uav2")
    }
    try:
        assert {n: machines.node_process(tmp_path / n, "camera").pid for n in started} == {
            n: p.pid for n, p in started.items()
        }
        with pytest.raises(machines.MachineError, match="uav1: no agent runs there"):
            machines.node_process(tmp_path / "uav1", "agent")
    finally:
        for process in started.values():
            process.kill()
            process.wait()
