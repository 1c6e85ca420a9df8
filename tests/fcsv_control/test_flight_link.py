# SPDX-License-Identifier: Apache-2.0
"""The flight link over real UDP against a scripted peer that answers as ArduCopter 4.3.8 was
measured to."""

import os

os.environ.setdefault("MAVLINK20", "1")

import collections
import contextlib
import math
import socket
import threading
import time
import tty

import numpy as np
import pytest
from pymavlink import mavutil
from support.autopilots import PROFILE
from support.link_by_hand import LinkByHand

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight.messages import AutopilotState, PoseEstimated, TextReceived
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.machines.machines import free_port

M = mavutil.mavlink
GUIDED, LAND, STABILIZE = 4, 9, 0
FAST = {"command_timeout_s": 0.6, "command_tries": 3}


class Peer:
    """An autopilot's side: silent unless asked, origin dropped twice, no arming without a fresh
    pose, told reasons."""

    def __init__(self, port, system=1):
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=system, source_component=1
        )
        self.mav = self.link.mav
        self.parameters = dict(PROFILE.values)
        self.mode, self.armed, self.follows, self.home_mm = STABILIZE, False, True, 0
        self.mute_acks = 0  # answers to swallow
        self.in_progress = False
        self.heard = []
        self.sent = collections.Counter()  # by message number
        self.boot()
        self.running = True
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def boot(self):
        self.boot_s, self.intervals, self.due = (
            time.monotonic(),
            {},
            {M.MAVLINK_MSG_ID_HEARTBEAT: 0.0},
        )
        self.origin, self.origins_dropped, self.vision_s, self.spoken = None, 0, -math.inf, False
        self.silent = False

    def run(self):
        while self.running:
            try:
                m = self.link.recv_match(blocking=True, timeout=0.01)
            except ConnectionRefusedError:
                continue
            if m is not None and not self.silent:
                self.heard.append(m)
                self.spoken = True
                getattr(self, "on_" + m.get_type().lower(), lambda m: None)(m)
            if not self.silent:
                self.send_due(time.monotonic())

    def send_due(self, now):
        self.intervals.setdefault(M.MAVLINK_MSG_ID_HEARTBEAT, 1.0)
        for message, interval in list(self.intervals.items()):
            if now >= self.due.get(message, 0.0):
                self.due[message] = now + interval
                self.send(message)

    def send(self, message):
        self.sent[message] += 1
        ms = int(1000 * (time.monotonic() - self.boot_s))
        if message == M.MAVLINK_MSG_ID_HEARTBEAT:
            base = (
                M.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            ) | M.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            self.mav.heartbeat_send(
                M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 3
            )
        elif message == M.MAVLINK_MSG_ID_ATTITUDE:
            self.mav.attitude_send(ms, 0.1, 0.2, 0.3, 0, 0, 0)
        elif message == M.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            self.mav.local_position_ned_send(ms, 1.0, 2.0, -3.0, 0, 0, 0)
        elif message == M.MAVLINK_MSG_ID_SYS_STATUS:
            self.mav.sys_status_send(1, 1, 0x10000000, 100, 15800, 1200, 77, 0, 0, 0, 0, 0, 0)
        elif message == M.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
            self.mav.ekf_status_report_send(0x33F, 0.1, 0.2, 0.3, 0.4, 0.0)
        elif message == M.MAVLINK_MSG_ID_RC_CHANNELS:
            self.mav.rc_channels_send(ms, 8, 1500, 1500, 1250, *[1500] * 5, *[0] * 10, 99)
        elif message == M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN and self.origin:
            self.mav.gps_global_origin_send(*self.origin)
        elif message == M.MAVLINK_MSG_ID_HOME_POSITION and self.origin:
            self.mav.home_position_send(
                *self.origin[:2], self.home_mm, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )

    def say(self, text, severity=2):
        if self.spoken:
            self.mav.statustext_send(severity, text.encode())

    def on_vision_position_estimate(self, _m):
        self.vision_s = time.monotonic()

    def on_set_gps_global_origin(self, m):
        self.origins_dropped += 1
        if self.origins_dropped > 2 and self.origin is None:
            self.origin = (m.latitude, m.longitude, m.altitude)
            self.send(M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)

    def on_param_request_read(self, m):
        if m.param_id in self.parameters:
            self.mav.param_value_send(m.param_id.encode(), self.parameters[m.param_id], 2, 1305, 0)

    def on_param_set(self, m):
        self.parameters[m.param_id] = m.param_value
        self.mav.param_value_send(m.param_id.encode(), m.param_value, 2, 1305, 0)

    def on_command_long(self, m):
        result = self.do(m)
        if m.command in (M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAV_CMD_REQUEST_MESSAGE):
            self.mav.command_ack_send(
                m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            )
            return
        if self.mute_acks:
            self.mute_acks -= 1
            return
        if self.in_progress:
            self.mav.command_ack_send(m.command, 5, 0, 0, m.get_srcSystem(), m.get_srcComponent())
            time.sleep(0.5)
        self.mav.command_ack_send(m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent())

    def do(self, m):
        if m.command == M.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.intervals[int(m.param1)] = m.param2 / 1e6
        elif m.command == M.MAV_CMD_REQUEST_MESSAGE:
            self.send(int(m.param1))
        elif m.command == M.MAV_CMD_DO_SET_MODE and self.follows:
            self.mode = int(m.param2)
        elif m.command == M.MAV_CMD_COMPONENT_ARM_DISARM and m.param1 == 1:
            if time.monotonic() - self.vision_s > 0.3:
                # after the acknowledgement
                threading.Timer(0.05, self.say, ["Arm: VisOdom: not healthy"]).start()
                return 4
            self.armed = True
        return 0

    def of(self, kind):
        return [m for m in list(self.heard) if m.get_type() == kind]

    def commands(self, number):
        return [m for m in self.of("COMMAND_LONG") if m.command == number]

    def close(self):
        self.running = False
        self.thread.join(2.0)
        self.link.close()


def until(condition, timeout_s=6.0):
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


class Both:
    """A link and its peer, and what the link called back."""

    def __init__(self, **parameters):
        self.port = free_port(socket.SOCK_DGRAM)
        self.link = LinkByHand(
            f"udpin:127.0.0.1:{self.port}", LinkParameters(**{**FAST, **parameters}), PROFILE
        )
        self.peer = Peer(self.port)

    @property
    def poses(self):
        return [m.T_odom_body for m in self.link.of(PoseEstimated)]

    @property
    def texts(self):
        return [(m.severity, m.text) for m in self.link.of(TextReceived)]

    def close(self):
        self.link.close()
        self.peer.close()


@pytest.fixture
def both():
    made = []

    def make(**parameters):
        made.append(Both(**parameters))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def pair(both):
    pair = both()
    assert until(
        lambda: (
            pair.link.connected and pair.link.state.mode == Mode.STABILIZE and pair.peer.intervals
        )
    )
    return pair


def feed(pair, seconds=0.1):
    for _ in range(max(1, int(seconds * 30))):
        pair.link.send_pose(time.time(), np.eye(4))
        time.sleep(1 / 30)


def test_connecting(pair):
    """Origin although it is dropped twice, streams at the rate asked for, poses in ENU, heartbeats
    of a companion."""
    assert until(lambda: pair.link.origin_set)
    assert pair.peer.origins_dropped >= 3 and pair.peer.origin == (350000000, 1350000000, 10000)
    count = len(pair.peer.of("SET_GPS_GLOBAL_ORIGIN"))
    position = M.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    asked_s = [pair.peer.intervals[number] for number in (position, M.MAVLINK_MSG_ID_ATTITUDE)]
    assert asked_s == pytest.approx([1 / 30, 1 / 30], abs=1e-5)
    poses, before = len(pair.poses), pair.peer.sent[position]
    assert until(lambda: pair.peer.sent[position] > before + 20)
    sent = pair.peer.sent[position] - before
    # as many as are sent, however busy it is
    assert until(lambda: len(pair.poses) - poses >= sent - 1)
    assert len(pair.peer.of("SET_GPS_GLOBAL_ORIGIN")) == count  # no more once it is there
    T_odom_body = pair.poses[-1]
    assert np.allclose(T_odom_body[:3, 3], [2.0, 1.0, 3.0])
    assert np.allclose(transforms.rpy(T_odom_body), [0.1, -0.2, math.pi / 2 - 0.3], atol=1e-6)
    assert until(lambda: len(pair.peer.of("HEARTBEAT")) >= 3)
    beats = pair.peer.of("HEARTBEAT")  # one a second: see test_flight.py
    assert {(b.get_srcSystem(), b.get_srcComponent(), b.autopilot) for b in beats} == {(1, 191, 8)}
    assert pair.link.state.prearm_ok and pair.link.state.battery_share == 0.77
    assert pair.link.state.voltage_v == 15.8 and pair.link.state.current_a == 12.0
    assert until(lambda: pair.link.parameters.known, 15.0) and pair.link.parameters.problems() == []
    state = pair.link.state
    assert state.ekf_variance == pytest.approx(0.4) and state.throttle == pytest.approx(-0.5)
    assert time.monotonic() - state.throttle_heard_s < 2.0 and state.rc_rssi == 99


def test_poses_in(pair):
    T = transforms.from_xyz_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    pair.link.send_pose(12.5, T)
    pair.link.note_reset()
    pair.link.send_pose(12.6, T)
    assert until(lambda: len(pair.peer.of("VISION_POSITION_ESTIMATE")) == 2)
    first, second = pair.peer.of("VISION_POSITION_ESTIMATE")
    assert (first.usec, first.x, first.y, first.z) == (12500000, 2.0, 1.0, -3.0)
    assert (first.roll, first.pitch, first.yaw) == pytest.approx(
        (0.1, -0.2, math.pi / 2 - 0.3), abs=1e-6
    )
    assert math.isnan(first.covariance[0])
    assert (first.reset_counter, second.reset_counter) == (0, 1)
    assert not pair.peer.of("ODOMETRY")


def test_set_points(pair):
    pair.link.send_set_point(transforms.from_xyz_yaw([4.0, 5.0, 6.0], 0.0))
    assert until(lambda: pair.peer.of("SET_POSITION_TARGET_LOCAL_NED"))
    m = pair.peer.of("SET_POSITION_TARGET_LOCAL_NED")[0]
    assert (m.type_mask, m.coordinate_frame, m.x, m.y, m.z) == (0x9F8, 1, 5.0, 4.0, -6.0)
    assert m.yaw == pytest.approx(math.pi / 2)
    assert (m.target_system, m.target_component) == (1, 1)


def test_arming_is_refused_with_the_reason_and_done_with_a_feed(pair):
    with pytest.raises(CommandRefused, match="arming refused: Arm: VisOdom: not healthy"):
        pair.link.arm(True)
    assert (2, "Arm: VisOdom: not healthy") in pair.texts
    feed(pair)
    pair.link.arm(True)
    assert pair.link.state.armed


def test_an_old_reason_is_not_given_for_a_new_refusal(pair):
    pair.peer.say("PreArm: something of before")
    assert until(lambda: pair.texts)
    with pytest.raises(CommandRefused) as refused:
        pair.link.arm(True)
    assert "before" not in str(refused.value)


def test_a_lost_acknowledgement_is_asked_for_again(pair):
    pair.peer.mute_acks = 1
    pair.link.set_mode(Mode.GUIDED)
    assert [m.confirmation for m in pair.peer.commands(M.MAV_CMD_DO_SET_MODE)] == [0, 1]
    assert pair.link.state.mode == Mode.GUIDED


def test_no_answer_is_an_error_after_the_last_try(pair):
    """How long that takes: see test_flight.py."""
    pair.peer.mute_acks = 99
    with pytest.raises(LinkError, match="mode GUIDED: the flight controller does not answer"):
        pair.link.set_mode(Mode.GUIDED)
    assert [m.confirmation for m in pair.peer.commands(M.MAV_CMD_DO_SET_MODE)] == [0, 1, 2]


def test_in_progress_is_waited_for(pair):
    pair.peer.in_progress = True
    pair.link.set_mode(Mode.LAND)
    assert len(pair.peer.commands(M.MAV_CMD_DO_SET_MODE)) == 1


def test_a_mode_that_is_acknowledged_but_not_taken(pair):
    pair.peer.follows = False
    with pytest.raises(CommandRefused, match="acknowledged, but the vehicle is in STABILIZE"):
        pair.link.set_mode(Mode.GUIDED)
    with pytest.raises(CommandRefused, match="'HOVER' is not known"):
        pair.link.set_mode("HOVER")


def test_stopping_does_not_wait_for_a_slow_arming(both):
    """The watchdog's LAND may come while another command is not answered."""
    pair = both(command_timeout_s=5.0, command_tries=1)
    assert until(lambda: pair.link.connected and pair.peer.intervals)
    pair.peer.mute_acks = 1
    slow = threading.Thread(
        target=lambda: pytest.raises(LinkError, pair.link.arm, True), daemon=True
    )
    slow.start()
    assert until(lambda: pair.peer.mute_acks == 0)
    pair.link.set_mode(Mode.LAND)
    assert slow.is_alive()
    slow.join(7.0)
    assert not slow.is_alive()


def test_take_off_is_counted_from_where_home_is(pair):
    with pytest.raises(CommandRefused, match="not armed in STABILIZE"):
        pair.link.take_off(3.0)
    assert until(lambda: pair.link.origin_set)
    pair.link.set_mode(Mode.GUIDED)
    feed(pair)
    pair.link.arm(True)
    pair.peer.home_mm = 10400  # set where it was armed, 0.4 m above the origin
    pair.link.take_off(3.0)
    assert pair.peer.commands(M.MAV_CMD_NAV_TAKEOFF)[0].param7 == pytest.approx(2.6)


def test_wrong_parameters_are_named_and_left_alone(both):
    pair = both()
    pair.peer.parameters.update(VISO_TYPE=0.0)
    assert until(lambda: len(pair.link.parameters.problems()) == 1)
    with pytest.raises(
        CommandRefused,
        match="mode GUIDED refused: parameter VISO_TYPE is 0, not 2 or 3: without it",
    ):
        pair.link.set_mode(Mode.GUIDED)
    assert not pair.peer.of("PARAM_SET") and not pair.peer.commands(M.MAV_CMD_DO_SET_MODE)
    pair.peer.parameters.update(VISO_TYPE=2.0)
    pair.peer.mav.param_value_send(b"VISO_TYPE", 2.0, 2, 1305, 0)  # a ground station has set it
    assert until(lambda: not pair.link.parameters.problems())
    pair.link.set_mode(Mode.GUIDED)


def test_wrong_parameters_are_set_when_asked_to(both):
    pair = both(set_parameters=True)
    pair.peer.parameters.update(VISO_TYPE=0.0, EK3_SRC1_YAW=1.0)
    assert until(lambda: len(pair.peer.of("PARAM_SET")) == 2)
    assert until(lambda: not pair.link.parameters.problems())
    assert pair.peer.parameters["VISO_TYPE"] == 2.0 and pair.peer.parameters["EK3_SRC1_YAW"] == 6.0


def test_it_connects_again_after_a_reboot(pair):
    assert until(lambda: pair.link.origin_set)
    pair.peer.boot_s -= 5.0  # a boot time to go back from
    poses = len(pair.poses)
    assert until(lambda: len(pair.poses) > poses + 1)
    pair.peer.boot()  # too quick for the heartbeat to be missed; origin and intervals are forgotten
    assert until(lambda: not pair.link.origin_set)
    assert until(lambda: pair.link.origin_set, 8.0)
    pair.link.told.clear()
    assert until(lambda: len(pair.poses) > 10)


def test_it_connects_again_after_silence(pair):
    assert until(lambda: pair.link.origin_set)
    pair.peer.silent = True
    assert until(lambda: not pair.link.connected, 4.5)
    pair.peer.boot()
    assert until(lambda: pair.link.connected and pair.link.origin_set, 8.0)


def test_another_autopilot_on_the_line_is_not_obeyed(both):
    pair = both(target_system=1)
    stranger = Peer(pair.port, system=7)
    try:
        stranger.mode, stranger.armed = LAND, True
        assert until(lambda: pair.link.connected and pair.link.strangers == (7,))
        stranger.intervals[M.MAVLINK_MSG_ID_HEARTBEAT] = 0.05
        for peer in (stranger, pair.peer):
            beats = peer.sent[M.MAVLINK_MSG_ID_HEARTBEAT]
            assert until(lambda p=peer, n=beats: p.sent[M.MAVLINK_MSG_ID_HEARTBEAT] >= n + 2)
        assert all(
            s.mode in ("", Mode.STABILIZE) and not s.armed for s in pair.link.of(AutopilotState)
        )
    finally:
        stranger.close()


def test_an_odd_message_does_not_end_the_link(pair):
    failed = []

    def fail(output):
        failed.append(output)
        raise RuntimeError("a callback of a node that is going down")

    pair.link.tell = fail
    assert until(lambda: failed)
    pair.peer.mode = GUIDED
    assert until(lambda: pair.link.state.mode == Mode.GUIDED)


def test_over_a_serial_device():
    """A pseudo-terminal in place of the cable; pulling it is noticed, said once, and does not end
    the thread."""
    master, slave = os.openpty()
    tty.setraw(master)
    os.set_blocking(master, False)
    link = LinkByHand(f"{os.ttyname(slave)}:115200", LinkParameters(**FAST))
    os.close(slave)
    encoder = M.MAVLink(None, srcSystem=3, srcComponent=1)
    try:
        beat = encoder.heartbeat_encode(
            M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, GUIDED, 4
        )
        os.write(master, beat.pack(encoder))
        assert until(lambda: link.connected and link.state.mode == Mode.GUIDED)
        decoder, heard = M.MAVLink(None), []
        decoder.robust_parsing = True

        def companion_speaks():
            with contextlib.suppress(BlockingIOError):
                heard.extend(decoder.parse_buffer(os.read(master, 4096)) or [])
            return any(m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 3 for m in heard)

        assert until(companion_speaks)  # with the system id of its vehicle
        os.close(master)
        assert until(lambda: link._transport.broken)
        link.send_pose(1.0, np.eye(4))  # lost, not raised
    finally:
        link.close()
    assert not link._thread.is_alive()


@pytest.mark.parametrize(
    "url", ["/dev/no_such_device:57600", "udpin:nowhere", "tcp:nowhere", "can:127.0.0.1:1"]
)
def test_a_line_that_cannot_be_opened_is_named(url):
    with pytest.raises(LinkError, match="cannot be opened") as raised:
        LinkByHand(url)
    assert url in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "values", [{"target_system": 300}, {"position_rate_hz": 0.0}, {"command_tries": 0}]
)
def test_parameters_out_of_range_are_refused(values):
    with pytest.raises(ValueError, match=next(iter(values))):
        LinkParameters(**values)
