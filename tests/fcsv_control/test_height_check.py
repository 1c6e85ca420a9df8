# SPDX-License-Identifier: Apache-2.0
"""A tracker's height held against the barometer of the simulated autopilot, which wind, weather and
wash move."""

import numpy as np
import pytest

from fcsv_control.flight.pose_feed.feed_check import PoseCheck
from fcsv_control.flight.pose_feed.height_check import HeightCheck, height_m
from fcsv_geometry import transforms
from fcsv_sim.autopilot.barometer import Barometer

HZ, CALM_S = 5.0, 120.0


def height_flown(since_s):
    """Up to 8 m at 1.5 m/s, some metres up and down, hover."""
    climbs = np.clip(since_s / 5.0, 0.0, 1.0) * 8.0
    return (
        climbs
        + np.clip((since_s - 30.0) / 4.0, 0.0, 1.0) * 4.0
        - np.clip((since_s - 60.0) / 5.0, 0.0, 1.0) * 5.0
    )


def doubted(seed, drift_m=lambda since_s: 0.0, seconds=60.0):
    """When doubt came (s since the drift began, after CALM_S of flight), or None."""
    check, barometer = HeightCheck(), Barometer(seed)
    for k in range(int((CALM_S + seconds) * HZ)):
        since_s = k / HZ
        z_m = float(height_flown(since_s))
        barometer.feel(z_m, (2.0 + np.sin(0.3 * since_s), 0.0, 0.0), (0.0, 0.0, 0.0))
        baro_m = height_m(barometer.pressure_hpa(100.0 + since_s, motors=True))
        off_m = check.barometer(100.0 + since_s, baro_m, z_m + drift_m(max(0.0, since_s - CALM_S)))
        if check.doubt(off_m):
            return since_s - CALM_S
    return None


@pytest.mark.parametrize("seed", range(20))
def test_climbs_hover_and_landing_raise_no_doubt(seed):
    assert doubted(seed) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_height_that_drifts_is_doubted(seed, sign):
    """0.1 m/s: 1.2 m, and three sigma of the gusts (0.3 m each of two means), are gone after 21
    s."""
    took_s = doubted(
        seed,
        lambda since_s: sign * 0.1 * min(since_s, 15.0) + sign * 0.5 * max(0.0, since_s - 15.0),
    )
    assert took_s is not None and 3.0 < took_s < 21.0


def test_what_is_near_the_ground_or_silent_is_not_compared():
    check = HeightCheck()
    for k in range(200):  # 1.2 m up: the rotors' wash counts
        assert check.barometer(k / HZ, 1.2 if k else 0.0, 50.0 * (k % 2)) == 0.0
    check.on_ground()
    for k in range(200):
        assert check.barometer(k / HZ, 5.0 if k else 0.0, 5.0) == pytest.approx(0.0)
    assert check.barometer(200 / HZ + 3.0, 5.0, 9.0) == 0.0  # after a silence all begins anew


def test_a_pressure_is_a_height():
    """The simulated barometer's own formula, there and back; a standard atmosphere has 898.7 hPa at
    1000 m."""
    assert height_m(898.75) == pytest.approx(1000.0, abs=0.5)


def feed(check, now_s, z_m):
    # the filter follows
    check.estimate(now_s, transforms.from_xyz_yaw([0.0, 0.0, z_m], 0.0), (0.0, 0.0, 0.0))
    p_m = [0.001 * np.sin(9.0 * now_s), 0.001 * np.cos(7.0 * now_s), z_m]
    return check.passes_in_flight(
        now_s, 1.7e9 + now_s, transforms.from_xyz_yaw(p_m, 0.001 * np.sin(5.0 * now_s))
    )


@pytest.mark.parametrize("gap_s", [0.0, 1.0])
def test_the_feed_is_doubted_where_barometer_and_tracker_part(gap_s):
    """Also after a gap of the tracker, which begins all anew but what the ground's height was."""
    check, now_s = PoseCheck(), 50.0
    check.on_ground()
    for k in range(1200):
        now_s += 1.0 / 30.0 + (gap_s if k == 300 else 0.0)
        feed(check, now_s, 0.0)
        if k % 6 == 0:
            climbed_m = 4.0 if k > 30 else 0.0
            check.barometer(now_s, climbed_m + (0.0 if k < 900 else 0.02 * (k - 900)))
        if check.doubt:
            break
    assert "barometer" in check.doubt and k > 900
    assert not feed(check, now_s + 0.03, 0.0)
    check.begin_again()
    check.barometer(now_s, 99.0)
    assert check.doubt == ""


def test_a_link_that_starts_in_flight_compares_heights_all_the_same():
    """It never saw the ground, and the vehicle climbs no more."""
    check = PoseCheck()
    for k in range(1200):
        now_s = 50.0 + k / 30.0
        drift_m = 0.0 if k < 600 else 0.004 * (k - 600)
        feed(check, now_s, 8.0 + drift_m)
        if k % 6 == 0:
            check.barometer(now_s, 57.0)
        if check.doubt:
            break
    assert "barometer" in check.doubt and 900 < k < 1100


def test_an_odometry_that_begins_anew_in_flight_keeps_the_height_of_the_ground():
    check = PoseCheck()
    check.on_ground()
    for k in range(1500):
        now_s = 50.0 + k / 30.0
        feed(check, now_s, 0.0 if k < 900 else 0.004 * (k - 900))
        if k == 300:
            check.begin_again()
        if k % 6 == 0:
            check.barometer(now_s, 4.0 if k > 30 else 0.0)
        if check.doubt:
            break
    assert "barometer" in check.doubt and k > 900
