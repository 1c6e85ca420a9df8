# SPDX-License-Identifier: Apache-2.0
"""MAVLink signing: who has the key is heard, nobody else, and nobody else can shut him out."""

import os

os.environ.setdefault("MAVLINK20", "1")

import contextlib
import socket
import time
from types import SimpleNamespace

import pytest
from pymavlink import mavutil
from support.autopilots import Served
from support.link_by_hand import LinkByHand

from fcsv_control.commands import signing as command
from fcsv_control.conditions import Grade
from fcsv_control.errors import LinkError
from fcsv_control.flight.mavlink.parser import Parser, Sender
from fcsv_control.flight.mavlink.signing import Signing, read_key
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight_check.autopilot_line import AutopilotLine
from fcsv_control.flight_check.lines import Judged
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import VEHICLE_CHECKS, VehicleFacts
from fcsv_control.parameters import transfer, vehicle
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.autopilot.udp import AutopilotUdp
from fcsv_sim.machines.machines import free_port

M = mavutil.mavlink
KEY, OTHER = bytes(range(32)), bytes(32)
GOOD = KEY.hex() + "\n"
NOW_S = 1.8e9


def key_file(tmp_path, text=GOOD, mode=0o600):
    path = tmp_path / "uav1.key"
    path.write_text(text)
    path.chmod(mode)
    return str(path)


def test_a_key_file_is_read(tmp_path):
    assert read_key(key_file(tmp_path)) == KEY


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o666])
def test_a_key_that_others_may_read_or_change_is_refused(tmp_path, mode):
    with pytest.raises(LinkError, match=f"others may read it .mode 0{mode:o}"):
        read_key(key_file(tmp_path, mode=mode))


@pytest.mark.parametrize(
    "text", ["", "secret", KEY.hex()[:-2], KEY.hex() + "00", "g" * 64, f"{2**83:021x} " * 3, "ö"]
)
def test_what_is_no_key_is_refused(tmp_path, text):
    with pytest.raises(LinkError, match="is no signing key of 64 hexadecimal digits"):
        read_key(key_file(tmp_path, text))
    with pytest.raises(LinkError, match="No such file"):
        read_key(str(tmp_path / "absent"))


class Wire:
    """What a sender writes."""

    def __init__(self, key=KEY, clock_s=NOW_S, component=1):
        self.clock_s, self._sent = clock_s, b""
        signing = Signing(key, lambda: self.clock_s) if key else None
        self.sender = Sender(self, signing)
        self.sender.srcSystem, self.sender.srcComponent = 1, component

    def write(self, data):
        self._sent = bytes(data)

    def beat(self, mode=4):
        message = M.MAVLink_heartbeat_message(
            M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, mode, 3, 3
        )
        self.sender.send(message)
        return self._sent


@pytest.fixture
def parser():
    return Parser(Signing(KEY, lambda: NOW_S))


def modes(parser, data):
    """Of the heartbeats in it that are heard."""
    return [m.custom_mode for m in parser.messages(data) if m.get_type() == "HEARTBEAT"]


def test_only_what_is_signed_with_the_key_is_heard(parser):
    assert modes(parser, Wire().beat(4)) == [4]
    assert modes(parser, Wire(key=None).beat(9)) == [] and modes(parser, Wire(OTHER).beat(9)) == []
    changed = bytearray(Wire(clock_s=NOW_S + 1.0).beat(4))
    changed[10] ^= 1  # and its checksum made right again
    changed[-15:-13] = M.x25crc(bytes(changed[1:-15]) + bytes([50])).crc.to_bytes(2, "little")
    assert modes(Parser(), bytes(changed)) == [5] and modes(parser, bytes(changed)) == []


def test_a_message_that_is_repeated_is_not_heard_again(parser):
    wire = Wire()
    first, second = wire.beat(4), wire.beat(9)
    assert (
        modes(parser, first + second) == [4, 9]
        and modes(parser, first) == []
        and modes(parser, second) == []
    )
    assert modes(parser, wire.beat(5)) == [5]


def test_a_recording_of_another_stream_is_not_heard(parser):
    recorded = Wire(component=7, clock_s=NOW_S - 120.0).beat(9)
    assert modes(parser, Wire().beat(4)) == [4] and modes(parser, recorded) == []


def test_a_forged_message_of_the_future_shuts_nobody_out(parser):
    """pymavlink's own check does: it keeps the time of a message whose signature is wrong."""
    wire, forged = Wire(), Wire(OTHER, clock_s=NOW_S + 1e8)
    theirs = M.MAVLink(None)
    theirs.robust_parsing, theirs.signing.secret_key = True, KEY
    for each, heard in ((parser, [4]), (theirs, [])):
        assert [m for m in each.parse_buffer(forged.beat(9)) if m.get_type() == "HEARTBEAT"] == []
        assert [
            m.custom_mode for m in each.parse_buffer(wire.beat(4)) if m.get_type() == "HEARTBEAT"
        ] == heard


def test_a_sender_keeps_to_the_clock_and_is_newer_than_what_was_heard(parser):
    """An autopilot takes the newest time that it hears for its own: one that is ahead is answered
    after its time."""
    wire = Wire()
    wire.beat()
    wire.clock_s += 3600.0
    wire.beat()
    assert wire.sender.signing.timestamp >= int((wire.clock_s - 1420070400.0) * 1e5)
    assert modes(parser, Wire(clock_s=NOW_S + 7200.0).beat(4)) == [4]
    ours = Sender(wire, parser.signing)
    ours.send(M.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    assert modes(Parser(Signing(KEY, lambda: NOW_S + 7200.0)), wire._sent) == [0]


@contextlib.contextmanager
def flown(link_key, autopilot_key):
    """A flight link and a simulated autopilot on one UDP port, and a step of the autopilot."""
    port = free_port(socket.SOCK_DGRAM)
    link = LinkByHand(
        Transport(f"udpin:127.0.0.1:{port}", link_key), LinkParameters(target_system=1)
    )
    pilot = Autopilot(hover_thrust=0.5, seed=1)
    line = AutopilotUdp(MavlinkServer(pilot, 1), f"127.0.0.1:{port}", 1, autopilot_key)

    def until(condition, timeout_s):
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s and not condition():
            line.step(time.monotonic(), (0.0, 0.0, 0.0))
            time.sleep(0.01)
        return condition()

    try:
        yield link, pilot, until, port
    finally:
        link.close()
        line.close()


def test_link_and_autopilot_with_one_key_hear_each_other_and_no_stranger():
    with flown(KEY, KEY) as (link, pilot, until, port):
        # it answered a request
        assert until(lambda: link.connected and link.firmware == "ArduCopter 4.3.8", 10.0)
        before = link.state.mode
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for key in (None, OTHER):
                stranger.sendto(
                    Wire(key, clock_s=time.time() + 1e6).beat(mode=9), ("127.0.0.1", port)
                )
            until(lambda: False, 0.5)
        assert link.state.mode == before and link.strangers == () and link.connected


@pytest.mark.parametrize("link_key, autopilot_key", [(None, KEY), (OTHER, KEY), (KEY, None)])
def test_an_autopilot_obeys_nobody_who_signs_otherwise(link_key, autopilot_key):
    """An unsigned link hears the signed autopilot, as any ground station does; it is not obeyed."""
    with flown(link_key, autopilot_key) as (link, pilot, until, _):
        until(lambda: False, 1.5)
        assert not link.firmware and pilot.origin is None
        assert link.connected == (link_key is None)


def test_the_flight_check_names_a_line_that_is_not_signed():
    def line(**given):
        facts = VehicleFacts(line=AutopilotLine(**given))
        facts.link.tell(0.9, SimpleNamespace(connected=False, doubt="", feed_age_s=9.0))
        lines = Judged("uav1", VEHICLE_CHECKS).lines(1.0, facts, VehicleCheckRules())
        return next(each for each in lines if each.name == "signing")

    found = line(url="udpin:0.0.0.0:14550")
    assert (
        found.state is Grade.AMBER and "not signed" in found.what and "signing_key" in found.remedy
    )
    assert line(url="udpin:0.0.0.0:14550", signed=True).state is Grade.GREEN
    assert line(url="/dev/ttyACM0:921600").state is Grade.GREEN


# ---- the command that gives an autopilot its key -------------------------------------------------


@pytest.fixture
def served(monkeypatch):
    monkeypatch.setattr(command, "_ANSWERS_S", 1.3)  # where nobody answers that is waited for
    monkeypatch.setattr(command, "_TRIES", 2)
    monkeypatch.setattr(transfer, "_PATIENCE_S", 0.2)
    monkeypatch.setattr(vehicle, "_COMPLAINS_S", 0.2)
    made = []

    def serve(**line):
        made.append(Served(**line))
        return made[-1]

    yield serve
    for each in made:
        each.close()


def signing(*words):
    return command.main([str(word) for word in words])


def test_an_autopilot_gets_its_key_signs_goes_on_after_a_restart_and_loses_it(
    served, tmp_path, capsys
):
    one, file = served(), key_file(tmp_path)
    assert (
        signing("check", one.url, "--key", file) == 1
        and "nobody who signs with" in capsys.readouterr().out
    )
    assert signing("set", one.url, "--key", file) == 0
    assert f"signs with {file}" in capsys.readouterr().out and one.server.signing[0] == KEY
    one.pilot.reboot()
    assert signing("check", one.url, "--key", file) == 0
    assert "it answers nobody who does not sign" in capsys.readouterr().out
    assert (
        signing("remove", one.url) == 2
        and "on another port than USB give --key" in capsys.readouterr().err
    )
    assert one.server.signing[0] == KEY
    assert signing("remove", one.url, "--key", file) == 0 and one.server.signing is None


def test_a_key_is_changed_by_who_has_the_old_one_or_the_cable(served, tmp_path, capsys):
    before = bytes(31) + b"1"
    one, usb = served(key=before), served(key=before, usb=True)
    new, old = key_file(tmp_path), tmp_path / "old.key"
    old.write_text(before.hex())
    old.chmod(0o600)
    assert (
        signing("set", one.url, "--key", new) == 2
        and "does not sign with" in capsys.readouterr().err
    )
    assert (
        signing("set", one.url, "--key", new, "--old-key", old) == 0
        and one.server.signing[0] == KEY
    )
    assert signing("set", usb.url, "--key", new) == 0 and usb.server.signing[0] == KEY
    capsys.readouterr()
    assert signing("check", usb.url, "--key", new) == 0
    assert (
        "it answers also who does not sign; so does ArduCopter on its first port"
        in capsys.readouterr().out
    )


def test_an_armed_autopilot_gets_no_key(served, tmp_path, capsys):
    one = served()
    one.pilot.armed = True
    assert signing("set", one.url, "--key", key_file(tmp_path)) == 2
    assert (
        "it is armed: keys are set on the ground" in capsys.readouterr().err
        and one.server.signing is None
    )
    m = M.MAVLink_setup_signing_message(4, 1, list(KEY), 1)  # and would not take one
    one.server.receive(time.monotonic(), m)
    assert one.server.signing is None


@pytest.mark.parametrize(
    "url", ["udpin:0.0.0.0:14550", "tcp:192.168.1.5:5760", "udpout:localhost.my.net:14550"]
)
def test_a_key_does_not_leave_the_computer_by_a_line_that_others_hear(tmp_path, capsys, url):
    assert signing("set", url, "--key", key_file(tmp_path)) == 2
    assert "who listens would have the key" in capsys.readouterr().err


def test_a_key_of_zeros_is_none(tmp_path, capsys):
    assert signing("set", "/dev/ttyACM0:115200", "--key", key_file(tmp_path, "0" * 64)) == 2
    assert "a key of zeros alone means no key" in capsys.readouterr().err
    assert signing("set", "/dev/ttyACM0:115200", "--key", key_file(tmp_path, mode=0o644)) == 2
    assert "others may read it" in capsys.readouterr().err


def test_a_key_for_another_vehicle_is_not_taken():
    server = MavlinkServer(Autopilot(hover_thrust=0.5, seed=1), 1)
    for system, taken in ((2, False), (1, True)):
        server.receive(0.0, M.MAVLink_setup_signing_message(system, 1, list(KEY), 5))
        assert (server.signing == (KEY, 5)) == taken
    server.receive(0.0, M.MAVLink_setup_signing_message(0, 1, [0] * 32, 0))
    assert server.signing is None
