# SPDX-License-Identifier: Apache-2.0
"""The flight link's port: which poses go on, what follows where they stop, what it answers and
tells of itself."""

import os

os.environ.setdefault("MAVLINK20", "1")

import math

import numpy as np
import pytest
from pymavlink import mavutil

from fcsv_control.agent.messages import Ack, Ask, Kind, SetPoint
from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight.messages import (
    AutopilotState,
    BatteryReading,
    EstimateMoved,
    FromAutopilot,
    LinkLives,
    LinkText,
    ModeAsked,
    OdometryReset,
    ParametersChecked,
    PoseEstimated,
    PoseFed,
    PosePassed,
    RequestOver,
    TextReceived,
    ToAutopilot,
)
from fcsv_control.flight.port import ExternalNavigationRules, FlightLinkPort
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import NOTHING
from fcsv_geometry import transforms
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.telemetry import Diagnosis

M = mavutil.mavlink
STABILIZE, GUIDED, LOITER, LAND, BRAKE = 0, 4, 5, 9, 17
STEP_S, FEED_EVERY = 0.02, 2
WALL_S = 1.7e9  # the odometry's clock
FAST_MPS = 0.3


class Link:
    """A port, its time, an autopilot that is spoken for, and a tracker that moves at 0.3 m/s while
    it is fed."""

    def __init__(self):
        self.now_s, self.steps, self.fed, self.x_m = 100.0, 0, True, 0.0
        self.mode, self.armed = STABILIZE, False
        self.encoder = M.MAVLink(None)
        self.port = FlightLinkPort(
            "uav1",
            LinkParameters(target_system=1),
            NOTHING,
            ExternalNavigationRules(),
            17,
            self.now_s,
        )

    def tell(self, *messages):
        for message in messages:
            self.port.receive(self.now_s, message)

    def hear(self, kind, *fields):
        message = getattr(self.encoder, kind + "_encode")(*fields)
        header = message.get_header()
        header.srcSystem, header.srcComponent = 1, 1
        self.tell(FromAutopilot(message))

    def beat(self):
        base = (
            M.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        ) | M.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.hear(
            "heartbeat", M.MAV_TYPE_QUADROTOR, M.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 4
        )
        self.hear(
            "extended_sys_state",
            0,
            M.MAV_LANDED_STATE_IN_AIR if self.armed else M.MAV_LANDED_STATE_ON_GROUND,
        )

    def run(self, seconds=STEP_S):
        out = []
        for _ in range(int(round(seconds / STEP_S))):
            self.steps += 1
            self.now_s += STEP_S
            self.x_m += FAST_MPS * STEP_S
            if self.steps % 25 == 0:
                self.beat()
            if self.fed and self.steps % FEED_EVERY == 0:
                wall_s = WALL_S + self.now_s
                self.tell(PoseFed(transforms.from_xyz_yaw([self.x_m, 0.0, 3.0], 0.0), wall_s))
            if self.steps % FEED_EVERY == 0:
                boot_ms = int(1000 * self.now_s)
                self.hear("attitude", boot_ms, 0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0)
                self.hear("local_position_ned", boot_ms, 0.0, self.x_m, -3.0, 0.0, FAST_MPS, 0.0)
            out += self.port.step(self.now_s)
        return out

    def fly(self, mode=GUIDED):
        self.run(2.0)
        self.mode, self.armed = mode, True
        self.beat()
        out = self.run(2.0)
        assert self.port.core.state.in_the_air and not self.port.check.doubt
        return out


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


def sent(out, kind):
    return [o.message for o in out if isinstance(o, ToAutopilot) and o.message.get_type() == kind]


def modes(out):
    return [int(m.param2) for m in sent(out, "COMMAND_LONG") if m.command == M.MAV_CMD_DO_SET_MODE]


@pytest.fixture
def link():
    return Link()


# ---- the feed ------------------------------------------------------------------------------------


def test_poses_go_on_at_their_rate_and_are_counted(link):
    link.run(3.0)
    out = link.run(2.0)
    passed = len(of(out, PosePassed))
    assert (
        len(sent(out, "VISION_POSITION_ESTIMATE"))
        == passed
        == pytest.approx(2.0 / (FEED_EVERY * STEP_S), abs=2)
    )
    assert of(out, LinkLives)[-1].feed_rate_hz == pytest.approx(passed / 2.0, abs=2.0)


def test_a_pose_that_came_before_is_dropped_and_said(link):
    link.run(3.0)
    pose = PoseFed(np.eye(4), WALL_S + link.now_s)
    link.fed = False
    link.tell(pose)
    link.run()
    link.tell(pose)
    assert of(link.run(), tm.Dropped) == [
        tm.Dropped("late pose", "pose is not newer than the last")
    ]


def test_a_dead_feed_lands_who_is_flown_by_the_companion_and_tells_others_so(link):
    link.fly()
    link.fed = False
    assert modes(link.run(0.7)) == []
    out = link.run(0.4)
    assert of(out, ModeAsked) == [ModeAsked(Mode.LAND)] and set(modes(out)) == {LAND}
    assert any(o.text.endswith("landing") and o.severity == 1 for o in of(out, LinkText))
    out = link.run(2.5)
    assert not of(out, ModeAsked), "not again while it is still asked for"


def test_a_dead_feed_in_a_brake_of_the_companion_lands_but_in_the_pilots_loiter_is_only_said(link):
    link.fly()
    link.tell(Ask(Kind.SET_MODE, Mode.BRAKE, number=1))
    link.run()
    link.mode = BRAKE
    link.beat()
    assert of(link.run(), RequestOver) == [RequestOver(1)]
    link.fed = False
    assert LAND in modes(link.run(1.2))

    other = Link()
    other.fly(LOITER)
    other.fed = False
    out = other.run(3.0)
    assert modes(out) == [] and not of(out, ModeAsked)
    [said] = of(out, LinkText)
    assert said.severity == 2 and said.text.endswith("in LOITER: fly in ALT_HOLD, or land")


def test_a_process_that_slept_does_not_take_its_sleep_for_a_dead_feed(link, caplog):
    link.fly()
    link.now_s += 3.0
    out = link.run(0.3)
    assert modes(out) == [] and "did not let the flight link run for 3.0" in caplog.text


def test_a_frozen_tracker_is_doubted_at_once_and_its_poses_are_withheld(link):
    link.fly()
    here = transforms.from_xyz_yaw([link.x_m, 0.0, 3.0], 0.0)
    link.fed = False
    out = []
    for _ in range(30):
        link.tell(PoseFed(here, WALL_S + link.now_s))
        out += link.run(2 * STEP_S)
    assert "frozen" in of(out, LinkLives)[-1].doubt
    assert (
        "frozen"
        in [d.problems["tracker"] for d in of(out, Diagnosis) if "tracker" in d.problems][-1]
    )
    before = len(sent(out, "VISION_POSITION_ESTIMATE"))
    link.tell(PoseFed(here, WALL_S + link.now_s))
    assert before < 20 and not sent(link.run(0.1), "VISION_POSITION_ESTIMATE")


def test_a_reset_that_is_announced_is_told_to_the_autopilot_and_adopted(link):
    link.fly()
    link.tell(OdometryReset())
    out = link.run(0.2)
    assert {m.reset_counter for m in sent(out, "VISION_POSITION_ESTIMATE")} == {1}


def test_pictures_that_contradict_the_tracker_are_said(link):
    link.fly()
    for _ in range(20):
        link.tell(tm.SceneLook(1.0, 0.2, 0.0, 40, 1.0))
        link.run(0.3)
    assert link.port.check.scene_says


# ---- requests ------------------------------------------------------------------------------------


def test_each_request_is_answered_by_its_number(link):
    link.run(2.0)
    link.tell(Ask(Kind.SET_MODE, Mode.LOITER, number=4), Ask(Kind.SET_MODE, "HOVER", number=5))
    link.tell(Ask(Kind.TAKEOFF, altitude_m=3.0, number=6))
    over = {o.number: o for o in of(link.run(), RequestOver)}
    assert set(over) == {5, 6} and "'HOVER' is not known" in over[5].refusal
    with pytest.raises(CommandRefused, match="must be armed in GUIDED"):
        over[6].require_done()
    link.mode = LOITER
    for message in sent(link.run(), "COMMAND_LONG"):
        link.hear(
            "command_ack",
            message.command,
            0,
            0,
            0,
            message.get_srcSystem(),
            message.get_srcComponent(),
        )
    link.beat()
    out = link.run(1.5)
    for message in sent(out, "COMMAND_LONG"):
        link.hear(
            "command_ack",
            message.command,
            0,
            0,
            0,
            message.get_srcSystem(),
            message.get_srcComponent(),
        )
    assert RequestOver(4) in of(out, RequestOver) + of(link.run(0.5), RequestOver)


def test_an_autopilot_that_does_not_answer_is_no_refusal(link):
    link.run(2.0)
    link.tell(Ask(Kind.ARM, flag=True, number=1))
    [over] = of(link.run(5.0), RequestOver)
    with pytest.raises(LinkError, match="does not answer"):
        over.require_done()


def test_a_set_point_goes_to_the_autopilot_first(link):
    link.run(2.0)
    link.tell(SetPoint(transforms.from_xyz_yaw([4.0, 5.0, 6.0], 0.0)))
    out = link.run()
    [m] = sent(out, "SET_POSITION_TARGET_LOCAL_NED")
    assert (m.x, m.y, m.z) == (5.0, 4.0, -6.0) and isinstance(out[0], ToAutopilot)


# ---- what it tells -------------------------------------------------------------------------------


def test_the_state_is_told_where_it_changes_and_else_every_0_4_s(link):
    link.run(3.0)
    states = of(link.run(4.0), AutopilotState)
    assert len(states) == pytest.approx(10, abs=2) and {
        (s.mode, s.armed, s.connected) for s in states
    } == {(Mode.STABILIZE, False, True)}
    link.mode = LOITER
    link.beat()
    assert of(link.run(), AutopilotState)[0].mode == Mode.LOITER


def test_its_health_comes_at_5_hz_and_at_once_where_it_matters(link):
    link.run(3.0)
    lives = of(link.run(4.0), LinkLives)
    assert (
        len(lives) == pytest.approx(20, abs=3)
        and lives[-1].pid == 17
        and lives[-1].in_the_air is False
    )
    link.hear("gps_global_origin", 350000000, 1350000000, 10000, 0)
    link.hear("ekf_status_report", 0x33F, *[0.0] * 5)
    link.hear("gps_global_origin", 350000000, 1350000000, 10000, 0)
    assert of(link.run(0.08), LinkLives)[0].origin_set


def test_a_silent_autopilot_is_not_connected(link):
    link.run(3.0)
    link.beat, link.hear = lambda: None, lambda *_: None
    out = link.run(4.0)
    assert not of(out, AutopilotState)[-1].connected and not of(out, LinkLives)[-1].connected
    assert "no heartbeat of the autopilot" in of(out, Diagnosis)[-1].problems["link"]


def test_words_battery_and_estimates_are_passed_on(link):
    link.run(1.0)
    link.hear("statustext", 4, b"PreArm: compass")
    link.hear("sys_status", 0, 0, 0x10000000, 0, 15800, 1200, 77, *[0] * 6)
    out = link.run(0.1)
    assert of(out, TextReceived) == [TextReceived(4, "PreArm: compass")]
    assert of(out, BatteryReading) == [BatteryReading(0.77, 15.8, 12.0)]
    assert np.allclose(
        of(out, PoseEstimated)[-1].T_odom_body[:3, 3], [link.x_m, 0.0, 3.0], atol=0.02
    )


def test_an_estimate_that_moved_is_told_and_logged(link, caplog):
    link.fly()
    out = []
    for k in range(1, 11):
        boot_ms = int(1000 * link.now_s)
        link.hear("local_position_ned", boot_ms, 0.0, link.x_m + 0.1 * k, -3.0, 0.0, FAST_MPS, 0.0)
        out += link.port.step(link.now_s)
    assert of(out, EstimateMoved) and "the autopilot's estimate moved by" in caplog.text


def test_parameters_are_told_where_they_are_news(link):
    out = link.run(6.0)
    assert len(of(out, ParametersChecked)) == 1
    assert all(math.isnan(v) for v in of(out, ParametersChecked)[0].limits.values.values())


def test_what_it_does_not_know_is_refused(link):
    with pytest.raises(TypeError, match="a flight link takes no Ack"):
        link.tell(Ack("mission", 1, 0, ""))
