# SPDX-License-Identifier: Apache-2.0
"""What may change nothing changes nothing: clocks that are set. And a flight in which nobody may be
stopped, and no feed be late, tells where somebody was, and which was."""

from types import SimpleNamespace

import numpy as np
import pytest

from fcsv_control.guardian.messages import GuardianVerdict
from fcsv_geometry.missions.mission import Mission, StereoConfiguration, load_mission
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.bringup import mission_file
from fcsv_sim.rehearsal.calm import CONTROL, DEADLINES_S, OTHERS, POSES, SEEN, STATES, Calm
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.radio import CRITICAL_S, Radio, RadioQuality

STEPS_S = (-60.0, -2.0, -0.4, 0.4, 2.0, 60.0)


def fly(flight: Flight, seconds: float) -> None:
    until_s = flight.now_s + seconds
    while flight.now_s < until_s:
        flight.step()


@pytest.fixture
def flying():
    """flying() -> a flight some seconds in its configurations; the same each time."""

    def begin() -> Flight:
        flight = Flight(
            Mission("rehearsed", [StereoConfiguration("vertical", 5.0, record_s=30.0)]), 2, 4
        )
        while flight.phase != "CONFIGURATIONS":
            flight.step()
            assert flight.now_s < 100.0
        fly(flight, 8.0)
        return flight

    return begin


def stopped_after_s(flight: Flight) -> dict:
    """/stop_all is called: when each companion asks for BRAKE."""
    called_s, asked = flight.now_s, {n: len(v.modes_asked) for n, v in flight.fleet.items()}
    flight.control.stop_all(called_s)
    fly(flight, 0.4)
    return {
        n: [(s - called_s, m) for s, m in v.modes_asked[asked[n] :]][0]
        for n, v in flight.fleet.items()
    }


def test_clocks_that_are_set_land_nobody_and_delay_no_stop(flying):
    stepped, calm = flying(), flying()
    stepped.expect_calm()
    asked = {n: len(v.modes_asked) for n, v in stepped.fleet.items()}
    for step_s in STEPS_S:  # of each machine in turn, and then of all together
        for machine in (*stepped.fleet.values(), stepped.control):
            machine.clock_offset_s += step_s
            fly(stepped, 0.5)
        for machine in (*stepped.fleet.values(), stepped.control):
            machine.clock_offset_s += step_s
        fly(stepped, 0.5)
    fly(calm, stepped.now_s - calm.now_s)
    assert stepped.invariants.violations == []
    assert all(len(v.modes_asked) == asked[n] for n, v in stepped.fleet.items())
    for machine in (*stepped.fleet.values(), stepped.control):
        machine.clock_offset_s -= 60.0  # and in the moment of the call
    after_s, must_s = stopped_after_s(stepped), stopped_after_s(calm)
    assert {m for _, m in after_s.values()} == {Mode.BRAKE}
    for name, (late_s, _) in after_s.items():
        assert late_s == pytest.approx(must_s[name][0], abs=0.021), (
            "a pass of the board later at most"
        )


@pytest.mark.parametrize("step_s", (-2.0, 60.0))
def test_a_sweep_during_which_the_control_pcs_clock_is_set_is_flown_again(step_s):
    """No time of day tells which pictures the first attempt took."""
    flight = Flight(load_mission(mission_file("sweep")), 2, 4)
    flight.expect_calm()
    while flight.control.machine.stage != "records":
        flight.step()
        assert flight.now_s < 120.0
    fly(flight, 2.0)
    flight.control.clock_offset_s += step_s
    set_s = flight.now_s
    result = flight.run()
    assert result.violations == [] and result.captures == result.wanted == 2
    assert min(w.start_s for w in flight.control.captures) > set_s


def test_a_mission_that_restarts_remembers_over_steps_of_the_clock_and_forgets_an_earlier_flight(
    flying,
):
    flight = flying()
    control = flight.control
    for step_s, remembers in ((-60.0, True), (60.0, True), (700.0, False)):
        control.alive = False
        control.clock_offset_s += step_s
        control.restart(flight.now_s)
        assert (control.machine._memory is not None) is remembers, step_s


# ---- radios that hold messages up ----------------------------------------------------------------


def test_what_is_held_up_comes_in_a_burst_in_its_order_unless_it_is_too_old():
    got, radio = [], Radio(RadioQuality(loss=0.0), 1)
    radio.held_until_s = 3.0
    for k in range(29):
        radio.send(0.1 * k, got.append, k)
        radio.send(0.1 * k, got.append, -k, CRITICAL_S)
    radio.step(2.99)
    assert got == []
    radio.step(3.01)
    assert [k for k in got if k < 0] == [-k for k in range(1, 29)], "commands wait for 5 s"
    assert [k for k in got if k > 0] == list(range(20, 29)), "states for 1 s"
    radio.send(3.1, got.append, 99)
    radio.step(3.14)
    assert got[-1] == 99


def test_a_stop_that_was_held_up_counts_when_it_comes(flying):
    flight = flying()
    for radio in flight.radios.values():
        # after 1.5 s of silence who is beneath moves aside, and refuses
        radio.held_until_s = flight.now_s + 1.2
    asked = {n: len(v.modes_asked) for n, v in flight.fleet.items()}
    flight.control.stop_all(flight.now_s)
    fly(flight, 1.15)
    assert all(len(v.modes_asked) == asked[n] for n, v in flight.fleet.items())
    fly(flight, 0.3)
    told = {n: [m for _, m in v.modes_asked[asked[n] :]] for n, v in flight.fleet.items()}
    assert told == dict.fromkeys(asked, [Mode.BRAKE])


# ---- what is seen --------------------------------------------------------------------------------


def watched(phase="CONFIGURATIONS"):
    """Calm over one vehicle made of what it looks at, and what it told."""
    told = []
    air = SimpleNamespace(control_s=10.0, others={"uav2": SimpleNamespace(heard_s=10.0)})
    vehicle = SimpleNamespace(
        guardian=SimpleNamespace(air=air, verdict=GuardianVerdict()),
        modes_asked=[(1.0, "GUIDED")],
        autopilot=SimpleNamespace(armed=True),
    )
    seen = SimpleNamespace(pose_age_s=0.1, state_age_s=0.5)
    mission = SimpleNamespace(recorded=[0])
    machine = SimpleNamespace(phase=phase, problems=[], captures=[1], detail="", mission=mission)
    control = SimpleNamespace(
        machine=machine, ages_s=lambda *_: (seen.pose_age_s, seen.state_age_s)
    )
    calm = Calm(
        {"uav1": vehicle},
        control,
        lambda who, at_s, text: told.append(text),
        lambda who, at_s, text: told.append(text),
    )
    return calm, vehicle, seen, machine, told


def test_who_is_stopped_without_a_reason_is_told():
    calm, vehicle, _, machine, told = watched()
    calm.look(10.0)
    assert told == []
    vehicle.guardian.verdict = GuardianVerdict("hold", True, reasons=("it dreams",))
    calm.look(10.05)
    assert told == ["uav1's guardian did: hold: it dreams"]
    vehicle.guardian.verdict = GuardianVerdict()
    vehicle.modes_asked.append((10.1, "LAND"))
    machine.problems = ["uav1: no pose for 2 s"]
    calm.look(10.1)
    assert told[1:] == ["uav1 was asked for LAND", "the mission paused: uav1: no pose for 2 s"]
    calm.look(10.15)
    assert len(told) == 4, "a mode once, a pause as long as it lasts"
    machine.phase, machine.problems = "LAND", []
    vehicle.modes_asked.append((20.0, "LAND"))  # all is flown
    calm.look(20.0)
    assert len(told) == 4
    machine.phase = "DONE"
    calm.end(30.0)
    assert len(told) == 4
    machine.captures = []
    calm.end(30.0)
    assert told[4] == "0 of 1 recorded ()"


@pytest.mark.parametrize("feed", DEADLINES_S)
def test_a_feed_that_is_late_is_told(feed):
    calm, vehicle, seen, _, told = watched()
    calm.posed(9.97, "uav1")
    calm.look(10.0)
    assert told == [] and calm.longest_s[POSES] == pytest.approx(0.03)
    late_s = DEADLINES_S[feed] + 0.01
    if feed == POSES:
        calm.posed(9.97 + late_s, "uav1")
    elif feed == CONTROL:
        vehicle.guardian.air.control_s = 10.0 - late_s
    elif feed == OTHERS:
        vehicle.guardian.air.others["uav2"].heard_s = 10.0 - late_s
    else:
        setattr(seen, {SEEN: "pose_age_s", STATES: "state_age_s"}[feed], late_s)
    calm.look(10.0)
    assert told == [f"{feed} (uav1): silent for {late_s:.2f} s"]
    assert calm.longest_s[feed] == pytest.approx(late_s)
    assert np.isfinite(list(calm.longest_s.values())).all()
