# SPDX-License-Identifier: Apache-2.0
"""Several vehicles that move at once: ways in time, checked against each other; who is not on time
stops all."""

import dataclasses
import json
from itertools import combinations

import numpy as np
import pytest

from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import FILE, Memory
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.plans import plan_check
from fcsv_control.mission.plans.task_list import TaskList, tasks
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_control.mission.watches.dropouts import Dropouts
from fcsv_control.mission.ways import traffic
from fcsv_control.mission.ways.convoy import Convoy
from fcsv_control.mission.ways.routes import Keep
from fcsv_control.mission.ways.timed_way import EARLY_S, LATE_S, STEP_S, timed_way
from fcsv_geometry import config, transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.vehicles.modes import Mode

NAMES = ("uav1", "uav2", "uav3")
KEEP = Keep(1.5, SeparationRules(0.95))
BOUNDS = FlightBounds()


def both(horizontal_m, vertical_m, record_s=2.0):
    return [
        StereoConfiguration("horizontal", horizontal_m, record_s=record_s, vehicle="uav2"),
        StereoConfiguration(
            "vertical", vertical_m, record_s=record_s, vehicle="uav3", at_once=True
        ),
    ]


def mission():
    return Mission("together", [*both(2.0, 4.0), *both(4.0, 8.0)])


def places(**by_name):
    return {n: np.array(p, float) for n, p in by_name.items()}


# ---- in time -------------------------------------------------------------------------------------


@pytest.mark.parametrize("goal", [(0, 9, 0), (0, 0, 6), (0, 0, -6), (3, -2, 5), (0.3, 0, 0)])
def test_a_timed_way_keeps_the_limits_and_ends_where_it_shall(goal):
    way = timed_way(
        np.zeros(3), [np.array([2.0, 2.0, 0.0]), np.array(goal, float)], BOUNDS, delay_s=1.0
    )
    v = np.diff(way.places, axis=0) / STEP_S
    a = np.diff(v, axis=0) / STEP_S
    level_mps = np.hypot(v[:, 0], v[:, 1])
    assert level_mps.max() <= BOUNDS.speed_mps + 1e-6
    assert v[:, 2].max() <= BOUNDS.climb_mps + 1e-6 and v[:, 2].min() >= -BOUNDS.sink_mps - 1e-6
    # a corner between two samples
    assert np.hypot(a[:, 0], a[:, 1]).max() <= 1.1 * BOUNDS.acceleration_mps2
    assert np.allclose(way.places[:11], 0.0) and np.allclose(way.places[-1], goal)
    assert way.begins_s[0] == 1.0 and way.ends_s == pytest.approx((len(way.places) - 1) * STEP_S)
    assert np.allclose(way.at(np.array([way.begins_s[1]])), [2.0, 2.0, 0.0])


def test_who_crosses_well_behind_another_is_clear_and_who_meets_it_is_not():
    across = timed_way(np.array([0.0, -8.0, 0.0]), [np.array([0.0, 8.0, 0.0])], BOUNDS)
    ahead = [np.array([8.0, 0.0, 0.0])]
    delays_s = np.arange(0.0, 20.0, 1.0)
    found = [
        traffic.clear(across, timed_way(np.array([-8.0, 0.0, 0.0]), ahead, BOUNDS, d), KEEP)
        for d in delays_s
    ]
    assert not any(found[: int(EARLY_S + LATE_S) + 1]) and found[-1]
    assert found == sorted(found)


def test_plans_keep_apart_whatever_each_vehicles_delay_within_its_band():
    random = np.random.default_rng(5)
    flown = waited = 0
    for _ in range(25):
        starts = dict(zip("abc", random.uniform(-6, 6, (3, 3)) * [1, 1, 0.6]))
        goals = dict(zip("abc", random.uniform(-6, 6, (3, 3)) * [1, 1, 0.6]))
        apart = [
            KEEP.share(p[m] - p[n]) for p in (starts, goals) for m, n in combinations("abc", 2)
        ]
        if min(apart) < 1.0:
            continue
        plan = traffic.plan(starts, goals, [], KEEP, BOUNDS).at_once()
        if plan.departures is None:
            continue
        flown += 1
        waited += any(d.timed.begins_s[0] > 0 for d in plan.departures.values())
        times_s = np.arange(0.0, plan.ends_s + 5.0, STEP_S)
        for _ in range(20):
            late = {n: random.uniform(-EARLY_S, LATE_S) for n in "abc"}
            at = {n: plan.departures[n].timed.at(times_s - late[n]) for n in "abc"}
            for m, n in combinations("abc", 2):
                # two samples of 0.1 s at 2 m/s each
                assert KEEP.shares_of(at[m] - at[n]).min() > 1.0 - 0.4 / KEEP.separation_m
    assert flown >= 8 and waited


def crowd():
    """Four who go through the same middle, past two that stand."""
    starts = places(a=(-9, 0, 0), b=(9, 1, 0), c=(0, -9, 0), d=(1, 9, 0))
    goals = places(a=(9, -2, 0), b=(-9, -2, 0), c=(0, 7, 0), d=(3, -9, 0))
    return starts, goals, [np.array([0.0, 0.0, 0.0]), np.array([4.0, 4.0, 0.0])]


def test_a_plan_in_slices_is_the_one_that_is_made_at_once():
    starts, goals, standing = crowd()
    whole = traffic.plan(starts, goals, standing, KEEP, BOUNDS).at_once()
    planning, made, slices = traffic.plan(starts, goals, standing, KEEP, BOUNDS), None, 0
    while made is None:
        made, slices = planning.step(1), slices + 1
    assert slices > 20 and (made.order, made.ends_s) == (whole.order, whole.ends_s)
    assert {n: d.timed.begins_s for n, d in made.departures.items()} == {
        n: d.timed.begins_s for n, d in whole.departures.items()
    }


def test_a_convoy_of_four_plans_over_several_steps_and_nobody_moves_before():
    starts, goals, standing = crowd()
    outbox, T = Outbox(), transforms.from_xyz_yaw
    convoy = Convoy(outbox, mission(), {n: T(p, 0.0) for n, p in goals.items()})
    others = {f"s{k}": p for k, p in enumerate(standing)}
    views = {
        n: VehicleView(T_home_cam=T(p, 0.0), mode=Mode.GUIDED)
        for n, p in {**starts, **others}.items()
    }
    steps, eye = 0, {n: np.eye(4) for n in views}
    while not outbox.due(0.1 * steps):
        steps += 1
        assert not convoy.step(Snapshot(0.1 * steps, views, eye, eye), list(others))
        assert steps < 400
    assert steps > 4


def test_two_that_change_places_are_refused():
    starts, goals = places(a=(0, 0, 0), b=(6, 0, 0)), places(a=(6, 0, 0), b=(0, 0, 0))
    with pytest.raises(MissionError, match="0.0 m from another vehicle, at least 1.5 m are needed"):
        traffic.plan(starts, goals, [], KEEP, BOUNDS).at_once()


def test_goals_too_near_to_each_other_are_refused():
    with pytest.raises(
        MissionError, match="b and c would be 1.0 m apart, at least 1.5 m are needed"
    ):
        goals = places(a=(0, 9, 0), b=(0, 0, 0), c=(1, 0, 0))
        traffic.plan(
            places(a=(9, 0, 0), b=(0, 5, 0), c=(5, 0, 0)), goals, [], KEEP, BOUNDS
        ).at_once()


# ---- the mission file and the plan ---------------------------------------------------------------


@pytest.mark.parametrize(
    "listed, why",
    [
        (
            lambda: [dataclasses.replace(both(2, 4)[0], at_once=True)],
            "at_once: there is none before it",
        ),
        (
            lambda: [both(2, 4)[0], dataclasses.replace(both(2, 4)[1], vehicle="uav2")],
            "need a vehicle of their own",
        ),
        (
            lambda: [both(2, 4)[0], dataclasses.replace(both(2, 4)[1], vehicle=None)],
            "need a vehicle of their own",
        ),
        (
            lambda: [both(2, 4)[0], both(2, 4, 9.0)[1]],
            r"configurations\[1\].record_s: must be that of",
        ),
    ],
)
def test_what_cannot_be_at_once_is_refused(listed, why):
    with pytest.raises(ValueError, match=why):
        Mission("m", listed())


def test_the_plan_names_those_that_cannot_be_at_once():
    m = Mission("m", [*both(2.0, 4.0), *both(2.0, 1.6)])
    found = plan_check.check_plan(m, plan_check.on_the_ground(m, NAMES, {}))
    assert (
        len(found) == 1 and "configurations[2]" in found[0] and "configurations[3]" in found[0]
    ), found


def test_a_plan_at_once_takes_less_time_than_one_after_the_other():
    def needs_s(m):
        tight = dataclasses.replace(m, flight=dataclasses.replace(m.flight, endurance_s=1.0))
        found = plan_check.check_plan(tight, plan_check.on_the_ground(m, NAMES, {}))
        return float(found[0].split("the flight needs ")[1].split(" s")[0])

    m = mission()
    apart = dataclasses.replace(
        m, configurations=[dataclasses.replace(c, at_once=False) for c in m.configurations]
    )
    assert needs_s(m) < needs_s(apart) - 10.0


def test_tasks_at_once_stay_together_whatever_the_operator_changes():
    random, m = np.random.default_rng(3), Mission("m", [*both(2, 4), *both(4, 8), both(5, 3)[0]])
    for _ in range(200):
        found, out = TaskList(m, NAMES, tasks(m, NAMES)), set()
        for _ in range(40):
            if not found.left:
                break
            moment = found.moment
            assert (
                len({t.vehicle for t in moment}) == len(moment)
                and len({t.index is None for t in moment}) == 1
            )
            if moment[0].index is not None:
                assert out <= {t.vehicle for t in moment}, "another one is still out"
                assert [t.index for t in moment] in ([0, 1], [2, 3], [4])
            change = [found.skip, found.put_off, found.before, found.again][random.integers(4)]
            if random.random() < 0.4:
                out |= {t.vehicle for t in moment}  # they have begun to move
                change()
                continue
            out = (out | {t.vehicle for t in moment}) - {
                t.vehicle for t in moment if t.index is None
            }
            found.done()


# ---- flown on paper ------------------------------------------------------------------------------


def moving(f):
    """Vehicles that move in the next step."""
    before = {n: v.p_home_cam for n, v in f.fleet.items()}
    f.step()
    return {n for n, v in f.fleet.items() if np.linalg.norm(v.p_home_cam - before[n]) > 0.05}


def test_both_move_together_and_are_recorded_in_the_same_seconds(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    together = 0
    while f.machine.phase == "CONFIGURATIONS":
        together += moving(f) == {"uav2", "uav3"}
        assert f.now_s < 1400.0
    f.phase("DONE", 100.0)
    windows = f.machine.captures
    assert [(w.index, w.vehicle) for w in windows] == [
        (0, "uav2"),
        (1, "uav3"),
        (2, "uav2"),
        (3, "uav3"),
    ]
    for a, b in (windows[:2], windows[2:]):
        assert (a.start_s, a.stop_s) == (b.start_s, b.stop_s)
        assert all(any(a.start_s <= t <= a.stop_s for t in f.pictures[n]) for n in NAMES)
    assert together > 40 and f.closest_m > 1.45


@pytest.mark.parametrize("slow", ["uav2", "uav3"])
def test_who_is_not_on_time_stops_all_and_they_go_on_one_after_the_other(flight, slow):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    vehicle = f.fleet[slow]
    fly = vehicle.fly
    vehicle.fly = lambda dt_s, speed_mps: fly(dt_s, 0.4)
    f.until(lambda: "one after the other" in f.machine.detail, 60.0)
    assert f"{slow} not on its way in time" in f.machine.detail
    held = {o.vehicle for _, o in f.orders if o.kind == "HOLD"}
    assert held == {"uav2", "uav3"}
    while f.captured != [0, 1]:
        assert moving(f) != {"uav2", "uav3"} and f.now_s < 1400.0
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 2, 3] and f.closest_m > 1.4


def test_finish_brings_all_that_are_away_back_before_they_land(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    f.machine.finish("enough")
    f.phase("ABORTED", 100.0)
    apart = [f.fleet[n].landed_at[0] - f.fleet["uav1"].landed_at[0] for n in NAMES]
    assert apart == pytest.approx([0.0, -3.5, -7.0], abs=0.5) and f.captured == [0, 1]


def test_a_restarted_mission_goes_on_at_once(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    f.wait(1.0)
    saved = json.loads(json.dumps(dataclasses.asdict(f.machine.memory())))
    assert sorted(saved["flight_list"]["away"]) == ["uav2", "uav3"]
    f.machine = MissionMachine(f.machine.mission, NAMES)
    f.machine.restore(config.from_mapping(saved, Memory, FILE))
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 2, 3] and f.closest_m > 1.45


def test_a_pilot_who_takes_one_of_them_stops_both(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.wait(2.0)
    f.fleet["uav3"].mode = Mode.LOITER
    f.wait(1.0)
    assert not moving(f) and f.machine.waits_for == "resume"
    assert {o.vehicle for _, o in f.orders if o.kind == "HOLD"} == {"uav1", "uav2"}
    f.press("resume")
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 2, 3] and f.closest_m > 1.45


def test_a_recording_that_is_disturbed_is_taken_again_for_both(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav3"].recording)
    f.wait(1.0)
    f.fleet["uav3"].push_m = np.array([0.3, 0.0, 0.0])
    f.wait(0.5)
    f.fleet["uav3"].push_m = np.zeros(3)
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 2, 3] and f.machine.captures[0].position_error_m < 0.15


# ---- one that drops out --------------------------------------------------------------------------


def come_down(f, name):
    """Its guardian lands it: a mode that nobody here asked for, then motors off."""
    f.fleet[name].mode = Mode.LAND
    f.until(lambda: not f.fleet[name].armed, 60.0)


@pytest.mark.parametrize("name, left", [("uav3", [2]), ("uav2", [3])])
def test_one_that_drops_out_leaves_a_working_pair(flight, name, left):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    f.wait(1.0)
    come_down(f, name)
    f.wait(1.0)
    assert any(
        f"{name} down, the others can go on: confirm 'resume'" in p for p in f.machine.problems
    )
    f.wait(5.0)
    assert not moving(f) and f.machine.phase == "CONFIGURATIONS"
    ordered = len(f.orders)
    f.press("resume")
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, *left] and "left out, " + name + " is down" in f.machine.detail
    assert name not in {o.vehicle for _, o in f.orders[ordered:]} and f.closest_m > 1.45


def test_who_drops_out_while_both_are_recorded_leaves_the_other_to_be_recorded_again(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav3"].recording)
    come_down(f, "uav3")
    f.press("resume")
    f.phase("DONE", 300.0)
    assert f.captured == [0, 2]


def test_nobody_flies_again_what_needs_one_that_dropped_out(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    come_down(f, "uav3")
    f.press("resume")
    f.phase("CONFIGURATIONS")
    assert f.operator.control("previous") == ""
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 0, 2]


def test_one_that_dropped_out_and_flies_again_stops_the_others_until_it_is_down(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.wait(1.0)
    come_down(f, "uav3")
    f.press("resume")
    f.phase("CONFIGURATIONS")
    f.wait(1.0)
    f.fleet["uav3"].armed, f.fleet["uav3"].mode = True, Mode.LOITER
    f.wait(1.0)
    assert "uav3: dropped out and flies again: land it" in f.machine.problems and not moving(f)
    f.fleet["uav3"].armed = False
    f.phase("DONE", 300.0)
    assert f.captured == [0, 2]


def test_one_that_lost_its_position_and_is_down_ends_the_flight():
    view = VehicleView(state_age_s=0.1, armed=False)
    for lost, out in ((False, {"uav3"}), (True, set())):
        drops = Dropouts("uav1", NAMES)
        others = dict.fromkeys(("uav1", "uav2"), dataclasses.replace(view, armed=True))
        drops.update(
            Snapshot(0.0, {**others, "uav3": dataclasses.replace(view, lost=lost)}),
            ["uav2", "uav3"],
        )
        assert drops.out == out


@pytest.mark.parametrize("down", [("uav1",), ("uav2", "uav3")])
def test_without_the_reference_or_any_mover_all_land(flight, down):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    for name in down:
        f.fleet[name].armed = False
    f.phase("ABORTED", 60.0)
    assert "motors are off: landing everybody" in f.machine.detail


def test_a_mission_restarted_without_the_one_that_dropped_out_goes_on_with_the_pair(flight):
    f = flight(mission(), NAMES)
    f.up_to_configurations()
    f.until(lambda: f.captured == [0, 1])
    come_down(f, "uav3")
    f.press("resume")
    f.phase("CONFIGURATIONS")
    f.wait(0.5)
    saved = json.loads(json.dumps(dataclasses.asdict(f.machine.memory())))
    f.machine = MissionMachine(f.machine.mission, NAMES)
    f.machine.restore(config.from_mapping(saved, Memory, FILE))
    f.press("resume")
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1, 2]
