# SPDX-License-Identifier: Apache-2.0
"""What a Tello's messages mean, also those that were damaged or come from another firmware; and the
vehicle's rules."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.tello_loop import CONFIG
from tellopy._internal import protocol

from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.tello.rules import TelloRules
from fcsv_control.tello.telemetry import OwnOdometry, flight_report
from fcsv_geometry import config, transforms
from fcsv_sim.tello.log import tick_of


def imu(at_s, v_ned=(0.0, 0.0, 0.0), yaw_deg=0.0, **fields):
    """A record of a time as tellopy decodes it, at rest and level, the nose ``yaw_deg`` to the
    left."""
    half = -np.radians(yaw_deg) / 2.0  # z is down
    record = SimpleNamespace(
        acc_x=0.0,
        acc_y=0.0,
        acc_z=-1.0,
        gyro_x=0.0,
        gyro_y=0.0,
        gyro_z=0.0,
        q0=np.cos(half),
        q1=0.0,
        q2=0.0,
        q3=np.sin(half),
    )
    record.vg_x, record.vg_y, record.vg_z = v_ned
    record.tick = tick_of(at_s)
    return SimpleNamespace(**{**vars(record), **fields})


def test_flight_data_of_another_length_is_no_empty_battery():
    assert flight_report(protocol.FlightData(0.0, bytes(18))) is None
    whole = bytearray(24)
    whole[0], whole[12], whole[17] = 15, 63, 1
    report = flight_report(protocol.FlightData(0.0, whole))
    assert (
        report.in_the_air
        and report.height_m == pytest.approx(1.5)
        and report.battery_share == pytest.approx(0.63)
    )
    whole[12] = 255
    assert np.isnan(flight_report(protocol.FlightData(0.0, whole)).battery_share)


def test_velocities_are_added_up_with_axes_turned():
    """2 s to the right of where it looked first, nose 90 degrees to the left: backwards in its own
    axes."""
    own = OwnOdometry()
    for k in range(21):
        motion = own.imu(10.0 + 0.1 * k, imu(0.1 * k, v_ned=(0.0, 0.5, 0.0), yaw_deg=90.0))
    assert motion.T_own_body[:3, 3] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert transforms.yaw(motion.T_own_body) == pytest.approx(np.pi / 2.0)
    assert motion.v_body_mps == pytest.approx([-0.5, 0.0, 0.0], abs=1e-9)
    assert motion.accel_mps2 == pytest.approx([0.0, 0.0, 9.81])


def test_its_height_is_that_of_the_flight_data():
    """A climb rate that is wrong by 0.1 m/s for 10 s: off by its time constant's share, 0.1 m, not
    by 1 m."""
    own = OwnOdometry()
    own.height(1.2)
    for k in range(101):
        motion = own.imu(0.1 * k, imu(0.1 * k, v_ned=(0.0, 0.0, -0.1)))
    assert motion.T_own_body[2, 3] == pytest.approx(1.3, abs=0.02)


@pytest.mark.parametrize(
    "fields",
    [
        {"q0": 0.0},
        {"q1": float("nan")},
        {"vg_x": float("inf")},
        {"vg_y": 400.0},
        {"acc_z": float("nan")},
    ],
)
def test_a_damaged_record_changes_nothing(fields):
    own = OwnOdometry()
    own.imu(0.0, imu(0.0))
    assert own.imu(0.1, imu(0.1, v_ned=(1.0, 0.0, 0.0), **fields)) is None
    motion = own.imu(0.2, imu(0.2, v_ned=(1.0, 0.0, 0.0)))
    assert motion.T_own_body[:3, 3] == pytest.approx([0.2, 0.0, 0.0])


def test_what_it_flew_in_a_gap_is_not_made_up():
    own = OwnOdometry()
    own.imu(0.0, imu(0.0, v_ned=(1.0, 0.0, 0.0)))
    assert own.imu(8.0, imu(8.0, v_ned=(1.0, 0.0, 0.0))).T_own_body[0, 3] == 0.0


def test_a_radio_that_delays_costs_no_place_and_hardly_a_stamp():
    """Delays of 0 to 0.2 s, one packet in ten quick; the tick wraps on the way (2**32 of them are
    1832 s)."""
    random, own, late_s = np.random.default_rng(1), OwnOdometry(), []
    for k in range(200):
        measured_s, begun_s = 0.1 * k, 1825.0
        delay_s = 0.0 if k % 10 == 0 else random.uniform(0.0, 0.2)
        motion = own.imu(
            50.0 + measured_s + delay_s, imu(begun_s + measured_s, v_ned=(0.5, 0.0, 0.0))
        )
        late_s.append(motion.stamp_s - 50.0 - measured_s)
    assert motion.T_own_body[0, 3] == pytest.approx(0.5 * 19.9, abs=0.01)
    # 1 s from one quick packet to the next, 1 ms/s
    assert 0.0 <= min(late_s) and max(late_s) < 0.002


def test_a_tick_that_jumps_begins_anew():
    """Records from just after it was switched on come first, as a real one sends them; then it is
    switched on again."""
    own = OwnOdometry()
    assert own.imu(50.0, imu(2.0)).stamp_s == 50.0
    assert own.imu(50.1, imu(60.0)).stamp_s == 50.1
    assert own.imu(50.3, imu(60.1)).stamp_s == pytest.approx(50.2, abs=0.001)
    assert own.imu(52.0, imu(0.5)).stamp_s == 52.0


def test_the_guardian_of_a_tello_comes_after_its_link():
    rules = config.load(Path(CONFIG).parent / "guardian" / "tello.yaml", GuardianRules)
    link = TelloRules()
    assert rules.feed_land_s > link.feed_land_s and rules.feed_warn_s > link.feed_old_s
    assert rules.separation.vertical_factor == 1.0
