# SPDX-License-Identifier: Apache-2.0
"""Ports of machines that share a computer."""

import socket

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
