# SPDX-License-Identifier: Apache-2.0
"""Everybody stops in a rehearsed flight: the real cores of link, agent, mission and stop-all over a
radio."""

import numpy as np
import pytest

from fcsv_control.stopping.core import LAND
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.people.operator import TransmitterSticks
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.radio import RadioQuality


class Call:
    """Somebody's call at ``at_s``: a fault that is told of every pass."""

    def __init__(self, at_s):
        self.at_s, self.called_s = at_s, None

    def __call__(self, flight):
        if self.called_s is None and flight.now_s >= self.at_s:
            self.called_s = flight.now_s
            flight.control.stop_all(flight.now_s)


@pytest.fixture
def flying():
    """flying(seed, loss) -> a flight that is in the configurations."""
    listed = [
        StereoConfiguration(axis, b, record_s=2.0)
        for axis, b in (("horizontal", 2.0), ("vertical", 5.0))
    ]

    def begin(seed, loss=0.01):
        flight = Flight(Mission("rehearsed", listed), 2, seed, RadioQuality(loss=loss))
        while flight.phase != "CONFIGURATIONS" and flight.now_s < 200.0:
            flight.step()
        wait(flight, 5.0)
        assert flight.phase == "CONFIGURATIONS"
        return flight

    return begin


def wait(flight, seconds, *faults):
    end_s = flight.now_s + seconds
    while flight.now_s < end_s:
        for fault in faults:
            fault(flight)
        flight.step()


def asked_since(flight, name, since_s):
    return [(at_s, mode) for at_s, mode in flight.fleet[name].modes_asked if at_s >= since_s]


# a second holds five repetitions
@pytest.mark.parametrize("loss, most_s", [(0.0, 0.1), (0.3, 1.0)])
def test_with_the_mission_dead_everybody_stops_and_stays(flying, loss, most_s):
    flight = flying(1, loss)
    flight.control.alive = False  # it neither hears nor says anything; the stop-all node does
    call = Call(flight.now_s)
    wait(flight, 25.0, call)  # after 30 s without the control PC the guardians land
    for name, vehicle in flight.fleet.items():
        [(at_s, mode), *more] = asked_since(flight, name, call.called_s)
        assert mode == Mode.BRAKE and at_s - call.called_s <= most_s
        assert {m for _, m in more} <= {Mode.BRAKE} and vehicle.state.mode == Mode.BRAKE
        assert np.linalg.norm(vehicle.body.velocity_mps) < 1.0  # wind of 2 m/s at most
    assert not flight.invariants.violations


def test_who_is_flown_by_hand_gets_no_mode_command(flying):
    flight = flying(2)
    flight.hand_flown["uav2"] = lambda *_: TransmitterSticks(
        mode=Mode.BRAKE
    )  # a pilot's BRAKE, which looks like ours
    wait(flight, 2.0)
    called_s = flight.now_s
    flight.control.alive = False  # a mission that lives lands everybody itself
    flight.control.stop_all(called_s, LAND, "a test")
    wait(flight, 20.0)
    assert not asked_since(flight, "uav2", called_s) and flight.control.stopped.by_hand == ["uav2"]
    assert [m for _, m in asked_since(flight, "uav1", called_s)][:1] == ["LAND"]


def test_the_mission_takes_them_again_when_the_operator_resumes(flying):
    flight = flying(3)
    flight.operator_there = False
    call = Call(flight.now_s)
    wait(flight, 60.0, call)
    assert {v.state.mode for v in flight.fleet.values()} == {Mode.BRAKE}
    assert {m for n in flight.fleet for _, m in asked_since(flight, n, call.called_s)} == {
        Mode.BRAKE
    }
    assert flight.control.machine.waits_for == "resume"
    flight.operator_there = True
    assert flight.control.proceed(flight.now_s, "resume") == ""
    result = flight.run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])


def test_who_was_stopped_above_another_lands_beside_it_when_the_control_pc_is_gone_for_good(flying):
    flight = flying(3)
    upper, lower = flight.fleet["uav2"], flight.fleet["uav1"]
    while upper.p_world_m[2] - lower.p_world_m[2] < 4.8 and flight.now_s < 300.0:
        flight.step()
    wait(flight, 3.0)
    flight.operator_there = False
    call = Call(flight.now_s)
    wait(flight, 2.0, call)
    assert {v.state.mode for v in flight.fleet.values()} == {Mode.BRAKE}
    assert np.linalg.norm((upper.p_world_m - lower.p_world_m)[:2]) < 1.5
    flight.control.die()  # the stop-all node, too
    wait(flight, 70.0)
    assert not any(v.state.armed for v in flight.fleet.values())
    assert not flight.invariants.violations
    assert np.linalg.norm((upper.p_world_m - lower.p_world_m)[:2]) > 1.5


# ---- an odometry that begins anew ----------------------------------------------------------------


def test_a_gap_of_the_tracker_holds_everybody_within_half_a_second(flying):
    flight = flying(4)
    flight.operator_there = False
    lost = flight.fleet["uav2"]
    lost.tracker_on = False
    wait(flight, 0.6)  # longer than what begins an epoch, shorter than what lands it
    lost.tracker_on = True
    back_s = flight.now_s
    wait(flight, 0.5)
    assert any(
        p.startswith("uav2: its odometry began anew (the tracker was silent for 0.")
        for p in flight.control.machine.problems
    )
    wait(flight, 4.0)  # from 2 m/s it takes a while to stand
    places = {n: v.p_world_m.copy() for n, v in flight.fleet.items()}
    wait(flight, 20.0)
    for name, vehicle in flight.fleet.items():
        assert vehicle.state.mode == Mode.GUIDED and not asked_since(flight, name, back_s)
        assert np.linalg.norm(vehicle.p_world_m - places[name]) < 0.5  # wind of 2 m/s at most
    assert "its odometry began anew" in lost.agent.port._core.rights.frame.outdated
    assert not flight.fleet["uav1"].agent.port._core.rights.frame.outdated


@pytest.mark.parametrize("step_s", [-60.0, -0.4, 2.0])
def test_a_step_of_a_vehicles_clock_begins_no_epoch(flying, step_s):
    flight = flying(4)
    before = flight.fleet["uav2"].epoch
    flight.fleet["uav2"].clock_offset_s = step_s
    result = flight.run()
    assert flight.fleet["uav2"].epoch == before and (result.phase, result.captures) == ("DONE", 2)
