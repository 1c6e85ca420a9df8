# SPDX-License-Identifier: Apache-2.0
"""The companion's core beside MAVROS, driven by hand: whose modes, why MAVROS was refused, where
home is, bytes."""

import os

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
import pytest
from pymavlink import mavutil

from fcsv_control.errors import LinkError
from fcsv_control.flight.mavlink import frame_bytes
from fcsv_control.flight.mavros import COMPONENT, MavrosCore, mavros_url
from fcsv_control.flight.messages import HomeReceived, Refused
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_geometry.vehicles.modes import Mode

M = mavutil.mavlink
LOITER, GUIDED, LAND, BRAKE = 5, 4, 9, 17
STEP_S = 0.02


class Beside:
    """A core and the time; the autopilot speaks to MAVROS, and the core hears it, as on
    mavlink/from."""

    def __init__(self):
        self.core = MavrosCore(LinkParameters(target_system=1))
        self.encoder = M.MAVLink(None)
        self.now_s, self.out, self.told = 100.0, [], []
        self.beat(LOITER)

    def hear(self, kind, *fields, by=1):
        message = getattr(self.encoder, kind + "_encode")(*fields)
        header = message.get_header()
        header.srcSystem, header.srcComponent = 1, by
        self.core.receive(self.now_s, message)

    def beat(self, mode, armed=True):
        base = (M.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0) | M.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.hear("heartbeat", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, base, mode, 3)

    def acknowledge(self, command, result=0, component=COMPONENT, by=1):
        self.hear("command_ack", command, result, 0, 0, 1, component, by=by)

    def run(self, seconds):
        for _ in range(int(round(seconds / STEP_S))):
            self.core.step(self.now_s)
            self.out += self.core.outgoing()
            self.told += self.core.events()
            self.now_s += STEP_S

    def of(self, kind):
        return [event for event in self.told if isinstance(event, kind)]


@pytest.fixture
def beside():
    return Beside()


def test_a_mode_that_was_asked_for_on_board_is_ours_until_another_shows(beside):
    beside.core.mode_asked(Mode.BRAKE)
    assert not beside.core.mode_is_ours
    beside.beat(BRAKE)
    assert beside.core.mode_is_ours
    beside.run(0.1)
    beside.beat(BRAKE)
    assert beside.core.mode_is_ours
    beside.beat(LOITER)  # a moment later: the pilot
    assert not beside.core.mode_is_ours


def test_a_mode_that_a_pilot_chooses_is_not_ours_whatever_was_asked_before(beside):
    beside.core.mode_asked(Mode.GUIDED)
    beside.beat(GUIDED)
    beside.run(2.0)
    beside.beat(BRAKE)
    assert not beside.core.mode_is_ours


@pytest.mark.parametrize("refused", [False, True])
def test_a_brake_that_showed_before_or_was_refused_is_a_pilots_later(beside, refused):
    if refused:
        beside.core.mode_asked(Mode.BRAKE)
        beside.hear("statustext", 4, b"Mode change to BRAKE failed: requires position")
    else:
        beside.beat(BRAKE)
        beside.core.mode_asked(Mode.BRAKE)
        assert not beside.core.mode_is_ours
        beside.beat(LOITER)
    beside.run(2.0)
    beside.beat(BRAKE)
    assert not beside.core.mode_is_ours


def test_the_reason_comes_with_the_refusal_whichever_is_heard_first(beside):
    beside.hear("statustext", 4, b"Arm: VisOdom: not healthy")
    beside.acknowledge(M.MAV_CMD_COMPONENT_ARM_DISARM, 4)
    beside.run(STEP_S)
    assert beside.of(Refused) == [Refused("arming or disarming refused: Arm: VisOdom: not healthy")]
    beside.run(1.0)
    beside.acknowledge(M.MAV_CMD_NAV_TAKEOFF, 4)
    beside.run(0.1)
    beside.hear("statustext", 4, b"Takeoff: not armed")
    beside.run(0.1)
    assert beside.of(Refused)[1:] == [Refused("take-off refused: Takeoff: not armed")]


def test_a_refused_mode_is_told_by_its_text_alone(beside):
    """MAVROS sends the message SET_MODE, which has no acknowledgement."""
    beside.hear("statustext", 4, b"Mode change to GUIDED failed: requires position")
    beside.acknowledge(M.MAV_CMD_COMPONENT_ARM_DISARM, 4)  # that text is not its reason
    beside.run(1.0)
    assert beside.of(Refused) == [
        Refused("Mode change to GUIDED failed: requires position"),
        Refused("arming or disarming refused: failed"),
    ]


def test_a_refusal_without_a_reason_is_told_once_with_the_result(beside):
    beside.hear("statustext", 6, b"EKF3 IMU0 is using external nav data")  # informative: no reason
    beside.acknowledge(M.MAV_CMD_NAV_TAKEOFF, 4)
    beside.run(2.0)
    assert beside.of(Refused) == [Refused("take-off refused: failed")]


def test_answers_to_our_own_questions_and_progress_are_no_refusals(beside):
    beside.acknowledge(M.MAV_CMD_REQUEST_MESSAGE, 4)
    beside.acknowledge(M.MAV_CMD_NAV_TAKEOFF, 5)
    beside.acknowledge(M.MAV_CMD_COMPONENT_ARM_DISARM, 4, component=191)
    beside.run(1.0)
    assert not beside.of(Refused)


def home(beside, altitude_mm):
    beside.hear("home_position", 0, 0, altitude_mm, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def test_home_is_told_above_the_origin_and_asked_for_on_the_ground_only(beside):
    home(beside, 10_300)
    beside.run(0.1)
    assert not beside.of(HomeReceived)  # the origin is not known yet
    beside.hear("gps_global_origin", 350000000, 1350000000, 10_000)
    home(beside, 10_300)
    beside.run(3.0)
    assert beside.of(HomeReceived) == [HomeReceived(pytest.approx(0.3))]
    asks = lambda: [m for m in beside.out if m.get_type() == "COMMAND_LONG" and m.param1 == 242]  # noqa: E731
    assert 3 <= len(asks()) <= 5  # HOME_POSITION, once a second
    beside.beat(LOITER)
    beside.hear("extended_sys_state", 0, M.MAV_LANDED_STATE_IN_AIR)
    before = len(asks())
    for _ in range(3):
        beside.run(1.0)
        beside.beat(LOITER)
    assert len(asks()) == before


def test_streams_and_origin_are_asked_for_as_without_mavros(beside):
    beside.run(1.0)
    kinds = {m.get_type() for m in beside.out}
    commands = [m.command for m in beside.out if m.get_type() == "COMMAND_LONG"]
    assert {"HEARTBEAT", "SET_GPS_GLOBAL_ORIGIN"} <= kinds and commands.count(
        M.MAV_CMD_SET_MESSAGE_INTERVAL
    ) >= 7
    # answers to us are not MAVROS's
    assert {m.get_srcComponent() for m in beside.out}.isdisjoint({COMPONENT})


def test_ten_thousand_odd_messages_end_nothing(beside):
    random = np.random.default_rng(7)
    for _ in range(10_000):
        kind = random.integers(4)
        if kind == 0:
            beside.acknowledge(
                int(random.integers(0, 65536)),
                int(random.integers(0, 256)),
                int(random.integers(256)),
            )
        elif kind == 1:
            home(beside, int(random.integers(-(2**31), 2**31)))
        elif kind == 2:
            beside.hear(
                "statustext",
                int(random.integers(0, 8)),
                bytes(random.integers(1, 128, 50, dtype=np.uint8)),
            )
        else:
            beside.beat(int(random.integers(2**32)), bool(random.integers(2)))
        beside.run(STEP_S)
    beside.beat(GUIDED)
    assert beside.core.state.mode == Mode.GUIDED


# ---- bytes and addresses -------------------------------------------------------------------------


def again(frame):
    f = frame_bytes.to_fields(frame)
    return frame_bytes.to_frame(
        f["len"],
        f["incompat_flags"],
        f["compat_flags"],
        f["seq"],
        f["sysid"],
        f["compid"],
        f["msgid"],
        f["checksum"],
        f["payload64"],
        f["signature"],
    )


@pytest.mark.parametrize("signed", [False, True])
def test_a_message_survives_the_way_through_fields(signed):
    packer = M.MAVLink(None, srcSystem=3, srcComponent=191)
    if signed:
        packer.signing.secret_key, packer.signing.sign_outgoing, packer.signing.link_id = (
            bytes(32),
            True,
            1,
        )
        packer.signing.timestamp = 77
    for message in (
        M.MAVLink_vision_position_estimate_message(
            12345678901, 1.5, -2.0, 0.25, 0.1, 0.2, 3.0, [float("nan")] * 21, 3
        ),
        M.MAVLink_command_long_message(1, 1, 511, 0, 32, 33333, 0, 0, 0, 0, 0),
        M.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3),
    ):
        frame = bytes(message.pack(packer))
        fields = frame_bytes.to_fields(frame)
        assert (
            again(frame) == frame
            and fields["msgid"] == message.get_msgId()
            and fields["sysid"] == 3
        )
        assert len(fields["payload64"]) == (fields["len"] + 7) // 8
        assert len(fields["signature"]) == (13 if signed else 0)


def test_ten_thousand_odd_frames_are_refused_or_kept():
    random = np.random.default_rng(8)
    for _ in range(10_000):
        frame = bytes(random.integers(0, 256, random.integers(0, 60), dtype=np.uint8))
        frame = bytes([253]) + frame if random.integers(2) else frame
        try:
            assert again(frame) == frame
        except ValueError:
            pass
    with pytest.raises(ValueError, match="has 8"):
        frame_bytes.to_frame(9, 0, 0, 0, 1, 1, 0, 0, [0])


@pytest.mark.parametrize(
    "ours, mavros",
    [
        ("udpin:0.0.0.0:14550", "udp://0.0.0.0:14550@"),
        ("udpout:192.168.8.2:14550", "udp://:0@192.168.8.2:14550"),
        ("serial:///dev/ttyUSB0:921600", "serial:///dev/ttyUSB0:921600"),
    ],
)
def test_addresses_are_written_as_mavros_has_them(ours, mavros):
    assert mavros_url(ours) == mavros


@pytest.mark.parametrize("wrong", ["", "udpin", "udpin:host", "http:1.2.3.4:80", "tcp:host:port"])
def test_an_address_that_mavros_does_not_understand_is_refused(wrong):
    with pytest.raises(LinkError, match="fcu_url"):
        mavros_url(wrong)
