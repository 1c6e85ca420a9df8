# SPDX-License-Identifier: Apache-2.0
"""The Tello link's decisions, in closed loop with fcsv_sim's Tello: what is flown, refused, held
and landed."""

import numpy as np
import pytest
from support.tello_loop import GIMBALS, MOCAP, LinkedTello

from fcsv_control.errors import CommandRefused
from fcsv_control.tello.pid import Sticks
from fcsv_control.tello.rules import TelloRules
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

_TARGET = transforms.from_xyz_yaw([0.6, -0.4, 2.0], 0.0)
_HELD_M = 0.15
_BODIES_M = 0.24  # twice a Tello's radius (config/vehicles/tello1.yaml)


@pytest.fixture
def flown(tmp_path) -> LinkedTello:
    link = LinkedTello(tmp_path, 1)
    link.guided(_TARGET)
    return link


# ---- the ordinary way ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [MOCAP, GIMBALS], ids=["mocap", "gimbals"])
def test_it_takes_off_flies_to_a_set_point_and_lands(tmp_path, kind):
    link = LinkedTello(tmp_path, 3, kind=kind)
    link.run(1.0)
    link.core.take_off(link.now_s, 1.8)
    link.run(8.0)
    assert link.core.mode == Mode.LOITER and link.core.state(link.now_s).armed
    assert link.p_m[2] == pytest.approx(1.8, abs=0.25)
    link.core.set_mode(link.now_s, Mode.GUIDED)
    link.run(8.0, _TARGET)
    assert link.run(10.0, _TARGET) < _HELD_M
    link.core.set_mode(link.now_s, Mode.LAND)
    link.run(10.0)
    assert not link.core.state(link.now_s).armed and link.p_m[2] < 0.05
    assert link.core.mode == Mode.LAND


def test_guided_begins_where_it_is_and_brake_holds_there(flown):
    flown.core.set_mode(flown.now_s, Mode.BRAKE)
    at = transforms.transform(np.eye(3), flown.p_m)
    assert flown.run(10.0, at) < 0.3  # the set-points of GUIDED do not count
    flown.core.set_mode(flown.now_s, Mode.GUIDED)
    here = flown.p_m
    flown.run(5.0)
    assert np.linalg.norm(flown.p_m - here) < 0.25


def test_before_the_tracker_knows_it_its_own_odometry_is_shown_and_the_step_is_told(tmp_path):
    link = LinkedTello(tmp_path, 1)
    link.tracked = False
    link.run(1.0)
    assert link.core.tracking.T_odom_body[0, 3] == pytest.approx(-4.0, abs=0.1)
    link.tracked = True
    link.run(1.0)
    assert link.core.tracking.T_odom_body[0, 3] == pytest.approx(0.0, abs=0.1)


def test_who_finds_it_in_flight_holds_it(tmp_path):
    """The link was started again."""
    first = LinkedTello(tmp_path, 1)
    first.guided(_TARGET)
    again = LinkedTello(tmp_path, 2)
    again.tello, again.now_s = first.tello, first.now_s
    at = transforms.transform(np.eye(3), first.p_m)
    assert again.run(6.0, at) < 0.3
    assert again.core.mode == Mode.BRAKE


# ---- what is refused -----------------------------------------------------------------------------


def _refusal(call, *what) -> str:
    with pytest.raises(CommandRefused) as told:
        call(*what)
    return str(told.value)


def test_modes_that_it_has_not_are_refused_with_those_that_it_has(flown):
    assert "LOITER, GUIDED, BRAKE, LAND" in _refusal(flown.core.set_mode, flown.now_s, Mode.RTL)


def test_guided_needs_a_steady_tracker(tmp_path):
    link = LinkedTello(tmp_path, 1)
    link.tracked = False
    link.run(1.0)
    link.core.take_off(link.now_s, 1.5)
    link.run(8.0)
    assert "poses of the tracker" in _refusal(link.core.set_mode, link.now_s, "GUIDED")
    link.tracked = True
    link.run(0.5)
    assert "for 1 s" in _refusal(link.core.set_mode, link.now_s, "GUIDED")
    link.run(1.2)
    link.core.set_mode(link.now_s, Mode.GUIDED)
    assert link.core.mode == Mode.GUIDED


@pytest.mark.parametrize(
    "prepare, altitude_m, why",
    [
        (lambda link: setattr(link, "wifi", False), 1.5, "Wi-Fi"),
        (lambda link: setattr(link, "battery_share", 0.15), 1.5, "battery below 20%"),
        (lambda link: setattr(link, "battery_share", np.nan), 1.5, "battery"),
        (lambda link: None, 30.0, "0.5..9"),
        (lambda link: None, np.nan, "0.5..9"),
    ],
)
def test_a_take_off_is_refused_with_its_reason(tmp_path, prepare, altitude_m, why):
    link = LinkedTello(tmp_path, 1)
    link.run(1.0)
    prepare(link)
    link.run(2.0)
    assert why in _refusal(link.core.take_off, link.now_s, altitude_m)


def test_nothing_is_flown_to_a_set_point_that_is_none(flown):
    flown.run(1.0, np.full((4, 4), np.nan))
    assert flown.run(5.0, _TARGET) < 0.3


def test_rules_that_contradict_each_other_name_their_field():
    with pytest.raises(ValueError, match="feed_old_s"):
        TelloRules(feed_old_s=5.0)


# ---- what goes wrong -----------------------------------------------------------------------------


def test_a_pilots_stick_takes_it_and_set_points_do_not_count_any_more(flown):
    flown.core.pilot(flown.now_s, Sticks(left=0.1))
    flown.run(0.2, _TARGET)
    assert flown.core.mode == Mode.GUIDED  # a stick that trembles
    flown.core.pilot(flown.now_s, Sticks(left=0.5))
    assert flown.core.mode == Mode.LOITER
    before = flown.p_m[1]
    for _ in range(40):
        flown.core.pilot(flown.now_s, Sticks(left=0.5))
        flown.run(0.04, _TARGET)
    assert flown.p_m[1] > before + 0.4
    flown.run(5.0, _TARGET)  # he lets go: it stays where it is
    assert flown.core.mode == Mode.LOITER and flown.off_m(_TARGET) > 0.4


def test_a_tracker_that_is_lost_for_two_seconds_is_ridden_out(flown):
    flown.tracked = False
    assert flown.run(2.0, _TARGET) < 0.4
    assert flown.core.mode == Mode.GUIDED and any("flow" in text for text in flown.said)
    flown.tracked = True
    flown.run(5.0, _TARGET)
    assert flown.run(5.0, _TARGET) < _HELD_M


def test_a_tracker_that_is_lost_for_good_is_held_and_landed(flown):
    flown.tracked = False
    lost_s, place = flown.now_s, flown.p_m
    flown.run(2.7, _TARGET)
    assert flown.core.mode == Mode.GUIDED and np.linalg.norm(flown.p_m - place) < 0.4
    flown.run(0.6, _TARGET)
    assert flown.core.mode == Mode.LAND
    flown.run(10.0, _TARGET)
    assert not flown.core.state(flown.now_s).armed
    assert np.linalg.norm((flown.p_m - place)[:2]) < 1.0
    assert flown.now_s - lost_s < 15.0


def test_a_tracker_that_jumps_is_not_followed(flown):
    flown.seen_off_m = np.array([3.0, 0.0, 0.0])
    place = flown.p_m
    flown.run(3.5, _TARGET)
    assert flown.core.mode == Mode.LAND and np.linalg.norm((flown.p_m - place)[:2]) < 0.5
    assert "refused" in flown.core.tracking.doubt(flown.now_s)


def test_a_pilot_or_a_brake_ends_the_landing_that_the_link_began(flown):
    """A Tello lands on, whatever its sticks say, until it is told to stay; first orders are lost in
    the air."""
    for ends in (
        lambda: flown.core.pilot(flown.now_s, Sticks(up=0.5)),
        lambda: flown.core.set_mode(flown.now_s, Mode.BRAKE),
    ):
        flown.core.set_mode(flown.now_s, Mode.LAND)
        flown.run(1.0)
        assert flown.tello.flight.state == "LAND"
        ends()
        flown.lost_orders = 3
        flown.run(1.0)
        height_m = flown.p_m[2]
        flown.run(5.0)
        assert flown.tello.flight.state == "FLY" and flown.p_m[2] == pytest.approx(
            height_m, abs=0.2
        )


def test_wifi_that_is_lost_for_ten_seconds_holds_then_lands(flown):
    flown.wifi = False
    place = flown.p_m
    flown.run(9.0, _TARGET)
    assert not flown.core.state(flown.now_s).connected
    # the Tello lets go of sticks that it does not hear, and hovers
    assert np.linalg.norm(flown.p_m - place) < 0.6
    flown.run(1.5, _TARGET)
    flown.wifi = True
    flown.run(10.0, _TARGET)
    assert flown.core.mode == Mode.LAND and not flown.core.state(flown.now_s).armed
    assert np.linalg.norm((flown.p_m - place)[:2]) < 1.0


def test_wifi_that_is_lost_for_five_seconds_is_ridden_out(flown):
    flown.wifi = False
    flown.run(5.0, _TARGET)
    flown.wifi = True
    flown.run(6.0, _TARGET)
    assert flown.core.mode == Mode.GUIDED and flown.run(5.0, _TARGET) < _HELD_M


def test_a_low_battery_is_said_an_empty_one_lands(flown):
    flown.battery_share = 0.18
    flown.run(1.0, _TARGET)
    assert flown.core.mode == Mode.GUIDED and sum("20%" in text for text in flown.said) == 1
    flown.battery_share = 0.09
    flown.run(0.5, _TARGET)
    assert flown.core.mode == Mode.LAND
    flown.run(10.0)
    assert not flown.core.state(flown.now_s).armed


def test_a_pilot_is_not_overruled_by_a_battery(flown):
    flown.core.pilot(flown.now_s, Sticks(left=0.5))
    flown.battery_share = 0.05
    flown.run(2.0, _TARGET)
    assert flown.core.mode == Mode.LOITER and flown.land_orders == 0


@pytest.mark.parametrize("fault", ["tracker", "wifi", "battery"])
def test_with_a_fault_of_one_nobody_is_hit(tmp_path, fault):
    """Side by side by 1 m, the closest that missions before a tracker fly: one has a fault, the
    other one flies on."""
    links = [
        LinkedTello(tmp_path / n, k + 1, (0.0, y), name=n)
        for k, (n, y) in enumerate((("a", 0.0), ("b", 1.0)))
    ]
    targets = [transforms.from_xyz_yaw([0.0, y, 2.0], 0.0) for y in (0.0, 1.0)]
    for link, target in zip(links, targets):
        link.guided(target)
    nearest = np.inf
    for k in range(650):
        if k == 50:
            links[0].tracked &= fault != "tracker"
            links[0].wifi &= fault != "wifi"
            links[0].battery_share = 0.05 if fault == "battery" else 0.9
        for link, target in zip(links, targets):
            link.step(target)
        nearest = min(nearest, float(np.linalg.norm(links[0].p_m - links[1].p_m)))
    assert nearest > _BODIES_M + 0.2
    assert links[0].p_m[2] < 0.05 and links[1].off_m(targets[1]) < _HELD_M
