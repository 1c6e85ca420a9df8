# SPDX-License-Identifier: Apache-2.0
"""Each fault of a rehearsal does what it says, and each invariant sees what it is for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fcsv_control.agent.messages import Ask, Kind, SetPoint
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot import modes
from fcsv_sim.people.operator import TransmitterSticks
from fcsv_sim.rehearsal.faults import make_faults
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.hand_flight import HandFlight
from fcsv_sim.rehearsal.invariants import Invariants


@pytest.fixture(scope="module")
def mission():
    return Mission("rehearsed", [StereoConfiguration("vertical", 4.0, record_s=2.0)])


def flown_to(mission, phase: str, after_s: float = 1.0, seed: int = 1) -> Flight:
    """A flight some time after it came to a phase."""
    flight = Flight(mission, 2, seed)
    while flight.phase != phase:
        flight.step()
        assert flight.now_s < 100.0
    fly(flight, after_s)
    return flight


def fly(flight: Flight, seconds: float, faults=()) -> None:
    until_s = flight.now_s + seconds
    while flight.now_s < until_s:
        for fault in faults:
            fault(flight)
        flight.step()


def begun(flight: Flight, name: str, seed: int = 1):
    """The fault, which has just begun."""
    (fault,) = make_faults([name], seed)
    fault._due = lambda _flight: True
    fault(flight)
    assert fault.began_s == flight.now_s and fault.vehicle is not None
    return fault


# ---- trackers ------------------------------------------------------------------------------------


def samples(mission, name: str, seconds: float, seed: int = 1):
    """(times, (N, 3) positions) of a standing tracker after the fault began; the first is the last
    before it."""
    flight = flown_to(mission, "COLUMN", 0.0)
    before = {
        n: v.tracker.odometry(flight.now_s, v.body.T_world_body)[0][:3, 3]
        for n, v in flight.fleet.items()
    }
    fault = begun(flight, name, seed)
    tracker, T = fault.vehicle.tracker, fault.vehicle.body.T_world_body
    times = np.arange(0.0, seconds, 0.03)
    positions = []
    for t in times:
        flight.now_s = fault.began_s + t
        positions.append(tracker.odometry(fault.began_s + t, T)[0][:3, 3])
    return times, np.array([before[fault.vehicle.name], *positions[1:]])


def test_a_frozen_tracker_says_one_pose_for_ever(mission):
    _, p = samples(mission, "tracker frozen", 5.0)
    assert (p[2:] == p[1]).all()


def test_a_noisy_frozen_tracker_moves_by_less_than_two_millimetres_and_never_stands(mission):
    _, p = samples(mission, "tracker frozen with noise", 5.0)
    assert (np.diff(p, axis=0) != 0).any(1).all()
    assert 0.0 < np.linalg.norm(p[1:] - p[1:].mean(0), axis=1).max() < 0.002


def test_a_tracker_that_drifts_gets_faster_and_one_that_runs_off_is_fast_at_once(mission):
    times, p = samples(mission, "tracker drifts slowly", 20.0)
    speed = np.linalg.norm(p[20:] - p[:-20], axis=1) / (times[20] - times[0])
    assert 0.1 < speed[0] < 0.7 and speed[-1] == pytest.approx(
        speed[0] + 0.1 * (times[-21] - times[0]), abs=0.1
    )
    times, p = samples(mission, "tracker runs off", 1.0)
    assert 0.4 < np.linalg.norm(p[-1] - p[0]) / times[-1] < 9.5


def test_a_tracker_that_resets_jumps_by_thirty_metres_and_begins_at_zero(mission):
    _, p = samples(mission, "tracker resets", 4.0)
    assert np.linalg.norm(p[1] - p[0]) == pytest.approx(30.0, abs=0.1)
    assert np.linalg.norm(p[-1]) < 0.1


def test_an_unsure_tracker_says_so_and_gets_noisy(mission):
    flight = flown_to(mission, "COLUMN")
    fault = begun(flight, "tracker unsure")
    assert fault.vehicle.tracker.confidence < 2
    _, p = samples(mission, "tracker unsure", 1.0)
    assert 0.015 < p.std(0).mean() < 0.2


# ---- processes -----------------------------------------------------------------------------------


def hover(mission) -> Flight:
    return flown_to(mission, "CONFIGURATIONS", 12.0)


def test_a_dead_agent_sends_nothing_and_its_guardian_holds(mission):
    flight = hover(mission)
    vehicle, sent, tell = flight.fleet["uav2"], [], flight.fleet["uav2"].told
    begun(flight, "agent dies")
    vehicle.agent.kill()

    def told(now_s, what, which):
        sent.append(what if what != "sent" else which.get_type())
        tell(now_s, what, which)

    vehicle.told = told
    fly(flight, 0.75)  # it lived 0.2 s ago at most
    assert not vehicle.agent.runs and "SET_POSITION_TARGET_LOCAL_NED" not in sent
    fly(flight, 1.35)
    assert (
        "held" in sent
        and "SET_POSITION_TARGET_LOCAL_NED" in sent
        and vehicle.autopilot.mode == modes.GUIDED
    )


def test_a_vehicle_with_a_low_battery_that_nobody_commands_comes_down_where_it_took_off(mission):
    far = replace(mission, configurations=[StereoConfiguration("horizontal", 6.0, record_s=60.0)])
    flight = flown_to(far, "CONFIGURATIONS", 20.0)
    fault = begun(flight, "low battery alone", 1)
    vehicle, began_m = fault.vehicle, flight.invariants._begun[fault.vehicle.name]
    assert vehicle.name == "uav2" and np.linalg.norm((vehicle.p_world_m - began_m)[:2]) > 4.0
    fly(flight, 9.5)
    assert vehicle.guardian.verdict.action == ""
    fly(flight, 1.0)
    assert vehicle.guardian.verdict.action == "home"
    fly(flight, 30.0)
    assert not vehicle.autopilot.armed and not flight.invariants.violations
    # 1 % of the way, and wind as it lands
    assert np.linalg.norm((vehicle.p_world_m - began_m)[:2]) < 1.0


def test_a_link_that_is_started_again_finds_its_autopilot(mission):
    flight = hover(mission)
    fault = begun(flight, "link dies")
    vehicle = fault.vehicle
    assert not vehicle.link.lives
    fly(flight, 1.9, [fault])
    assert not fault.ended
    fly(flight, 2.0, [fault])
    assert fault.ended and vehicle.link.runs and vehicle.state.connected
    assert vehicle.state.mode == modes.NAMES[vehicle.autopilot.mode]


def test_a_link_that_sleeps_reads_on_where_it_was_and_does_not_take_its_sleep_for_a_dead_feed(
    mission,
):
    flight = hover(
        replace(mission, configurations=[StereoConfiguration("vertical", 4.0, record_s=20.0)])
    )
    fault = begun(flight, "link sleeps")
    vehicle = fault.vehicle
    assert vehicle.link.lives and not vehicle.link.runs
    estimate_s = vehicle.autopilot.estimator._vision_s
    fly(flight, 1.5, [fault])
    assert vehicle.autopilot.estimator._vision_s == estimate_s  # nothing left it
    asked = len(vehicle.modes_asked)
    fly(flight, 5.0, [fault])
    assert fault.ended and vehicle.link.runs and vehicle.state.connected
    assert vehicle.autopilot.estimator._vision_s > flight.now_s - 0.1
    assert len(vehicle.modes_asked) == asked  # no LAND


def test_a_mission_that_restarts_goes_on_where_it_was(mission):
    """A new process under a new name: the old one's lease ends first, then everybody is held and
    the list goes on."""
    first = StereoConfiguration("horizontal", 2.0, record_s=2.0)
    two = replace(mission, configurations=[first, *mission.configurations])
    flight = flown_to(two, "CONFIGURATIONS", 0.0)
    while not flight.control.machine.captures:
        flight.step()
    fly(flight, 1.0)
    fault, machine, sender = (
        begun(flight, "mission restarts"),
        flight.control.machine,
        flight.control.sender,
    )
    fly(flight, 4.0, [fault])
    assert not flight.control.alive
    fly(flight, 2.5, [fault])
    assert (
        flight.control.alive
        and flight.control.machine is not machine
        and flight.control.sender != sender
    )
    assert (
        flight.control.machine.phase == "CONFIGURATIONS"
        and len(flight.control.machine.captures) == 1
    )
    result = flight.run([fault])
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])


def test_a_mission_that_restarts_while_people_fly_begins_anew(mission):
    flight = flown_to(mission, "MOVE_HOME")
    fault = begun(flight, "mission restarts")
    result = flight.run([fault])
    assert (result.phase, result.captures, result.violations) == ("DONE", 1, [])


def test_a_mission_that_forgets_names_who_flies_and_the_operator_aborts(mission):
    flight = flown_to(mission, "CONFIGURATIONS", 3.0)
    fault = begun(flight, "mission forgets")
    fly(flight, 6.0, [fault])
    machine = flight.control.machine
    assert (
        flight.phase == "WAIT_VEHICLES"
        and "uav1 flies in GUIDED and nothing is known" in machine.problems[0]
    )
    result = flight.run([fault])
    assert (result.phase, result.violations) == ("ABORTED", [])
    assert result.detail == "aborted by the operator: landing"


def test_a_stick_that_is_off_the_middle_is_named_and_forbids_guided_until_it_is_in_the_middle(
    mission,
):
    flight = flown_to(mission, "SET_HOME", 0.5)
    fault = begun(flight, "stick off the middle", seed=3)
    fault._until_s = flight.now_s + 6.0
    refused = []
    while flight.phase != "CONFIGURATIONS":
        fly(flight, 0.1, [fault])
        refused += flight.fleet[fault.vehicle.name].guardian.verdict.forbids
        assert flight.now_s < 120.0
    assert any("the throttle stick is not in the middle" in text for text in refused)
    assert flight.now_s > fault.began_s + 3.0, "until it was in the middle"
    assert flight.run([fault]).violations == [] and fault.ended


def test_an_operator_who_confirms_anything_confirms_only_what_is_waited_for(mission):
    flight = flown_to(mission, "COLUMN", 0.5)
    fault, phases = begun(flight, "operator confirms anything"), []
    while len(phases) < 1 or not fault.ended:
        fly(flight, 0.1, [fault])
        phases += [flight.phase] if flight.phase not in phases else []
    assert phases in (["COLUMN"], ["COLUMN", "CALIBRATE"])
    result = flight.run([fault])
    assert (result.phase, result.violations, result.captures) == ("DONE", [], 1)


def test_who_comes_down_is_the_upper_one_and_the_lower_one_must_react(mission):
    (fault,) = make_faults(["comes down"], 3)
    assert {
        make_faults(["comes down"], k)[0].adapt(mission).configurations[0].baseline_m
        for k in range(20)
    } == {3, 5, 10}
    flight = hover(mission)
    upper, lower = flight.fleet["uav2"], flight.fleet["uav1"]
    T = lower.body.T_world_body
    T[2, 3] += 1.5
    upper.body.place(T)
    fault._due = lambda _flight: True
    fault(flight)
    assert fault.began_s is None  # nobody stands above another
    T[2, 3] += 2.5
    upper.body.place(T)
    fault(flight)
    assert (
        fault.vehicle is upper
        and upper.autopilot.mode == modes.LAND
        and lower.autopilot.mode == modes.GUIDED
    )
    (answer,) = flight.witness.answers
    flight.now_s += 0.2
    upper.told(flight.now_s, "held", None)
    assert answer.after_s is None
    lower.told(flight.now_s, "held", None)
    assert answer.after_s == pytest.approx(0.2)


# ---- pilots --------------------------------------------------------------------------------------


def take_over(flight: Flight, name: str, mode: str, roams: bool = False, drops: bool = False):
    """From now on ``name`` is in its pilot's hands."""
    vehicle, begun_s = flight.fleet[name], flight.now_s
    hands = HandFlight(mode, vehicle.p_world_m, np.random.default_rng(1), roams, drops)
    flight.hand_flown[name] = lambda now_s, _phase, sight: hands.sticks(now_s - begun_s, sight)
    return vehicle


@pytest.mark.parametrize("mode", [Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.BRAKE])
def test_a_pilot_who_has_a_vehicle_hovers_with_it(mission, mode):
    flight = flown_to(mission, "COLUMN")
    vehicle = take_over(flight, "uav1", mode)
    here = vehicle.p_world_m
    fly(flight, 1.0)
    assert vehicle.flown_by_hand and modes.NAMES[vehicle.autopilot.mode] == mode
    fly(flight, 20.0)
    assert np.linalg.norm(vehicle.p_world_m - here) < 1.5


def test_a_pilot_who_pulls_the_stick_down_sinks(mission):
    flight = flown_to(mission, "COLUMN", 4.0)
    vehicle = take_over(flight, "uav1", Mode.LOITER, roams=True, drops=True)
    before_m = vehicle.p_world_m[2]
    fly(flight, 1.5)
    assert before_m - vehicle.p_world_m[2] > 0.8


# ---- the witness ---------------------------------------------------------------------------------


def taken(mission) -> Flight:
    """uav2's pilot has taken it over in CONFIGURATIONS, and everybody knows."""
    flight = hover(mission)
    take_over(flight, "uav2", Mode.ALT_HOLD)
    fly(flight, 2.0)
    assert flight.fleet["uav2"].flown_by_hand and not flight.invariants.violations
    return flight


@pytest.mark.parametrize("what", ["mode", "set-point"])
def test_a_command_to_a_hand_flown_vehicle_is_seen(mission, what):
    flight = taken(mission)
    ask = Ask(Kind.SET_MODE, Mode.GUIDED) if what == "mode" else SetPoint(np.eye(4))
    flight.fleet["uav2"].link.receive(flight.now_s, ask)
    fly(flight, 0.1)
    (v,) = flight.invariants.violations
    assert (
        v.kind == "overruled"
        and v.text.startswith("uav2 was sent ")
        and "in its pilot's ALT_HOLD" in v.text
    )


def test_after_the_operator_confirmed_the_mission_may_command(mission):
    flight = taken(mission)
    flight.witness.confirmed(flight.now_s)
    flight.fleet["uav2"].link.receive(flight.now_s, Ask(Kind.SET_MODE, Mode.GUIDED))
    fly(flight, 0.1)
    assert not flight.invariants.violations


def test_a_command_before_the_companion_heard_of_the_pilot_does_not_count(mission):
    flight = hover(mission)
    vehicle = flight.fleet["uav2"]
    vehicle.sticks(flight.now_s, TransmitterSticks(mode=Mode.ALT_HOLD))
    assert vehicle.flown_by_hand
    vehicle.link.receive(flight.now_s, SetPoint(np.eye(4)))
    fly(flight, 0.02)
    assert not flight.invariants.violations


def test_the_first_command_to_stop_answers_a_fault():
    """While a configuration is recorded: a mission that is flown to its end lands everybody, and
    answers nothing."""
    flight = hover(Mission("rehearsed", [StereoConfiguration("vertical", 4.0, record_s=20.0)]))
    fault = begun(flight, "tracker gone", seed=4)
    fly(flight, 2.0)
    (answer,) = flight.witness.answers
    assert (
        answer.fault == "tracker gone"
        and answer.flown
        and 0.6 < answer.after_s < 1.0
        and answer.moved_m < 0.5
    )
    assert fault.vehicle.autopilot.mode == modes.LAND


# ---- invariants ----------------------------------------------------------------------------------


class Still:
    """A flight of two vehicles that stand where they are put."""

    def __init__(self, *places, mode=modes.GUIDED, configurations=()):
        self.fleet = {
            f"uav{k + 1}": SimpleNamespace(
                p_world_m=np.array(p, float),
                body=SimpleNamespace(velocity_mps=np.zeros(3)),
                flown_by_hand=False,
                autopilot=SimpleNamespace(mode=mode, armed=True),
            )
            for k, p in enumerate(places)
        }
        self.control = SimpleNamespace(captures=[])
        self.mission = Mission(
            "still", list(configurations) or [StereoConfiguration("horizontal", 4.0)]
        )
        self.phase, self.now_s = "CONFIGURATIONS", 0.0
        self.looked = Invariants(self)
        self.look()

    def look(self, seconds: float = 0.05):
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += 0.05
            self.looked.check(self.now_s)
        return [v.kind for v in self.looked.violations]

    def put(self, name: str, *p):
        self.fleet[name].p_world_m = np.array(p, float)
        return self.look()


def test_contacts_and_downwash():
    flight = Still((0, 0, 8), (0, 0, 10))
    assert flight.look() == [] and flight.put("uav2", 0, 0, 9.7) == ["downwash"]
    assert flight.put("uav2", 0.4, 0, 8) == [
        "downwash",
        "contact",
    ] and flight.looked.nearest_m == pytest.approx(0.4)


def test_nobody_beneath_one_that_lands():
    beside = Still((0, 0, 8), (1.6, 0, 10), mode=modes.LAND)
    assert beside.put("uav2", 1.6, 0, 8) == [] and beside.looked.crossing_m == pytest.approx(1.6)
    beneath = Still((0, 0, 8), (1.4, 0, 10), mode=modes.LAND)
    assert beneath.put("uav2", 1.4, 0, 8) == ["beneath"]
    flown = Still((0, 0, 8), (1.4, 0, 10))
    assert flown.put("uav2", 1.4, 0, 8) == []


def test_the_ground_is_met_gently():
    flight = Still((0, 0, 0.5), (5, 0, 8))
    flight.fleet["uav1"].body.velocity_mps[2] = -1.2
    flight.look()
    assert flight.put("uav1", 0, 0, 0.1) == ["touch-down"]


def test_who_leaves_the_fence_reacts_within_a_second():
    flight = Still((0, 0, 8), (5, 0, 8))
    flight.put("uav1", 101, 0, 8)
    assert flight.look(0.8) == [] and flight.look(0.3) == ["fence"]
    landing = Still((0, 0, 8), (5, 0, 8), mode=modes.LAND)
    landing.put("uav1", 101, 0, 8)
    assert landing.look(2.0) == []
    high = Still((0, 0, 8), (5, 0, 8))
    high.put("uav2", 5, 0, 46)
    assert high.look(1.1) == ["fence"]


@pytest.mark.parametrize("axis, place", [("horizontal", (0, -4.0, 8)), ("vertical", (0, 0, 12))])
def test_what_was_recorded_was_held(axis, place):
    for off, broken in (((0.0, 0.0, 0.3), []), ((0.9, 0.0, 0.9), ["not held"])):
        flight = Still(
            (0, 0, 8), np.add(place, off), configurations=[StereoConfiguration(axis, 4.0)]
        )
        flight.look(5.0)
        flight.control.captures.append(CaptureWindow(0, "uav2", 1.0, 4.0, 0.05))
        assert flight.look() == broken
