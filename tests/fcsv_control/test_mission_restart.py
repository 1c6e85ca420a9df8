# SPDX-License-Identifier: Apache-2.0
"""A mission node that dies and comes back: what it takes over, what it does not repeat, which files
it refuses."""

import dataclasses
import json

import numpy as np
import pytest

from fcsv_control.errors import SessionError
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.ros.mission import memory_file
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode

LIST = (("horizontal", 4.0), ("horizontal", 8.0), ("vertical", 5.0))


def mission(name="test"):
    return Mission(name, [StereoConfiguration(a, b, record_s=2.0) for a, b in LIST])


def restarted(f, path):
    """The machine as it was is gone; a new one reads the file. Its command numbers begin anew,
    under a new name."""
    memory_file.write(path, dataclasses.replace(f.machine.memory(), saved_s=f.now_s))
    machine = MissionMachine(f.machine.mission, f.machine.vehicles)
    machine.restore(memory_file.read(path, machine.mission, machine.vehicles, f.now_s + 5.0))
    f.machine = machine
    f.orders.clear()
    return machine


@pytest.fixture
def path(tmp_path):
    return tmp_path / "mission_memory.json"


@pytest.fixture
def flying(flight):
    f = flight(mission())
    f.up_to_configurations()
    return f


@pytest.mark.parametrize("when", ["travelling", "recording", "between"])
def test_a_restarted_mission_holds_and_goes_on_where_it_was(flying, path, when):
    flying.until(lambda: len(flying.machine.captures) == 1)
    if when == "recording":
        flying.until(lambda: flying.fleet["uav2"].recording and len(flying.machine.captures) == 1)
    elif when == "travelling":
        flying.wait(1.5)
    recorded = list(flying.machine.captures)
    machine = restarted(flying, path)
    begun_s = flying.now_s
    flying.until(lambda: flying.orders, 5.0)
    assert {(o.vehicle, o.kind) for _, o in flying.orders} == {("uav1", "HOLD"), ("uav2", "HOLD")}
    assert flying.now_s - begun_s < 5.0 and machine.phase == "CONFIGURATIONS"
    flying.phase("DONE", 400.0)
    assert (
        flying.captured == [0, 1, 2]
        and machine.captures[0] == recorded[0]
        and flying.closest_m > 1.45
    )


def test_nobody_moves_before_all_hold(flying, path):
    flying.wait(1.0)
    restarted(flying, path)
    flying.lossy = 1.0
    flying.wait(20.0)
    assert flying.orders and not [o for _, o in flying.orders if o.kind != "HOLD"]
    flying.lossy = 0.0
    flying.phase("DONE", 400.0)
    assert flying.captured == [0, 1, 2]


def test_who_is_heard_late_is_held_then(flying, path):
    flying.wait(1.0)
    flying.fleet["uav2"].heard = flying.fleet["uav2"].heard_once = False
    restarted(flying, path)
    flying.wait(3.0)
    assert {o.vehicle for _, o in flying.orders} == {"uav1"}
    flying.fleet["uav2"].heard = True
    flying.until(lambda: any(o.vehicle == "uav2" for _, o in flying.orders), 5.0)
    assert next(o.kind for _, o in flying.orders if o.vehicle == "uav2") == "HOLD"
    flying.phase("DONE", 400.0)


def test_who_was_taken_by_a_pilot_meanwhile_is_left_to_him(flying, path):
    flying.wait(1.0)
    memory_taken_before = flying.machine.memory().taken
    machine = restarted(flying, path)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(10.0)
    assert not memory_taken_before and {o.vehicle for _, o in flying.orders} == {"uav1"}
    assert machine.waits_for == "resume" and any(
        "uav2: LOITER was not asked for" in p for p in machine.problems
    )
    flying.press("resume")
    flying.phase("DONE", 400.0)
    assert flying.captured == [0, 1, 2]


@pytest.mark.parametrize("landing", [False, True], ids=["configurations", "landing"])
def test_who_was_stopped_meanwhile_waits_for_the_operator(flying, path, landing):
    """/stop_all while the mission is dead: a LAND of its successor would fight with the BRAKE that
    is sent again."""
    flying.wait(1.0)
    if landing:
        flying.machine.abort("enough")
        flying.wait(0.2)
    machine = restarted(flying, path)
    for vehicle in flying.fleet.values():
        vehicle.mode = Mode.BRAKE
    flying.wait(10.0)
    assert flying.orders == [] and machine.waits_for == "resume"
    assert any("found in BRAKE" in p and "confirm 'resume'" in p for p in machine.problems)
    flying.press("resume")
    flying.phase("ABORTED" if landing else "DONE", 400.0)


def test_who_was_given_back_and_not_confirmed_before_the_restart_still_waits(flying, path):
    flying.wait(1.0)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(0.5)
    flying.fleet["uav2"].mode = Mode.GUIDED
    flying.wait(0.5)
    machine = restarted(flying, path)
    flying.wait(10.0)
    assert machine.waits_for == "resume" and not [
        o for _, o in flying.orders if o.vehicle == "uav2"
    ]


def test_a_restart_while_handing_over_asks_nobody_for_guided_before_it_is_confirmed(flight, path):
    f = flight(mission())
    f.fleet["uav1"].refuses = {"SET_MODE": "requires position"}
    f.up_to_home()
    f.press("execute")
    f.until(lambda: f.fleet["uav2"].mode == Mode.GUIDED)
    f.fleet["uav1"].refuses = {}
    restarted(f, path)
    f.wait(10.0)
    assert {(o.vehicle, o.kind) for _, o in f.orders} == {
        ("uav2", "HOLD")
    } and f.machine.phase == "GUIDED"
    f.press("resume")
    f.phase("DONE", 400.0)


def test_a_restart_while_landing_lands_and_stays_aborted(flying, path):
    flying.wait(1.0)
    flying.fleet["uav2"].heard = False
    flying.machine.abort("stop")
    flying.wait(0.5)
    restarted(flying, path)
    flying.fleet["uav2"].heard = True
    flying.phase("ABORTED", 60.0)
    assert not flying.fleet["uav2"].armed and "stop" in flying.machine.detail


def test_a_restart_when_nobody_flies_begins_anew_and_says_so(flying, path):
    flying.wait(1.0)
    for v in flying.fleet.values():
        v.armed = False
    machine = restarted(flying, path)
    flying.phase("TAKE_OFF", 5.0)
    assert (
        any("nobody flies: a new mission begins" in text for text in machine.said)
        and not flying.captured
    )


def test_a_restart_when_all_are_flown_by_hand_begins_anew(flying, path):
    flying.wait(1.0)
    for v in flying.fleet.values():
        v.mode = Mode.LOITER
    machine = restarted(flying, path)
    flying.phase("COLUMN", 5.0)
    assert any("calibrate again" in text for text in machine.said) and not flying.orders


def test_guided_vehicles_of_an_unknown_mission_are_named_and_can_be_landed(flying):
    flying.wait(1.0)
    flying.machine = MissionMachine(mission(), ("uav1", "uav2"))
    flying.wait(2.0)
    assert flying.machine.phase == "WAIT_VEHICLES"
    assert any("uav1 flies in GUIDED and nothing is known" in p for p in flying.machine.problems)
    flying.machine.abort("stop")
    flying.phase("ABORTED", 60.0)


def test_a_memory_is_not_written_over_before_it_was_judged(flying, path):
    flying.wait(1.0)
    for v in flying.fleet.values():
        v.heard = v.heard_once = False
    machine = restarted(flying, path)
    flying.wait(5.0)
    assert machine.memory() is None and machine.phase == "WAIT_VEHICLES"


def test_an_abort_before_the_memory_was_judged_lands_and_is_remembered(flying, path):
    flying.wait(1.0)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.fleet["uav1"].heard = flying.fleet["uav1"].heard_once = False
    machine = restarted(flying, path)
    flying.wait(2.0)
    assert machine.phase == "WAIT_VEHICLES" and "once uav1 is heard" in machine.detail
    machine.abort("stop")
    flying.fleet["uav1"].heard = True
    flying.until(lambda: not flying.fleet["uav1"].armed, 60.0)
    assert machine.memory().phase == "LAND" and flying.fleet["uav2"].mode == Mode.LOITER


# ---- the file ------------------------------------------------------------------------------------


def test_what_is_read_is_what_was_written(flying, path):
    flying.until(lambda: len(flying.machine.captures) == 2)
    written = dataclasses.replace(
        flying.machine.memory(), saved_s=1000.0, calibration={"links": [1]}, home={"a": 0.5}
    )
    memory_file.write(path, written)
    assert memory_file.read(path, mission(), ["uav1", "uav2"], 1001.0) == written
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_no_file_is_no_memory(path):
    assert memory_file.read(path, mission(), ["uav1", "uav2"], 0.0) is None


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda d: "{", "is damaged"),
        (lambda d: "[]", "must be a mapping"),
        (lambda d: json.dumps({**d, "version": 9}), "version: 9 is not known"),
        (lambda d: json.dumps({**d, "phases": 1}), "unknown key 'phases'"),
        (lambda d: json.dumps({**d, "digest": "0"}), "is of mission 'test' as it was then"),
        (lambda d: json.dumps({**d, "vehicles": ["uav1", "uav3"]}), "is of the fleet uav1, uav3"),
        (lambda d: json.dumps({**d, "saved_s": -700.0}), "12 min old"),
        (
            lambda d: json.dumps({**d, "flight_list": {**d["flight_list"], "flown": [7]}}),
            "that this mission lacks",
        ),
        (
            lambda d: json.dumps({**d, "flight_list": {**d["flight_list"], "parked": {}}}),
            "that this mission lacks",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_refused_and_set_aside(flying, path, change, words):
    memory_file.write(path, flying.machine.memory())
    path.write_text(change(json.loads(path.read_text())))
    with pytest.raises(SessionError) as error:
        memory_file.read(path, mission(), ["uav1", "uav2"], 1.0)
    assert words in str(error.value) and str(path) in str(error.value)
    aside = [memory_file.set_aside(path)]
    path.write_text("again")
    aside.append(memory_file.set_aside(path))
    assert len(set(aside)) == 2 and all(p.exists() for p in aside) and not path.exists()


def test_a_disk_that_refuses_is_an_error_with_words(flying, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match="cannot be written"):
        memory_file.write(tmp_path / "file" / "memory.json", flying.machine.memory())


def test_places_in_the_column_come_back_to_the_last_bit(flying, path):
    parked = flying.machine.memory().flight_list.parked
    machine = restarted(flying, path)
    flying.wait(0.3)
    for name, T in machine.memory().flight_list.parked.items():
        np.testing.assert_array_equal(T, parked[name])
