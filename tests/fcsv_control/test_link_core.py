# SPDX-License-Identifier: Apache-2.0
"""The flight link's core, driven by hand: which answer belongs to which command, and what stops a
vehicle."""

import os

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
import pytest
from pymavlink import mavutil
from support.autopilots import MUST, PROFILE

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight.core import STOP_REPEAT_S, LinkCore, LinkParameters
from fcsv_control.flight.mavlink.listener import STREAMS_HZ
from fcsv_control.flight.mavlink.requests import Outcome
from fcsv_control.flight.messages import (
    BarometerReceived,
    FixReceived,
    FixStatus,
    PoseReceived,
    StateReceived,
    TextReceived,
)
from fcsv_control.flight.settings.profile import NOTHING
from fcsv_geometry.vehicles.modes import Mode

M = mavutil.mavlink
STABILIZE, GUIDED, LAND, BRAKE = 0, 4, 9, 17
STEP_S = 0.02


class Line:
    """A core and the time; ``autopilot`` speaks to it as ArduCopter does."""

    def __init__(self, profile=NOTHING):
        self.core = LinkCore(LinkParameters(), profile)
        self.encoder = M.MAVLink(None)
        self.now_s, self.sent = 100.0, []
        self.beat(STABILIZE)

    def hear(self, kind, *fields):
        message = getattr(self.encoder, kind + "_encode")(*fields)
        header = message.get_header()
        header.srcSystem, header.srcComponent = 1, 1
        self.core.receive(self.now_s, message)

    def beat(self, mode, armed=False, status=M.MAV_STATE_STANDBY):
        base = (M.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0) | M.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.hear(
            "heartbeat", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, base, mode, status
        )

    def set_up(self):
        """Origin, parameters and pre-arm are known."""
        for name, value in MUST.items():
            self.hear("param_value", name.encode(), value, 9, 1, 0)
        self.hear("ekf_status_report", 0x33F, *[0.0] * 5)
        self.hear("gps_global_origin", 350000000, 1350000000, 10000, 0)
        self.hear("sys_status", 0, 0, 0x10000000, *[0] * 10)
        return self

    @property
    def known(self):
        core = self.core
        return core.origin_set(self.now_s), core.listener.parameters.known, core.state.prearm_ok

    def acknowledge(self, message, result=0):
        self.hear(
            "command_ack",
            message.command,
            result,
            0,
            0,
            message.get_srcSystem(),
            message.get_srcComponent(),
        )

    def run(self, seconds):
        """Let time pass; what was sent meanwhile."""
        sent = []
        for _ in range(int(round(seconds / STEP_S))):
            self.core.step(self.now_s)
            sent += self.core.outgoing()
            self.now_s += STEP_S
        self.sent += sent
        return sent

    def modes(self, sent):
        return [
            m for m in sent if m.get_type() == "COMMAND_LONG" and m.command == M.MAV_CMD_DO_SET_MODE
        ]


@pytest.fixture
def line():
    return Line()


def test_a_late_answer_to_guided_is_not_taken_for_lands(line):
    """Both are the same MAV_CMD. LAND goes out at once and is not done by what GUIDED is
    answered."""
    guided = line.core.set_mode(line.now_s, Mode.GUIDED)
    [asked] = line.modes(line.run(STEP_S))
    land = line.core.set_mode(line.now_s, Mode.LAND)
    [stop] = line.modes(line.run(STEP_S))
    assert int(stop.param2) == LAND and guided.outcome is Outcome.OVERTAKEN
    line.acknowledge(asked)
    line.beat(STABILIZE)
    line.run(1.0)
    assert not land.over
    with pytest.raises(CommandRefused, match="mode GUIDED was overtaken by a newer command"):
        guided.require_done()


def test_land_is_repeated_until_the_mode_shows_although_it_was_acknowledged(line):
    land = line.core.set_mode(line.now_s, Mode.LAND)
    sent = line.modes(line.run(1.0))
    assert len(sent) == pytest.approx(1.0 / STOP_REPEAT_S, abs=1)
    line.acknowledge(sent[0])
    assert len(line.modes(line.run(1.0))) == pytest.approx(1.0 / STOP_REPEAT_S, abs=1)
    line.beat(LAND, armed=True)
    assert not line.modes(line.run(1.0))
    assert land.outcome is Outcome.DONE


def test_a_stop_that_nobody_answers_ends_as_unanswered(line):
    brake = line.core.set_mode(line.now_s, Mode.BRAKE)
    line.run(6.0)
    with pytest.raises(LinkError, match="mode BRAKE: the flight controller does not answer"):
        brake.require_done()


def test_a_refused_stop_tells_the_autopilots_reason(line):
    brake = line.core.set_mode(line.now_s, Mode.BRAKE)
    [asked] = line.modes(line.run(STEP_S))
    line.hear("statustext", 4, b"Mode change to BRAKE failed: requires position")
    line.acknowledge(asked, 4)
    line.run(STEP_S)
    with pytest.raises(
        CommandRefused, match="mode BRAKE refused: Mode change to BRAKE failed: requires position"
    ):
        brake.require_done()


def test_a_mode_that_was_asked_for_before_a_pilot_chose_another_is_withdrawn(line):
    guided = line.core.set_mode(line.now_s, Mode.GUIDED)
    line.beat(BRAKE, armed=True)
    assert line.modes(line.run(1.0)) == [] and guided.outcome is Outcome.OVERTAKEN
    with pytest.raises(CommandRefused, match="mode GUIDED was withdrawn: BRAKE showed"):
        guided.require_done()
    land = line.core.set_mode(line.now_s, Mode.LAND)
    line.beat(STABILIZE, armed=True)
    assert line.modes(line.run(0.3)) and not land.over, (
        "what stops a vehicle is asked for all the same"
    )


def test_a_mode_that_shows_already_is_ours_once_it_is_acknowledged(line):
    """Flown on ArduCopter after a reboot in GUIDED: asked for again, it stayed somebody else's."""
    line.beat(GUIDED)
    line.core.set_mode(line.now_s, Mode.GUIDED)
    [asked] = line.modes(line.run(STEP_S))
    assert not line.core.mode_is_ours
    line.acknowledge(asked)
    line.run(STEP_S)
    assert line.core.mode_is_ours


def a_pilot_flies_and_chooses(line, mode):
    line.beat(STABILIZE, armed=True)
    line.run(60.0)
    line.beat(mode, armed=True)
    line.run(STEP_S)


def test_a_stop_that_a_pilot_chose_before_stays_his(line):
    """Where the feed dies the watchdog lands in a BRAKE that is ours, and only speaks in a
    pilot's."""
    line.beat(BRAKE, armed=True)
    line.core.set_mode(line.now_s, Mode.BRAKE)
    line.run(0.3)
    assert not line.core.mode_is_ours
    a_pilot_flies_and_chooses(line, BRAKE)
    assert not line.core.mode_is_ours


def test_a_mode_that_was_refused_and_that_a_pilot_chooses_later_is_his(line):
    line.core.set_mode(line.now_s, Mode.BRAKE)
    [asked] = line.modes(line.run(STEP_S))
    line.acknowledge(asked, 4)
    line.run(1.0)
    a_pilot_flies_and_chooses(line, BRAKE)
    assert not line.core.mode_is_ours


def test_a_link_that_stood_still_takes_no_mode_but_those_that_stop(line):
    """SIGSTOP: the caller's GUIDED waited with it, and a pilot may have switched meanwhile."""
    line.run(1.0)
    line.now_s += 2.0
    for _ in range(2):  # before and after its first step
        with pytest.raises(CommandRefused, match="stood still until just now; ask again"):
            line.core.set_mode(line.now_s, Mode.GUIDED)
        line.run(STEP_S)
    line.core.set_mode(line.now_s, Mode.BRAKE)
    assert line.modes(line.run(STEP_S))
    line.run(0.3)
    line.core.set_mode(line.now_s, Mode.GUIDED)
    assert line.modes(line.run(STEP_S))


def test_open_commands_speak_with_components_of_their_own_and_reuse_the_oldest(line):
    components = []
    for name in (Mode.GUIDED, Mode.LOITER, Mode.GUIDED, Mode.LOITER, Mode.GUIDED):
        line.core.set_mode(line.now_s, name)
        components.append(line.modes(line.run(STEP_S))[0].get_srcComponent())
    assert components[:4] == [192, 193, 194, 191] and components[4] == 192


def test_answers_to_other_companions_are_not_ours(line):
    guided = line.core.set_mode(line.now_s, Mode.GUIDED)
    line.run(STEP_S)
    line.hear("command_ack", M.MAV_CMD_DO_SET_MODE, 0, 0, 0, 255, 190)  # a ground station's
    line.beat(GUIDED)
    line.run(0.5)
    assert not guided.over
    line.hear("command_ack", M.MAV_CMD_DO_SET_MODE, 0)  # firmware that does not say to whom
    line.run(STEP_S)
    assert guided.outcome is Outcome.DONE


def test_messages_out_are_whole_and_name_their_source(line):
    """What the core gives can be packed as it is, with the source of its header."""
    line.core.send_pose(12.5, np.eye(4))
    line.core.send_set_point(np.eye(4))
    out = line.core.outgoing()
    assert [m.get_type() for m in out] == [
        "VISION_POSITION_ESTIMATE",
        "SET_POSITION_TARGET_LOCAL_NED",
    ]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in out} == {(1, 191)}
    packer, reader = M.MAVLink(None, srcSystem=1, srcComponent=191), M.MAVLink(None)
    for message in out:
        back = reader.parse_char(message.pack(packer))
        assert back.get_type() == message.get_type()
    assert line.core.outgoing() == []


def test_what_is_heard_comes_back_as_events_once(line):
    line.core.events()
    line.hear("attitude", 5, 0.1, 0.2, 0.3, 0, 0, 0)
    line.hear("local_position_ned", 5, 1.0, 2.0, -3.0, 0, 0, 0)
    line.hear("statustext", 6, b"Arming motors")
    line.beat(GUIDED, armed=True)
    pose, text, state = line.core.events()
    assert isinstance(pose, PoseReceived) and np.allclose(pose.T_odom_body[:3, 3], [2.0, 1.0, 3.0])
    assert text == TextReceived(6, "Arming motors") and state == StateReceived()
    assert line.core.events() == [] and line.core.state.armed


@pytest.mark.parametrize(
    "autopilot, kind, name", [(12, 2, "PX4"), (3, 1, "ArduPlane"), (3, 10, "ArduRover")]
)
def test_another_firmware_is_named_and_neither_obeyed_nor_commanded(autopilot, kind, name):
    line = Line.__new__(Line)
    line.core, line.encoder, line.now_s, line.sent = (
        LinkCore(LinkParameters()),
        M.MAVLink(None),
        100.0,
        [],
    )
    line.hear("heartbeat", kind, autopilot, M.MAV_MODE_FLAG_SAFETY_ARMED, GUIDED, 4)
    line.hear("attitude", 5, 0.1, 0.2, 0.3, 0, 0, 0)
    line.core.send_pose(100.0, np.eye(4))
    line.core.send_set_point(np.eye(4))
    assert {m.get_type() for m in line.run(3.0)} == {"HEARTBEAT"}
    assert (
        not line.core.connected(line.now_s) and not line.core.state.armed and not line.core.events()
    )
    for command in (
        lambda: line.core.set_mode(line.now_s, Mode.LAND),
        lambda: line.core.arm(line.now_s, False),
    ):
        with pytest.raises(
            CommandRefused, match=f"{name} with system id 1 speaks; only ArduCopter is flown"
        ):
            command()
    line.beat(GUIDED)  # it was flashed
    line.run(STEP_S)
    assert line.core.connected(line.now_s) and line.core.state.mode == Mode.GUIDED


def test_only_streams_that_stop_are_asked_for_again(line):
    def asked():
        sent = [m for m in line.run(1.0) if m.get_type() == "COMMAND_LONG"]
        # 0: the heartbeat
        return {int(m.param1) for m in sent if m.command == M.MAV_CMD_SET_MESSAGE_INTERVAL} - {0}

    assert len(asked()) == 8
    again = []
    for second in range(1, 13):
        line.hear("attitude", 1000 * second, *[0.0] * 6)
        line.hear("rc_channels", 1000 * second, 8, *[1500] * 18, 255)
        if not 4 < second < 9:
            line.hear("local_position_ned", 1000 * second, *[0.0] * 6)
        line.hear("sys_status", *[0] * 13)
        line.hear("ekf_status_report", 0, *[0.0] * 5)
        line.hear("extended_sys_state", 0, 1)
        line.hear("scaled_pressure", 1000 * second, 1013.25, 0.0, 2500)
        line.hear("gps_raw_int", 0, 0, 0, 0, 0, *[65535] * 4, 0)  # without a receiver
        line.beat(STABILIZE)
        again.append(asked())
    assert set().union(*again) == {M.MAVLINK_MSG_ID_LOCAL_POSITION_NED} and not any(
        [*again[:5], *again[9:]]
    )


def test_version_and_clock_are_asked_for_until_they_are_known(line):
    sent = line.run(3.0)
    version = [
        m
        for m in sent
        if m.get_type() == "COMMAND_LONG" and m.param1 == M.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    ]
    questions = [m for m in sent if m.get_type() == "TIMESYNC"]
    assert len(version) == 2 and len(questions) == 3
    line.hear("autopilot_version", 0, 0x040602FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
    line.beat(STABILIZE)
    assert line.core.listener.version == "4.6.2"
    sent = line.run(2.5)
    assert not [
        m
        for m in sent
        if m.get_type() == "COMMAND_LONG" and m.param1 == M.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    ]
    line.hear("timesync", 0, 1234)
    [answer] = [m for m in line.run(STEP_S) if m.get_type() == "TIMESYNC" and m.tc1]
    assert answer.ts1 == 1234 and answer.tc1 == pytest.approx((line.now_s - STEP_S) * 1e9, abs=1e3)


def test_ten_thousand_odd_messages_end_nothing(line):
    """Random fields, and NaN among them: the core goes on deciding."""
    random = np.random.default_rng(4)
    for _ in range(10000):
        kind = random.integers(5)
        big = float(random.choice([0.0, 1.0, -1e30, float("nan"), float("inf")]))
        if kind == 0:
            line.hear("command_ack", int(random.integers(0, 65536)), int(random.integers(0, 256)))
        elif kind == 1:
            line.hear(
                "local_position_ned", int(random.integers(0, 2**32)), big, big, big, big, big, big
            )
        elif kind == 2:
            line.hear("attitude", int(random.integers(0, 2**32)), big, big, big, big, big, big)
        elif kind == 3:
            line.hear("param_value", b"VISO_TYPE", big, 9, 1, 0)
        else:
            line.hear("heartbeat", 2, 3, int(random.integers(256)), int(random.integers(2**32)), 3)
        line.core.step(line.now_s)
        line.core.outgoing(), line.core.events()
    line.beat(GUIDED)
    assert line.core.state.mode == Mode.GUIDED


def test_the_barometer_is_heard_as_a_height(line):
    line.beat(STABILIZE)
    line.core.events()
    for hpa in (1013.25, 1001.3, float("nan"), 0.0):
        line.hear("scaled_pressure", 1000, hpa, 0.0, 2500)
    heard = [e.height_m for e in line.core.events() if isinstance(e, BarometerReceived)]
    assert heard == pytest.approx([0.0, 100.0], abs=0.1)


def test_streams_are_asked_for_in_one_order_in_every_process():
    """A set of names has another order in each process: rehearsed flights differed by it, with one
    seed."""
    asked = [
        int(m.param1)
        for m in Line().run(0.5)
        if m.get_type() == "COMMAND_LONG" and m.command == 511
    ]
    assert len(asked) >= 6 and asked == [
        getattr(M, f"MAVLINK_MSG_ID_{name}") for name in sorted(STREAMS_HZ)
    ]


@pytest.mark.parametrize(
    "fix_type, status",
    [(3, FixStatus.ALONE), (4, FixStatus.SATELLITES), (5, FixStatus.GROUND), (6, FixStatus.GROUND)],
)
def test_a_gps_fix_is_told_as_it_came(line, fix_type, status):
    before = (0, fix_type, 481000000, 116000000, 514000, 80, 120, 0, 65535, 14)
    line.hear("gps_raw_int", *before, 560000, 2000, 4000)
    (fix,) = [e for e in line.core.events() if isinstance(e, FixReceived)]
    assert fix.status is status and (fix.sigma_m, fix.height_sigma_m) == (2.0, 4.0)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((48.1, 11.6), abs=1e-9)
    assert fix.height_m == 560.0  # above the ellipsoid, not above the sea


def test_a_fix_of_old_firmware_has_neither_height_nor_accuracy_and_none_is_told_without_a_fix(line):
    before = (481000000, 116000000, 514000, 80, 120, 0, 65535, 14)
    line.hear("gps_raw_int", 0, 3, *before)
    (fix,) = [e for e in line.core.events() if isinstance(e, FixReceived)]
    assert np.isnan([fix.height_m, fix.sigma_m, fix.height_sigma_m]).all()
    for fix_type in (0, 1, 2):
        line.hear("gps_raw_int", 0, fix_type, *before)
    assert not [e for e in line.core.events() if isinstance(e, FixReceived)]


ALL_KNOWN, NOTHING_KNOWN = (True, True, True), (False, False, None)


def test_a_heartbeat_that_says_booting_makes_unknown_what_was_known_at_once(line):
    """And while it boots nothing that it says of its sensors counts."""
    line = Line(PROFILE).set_up()
    assert line.known == ALL_KNOWN
    line.now_s += 0.5
    line.beat(GUIDED, status=M.MAV_STATE_BOOT)
    assert line.known == NOTHING_KNOWN and line.core.connected(line.now_s)
    asked = {m.get_type() for m in line.run(0.5)}
    assert "PARAM_REQUEST_READ" not in asked and "SET_GPS_GLOBAL_ORIGIN" not in asked
    line.set_up()
    assert line.known[0] is False and line.known[2] is None
    line.beat(STABILIZE, status=M.MAV_STATE_BOOT)
    for ask in (
        lambda: line.core.set_mode(line.now_s, Mode.GUIDED),
        lambda: line.core.arm(line.now_s, True),
    ):
        with pytest.raises(CommandRefused, match="the autopilot is still starting"):
            ask()
    line.core.set_mode(line.now_s, Mode.LAND)  # what stops is asked for all the same
    line.beat(STABILIZE)
    assert {"PARAM_REQUEST_READ"} < {m.get_type() for m in line.run(0.5)}
    assert line.set_up().known == ALL_KNOWN


@pytest.mark.parametrize(
    "gap_s, before", [(1.9, ALL_KNOWN), (2.7, NOTHING_KNOWN), (8.0, NOTHING_KNOWN)]
)
def test_a_gap_of_heartbeats_makes_unknown_what_was_known(gap_s, before):
    """At once, not only with the next heartbeat; a lost heartbeat or two do not."""
    line = Line(PROFILE).set_up()
    for _ in range(int(round(gap_s / STEP_S))):
        line.run(STEP_S)
        line.hear("gps_global_origin", 350000000, 1350000000, 10000, 0)
    assert line.known[1:] == before[1:], "while it is silent"
    line.beat(GUIDED, armed=True)
    assert line.known[1:] == before[1:], "and at its first heartbeat"
    assert line.core.state.armed and line.set_up().known == ALL_KNOWN


def test_a_gap_that_this_process_slept_through_counts_at_the_next_heartbeat():
    line = Line(PROFILE).set_up()
    line.now_s += 4.0
    line.beat(GUIDED)
    assert line.known == NOTHING_KNOWN


@pytest.mark.parametrize(
    "name, kind, autopilot",
    [
        ("companion", M.MAV_TYPE_ONBOARD_CONTROLLER, M.MAV_AUTOPILOT_INVALID),
        ("companion as ArduPilot", M.MAV_TYPE_ONBOARD_CONTROLLER, M.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("script, INVALID", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_INVALID),
        ("script, GENERIC", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_GENERIC),
        ("script, GENERIC of type GENERIC", M.MAV_TYPE_GENERIC, M.MAV_AUTOPILOT_GENERIC),
        ("gimbal", M.MAV_TYPE_GIMBAL, M.MAV_AUTOPILOT_INVALID),
        ("gimbal as ArduPilot", M.MAV_TYPE_GIMBAL, M.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("ground station", M.MAV_TYPE_GCS, M.MAV_AUTOPILOT_INVALID),
        ("ADS-B", M.MAV_TYPE_ADSB, M.MAV_AUTOPILOT_INVALID),
        ("ADS-B as ArduPilot", M.MAV_TYPE_ADSB, M.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("camera", M.MAV_TYPE_CAMERA, M.MAV_AUTOPILOT_GENERIC),
        ("another airframe", M.MAV_TYPE_HEXAROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("PX4", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_PX4),
    ],
)
def test_foreign_heartbeats_with_the_autopilots_ids_change_nothing(
    line, wrong_input, name, kind, autopilot, caplog
):
    """Before, "armed GUIDED" became "disarmed STABILIZE", or all that the vehicle said was
    dropped."""
    line.beat(GUIDED, armed=True)
    line.core.events()
    for _ in range(8):
        line.now_s += 0.4
        line.beat(GUIDED, armed=True)
        line.hear("heartbeat", kind, autopilot, 0, STABILIZE, 0)
        line.hear("attitude", 5, 0.1, 0.2, 0.3, 0, 0, 0)
        line.hear("local_position_ned", 5, 1.0, 2.0, -3.0, 0, 0, 0)
    state = line.core.state
    assert state.armed and state.mode == Mode.GUIDED and state.system_status == 3
    assert not line.core.listener.foreigner and not line.core.listener.strangers
    assert sum(isinstance(e, PoseReceived) for e in line.core.events()) == 8
    line.core.set_mode(line.now_s, Mode.LAND)
    [told] = [r.getMessage() for r in caplog.records if "autopilot's ids" in r.getMessage()]
    assert line.core.listener.identities.imitated(line.now_s, 1) == told
    assert line.core.listener.identities.imitated(line.now_s + 6.0, 1) == ""
    wrong_input(
        "Autopilot",
        f"heartbeat of another program with the autopilot's ids: {name}",
        "left out and named",
        told,
    )


@pytest.mark.parametrize(
    "kind, autopilot", [(M.MAV_TYPE_ONBOARD_CONTROLLER, 8), (2, M.MAV_AUTOPILOT_GENERIC), (6, 8)]
)
def test_a_script_that_speaks_before_the_autopilot_is_not_taken_for_it(kind, autopilot):
    line = Line.__new__(Line)
    line.core, line.encoder, line.now_s, line.sent = (
        LinkCore(LinkParameters()),
        M.MAVLink(None),
        100.0,
        [],
    )
    line.hear("heartbeat", kind, autopilot, 0, STABILIZE, 0)
    assert not line.core.connected(line.now_s)
    line.beat(GUIDED, armed=True)
    line.hear("heartbeat", kind, autopilot, 0, STABILIZE, 0)
    assert (
        line.core.connected(line.now_s)
        and line.core.state.armed
        and not line.core.listener.foreigner
    )


@pytest.mark.parametrize(
    "system, component", [(1, 154), (1, 191), (1, 156), (255, 190), (2, 191), (1, 0)]
)
def test_heartbeats_of_other_components_and_systems_change_nothing(line, system, component):
    line.beat(GUIDED, armed=True)
    for kind, autopilot in ((2, 3), (18, 3), (26, 8), (6, 8), (2, 12)):
        message = line.encoder.heartbeat_encode(kind, autopilot, 0, STABILIZE, 0)
        message.get_header().srcSystem, message.get_header().srcComponent = system, component
        line.core.receive(line.now_s, message)
    assert line.core.state.armed and line.core.state.mode == Mode.GUIDED
    assert not line.core.listener.foreigner and not line.core.listener.strangers


def test_a_vehicle_that_was_flashed_is_met_again_after_its_silence(line):
    line.beat(GUIDED)
    line.now_s += 3.5
    line.hear("heartbeat", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_PX4, 0, 0, 3)
    assert line.core.listener.foreigner.startswith("PX4 with system id 1 speaks")
    line.beat(STABILIZE)
    assert not line.core.listener.foreigner and line.core.connected(line.now_s)
