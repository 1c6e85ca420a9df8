# SPDX-License-Identifier: Apache-2.0
"""Lines to a flight controller: peers that come and go, and two autopilots at one port."""

import os

from support.waiting import within

os.environ.setdefault("MAVLINK20", "1")

import contextlib
import socket
import time

import numpy as np
import pytest
from pymavlink import mavutil
from support.link_by_hand import LinkByHand

from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.machines.machines import free_port

M = mavutil.mavlink


class Speaker:
    """A socket that says an autopilot's heartbeats and parses what it is told."""

    def __init__(self, system=1):
        self.encoder = M.MAVLink(None, srcSystem=system, srcComponent=1)
        self.decoder = M.MAVLink(None)
        self.decoder.robust_parsing = True
        self.heard = []

    def beat(self, mode=4):
        message = self.encoder.heartbeat_encode(
            M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, mode, 3
        )
        return message.pack(self.encoder)

    def take(self, data):
        self.heard += [m.get_type() for m in self.decoder.parse_buffer(data) or ()]


until = within(6.0)


class TcpAutopilot(Speaker):
    """Listens, and can go away and come back at the same port."""

    def __init__(self, port):
        super().__init__()
        self.port, self.listener, self.connection = port, None, None

    def come(self):
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind(("127.0.0.1", self.port))
        self.listener.listen(1)
        self.listener.setblocking(False)

    def speak(self):
        """One turn: take who comes, say a heartbeat, read."""
        with contextlib.suppress(BlockingIOError, OSError):
            if self.connection is None:
                self.connection, _ = self.listener.accept()
                self.connection.setblocking(False)
            self.connection.sendall(self.beat())
            self.take(self.connection.recv(65536))

    def go(self):
        for each in (self.connection, self.listener):
            if each is not None:
                each.close()
        self.connection = self.listener = None


def test_a_tcp_peer_may_come_late_go_and_come_back():
    autopilot = TcpAutopilot(free_port())
    link = LinkByHand(f"tcp:127.0.0.1:{autopilot.port}")  # nobody is there yet
    try:
        for _ in range(2):
            autopilot.come()
            until(lambda: autopilot.speak() or link.connected)
            autopilot.heard.clear()
            until(lambda: autopilot.speak() or "HEARTBEAT" in autopilot.heard)
            autopilot.go()
            until(lambda: link._transport.broken)
            assert link._thread.is_alive()
            until(lambda: not link.connected, 4.0)
            began_s = time.monotonic()
            for _ in range(30):
                link.send_pose(time.monotonic(), np.eye(4))  # lost: neither raised nor waited for
            assert time.monotonic() - began_s < 0.5
    finally:
        link.close()
        autopilot.go()
    assert not link._thread.is_alive()


def test_a_tcp_peer_that_falls_silent_is_connected_to_again(monkeypatch):
    monkeypatch.setattr("fcsv_control.flight.mavlink.lines._SILENT_S", 0.3)
    monkeypatch.setattr("fcsv_control.flight.mavlink.transport._REOPEN_S", 0.05)
    autopilot = TcpAutopilot(free_port())
    autopilot.come()
    transport = Transport(f"tcp:127.0.0.1:{autopilot.port}")
    try:
        autopilot.speak()
        assert transport.receive(0.5).get_type() == "HEARTBEAT"
        # its machine lost power: no end is told
        first, autopilot.connection = autopilot.connection, None
        until(lambda: autopilot.speak() or transport.receive(0.05) is not None)
        first.close()
    finally:
        transport.close()
        autopilot.go()


class UdpAutopilot(Speaker):
    def __init__(self, port, system=1):
        super().__init__(system)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.to = ("127.0.0.1", port)

    def speak(self, mode=4):
        self.socket.sendto(self.beat(mode), self.to)
        with contextlib.suppress(BlockingIOError):
            while True:
                self.take(self.socket.recv(65536))


@pytest.fixture
def udp():
    port = free_port(socket.SOCK_DGRAM)
    link = LinkByHand(f"udpin:127.0.0.1:{port}", LinkParameters(target_system=1))
    made = []

    def autopilot(system):
        made.append(UdpAutopilot(port, system))
        return made[-1]

    yield link, autopilot
    link.close()
    for each in made:
        each.socket.close()


def test_poses_go_to_the_address_of_the_vehicles_own_autopilot_alone(udp):
    """Before, a second autopilot on the port received and fused all of the first one's poses."""
    link, autopilot = udp
    ours, other = autopilot(1), autopilot(2)
    until(lambda: other.speak() or ours.speak() or (link.connected and link.strangers == (2,)))
    for _ in range(20):
        link.send_pose(time.monotonic(), np.eye(4))
        ours.speak()
        other.speak()
        time.sleep(0.01)
    until(lambda: ours.speak() or ours.heard.count("VISION_POSITION_ESTIMATE") == 20)
    assert other.heard == []


def test_a_second_autopilot_with_the_same_id_is_refused_aloud_until_the_first_is_gone(
    udp, caplog, monkeypatch
):
    link, autopilot = udp
    ours, other = autopilot(1), autopilot(1)
    until(lambda: ours.speak() or link.connected)
    for _ in range(20):
        ours.speak(mode=4)
        other.speak(mode=9)
        time.sleep(0.01)
    until(lambda: ours.speak() or link.state.mode == Mode.GUIDED)
    assert "a second autopilot with system id 1 speaks from" in caplog.text and other.heard == []
    # the first is silent: it was replaced
    until(lambda: other.speak(mode=9) or link.state.mode == Mode.LAND, 5.0)


def test_a_script_with_the_autopilots_ids_does_not_take_its_address(udp):
    """It speaks first, from another port, and goes on: before, the autopilot was refused as a
    second one."""
    link, autopilot = udp
    script, ours = autopilot(1), autopilot(1)
    says = script.encoder.heartbeat_encode(
        M.MAV_TYPE_ONBOARD_CONTROLLER, M.MAV_AUTOPILOT_INVALID, 0, 0, 4
    )
    script.beat = lambda mode=0: says.pack(script.encoder)
    for _ in range(20):
        script.speak()
        time.sleep(0.01)
    assert not link.connected
    until(lambda: script.speak() or ours.speak() or (link.connected and link.imitated))
    link.send_pose(time.monotonic(), np.eye(4))
    until(lambda: script.speak() or ours.speak() or "VISION_POSITION_ESTIMATE" in ours.heard)
    assert script.heard == [] and link.state.mode == Mode.GUIDED


def test_random_bytes_on_the_port_end_nothing(udp):
    link, autopilot = udp
    ours, random = autopilot(1), np.random.default_rng(2)
    for _ in range(2000):
        ours.socket.sendto(random.bytes(int(random.integers(1, 300))), ours.to)
    until(lambda: ours.speak() or link.connected)


def test_while_a_peer_is_away_who_reads_goes_on(monkeypatch):
    """Before, each try to open the line again kept the link's time standing for a second: it
    refused GUIDED for having stood still, not for want of an autopilot."""
    opened = []
    monkeypatch.setattr("fcsv_control.flight.mavlink.transport._REOPEN_S", 30.0)
    monkeypatch.setattr(
        "fcsv_control.flight.mavlink.transport._opened", lambda *a: opened.append(a) or absent()
    )
    transport = Transport("tcp:127.0.0.1:5760")
    begun_s = time.monotonic()
    for _ in range(20):
        assert transport.receive(0.01) is None
    assert 0.2 <= time.monotonic() - begun_s < 15.0 and len(opened) == 1
    monkeypatch.setattr("fcsv_control.flight.mavlink.transport._REOPEN_S", 0.1)
    transport._reopen_s = time.monotonic()
    # and it is tried again and again
    until(lambda: transport.receive(0.01) or len(opened) == 3)
    transport.close()


def absent():
    raise ConnectionRefusedError("nobody listens")
