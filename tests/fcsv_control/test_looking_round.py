# SPDX-License-Identifier: Apache-2.0
"""Vehicles that turn about themselves for their depth cameras: slowly, one at a time, and never
into a recording."""

import dataclasses
import doctest
import json
import math

import numpy as np
import pytest

from fcsv_control.mission.activities import looking_round
from fcsv_control.mission.activities.stages import TURNS
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import FILE, Memory, RememberedList
from fcsv_control.mission.plans import plan_check
from fcsv_geometry import config, rotations, transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions import look_round
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.look_round import LookRound
from fcsv_geometry.missions.mission import Mission, SettleBounds, StereoConfiguration
from fcsv_geometry.missions.sweep import Sweep
from fcsv_geometry.vehicles.modes import Mode

STEP_S, RATE_DPS = 0.2, 30.0  # between two orders; the quickest
H4, V5 = (
    StereoConfiguration(a, b, record_s=2.0) for a, b in (("horizontal", 4.0), ("vertical", 5.0))
)


def mission(*configurations, how=None, **more):
    quick = {"settle": SettleBounds(time_s=0.5, timeout_s=10.0), **more}
    return Mission(
        "round",
        list(configurations or (H4, V5)),
        look_round=how or LookRound(rate_dps=RATE_DPS),
        **quick,
    )


class Watched:
    """A flight of which each step is looked at: headings (rad, not wrapped) and who moves."""

    def __init__(self, flight, wanted, names=("uav1", "uav2")):
        self.f = flight(wanted, names)
        self.f.up_to_configurations()
        self.names, self.turned_rad, self.recorded_rad = names, dict.fromkeys(names, 0.0), []
        self.last = {n: self.heading(n) for n in names}
        self.places = {n: self.f.fleet[n].T_home_body[:3, 3].copy() for n in names}
        self.rounds, self.most_step_rad = [], 0.0  # (who, where) in their order

    def heading(self, name):
        return transforms.yaw(self.f.fleet[name].T_home_body)

    def look(self):
        """One step of the flight."""
        before = self.f.machine.stage
        self.f.step()
        fleet, machine = self.f.fleet, self.f.machine
        turning, moving = [], []
        for name, vehicle in fleet.items():
            heading = self.heading(name)
            step = rotations.wrap(heading - self.last[name])
            moved_m = float(np.linalg.norm(vehicle.T_home_body[:3, 3] - self.places[name]))
            self.last[name], self.places[name] = heading, vehicle.T_home_body[:3, 3].copy()
            self.turned_rad[name] += step
            if "looks round" in machine.detail and machine.phase == "CONFIGURATIONS":
                turning += [name] if abs(step) > 1e-3 else []
                moving += [name] if moved_m > 0.05 else []
                self.most_step_rad = max(self.most_step_rad, abs(step))
            if vehicle.recording:
                self.recorded_rad.append(abs(rotations.wrap(heading)))
        if machine.detail not in self.rounds and "looks round" in machine.detail:
            self.rounds.append(machine.detail)
        if turning:
            assert TURNS in (before, machine.stage)
            assert len(turning) == 1 and not moving, (turning, moving)
            assert not any(v.recording for v in fleet.values()), (
                "pictures on the turn are of no configuration"
            )

    def until(self, done, limit_s=400.0):
        end_s = self.f.now_s + limit_s
        while not done():
            assert self.f.now_s < end_s, (
                self.f.machine.phase,
                self.f.machine.detail,
                self.f.machine.problems,
            )
            self.look()

    def turns(self, name):
        return round(self.turned_rad[name] / (2.0 * math.pi))


@pytest.mark.parametrize("module", [look_round, looking_round])
def test_examples_in_docstrings(module):
    assert doctest.testmod(module).failed == 0


# ---- the ordinary way ----------------------------------------------------------------------------


def test_each_turns_in_the_column_and_the_mover_at_its_places(flight):
    w = Watched(flight, mission())
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1] and w.f.machine.detail.startswith("all configurations flown")
    assert w.rounds == [
        "uav1 looks round in the column",
        "uav2 looks round in the column",
        "uav2 looks round at horizontal 4 m",
        "uav2 looks round at vertical 5 m",
    ]
    assert (w.turns("uav1"), w.turns("uav2")) == (1, 3)
    assert w.most_step_rad < math.radians(RATE_DPS) * STEP_S + 1e-6, (
        "never faster than the file says"
    )
    assert max(w.recorded_rad) < math.radians(3.0), (
        "back at its heading before anything is recorded"
    )
    assert w.f.closest_m > 1.45


@pytest.mark.parametrize(
    "how, turns",
    [
        (LookRound(places=False, rate_dps=RATE_DPS), (1, 1)),
        (LookRound(column=False, rate_dps=RATE_DPS), (0, 2)),
    ],
)
def test_only_in_the_column_or_only_at_places(flight, how, turns):
    w = Watched(flight, mission(how=how))
    w.until(lambda: w.f.machine.phase == "DONE")
    assert (w.turns("uav1"), w.turns("uav2")) == turns and w.f.captured == [0, 1]


def test_a_place_is_looked_round_once(flight):
    again = dataclasses.replace(H4, name="monitoring")
    w = Watched(flight, mission(H4, again, how=LookRound(column=False, rate_dps=RATE_DPS)))
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.turns("uav2") == 1 and w.f.captured == [0, 1]


def test_those_at_once_turn_one_after_the_other(flight):
    both = (
        dataclasses.replace(H4, vehicle="uav2"),
        dataclasses.replace(V5, vehicle="uav3", at_once=True),
    )
    w = Watched(
        flight,
        mission(*both, how=LookRound(column=False, rate_dps=RATE_DPS)),
        ("uav1", "uav2", "uav3"),
    )
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.rounds == [f"uav{k} looks round at horizontal 4 m and vertical 5 m" for k in (2, 3)]
    assert (w.turns("uav2"), w.turns("uav3")) == (1, 1) and w.f.captured == [0, 1]


def test_a_sweep_begins_with_a_turn_and_is_not_interrupted_by_one(flight):
    swept = StereoConfiguration(sweep=Sweep("horizontal", 2.0, 6.0, 1.0))
    w = Watched(flight, mission(swept, how=LookRound(column=False, rate_dps=RATE_DPS)))
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.turns("uav2") == 1 and w.f.captured == [0] and max(w.recorded_rad) < math.radians(3.0)


def test_without_the_field_nobody_turns(flight):
    w = Watched(flight, Mission("straight", [H4]))
    w.until(lambda: w.f.machine.phase == "DONE")
    assert max(abs(v) for v in w.turned_rad.values()) < 0.2


# ---- what interrupts it --------------------------------------------------------------------------


def half_round(flight, **more):
    """uav1 is half round, in the column."""
    w = Watched(flight, mission(**more))
    w.until(lambda: w.turned_rad["uav1"] > 0.5 * 2.0 * math.pi)
    return w


def test_after_a_pause_it_goes_on_from_its_heading_without_a_jump_of_the_order(flight):
    w = half_round(flight)
    assert w.f.operator.control("pause") == ""
    w.look()
    stood_rad = w.turned_rad["uav1"]
    for _ in range(50):
        w.look()
    assert w.turned_rad["uav1"] == stood_rad and w.f.orders[-1][1].kind == "HOLD"
    w.f.press("resume")
    w.last["uav1"] = w.heading("uav1")
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1] and max(w.recorded_rad) < math.radians(3.0)
    assert [r for r in w.rounds if r.startswith("uav1")] == ["uav1 looks round in the column"]


def test_a_pilot_may_take_it_over_at_any_time(flight):
    w = half_round(flight)
    w.f.fleet["uav1"].mode = Mode.LOITER
    w.f.wait(1.0)
    orders = len([o for _, o in w.f.orders if o.vehicle == "uav1"])
    w.f.wait(5.0)
    told = [o.kind for _, o in w.f.orders if o.vehicle == "uav1"][orders:]
    assert told == [] and "uav1" in " ".join(w.f.machine.problems)
    w.f.fleet["uav1"].mode = Mode.GUIDED
    w.f.press("resume")
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1]


def test_an_abort_in_the_turn_lands(flight):
    w = half_round(flight)
    assert w.f.operator.control("abort") == ""
    w.f.phase("ABORTED", 60.0)
    assert all(not v.armed for v in w.f.fleet.values())


def test_a_sweep_that_was_disturbed_is_flown_again_and_nobody_turns_on_its_way_back(flight):
    swept = StereoConfiguration(sweep=Sweep("horizontal", 2.0, 6.0, 1.0))
    w = Watched(flight, mission(swept))
    w.until(lambda: w.f.machine.so_far)  # the mover is far from where it turned
    w.f.clock_set += 1
    w.until(lambda: not w.f.machine.so_far)
    rounds = list(w.rounds)
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0] and w.rounds == rounds
    assert [r for r in rounds if "column" in r] == [
        f"uav{k} looks round in the column" for k in (1, 2)
    ]


def test_skip_in_the_column_leaves_out_the_turn_and_no_configuration(flight):
    w = half_round(flight)
    assert w.f.operator.control("skip") == ""
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1] and max(w.recorded_rad) < math.radians(3.0)
    assert (
        w.rounds[:2] == [f"uav{k} looks round in the column" for k in (1, 2)]
        and w.turns("uav2") == 3
    )


def test_skip_at_a_place_leaves_out_its_configuration(flight):
    w = Watched(flight, mission())
    w.until(lambda: w.f.machine.detail == "uav2 looks round at horizontal 4 m")
    assert w.f.operator.control("skip") == ""
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [1]


@pytest.mark.parametrize(
    "when", ["uav2 looks round in the column", "uav2 looks round at vertical 5 m"]
)
def test_a_restarted_mission_turns_nobody_twice(flight, when):
    w = Watched(flight, mission())
    w.until(lambda: w.f.machine.detail == when and w.f.now_s > 0.0)
    for _ in range(60):
        w.look()
    kept = json.loads(
        json.dumps(dataclasses.asdict(dataclasses.replace(w.f.machine.memory(), saved_s=w.f.now_s)))
    )
    w.f.machine = MissionMachine(w.f.machine.mission, w.f.machine.vehicles)
    w.f.machine.restore(config.from_mapping(kept, Memory, FILE))
    before = len(w.rounds)
    w.rounds.append("restarted")
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1] and max(w.recorded_rad) < math.radians(3.0)
    done = w.rounds[: before - 1]
    assert not set(done) & set(w.rounds[before + 1 :]), "what was done is not done again"
    assert w.turns("uav1") == 1


def test_a_memory_with_half_a_place_is_refused():
    bad = {
        "left": [],
        "flown": [],
        "parked": {},
        "turned": [{"vehicle": "uav2", "p_home_m": [1.0]}],
    }
    with pytest.raises(ConfigError, match="a place has 3 numbers"):
        config.from_mapping(bad, RememberedList, FILE)


# ---- who does not turn ---------------------------------------------------------------------------


def stuck(vehicle):
    """It obeys, but keeps its heading."""
    flies = vehicle.fly

    def fly(dt_s, speed_mps):
        before = vehicle.T_home_body.copy()
        speed = flies(dt_s, speed_mps)
        vehicle.T_home_body[:3, :3] = before[:3, :3]
        return speed

    vehicle.fly = fly


def test_who_does_not_turn_is_left_out_and_the_flight_goes_on(flight):
    w = Watched(flight, mission())
    stuck(w.f.fleet["uav2"])
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1] and w.turns("uav1") == 1
    for where in ("in the column", "at horizontal 4 m", "at vertical 5 m"):
        assert f"uav2 does not turn: it did not look round {where}" in w.f.machine.detail


def test_who_refuses_its_orders_is_not_waited_for_for_ever(flight):
    w = half_round(flight)
    w.f.fleet["uav1"].refuses["GOTO"] = "no"
    w.until(lambda: w.f.machine._flight_list.notes)
    assert w.f.machine._flight_list.notes == [
        "uav1 does not turn: it did not look round in the column"
    ]


def test_who_is_blown_off_waits_in_its_turn(flight):
    w = half_round(flight)
    w.f.fleet["uav1"].push_m = np.array([0.0, 1.0, 0.0])
    w.f.wait(1.5)  # it brakes
    stood_rad = w.last["uav1"] = w.heading("uav1")
    w.f.wait(2.0)
    assert w.heading("uav1") == pytest.approx(stood_rad)
    w.f.fleet["uav1"].push_m = np.zeros(3)
    w.until(lambda: w.f.machine.phase == "DONE")
    assert w.f.captured == [0, 1]


# ---- before take-off -----------------------------------------------------------------------------


def test_the_plan_has_time_and_battery_for_the_turns():
    straight, round_ = Mission("a", [H4, V5]), mission(how=LookRound(rate_dps=20.0))
    assert looking_round.turns_s(round_, [0, 1], 2) == pytest.approx(4 * 19.0)
    assert (
        looking_round.turns_s(round_, [1], 0) == pytest.approx(19.0)
        and looking_round.turns_s(straight, [0], 2) == 0
    )
    at_ease = [
        dataclasses.replace(m, flight=FlightBounds(endurance_s=420.0)) for m in (straight, round_)
    ]
    wrong = [
        plan_check.check_plan(m, plan_check.on_the_ground(m, ["uav1", "uav2"], {})) for m in at_ease
    ]
    assert not wrong[0] and "the flight needs" in wrong[1][0]


@pytest.mark.parametrize(
    "said, words",
    [
        ({"rate_dps": 45.0}, "look_round.rate_dps: 45.0 is not in 3..30 degrees a second"),
        ({"rate_dps": 0.0}, "look_round.rate_dps: 0.0 is not in 3..30"),
        ({"column": False, "places": False}, "look_round.column: and places are both false"),
        ({"rate": 20.0}, "unknown key 'look_round.rate'; known here: column, places, rate_dps"),
        (True, "look_round must be a mapping of column, places, rate_dps, got bool True"),
    ],
)
def test_what_a_file_may_not_say(said, words):
    document = {
        "name": "a",
        "configurations": [{"axis": "horizontal", "baseline_m": 4.0}],
        "look_round": said,
    }
    with pytest.raises(ConfigError) as error:
        config.from_mapping(document, Mission, "file")
    assert words in str(error.value)
