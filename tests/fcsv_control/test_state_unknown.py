# SPDX-License-Identifier: Apache-2.0
"""A link that has just been started tells a state without a mode, as MAVROS does where it hears no
autopilot: that says nothing of the motors."""

import numpy as np
import pytest

from fcsv_control.mission.watches.telemetry import VehicleTelemetry
from fcsv_control.stopping.core import STOP, StopAll
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.rehearsal.flight import Flight


def flying() -> VehicleTelemetry:
    heard = VehicleTelemetry(np.eye(4))
    heard.state(1.0, Mode.LOITER, False, True)
    heard.position(0.2)
    heard.state(2.0, Mode.GUIDED, True, True)
    heard.position(8.2)
    return heard


def test_a_vehicle_whose_link_begins_anew_is_not_taken_to_stand_on_the_ground():
    heard = flying()
    heard.state(3.0, "", False, False)
    heard.position(8.3)
    view = heard.view(3.0, None)
    assert (view.armed, view.mode, view.connected, view.state_age_s) == (True, "GUIDED", False, 0.0)
    assert view.height_m == pytest.approx(8.1)
    heard.state(3.5, Mode.LAND, False, True)
    heard.position(0.4)
    view = heard.view(3.5, None)
    assert (view.armed, view.connected) == (False, True) and view.height_m == pytest.approx(0.0)


def test_what_was_never_known_of_a_vehicle_is_no_ground():
    heard = VehicleTelemetry(np.eye(4))
    heard.state(1.0, "", False, False)
    heard.position(8.2)
    heard.state(2.0, Mode.GUIDED, True, True)
    assert heard.view(2.0, None).height_m == pytest.approx(8.2)


def test_stop_all_goes_on_with_a_vehicle_that_says_nothing_of_its_mode():
    stop = StopAll(["uav1"])
    stop.state(1.0, "uav1", Mode.GUIDED, True)
    stop.state(2.0, "uav1", "", False)
    stop.begin(2.1, STOP, "a test")
    assert [o.mode for o in stop.due(2.1)] == [Mode.BRAKE] and stop.report(2.1).done == []


def test_a_link_that_dies_in_flight_lands_nobody_and_changes_no_height():
    flight = Flight(
        Mission("rehearsed", [StereoConfiguration("horizontal", 4.0, record_s=30.0)]), 2, 1
    )
    while flight.phase != "CONFIGURATIONS":
        flight.step()
        assert flight.now_s < 100.0
    vehicle = flight.fleet["uav2"]
    height_m = flight.control.view(flight.now_s, "uav2").height_m
    took_off = vehicle.guardian.air.take_off
    vehicle.kill_link()
    for seconds, what in ((0.4, lambda: vehicle.link.start(flight.now_s)), (3.0, lambda: None)):
        until_s = flight.now_s + seconds
        while flight.now_s < until_s:
            flight.step()
            view = flight.control.view(flight.now_s, "uav2")
            assert view.armed and view.height_m == pytest.approx(height_m, abs=1.0)
        what()
    assert vehicle.state.connected and vehicle.guardian.air.take_off is took_off
    assert flight.phase == "CONFIGURATIONS" and not flight.control.machine.problems
