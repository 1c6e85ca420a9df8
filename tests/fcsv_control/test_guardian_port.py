# SPDX-License-Identifier: Apache-2.0
"""The guardian's port: which of what is heard reaches its core, when, and what it gives."""

import math

import numpy as np
import pytest

from fcsv_control.agent.messages import DONE, REFUSED, Ack, Instruction, Kind
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import AutopilotLimits, LinkLives, PoseEstimated
from fcsv_control.guardian.messages import GuardianVerdict, RestartLink
from fcsv_control.guardian.port import GuardianPort, MissionFence, OtherGuarded
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import transforms
from fcsv_geometry.home import OdomLink, Place
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.streams.arrivals import RELAY
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode

NOW_S = 100.0
THERE = transforms.from_xyz_yaw([4.0, 0.0, 6.0], 0.0)


@pytest.fixture
def port():
    return GuardianPort("uav1", GuardianRules(), NOW_S)


def command(kind, number=1, sender="mission-1", **fields):
    return Instruction("uav1", sender, number, kind, 5.0, 5.0, 2.0, **fields)


def link(**fields):
    told = {
        "doubt": "",
        "ekf_variance": 0.1,
        "throttle": 0.4,
        "throttle_age_s": 0.1,
        "system_status": 4,
        "origin_set": True,
        "parameters_ok": True,
        "parameter": "",
        "in_the_air": True,
        "connected": True,
        "pid": 17,
        "ekf_flags": 0x33F,
        "ekf_age_s": 0.1,
        "feed_rate_hz": 30.0,
        "feed_age_s": 0.03,
        "estimate_apart_m": 0.1,
        "prearm_ok": True,
    }
    return LinkLives(**{**told, **fields})


def calibrated(port, sigma_m=0.2, sigma_rad=0.0):
    covariance = np.diag([sigma_m**2] * 3 + [sigma_rad**2])
    T = transforms.from_xyz_yaw([-3.5, 0.0, 0.0], 0.0)
    port.receive(NOW_S, tm.CalibrationFound(0.0, [OdomLink("uav2", "uav1", T, covariance)]))
    port.receive(NOW_S, tm.HomeFound(0.0, "uav2", np.eye(4)))


def heard_of_uav2(port, now_s=NOW_S, sent_s=NOW_S - 0.3):
    odometry = tm.VehicleOdometry("uav2", RELAY, 0.0, THERE, (0.6, 0.0, 0.8))
    port.receive(now_s, tm.RelayAges(["/uav2/odometry/state"], [sent_s]))
    port.receive(now_s, odometry)


def test_a_vehicle_counts_as_sent_when_its_agent_took_the_way_point(port):
    port.receive(NOW_S, command(Kind.GOTO, target=THERE))
    assert port.core.air.sent_to is None, "it may still be refused"
    port.receive(NOW_S, Ack("mission-1", 1, REFUSED, "a pilot has it"))
    port.receive(NOW_S, Ack("mission-2", 1, DONE, ""))
    port.receive(NOW_S, Ack("mission-1", 2, DONE, ""))
    assert port.core.air.sent_to is None
    port.receive(NOW_S, Ack("mission-1", 1, DONE, ""))
    assert port.core.air.sent_to is THERE
    port.receive(NOW_S, command(Kind.HOLD, 2))
    port.receive(NOW_S, Ack("mission-1", 2, DONE, ""))
    assert port.core.air.sent_to is None


def test_commands_that_nobody_acknowledged_are_forgotten(port):
    for number in range(30):
        port.receive(NOW_S, command(Kind.GOTO, number, target=THERE))
    port.receive(NOW_S, Ack("mission-1", 3, DONE, ""))
    assert port.core.air.sent_to is None
    port.receive(NOW_S, Ack("mission-1", 29, DONE, ""))
    assert port.core.air.sent_to is THERE


def test_how_well_calibration_knows_places_is_told_with_them(port):
    calibrated(port, 0.2, 0.1)
    heard_of_uav2(port)
    port.receive(NOW_S, PoseEstimated(transforms.from_xyz_yaw([0.0, 5.0, 8.0], 0.0)))
    port.step(NOW_S)
    air = port.core.air
    assert air.sigma_m == pytest.approx(math.hypot(0.2, 0.5))  # 0.1 rad over 5 m
    assert np.allclose(air.p_home_m, [-3.5, 5.0, 8.0])
    assert air.others["uav2"].sigma_m == 0.0, "home stands in its odometry"
    assert np.allclose(air.others["uav2"].p_home_m, [4.0, 0.0, 6.0])


def test_another_calibration_in_flight_moves_the_others_and_is_no_motion_of_theirs():
    port = GuardianPort("uav2", GuardianRules(), NOW_S)

    def heard(k):
        odometry = tm.VehicleOdometry("uav1", RELAY, 0.0, THERE, (0.0, 0.0, 0.0))
        port.receive(NOW_S + 0.1 * k, odometry)

    for moved_m in (0.0, 0.3):
        T = transforms.from_xyz_yaw([3.5 + moved_m, 0.0, 0.0], 0.0)
        link = OdomLink("uav2", "uav1", T, np.zeros((4, 4)))
        heard(10 * moved_m)
        port.receive(NOW_S, tm.CalibrationFound(0.0, [link]))
        port.receive(NOW_S, tm.HomeFound(0.0, "uav2", np.eye(4)))
        heard(10 * moved_m + 1)
        port.step(NOW_S + moved_m + 0.1)
        uav1 = port.core.air.others["uav1"]
        assert np.allclose(uav1.p_home_m, [7.5 + moved_m, 0.0, 6.0])
        assert np.allclose(uav1.v_home_mps, 0.0)


def test_another_counts_from_when_it_sent_and_as_flying_until_it_tells_its_mode(port):
    heard_of_uav2(port)
    port.step(NOW_S)
    assert port.core.air.others == {}, "where it is in home is not known"
    calibrated(port)
    port.step(NOW_S)
    other = port.core.air.others["uav2"]
    assert (other.heard_s, other.armed, other.mode) == (NOW_S - 0.3, True, "")
    assert other.speed_mps == pytest.approx(1.0)
    port.receive(NOW_S, tm.VehicleState("uav2", RELAY, Mode.LAND, False, True))
    # its link hears no autopilot
    port.receive(NOW_S, tm.VehicleState("uav2", RELAY, "", True, False))
    port.receive(
        NOW_S,
        OtherGuarded(
            "uav2", GuardianVerdict(lost=True, lost_s=3.0, taken=True, going_to_m=(1.0, 2.0, 3.0))
        ),
    )
    port.step(NOW_S)
    other = port.core.air.others["uav2"]
    assert (other.armed, other.mode, other.lost, other.lost_s, other.taken) == (
        False,
        "LAND",
        True,
        3.0,
        True,
    )
    assert np.allclose(other.going_to_m, [1.0, 2.0, 3.0])


def test_what_the_link_tells(port):
    port.receive(NOW_S, link())
    assert port.core.air.link.throttle == 0.4 and not port.core.air.link.failsafe
    port.receive(
        NOW_S,
        link(
            throttle_age_s=2.1, system_status=5, parameters_ok=False, parameter="X", connected=False
        ),
    )
    report = port.core.air.link
    assert math.isnan(report.throttle), "no transmitter is heard"
    assert (
        report.failsafe
        and not report.parameters_ok
        and report.parameter == "X"
        and not report.connected
    )
    port.receive(NOW_S, AutopilotLimits({"WPNAV_ACCEL": 150.0}))
    assert port.core.air.slows_mps2 == pytest.approx(1.5)
    port.receive(NOW_S, AutopilotLimits({}))
    assert port.core.air.slows_mps2 == pytest.approx(1.5), "what was not answered changes nothing"


def test_a_link_that_hangs_is_named_by_its_process(port):
    port.receive(NOW_S, link(pid=4711))
    port.receive(NOW_S, tm.VehicleState("uav1", "", Mode.GUIDED, True, True))
    out = []
    for k in range(100):
        out += port.step(NOW_S + 0.04 * k)
    assert [o for o in out if isinstance(o, RestartLink)] == [RestartLink(4711)]


def test_a_verdict_is_told_at_once_and_again(port):
    told = [
        [o for o in port.step(NOW_S + 0.04 * k) if isinstance(o, GuardianVerdict)]
        for k in range(11)
    ]
    assert [len(t) for t in told] == [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    port.receive(NOW_S + 0.41, tm.VehicleState("uav1", "", Mode.LOITER, True, True))
    assert any(isinstance(o, GuardianVerdict) and o.taken for o in port.step(NOW_S + 0.44))


def test_the_missions_fence_and_life_and_calibration_of_its_own_epoch(port):
    port.receive(NOW_S + 1.0, MissionAlive("mission-1", 3.0))
    assert port.core.air.control_s == NOW_S + 1.0
    fence = Fence(1.0, 20.0, 30.0, [])
    port.receive(NOW_S, MissionFence(fence))
    assert port.core.air.mission_fence is fence
    port.receive(NOW_S, tm.EpochsFound(tm.HOME, 0.0, {"uav1": 9}))
    port.receive(NOW_S, tm.EpochsFound(tm.CALIBRATION, 0.0, {"uav2": 8}))
    assert port.core.air.calibrated is None
    port.receive(NOW_S, tm.EpochsFound(tm.CALIBRATION, 0.0, {"uav1": 7}))
    assert port.core.air.calibrated == 7


def test_what_it_does_not_know_is_refused(port):
    with pytest.raises(TypeError, match="takes no str"):
        port.receive(NOW_S, "GUIDED")


@pytest.mark.parametrize("seed", range(5))
def test_sigma_is_the_larger_axis_of_the_covariance_there(seed):
    random = np.random.default_rng(seed)
    half = random.normal(size=(4, 4))
    place = Place(transforms.from_xyz_yaw(random.normal(size=3), 0.8), half @ half.T)
    p_m = random.normal(0.0, 5.0, 3)
    assert place.sigma_m(p_m) == pytest.approx(
        math.sqrt(np.linalg.eigvalsh(place.at(p_m)[:2, :2])[-1]), rel=1e-12
    )
