# SPDX-License-Identifier: Apache-2.0
"""Hands on the sticks of Tellos before a mocap: from take-off until the tracker knows everybody, by
screens alone."""

import numpy as np
import pytest
from support.tello_by_hand import ByHand, apart_m

from fcsv_control.tello.pid import PidConfig
from fcsv_geometry import transforms
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.people.tello_hands import LAND, TAKE_OFF, Act, Finger, Screen, TelloHands

HERE = transforms.from_xyz_yaw([0.1, 0.2, 2.0], 0.0)


def screen(T=HERE, mode=Mode.LOITER, armed=True, feed_hz=10.0):
    return Screen(armed, mode, T, np.zeros(3), feed_hz)


@pytest.mark.parametrize("seed", [1, 2])
def test_they_take_off_sway_until_the_tracker_knows_both_hold_and_land(seed, tmp_path, root):
    """A place that is held is off by what the flow sensor and the odometry drift before the
    tracker's first pose."""
    mission = load_mission(root / "config" / "missions" / "tello.yaml")
    air = ByHand(tmp_path, mission, seed)
    air.run(1.0, "WAIT_VEHICLES")
    tellos = air.tellos.values()
    assert air.run(
        20.0, "TAKE_OFF", lambda: all(one.p_m[2] > mission.home_height_m - 0.3 for one in tellos)
    )
    air.run(3.0, "TAKE_OFF")
    # a heading is not proven by standing still
    assert not any(air.screen(n).tracked for n in air.tellos)
    assert air.run(30.0, "COLUMN", lambda: all(air.screen(n).tracked for n in air.tellos))
    air.run(8.0, "MOVE_HOME")
    places = {n: one.p_m.copy() for n, one in air.tellos.items()}
    air.run(8.0, "SET_HOME")
    for name, one in air.tellos.items():
        assert np.linalg.norm(one.p_m - places[name]) < 0.15, name
        assert abs(one.p_m[2] - mission.home_height_m) < 0.2
        assert air.duo.in_view(one.drone.body.T_world_body)
    assert apart_m(air) > mission.min_separation_m
    assert air.run(20.0, "ABORTED", lambda: not any(one.drone.flight.flying for one in tellos))


def test_the_frame_that_changes_moves_no_vehicle():
    hands = TelloHands(PidConfig(), 2.0, 0.35)
    hands.act(1.0, "MOVE_HOME", screen())
    assert hands.act(1.05, "MOVE_HOME", screen()).sticks.moved == 0.0
    moved = transforms.from_xyz_yaw([3.0, -1.0, -0.3], 0.2)
    sticks = hands.act(1.1, "MOVE_HOME", screen(moved @ HERE)).sticks
    # to look along its x
    assert (sticks.forward, sticks.left, sticks.up) == (0.0, 0.0, 0.0) and sticks.turn < 0.0


def test_they_line_up_as_they_are_to_in_the_trackers_frame():
    hands = TelloHands(PidConfig(), 2.0, 0.35, np.pi)
    assert hands.act(1.0, "TAKE_OFF", screen(feed_hz=0.0)).sticks.turn == 0.0, "nobody sees it yet"
    assert abs(hands.act(1.1, "COLUMN", screen()).sticks.turn) > 0.1
    turned = HERE @ transforms.from_xyz_yaw(np.zeros(3), np.pi)
    assert hands.act(1.2, "COLUMN", screen(T=turned, feed_hz=0.0)).sticks.turn == pytest.approx(0.0)


def test_they_let_go_of_whom_the_mission_flies_and_land_whom_it_leaves():
    hands = TelloHands(PidConfig(), 2.0, 0.35)
    off = transforms.from_xyz_yaw([1.0, 0.2, 2.0], 0.0)
    hands.act(1.0, "SET_HOME", screen())
    assert hands.act(1.1, "SET_HOME", screen(mode=Mode.GUIDED, T=off)) == Act()
    assert hands.act(2.0, "CONFIGURATIONS", screen(mode=Mode.GUIDED)) == Act()
    assert hands.act(3.0, "LAND", screen(mode=Mode.GUIDED)) == Act()
    assert hands.act(19.0, "LAND", screen(mode=Mode.GUIDED)).order == LAND
    assert hands.act(30.0, "LAND", screen(mode=Mode.LAND)) == Act()
    assert hands.act(31.0, "TAKE_OFF", screen(armed=False)).order == TAKE_OFF


def test_the_button_is_pressed_once_all_are_tracked_and_calm():
    finger, lost = Finger(), screen(feed_hz=0.0)
    assert not any(
        finger.press(t, "set_home", {"a": screen(), "b": lost}) for t in np.arange(0.0, 5.0, 0.5)
    )
    pressed = [
        t
        for t in np.arange(5.0, 8.0, 0.5)
        if finger.press(t, "set_home", {"a": screen(), "b": screen()})
    ]
    assert pressed == [7.0]
    moving = Screen(True, Mode.LOITER, HERE, np.array([0.5, 0.0, 0.0]), 10.0)
    assert not any(finger.press(t, "execute", {"a": moving}) for t in np.arange(10.0, 15.0, 0.5))
    assert any(finger.press(t, "calibrate", {"a": moving}) for t in np.arange(20.0, 25.0, 0.5))
