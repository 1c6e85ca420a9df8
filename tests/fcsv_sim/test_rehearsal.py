# SPDX-License-Identifier: Apache-2.0
"""Whole flights without ROS: that they go as real ones do, that faults are felt, and that a seed
gives one flight."""

import json
import math
import os
import signal
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from fcsv_control.mission.ways.places import FollowPlace
from fcsv_geometry import transforms
from fcsv_geometry.missions.flight_limits import PauseLimits
from fcsv_geometry.missions.mission import Mission, SettleBounds, StereoConfiguration, load_mission
from fcsv_geometry.missions.stations import MissionStation
from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal import command, takeover
from fcsv_sim.rehearsal.command import Job, main, on_all_cores, prepare, rehearse
from fcsv_sim.rehearsal.faults import FAULTS, NONE, faults_of
from fcsv_sim.rehearsal.flight import Flight, Result
from fcsv_sim.rehearsal.invariants import Violation
from fcsv_sim.rehearsal.radio import Radio, RadioQuality
from fcsv_sim.rehearsal.tables import table, verdict_line

FLIGHTS, LONGEST_S = 60, 180.0


@pytest.fixture(scope="module")
def mission():
    listed = [("horizontal", 2.0), ("vertical", 5.0)]
    return Mission("rehearsed", [StereoConfiguration(a, b, record_s=2.0) for a, b in listed])


def quick() -> Mission:
    """A flight of a minute, as short as one with all phases can be; its pauses are short, too."""
    listed = [
        StereoConfiguration(a, b, record_s=1.0, least_pictures=3)
        for a, b in (("horizontal", 2.0), ("vertical", 4.0))
    ]
    limits = PauseLimits(15.0, 5.0, 15.0, 20.0, 15.0, 60.0, 60.0)
    return Mission("quick", listed, settle=SettleBounds(time_s=1.0), limits=limits)


@pytest.mark.parametrize("vehicles", [2, 3])
def test_a_flight_without_faults_records_all_and_lands(mission, vehicles):
    result = Flight(mission, vehicles, 2).run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])
    assert result.nearest_m > 1.4 and 60.0 < result.flown_s < 200.0
    assert 0.0 < result.off_m < 0.5


def test_a_sweep_flies_its_line_without_a_stop(root):
    flight = Flight(load_mission(root / "config" / "missions" / "sweep.yaml"), 2, 2)
    speeds_mps, so_far = [], set()

    def look(f):
        so_far.update((w.index, w.start_s, w.stop_s) for w in f.control.machine.so_far)
        if "recording sweep" in f.control.machine.detail:
            speeds_mps.append(float(np.linalg.norm(f.fleet["uav2"].body.velocity_mps)))

    flight.recorder = look
    result = flight.run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])
    assert 1.3 < max(speeds_mps) < 1.9, "as fast as the file says, and not faster"
    assert [w.stop_s - w.start_s < 10.0 for w in flight.control.machine.captures] == [True, True]
    assert 0.0 < result.off_m < 0.5
    whole = {w.index: w for w in flight.control.machine.captures}
    assert {i for i, _, _ in so_far} == {0, 1} and len(so_far) >= 4, "the map grows on the way"
    assert all(
        start == whole[i].start_s and start + 1.9 < stop < whole[i].stop_s
        for i, start, stop in so_far
    )


def between_stations():
    listed = [StereoConfiguration("horizontal", 2.5, record_s=1.0, least_pictures=3)]
    stations = [
        MissionStation([40.0], (6.0, 0.0), name="east"),
        MissionStation([-20.0], (6.0, 6.0), name="north", height_m=9.0),
    ]
    return Flight(Mission("stations", listed, stations=stations), 2, 3)


def test_vehicles_follow_in_steps_and_land_beside_a_robot():
    """As fcsv_guidance/place/steps.py asks: one after the other, as the robot drives on along x."""
    listed = [StereoConfiguration("horizontal", 3.0, follow_s=60.0)]
    flight = Flight(Mission("follow", listed), 2, 4)
    steps = [("uav2", 2.5, -3.0), ("uav1", 2.5, 0.0), ("uav2", 5.0, -3.0)]
    control, asked_s, asked, off_m = flight.control, -np.inf, [], {}

    def asker(f):
        nonlocal asked_s
        if control.machine.stage == "follows" and f.now_s > asked_s + 6.0:
            if asked:
                name, *xy = asked[-1]
                off_m[asked[-1]] = np.hypot(*(control.view(f.now_s, name).T_home_cam[:2, 3] - xy))
            if len(asked) < len(steps):
                name, *xy = steps[len(asked)]
                assert control.follow(f.now_s, name, FollowPlace(*xy)) == ""
                asked.append(steps[len(asked)])
                asked_s = f.now_s
            elif not control.machine.detail.endswith("all hold"):
                raise AssertionError(control.machine.detail)
            else:
                control.operate(f.now_s, "skip")
                asked_s = np.inf

    flight.expect_calm()
    result = flight.run([asker])
    assert (result.phase, result.captures, result.wanted) == ("DONE", 0, 0), result.detail
    assert result.violations == [] and result.nearest_m > 1.4
    assert len(off_m) == 3 and max(off_m.values()) < 0.3, off_m
    places = [v.p_world_m[:2] for v in flight.fleet.values()]
    assert np.linalg.norm(places[0] - places[1]) == pytest.approx(math.hypot(2.5, 3.0), abs=0.5)


def test_a_column_changes_over_between_stations_and_nobody_is_stopped():
    """As one body, with a turn; calibrated at both stations, where it has drifted; everybody lands
    where the flight began."""
    flight, told = between_stations(), []
    flight.expect_calm()
    flight.recorder = lambda f: told.append(f.control.replied.text)
    result = flight.run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])
    assert len({text for text in told if "off uav1 (" in text}) == 2
    assert 0.0 < result.off_m < 0.15, "nearer than what had drifted by then"
    learnt = flight.control.T_home_odom
    for vehicle in flight.fleet.values():
        by_guardian = vehicle.guardian_port.core.air.T_home_odom
        assert np.allclose(by_guardian, learnt[vehicle.name]), "the newest, in flight"
    for vehicle, x in (("uav1", 0.0), ("uav2", -3.5)):
        assert np.linalg.norm(flight.fleet[vehicle].p_world_m[:2] - [x, 0.0]) < 2.0


def test_a_tracker_that_drifts_beyond_what_is_known_of_it_ends_the_flight():
    """By 2 cm/s, as the column flies: no look at pictures tells it, and the tag is still seen within
    half a metre."""
    flight = between_stations()
    tracker, begun_s = flight.fleet["uav2"].tracker, []
    true = tracker.odometry

    def drifting(stamp_s, T):
        T, linear, angular = true(stamp_s, T)
        if flight.phase == "CONFIGURATIONS" and not begun_s:
            begun_s.append(flight.now_s)
        gone_m = 0.02 * min(flight.now_s - begun_s[0], 22.0) if begun_s else 0.0
        return transforms.transform(T[:3, :3], T[:3, 3] + [0.0, 0.0, gone_m]), linear, angular

    tracker.odometry = drifting
    result = flight.run()
    assert (result.phase, result.violations) == ("ABORTED", [])
    assert "off uav1" in result.detail and "a tracker drifts: landing everybody" in result.detail


def test_another_flight_goes_on_at_the_station_where_one_was_landed():
    """All take off again; the mission's node reads its memory."""
    flight = between_stations()

    def lands_at_north(f):
        if f.control.machine.viewpoint.station == "north" and f.control.machine.stage == "holds":
            f.control.abort(f.now_s)

    flight.recorder = lands_at_north
    result = flight.run()
    assert (result.phase, result.captures, result.violations) == ("ABORTED", 1, [])
    flight.recorder, resumed = None, []
    flight.take_off_again()
    confirm = flight.confirm

    def resumes(step):
        if step == "execute":
            resumed.append(flight.control.operate(flight.now_s, "resume_station"))
            flight.witness.confirmed(flight.now_s)
        else:
            confirm(step)

    flight.confirm = resumes
    result = flight.run()
    assert resumed == [""] and (result.phase, result.violations) == ("DONE", [])
    assert [c.index for c in flight.control.machine.captures] == [1]


def test_a_station_is_repeated_and_another_skipped_by_the_operator():
    """What he says comes in flight; nobody is stopped by it, and all land where they began."""
    listed = [StereoConfiguration("horizontal", 2.5, record_s=1.0, least_pictures=3)]
    stations = [
        MissionStation([40.0, 10.0], (6.0, 0.0), name="east"),
        MissionStation([-20.0], (6.0, 6.0), name="north"),
    ]
    flight = Flight(Mission("stations", listed, stations=stations), 2, 3)
    said = ["repeat_station", "skip_station"]

    def operator(flight):
        machine = flight.control.machine
        if said and len(machine.captures) == 3 - len(said):
            assert flight.control.operate(flight.now_s, said.pop(0)) == ""

    flight.recorder = operator
    result = flight.run()
    assert (result.phase, result.violations, said) == ("DONE", [], [])
    assert [c.index for c in flight.control.machine.captures] == [0, 0, 2]
    assert "left out by the operator" in result.detail


@pytest.mark.slow
def test_the_site_that_comes_along_is_flown_whole(root):
    """By three, whose trackers part so far that without calibrations in flight it ends after 8
    recordings (docs/lab/rehearsals.md)."""
    flight = Flight(load_mission(root / "config" / "missions" / "site.yaml"), 3, 2)
    result = flight.run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 12, [])


def test_the_same_seed_gives_the_same_flight(mission):
    one, two = (rehearse(Job(mission, 2, 5, "radio cut+pilot disobeys", 120.0)) for _ in range(2))
    assert one == two and one.faults == ["radio cut", "pilot disobeys"]
    assert rehearse(Job(mission, 2, 6, "radio cut+pilot disobeys", 120.0)) != one


def _job(seed: int) -> Job:
    """Each fault once, then pairs."""
    single = [NONE, *FAULTS]
    return Job(quick(), 2, seed, single[seed] if seed < len(single) else "pairs", LONGEST_S)


#: What a drift does that nothing on board sees: level, over ground without texture
#: (docs/design/guardian.md).
KNOWN = {5: ["not held"], 39: ["not held", "not held"], 55: ["not held"]}


@pytest.mark.timeout(900)  # a minute, where the machine does nothing else
def test_sixty_flights_with_every_fault():
    with ProcessPoolExecutor(os.cpu_count(), initializer=prepare) as pool:
        flown = list(pool.map(_fly, range(FLIGHTS)))
    assert {name for r in flown for name in r.began} == set(FAULTS)
    for result in flown:
        broken = f"{'+'.join(result.faults)}, seed {result.seed}: {result.violations}"
        assert [v.kind for v in result.violations] == KNOWN.get(result.seed, []), broken


def _fly(seed: int):
    return rehearse(_job(seed))


def test_a_process_that_is_killed_is_told(monkeypatch):
    # this process is to stay as it is
    monkeypatch.setattr("fcsv_sim.rehearsal.command.prepare", int)
    with pytest.raises(SimulationError, match="one of 2 processes was killed.*--jobs"):
        on_all_cores(_killed, [1, 2, 3], 2)


def _killed(_job):
    os.kill(os.getpid(), signal.SIGKILL)


def test_who_was_flown_by_hand_is_never_commanded():
    """Each phase, with one mode of the pilot for each: all of them in `rehearse --faults
    takeover-table`."""
    mission, modes = quick(), takeover.MODES
    outcomes = [
        takeover.fly(takeover.Trial(mission, 2, 1, phase, modes[k % len(modes)], 12.0))
        for k, phase in enumerate(takeover.PHASES)
    ]
    assert all(o.reached and not o.commands for o in outcomes), outcomes
    assert sum(o.taken for o in outcomes) >= 9
    lines = takeover.table(outcomes)
    assert len(lines) == 2 + len(takeover.PHASES) and lines[2].startswith(
        "| WAIT_VEHICLES | 0 | – |"
    )


def test_a_radio_delays_loses_and_keeps_order_of_arrival():
    got = []
    radio = Radio(RadioQuality(delay_s=0.1, jitter_s=0.0, loss=0.0), 1)
    for k in range(3):
        radio.send(0.01 * k, got.append, k)
    radio.step(0.105)
    assert got == [0]
    radio.cut = True
    radio.send(0.2, got.append, 9)
    radio.cut = False
    radio.step(9.0)
    assert got == [0, 1, 2]
    lossy = Radio(RadioQuality(loss=0.3), 1)
    for _ in range(1000):
        lossy.send(0.0, got.append, None)
    lossy.step(9.0)
    assert len(got) - 3 == pytest.approx(700, abs=60)


# ---- the command ---------------------------------------------------------------------------------


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) == 2
    assert "no mission" in capsys.readouterr().err
    path = tmp_path / "m.yaml"
    path.write_text("name: m\nconfigurations: [{axis: horizontal, baseline_m: 2.0}]")
    assert main([str(path), "--faults", "abort,radio cut+meteorite"]) == 2
    assert "'meteorite' is not one of tracker gone" in capsys.readouterr().err
    assert main([str(path), "--vehicles", "1"]) == 2
    assert main([str(path), "--trace", str(path / "trace.png")]) == 2  # before it flies
    assert "m.yaml: a file stands there" in capsys.readouterr().err


def test_the_command_flies_tells_and_draws(tmp_path, capsys):
    path, picture = tmp_path / "m.yaml", tmp_path / "trace.png"
    path.write_text("name: m\nconfigurations: [{axis: vertical, baseline_m: 4.0, record_s: 1.0}]")
    told_to = tmp_path / "flown.json"
    asked = [str(path), "--flights", "1", "--faults", "abort", "--jobs", "1", "--json"]
    assert (
        main([*asked, str(path / "flown.json")]) == 2
        and "a file stands there" in capsys.readouterr().err
    )
    assert main([*asked, str(told_to)]) == 0
    (flown,) = json.loads(told_to.read_text())
    assert (flown["faults"], flown["wanted"], flown["violations"]) == ("abort", 1, []) and flown[
        "flown_s"
    ] > 10.0
    told = capsys.readouterr().out
    assert "| abort | 1 | 0 |" in told and "simulated seconds per second of one processor" in told
    asked = [str(path), "--faults", "mission dies", "--seed", "3", "--longest", "70"]
    assert main([*asked, "--flights", "1", "--jobs", "1"]) == 1
    told = capsys.readouterr().out
    assert "--faults 'mission dies' --seed 3: 70.0 s: still" in told
    assert told.splitlines()[-1].startswith(
        "Verdict: do not fly it: 1 of 1 flights with faults were unsafe (no end)"
    )
    assert main([*asked, "--trace", str(picture)]) == 1
    told = capsys.readouterr().out
    assert "FAULT mission dies (uav" in told and "VIOLATION no end" in told
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_the_table_has_a_line_for_each_fault_and_one_for_pairs(mission):
    jobs = [
        Job(mission, 2, 1, faults, 90.0) for faults in ("none", "tracker gone", "abort+clock steps")
    ]
    lines = table([(job.name, rehearse(job)) for job in jobs])
    assert [line.split(" | ")[0] for line in lines[2:]] == [
        "| none",
        "| tracker gone",
        "| pairs of faults",
    ]
    assert all(line.count("|") == lines[0].count("|") for line in lines)


def test_which_fault_befalls_a_flight_depends_on_its_seed_alone():
    drawn = [faults_of("all", seed) for seed in range(400)]
    assert drawn == [faults_of("all", seed) for seed in range(400)]
    singles = Counter(names for names in drawn[::2])
    assert (
        set(singles) == {(), *((name,) for name in FAULTS)}
        and max(singles.values()) - min(singles.values()) <= 1
    )
    assert all(len(set(names)) == 2 for names in drawn[1::2]) and len(set(drawn[1::2])) > 100
    assert faults_of("abort, battery", 0) == ("abort",) and faults_of("abort, battery", 1) == (
        "battery",
    )


def test_a_plan_is_rehearsed_calm_with_the_vehicles_that_it_names(tmp_path, capsys, monkeypatch):
    path = tmp_path / "m.yaml"
    path.write_text(
        "name: m\nair: {horizontal_m: 1.1}\nconfigurations:\n"
        "- {axis: horizontal, baseline_m: 3.0, record_s: 1.0, vehicle: uav3}\n"
    )
    flown = []
    monkeypatch.setattr(command, "rehearse", lambda job: flown.append(job) or rehearse(job))
    assert main([str(path), "--flights", "2", "--jobs", "1"]) == 0
    assert [(job.vehicles, job.name) for job in flown] == [(3, "none")] * 2
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(
        "Verdict: nothing unsafe in 2 calm flights; 2 recorded every configuration"
    )


def _went(seed: int, captures: int, faults=(), violations=()) -> Result:
    """A flight of a mission of four captures."""
    return Result(seed, "DONE", "flown", 60.0, captures, 2.0, list(violations), faults, wanted=4)


@pytest.mark.parametrize(
    "flown, words",
    [
        (
            [("none", _went(1, 4)), ("none", _went(2, 3))],
            "safe, but not whole: 1 of 2 calm flights left configurations out, the first with 3 of 4",
        ),
        (
            [("abort", _went(7, 0, ["abort"])), ("none", _went(8, 4))],
            "nothing unsafe in 2 flights with faults; 1 recorded every configuration",
        ),
        (
            [
                ("none", _went(1, 4)),
                ("abort", _went(9, 4, ["abort"], [Violation("contact", 3.0, "uav1, uav2")])),
            ],
            "do not fly it: 1 of 2 flights with faults were unsafe (contact); "
            "see one: --faults 'abort' --seed 9 --trace",
        ),
    ],
)
def test_the_table_ends_with_a_verdict(flown, words):
    assert verdict_line(flown).startswith(f"Verdict: {words}")


def test_a_rehearsal_says_what_comes_and_that_it_works(tmp_path, capsys, monkeypatch):
    """Where no terminal shows a bar: a line at once, and one from time to time."""
    from fcsv_geometry.programs import live_line

    monkeypatch.setattr(live_line, "LOGGED_S", 0.0)
    path = tmp_path / "mine.yaml"
    path.write_text(
        "name: mine\nconfigurations: [{axis: horizontal, baseline_m: 2.0, record_s: 1.0}]"
    )
    assert main([str(path), "--flights", "1"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("rehearsing mission 'mine': 1 flight of 2 vehicles, calm")
    assert said[-1] == "1 of 1 configurations recorded"
