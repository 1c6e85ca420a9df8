# SPDX-License-Identifier: Apache-2.0
"""Conditions: what is known, what is not, and what stands exactly at a bound."""

import doctest
import math
from dataclasses import fields

import pytest

from fcsv_control import conditions
from fcsv_control.conditions import Grade
from fcsv_control.flight.pose_feed.feed_check import PoseCheckRules
from fcsv_control.flight.pose_feed.watchdog import WatchdogParameters
from fcsv_control.flight_check.fleet import FleetCheckRules
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.mission.snapshot import VehicleView
from fcsv_control.tello.rules import TelloRules
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles import thresholds
from fcsv_geometry.vehicles.thresholds import Thresholds
from fcsv_tracking.devices.clocks import ClockOffset

NAN, INF = math.nan, math.inf
G, A, R, U = Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN
TABLE = {n: t for n, t in vars(thresholds).items() if isinstance(t, Thresholds)}
USERS = [f.name for f in fields(Thresholds) if f.name not in ("what", "why")]
JUDGES = [
    # (condition of a value by red and amber, green, amber, red)
    (conditions.battery, (0.4, 0.9), (0.2, 0.3), (0.19, 0.0), (0.2, 0.4)),
    (conditions.feed_rate, (15.0, 30.0), (8.0, 14.9), (7.9, 0.0), (8.0, 15.0)),
    (conditions.disk, (8000.0, INF), (1000.0, 7999.0), (999.0, 0.0), (1000.0, 8000.0)),
    (conditions.ekf, (0.5, 0.0), (0.8, 0.51), (0.81, INF), (0.8, 0.5)),
    (conditions.estimate_apart, (0.2, 0.0), (0.5, 0.21), (0.51, INF), (0.5, 0.2)),
]


@pytest.mark.parametrize("judge, green, amber, red, bounds", JUDGES)
def test_at_a_bound_it_is_not_worse_than_the_bound(judge, green, amber, red, bounds):
    for grade, values in ((G, green), (A, amber), (R, red)):
        assert [judge(v, *bounds).grade for v in values] == [grade] * 2
    assert all(judge(v, bounds[0]).grade is G for v in amber), "without an amber bound"


@pytest.mark.parametrize("judge, green, amber, red, bounds", JUDGES)
def test_words_say_what_is_wrong_and_nothing_where_nothing_is(judge, green, amber, red, bounds):
    assert judge(green[0], *bounds).words == "" and judge(NAN, *bounds).words
    a, b = (judge(v, *bounds) for v in red)
    assert a.words == b.words != "", "a text stays while the figure changes"


@pytest.mark.parametrize("judge, green, amber, red, bounds", JUDGES)
def test_what_is_not_known_is_neither_green_nor_red(judge, green, amber, red, bounds):
    found = judge(NAN, *bounds)
    assert found.grade is U and not found.red and not found.green
    assert found.measured("nan %") == (U, found.words)
    assert judge(green[0], *bounds).measured("90 %") == (G, "90 %")


@pytest.mark.parametrize(
    "age_s, grade", [(3.5, G), (3.51, R), (0.0, G), (-0.2, G), (INF, R), (NAN, U)]
)
def test_an_age_of_the_future_is_fresh_and_one_of_nothing_old(age_s, grade):
    assert conditions.state_age(age_s, 3.5).grade is grade
    assert (
        VehicleView(state_age_s=age_s).fresh == (grade is G) == VehicleView(state_age_s=age_s).down
    )
    assert not VehicleView(state_age_s=age_s, armed=True).down


@pytest.mark.parametrize("level, grade", [(0.0, R), (1.0, R), (1.01, G), (3.0, G), (NAN, A)])
def test_a_tracker_that_tells_no_confidence_is_no_low_one(level, grade):
    assert conditions.confidence(level, 1.0).grade is grade


@pytest.mark.parametrize(
    "throttle, age_s, grade", [(0.0, 2.0, G), (0.0, 2.01, R), (NAN, 0.0, R), (0.0, NAN, R)]
)
def test_a_transmitter_is_heard_or_not(throttle, age_s, grade):
    assert conditions.transmitter(throttle, age_s, 2.0).grade is grade


@pytest.mark.parametrize("throttle, grade", [(0.25, G), (-0.26, R), (1.0, R), (NAN, U)])
def test_a_stick_off_its_middle_to_either_side(throttle, grade):
    assert conditions.stick(abs(throttle), 0.25).grade is grade


@pytest.mark.parametrize(
    "age_s, problem, dropped, found",
    [
        (5.0, "", 0, (G, "")),
        (5.1, "", 0, (R, "not heard")),
        (INF, "disk full", 3, (R, "not heard")),
        (0.0, "disk full", 3, (R, "disk full")),
        (0.0, "", 3, (A, "3 messages were dropped")),
        (NAN, "", 0, (R, "not heard")),
    ],
)
def test_a_recorder(age_s, problem, dropped, found):
    told = conditions.recorder(age_s, problem, 5.0, dropped)
    assert (told.grade, told.words) == found


@pytest.mark.parametrize(
    "offset_s, uncertainty_s, grade",
    [
        (0.02, 0.0, G),
        (-0.03, 0.0, A),
        (0.03, 0.01, G),
        (0.6, 0.2, A),
        (-0.6, 0.0, R),
        (NAN, 0.0, U),
    ],
)
def test_clocks_that_are_apart_for_sure(offset_s, uncertainty_s, grade):
    least_s = ClockOffset(0.0, offset_s, uncertainty_s).least_s
    assert conditions.clock(least_s, 0.5, 0.02).grade is grade


def test_a_vehicle_that_leans():
    assert [conditions.tilt(deg, 30.0).grade for deg in (30.0, 30.1, NAN)] == [G, R, U]


def test_examples():
    assert doctest.testmod(conditions).attempted > 1 and doctest.testmod(conditions).failed == 0


# ---- the table -----------------------------------------------------------------------------------


def test_every_condition_has_a_user_and_tells_why_users_differ():
    assert len(TABLE) > 20
    for name, row in TABLE.items():
        told = [b for b in (getattr(row, user) for user in USERS) if not math.isnan(b.red)]
        assert told, name
        assert row.why or len({b.red for b in told}) == 1 or len(told) == 1, f"{name}: why"


def test_who_warns_warns_before_who_acts():
    for name, row in TABLE.items():
        worse_below = row.what.endswith(("below", "fewer", "at or below"))
        for bounds in (getattr(row, user) for user in USERS):
            if not math.isnan(bounds.amber):
                assert (bounds.amber > bounds.red) == worse_below, name


def test_nobody_is_handed_over_whom_the_guardian_would_refuse_at_once():
    """Red of the flight check is never looser than what the guardian forbids GUIDED for."""
    for row in (thresholds.BATTERY, thresholds.FEED_HZ):
        assert row.check.red >= row.guardian.amber
    for row in (thresholds.EKF_VARIANCE, thresholds.APART_M, thresholds.APART_IN_FLIGHT_M):
        assert row.check.red <= row.guardian.red
    assert thresholds.POSE_AGE_S.check.red <= thresholds.POSE_AGE_S.guardian.amber
    assert thresholds.POSE_AGE_S.guardian.red < thresholds.POSE_AGE_S.link.red


def test_rules_have_the_tables_numbers_as_defaults(root):
    """The figures themselves, once: what a change of the table changes for people who fly."""
    guardian, check, tello = GuardianRules(), VehicleCheckRules(), TelloRules()
    mission = load_mission(root / "config/missions/short.yaml")
    assert (check.amber_battery, check.red_battery) == (0.4, 0.2)
    assert (guardian.low_battery, guardian.empty_battery) == (0.2, 0.1)
    assert (mission.low_battery_share, mission.empty_battery_share) == (0.2, 0.1)
    assert (tello.warn_battery, tello.land_battery) == (0.2, 0.1)
    assert (guardian.feed_warn_s, guardian.feed_land_s) == (0.5, 0.7)
    assert (guardian.link_warn_s, guardian.link_hold_s) == (2.0, 30.0)
    assert (WatchdogParameters().warn_s, WatchdogParameters().land_s) == (0.5, 0.8)
    assert (PoseCheckRules().apart_m, guardian.apart_m, check.red_apart_m) == (0.5, 0.5, 0.5)
    assert (FleetCheckRules().amber_clock_s, FleetCheckRules().silent_s) == (0.02, 3.0)
