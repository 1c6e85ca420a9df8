# SPDX-License-Identifier: Apache-2.0
"""Ports of machines that share a computer, and the end of what was started on them."""

import socket
import time

import psutil
import pytest

from fcsv_sim.machines import machines


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


@pytest.mark.parametrize("end", [lambda p: p.stop(grace_s=5.0), lambda p: p.kill()], ids=["stop", "kill"])
def test_what_a_process_started_in_a_session_of_its_own_ends_with_it(tmp_path, end):
    process = machines.Process(["sh", "-c", "setsid sleep 60 & echo begun; wait"], tmp_path / "log")
    deadline = time.monotonic() + 10.0
    while not (children := psutil.Process(process.pid).children(recursive=True)) or "begun" not in process.tail():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    end(process)
    assert process.returncode is not None
    psutil.wait_procs(children, timeout=5.0)
    assert not [c for c in children if c.is_running() and c.status() != psutil.STATUS_ZOMBIE]
    process.stop()  # safe to call again
