# SPDX-License-Identifier: Apache-2.0
"""Bytes and MAVLink that no autopilot would send: nothing dies, and an ArduCopter that speaks
afterwards is flown."""

import math
import os

os.environ.setdefault("MAVLINK20", "1")

import contextlib
import pty
import random
import socket
import struct
import time
import tty

import numpy as np
import pytest
from pymavlink import mavutil

from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.mavlink.parser import Parser
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.mavros import MavrosCore
from fcsv_control.flight.messages import BarometerReceived, PoseReceived
from fcsv_control.flight.pose_feed.feed_check import PoseCheck
from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.autopilot.udp import AutopilotUdp
from fcsv_sim.machines.machines import free_port

M = mavutil.mavlink
INPUTS = 10_000
NUMBERS = sorted(M.mavlink_map)
# what an autopilot and a companion say to each other: half of the strange messages are of these
SPOKEN = [
    "HEARTBEAT",
    "ATTITUDE",
    "LOCAL_POSITION_NED",
    "SYS_STATUS",
    "EXTENDED_SYS_STATE",
    "EKF_STATUS_REPORT",
    "TIMESYNC",
    "RC_CHANNELS",
    "SCALED_PRESSURE",
    "STATUSTEXT",
    "COMMAND_ACK",
    "GPS_GLOBAL_ORIGIN",
    "HOME_POSITION",
    "PARAM_VALUE",
    "AUTOPILOT_VERSION",
    "COMMAND_LONG",
    "COMMAND_INT",
    "SET_MODE",
    "PARAM_SET",
    "PARAM_REQUEST_READ",
    "ODOMETRY",
    "VISION_POSITION_ESTIMATE",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_GPS_GLOBAL_ORIGIN",
    "REQUEST_DATA_STREAM",
    "PARAM_REQUEST_LIST",
    "SETUP_SIGNING",
]
KNOWN = [number for number in NUMBERS if M.mavlink_map[number].msgname in SPOKEN]
EDGES = [
    struct.pack("<f", x)
    for x in (math.nan, math.inf, -math.inf, 3e38, -3e38, 1e-40, 0.0, -1.0, 1.0)
]
EDGES += [b"\xff" * 4, b"\x00\x00\x00\x80", b"\xff\xff\xff\x7f", b"\x00" * 4]


def noise(random_, size):
    return random_.getrandbits(8 * size).to_bytes(size, "little") if size else b""


def strange(random_, system, component):
    """A frame with right checksum: a message that exists, its payload made of edges and noise."""
    number = random_.choice(KNOWN if random_.random() < 0.5 else NUMBERS)
    kind = M.mavlink_map[number]
    payload = b"".join(
        random_.choice(EDGES) if random_.random() < 0.6 else noise(random_, 4)
        for _ in range(kind.unpacker.size // 4 + 1)
    )[: random_.choice([kind.unpacker.size, random_.randrange(1, kind.unpacker.size + 1)])]
    head = struct.pack(
        "<BBBBBBHB", len(payload), 0, 0, 0, system, component, number & 0xFFFF, number >> 16
    )
    crc = M.x25crc(head + payload + bytes([kind.crc_extra])).crc
    return b"\xfd" + head + payload + struct.pack("<H", crc)


def garbage(random_, system=1, component=1):
    """Noise; strange messages; such that are cut, lengthened, changed in one bit, or begin anew
    within."""
    frame = strange(
        random_,
        random_.choice([system] * 4 + [random_.randrange(256)]),
        random_.choice([component] * 4 + [random_.randrange(256)]),
    )
    at = random_.randrange(len(frame))
    return random_.choice(
        [
            frame,
            frame,
            frame,
            frame,
            frame,
            frame,
            noise(random_, random_.randrange(300)),
            frame[:at],
            frame[:at] + bytes([frame[at] ^ 1 << random_.randrange(8)]) + frame[at + 1 :],
            frame[:at] + frame,
            b"\xfd\xff" + noise(random_, random_.randrange(12)),
            b"\xfe" + noise(random_, random_.randrange(40)),
        ]
    )


def beat():
    """A heartbeat of an ArduCopter, as if it had come from the line."""
    encoder = M.MAVLink(None, srcSystem=1, srcComponent=1)
    message = encoder.heartbeat_encode(M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, 4, 3)
    return Parser().messages(message.pack(encoder))[0]


class Vehicle:
    """A simulated autopilot that is fed and flies nowhere, and the time."""

    def __init__(self, ready_s=0.5):
        self.pilot = Autopilot(hover_thrust=0.5, seed=1, ready_s=ready_s)
        self.server = MavlinkServer(self.pilot, 1)
        self.now_s = 100.0

    def step(self, dt_s=0.02):
        self.now_s += dt_s
        self.pilot.estimator.predict(self.now_s, dt_s, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
        command = self.pilot.update(self.now_s, dt_s, on_ground=True, climb_mps=0.0)
        self.server.step(self.now_s, (0.0, 0.0, 0.0))
        return command

    def lift(self):
        """In the air, in GUIDED, on a pose."""
        self.pilot.estimator.vision(self.now_s, (0.0, 0.0, 2.0), 0.0, 0)
        self.pilot.mode, self.pilot.armed, self.pilot._flying = modes.GUIDED, True, True


def flown(core, vehicle):
    """Core and vehicle speak with each other for some seconds; whether it is ready to be flown."""
    for k in range(800):
        vehicle.step()
        for message in vehicle.server.outgoing():
            core.receive(vehicle.now_s, message)
        if k % 2:
            core.send_pose(vehicle.now_s, np.eye(4))
        core.step(vehicle.now_s)
        core.events()
        for message in core.outgoing():
            vehicle.server.receive(vehicle.now_s, message)
    ready = (
        core.connected(vehicle.now_s) and core.origin_set(vehicle.now_s) and core.state.prearm_ok
    )
    return ready and core.estimate_apart_m(vehicle.now_s) < 0.3


@pytest.mark.parametrize("kind", [LinkCore, MavrosCore])
def test_ten_thousand_strange_inputs_end_no_link(kind):
    """Also what the guardian's feed check is given of it: numbers alone, so that it goes on
    checking."""
    random_, line, vehicle = random.Random(1), Parser(), Vehicle()
    core, check, heard = kind(LinkParameters(target_system=1)), PoseCheck(), 0
    packer = M.MAVLink(None)
    for k in range(INPUTS):
        vehicle.now_s += 0.005
        if k % 5 == 0:
            # or it would be another firmware to it, and not be heard at all
            core.receive(vehicle.now_s, beat())
        for message in line.messages(garbage(random_)):
            core.receive(vehicle.now_s, message)
        if k % 4 == 0:
            core.step(vehicle.now_s)
            core.send_pose(vehicle.now_s, np.eye(4))
        for event in core.events():
            heard += 1
            if isinstance(event, PoseReceived):
                assert np.isfinite(event.T_odom_body).all() and np.isfinite(event.v_odom_mps).all()
                check.estimate(vehicle.now_s, event.T_odom_body, event.v_odom_mps)
            if isinstance(event, BarometerReceived):
                assert math.isfinite(event.height_m)
        for message in core.outgoing():
            message.pack(packer)  # whatever it answers can be sent
    assert heard > 500
    assert flown(core, vehicle)


@pytest.mark.parametrize("kind", [LinkCore, MavrosCore])
def test_ten_thousand_strange_inputs_end_no_simulated_autopilot(kind):
    """Of companions and ground stations: nothing that is no number reaches its motors, and it can
    be flown after it."""
    random_, line, vehicle = random.Random(2), Parser(), Vehicle()
    packer, heard = M.MAVLink(None), 0
    for k in range(INPUTS):
        for message in line.messages(garbage(random_)):
            heard += 1
            vehicle.server.receive(vehicle.now_s, message)
        if k % 200 == 0:
            vehicle.lift()
        if k % 4 == 0:
            assert np.isfinite(vehicle.step()).all()
            for message in vehicle.server.outgoing():
                message.pack(packer)
    assert heard > INPUTS // 2
    vehicle.pilot.disarm(vehicle.now_s, force=True)
    vehicle.pilot.reboot()
    vehicle.server = MavlinkServer(vehicle.pilot, 1)
    assert flown(kind(LinkParameters(target_system=1)), vehicle)


class Peer:
    """What speaks to a line of the flight link: ``say`` bytes, in whatever way this kind of line
    has."""

    def __init__(self, kind):
        self._open = contextlib.ExitStack()
        if kind == "serial":
            self._master, slave = pty.openpty()
            tty.setraw(slave)
            self._open.callback(os.close, self._master)
            self._open.callback(os.close, slave)
            os.set_blocking(self._master, False)
            self.transport = Transport(f"{os.ttyname(slave)}:921600")
            self.say = lambda data: os.write(self._master, data)
        elif kind == "tcp":
            listener = self._open.enter_context(socket.create_server(("127.0.0.1", 0)))
            self.transport = Transport(f"tcp:127.0.0.1:{listener.getsockname()[1]}")
            connection = self._open.enter_context(listener.accept()[0])
            self.say = connection.sendall
        else:
            port = free_port(socket.SOCK_DGRAM)
            sock = self._open.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self.transport = Transport(f"udpin:127.0.0.1:{port}")
            self.say = lambda data: sock.sendto(data, ("127.0.0.1", port))
        self._open.callback(self.transport.close)

    def heard(self):
        """Messages that have come."""
        came = []
        while True:
            message = self.transport.receive(0.0)
            if message is None:
                return came
            came.append(message)

    def close(self):
        self._open.close()


def test_a_line_keeps_only_what_may_still_become_a_message():
    """Whole messages and the beginning of the next in each piece: so it was kept for ever
    before."""
    line = Parser()
    frame = strange(random.Random(5), 1, 1)
    for _ in range(INPUTS):
        assert len(line.messages(frame[5:] + frame[:5])) <= 2
    assert len(line.buf) < 5000


@pytest.mark.parametrize("kind", ["udp", "tcp", "serial"])
def test_ten_thousand_strange_inputs_end_no_line(kind):
    """It stays open, keeps nothing of it, and the next heartbeats are heard."""
    peer, random_, heard = Peer(kind), random.Random(3), 0
    encoder = M.MAVLink(None, srcSystem=1, srcComponent=1)
    message = encoder.heartbeat_encode(M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, 4, 3)
    try:
        line = peer.transport._line
        for k in range(INPUTS):
            peer.say(garbage(random_))
            if k % 5 == 4:
                heard += len(peer.heard())
        # a false length swallows what comes after it
        assert peer.transport._line is line and heard > INPUTS // 30
        end_s, beats = time.monotonic() + 5.0, 0
        while beats < 10 and time.monotonic() < end_s:
            peer.say(message.pack(encoder))
            time.sleep(0.001)
            beats += sum(m.get_type() == "HEARTBEAT" and m.custom_mode == 4 for m in peer.heard())
        assert beats >= 10 and peer.transport._line is line
    finally:
        peer.close()


def test_ten_thousand_strange_inputs_end_no_line_of_the_simulated_autopilot():
    vehicle, random_ = Vehicle(), random.Random(4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion:
        companion.bind(("127.0.0.1", 0))
        companion.setblocking(False)
        line = AutopilotUdp(vehicle.server, f"127.0.0.1:{companion.getsockname()[1]}", 1)
        try:
            line.step(vehicle.now_s, (0.0, 0.0, 0.0))  # says a heartbeat
            home = companion.recvfrom(300)[1]
            for k in range(INPUTS):
                companion.sendto(garbage(random_), home)
                if k % 10 == 9:
                    vehicle.step(0.02)
                    line.step(vehicle.now_s, (0.0, 0.0, 0.0))
                    with contextlib.suppress(BlockingIOError):
                        while True:
                            companion.recv(300)
        finally:
            line.close()
