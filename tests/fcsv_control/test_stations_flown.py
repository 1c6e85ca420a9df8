# SPDX-License-Identifier: Apache-2.0
"""Stations on paper: the column changes over as one body, each station's list is flown there, and
everybody lands at home."""

import dataclasses
import doctest
import math

import numpy as np
import pytest

from fcsv_control.mission import memory as memories
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.plans import plan_check, plan_words
from fcsv_control.mission.plans.task_list import TaskList, tasks
from fcsv_control.mission.ways import formation, gliding
from fcsv_control.mission.ways.formation import formation_legs
from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME, mover_place, reference_place
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.missions.stations import MissionStation

PAIR = ["uav1", "uav2"]
STATIONS = [
    MissionStation([0.0, 90.0], (10.0, 0.0), name="east", calibrate=False),
    MissionStation([0.0], (10.0, 8.0), name="north", height_m=10.0, calibrate=False),
]
CALIBRATING = [dataclasses.replace(s, calibrate=None) for s in STATIONS]


def mission(**more):
    listed = [StereoConfiguration("horizontal", 4.0, record_s=2.0)]
    return Mission(more.pop("name", "site"), listed, **{"stations": STATIONS, **more})


@pytest.fixture
def flying(flight):
    f = flight(mission())
    f.up_to_configurations()
    return f


def off_m(f, name, T_home_cam):
    return float(np.linalg.norm(f.fleet[name].p_home_cam - T_home_cam[:3, 3]))


def changing(f):
    return "changes over" in f.machine.detail


def test_every_list_is_flown_at_its_station_and_all_land_at_home(flying):
    m, recorded, apart_m = flying.machine.mission, {}, []
    while flying.machine.phase == "CONFIGURATIONS":
        flying.wait(0.1)
        if changing(flying):
            a, b = (flying.fleet[n].p_home_cam for n in PAIR)
            apart_m.append(float(np.linalg.norm(a - b)))
        if flying.fleet["uav2"].recording:
            i = flying.machine.configuration
            off = [off_m(flying, "uav1", reference_place(m, i + 1))]
            off.append(off_m(flying, "uav2", mover_place(m, i)))
            recorded[i] = max(recorded.get(i, 0.0), *off)
    assert flying.captured == [0, 1, 2]
    assert set(recorded) == {0, 1, 2} and max(recorded.values()) < m.settle.hold_m
    assert max(apart_m) - min(apart_m) < 1.0, "the figure is kept"
    assert off_m(flying, "uav1", T_HOME_CAM_AT_HOME) < 0.5, "the column lands where it took off"
    flying.phase("DONE", 60.0)


def test_a_pause_on_the_way_begins_again_from_there(flying):
    flying.until(lambda: changing(flying) and flying.fleet["uav1"].p_home_cam[0] > 4.0)
    assert flying.operator.control("pause") == ""
    flying.wait(5.0)
    before = flying.fleet["uav1"].p_home_cam.copy()
    kept = flying.machine.memory().flight_list
    assert kept.at is None and kept.left[0].changes and kept.left[0].view == 1
    flying.wait(20.0)
    assert np.allclose(flying.fleet["uav1"].p_home_cam, before)
    assert flying.operator.control("resume") == ""
    flying.phase("DONE", 400.0)
    assert flying.captured == [0, 1, 2]


def test_a_mission_that_is_restarted_on_the_way_goes_on(flying):
    flying.until(lambda: changing(flying) and len(flying.machine.captures) == 1)
    kept = flying.machine.memory()
    flying.machine = MissionMachine(flying.machine.mission, flying.machine.vehicles)
    flying.machine.restore(kept)
    flying.orders.clear()
    flying.phase("LAND", 400.0)
    assert flying.captured == [0, 1, 2]
    assert off_m(flying, "uav1", T_HOME_CAM_AT_HOME) < 0.5


def test_the_operator_skips_a_station_and_repeats_one(flying):
    flying.until(lambda: flying.machine.configuration == 1 and flying.fleet["uav2"].recording)
    assert flying.operator.control("repeat_station") == ""
    flying.until(lambda: len(flying.machine.captures) == 2, 200.0)
    assert [c.index for c in flying.machine.captures] == [0, 0]
    assert flying.operator.control("skip_station") == ""
    flying.phase("LAND", 400.0)
    assert flying.captured == [0, 0, 2]
    said = flying.machine.detail
    assert "east at 90 deg left out by the operator" in said and "north" not in said


def test_nothing_more_is_flown_but_the_way_home(flying):
    flying.until(lambda: flying.machine.configuration == 1 and flying.fleet["uav2"].recording)
    flying.machine.finish("cancelled")
    flying.until(lambda: flying.machine.phase == "LAND", 120.0)
    assert off_m(flying, "uav1", T_HOME_CAM_AT_HOME) < 0.5
    assert off_m(flying, "uav2", T_HOME_CAM_AT_HOME) > 3.0


def test_who_does_not_follow_is_waited_for_and_then_all_land(flying):
    """One that is held back by a wind lets the others wait, before the figure is out of shape."""
    flying.until(lambda: changing(flying) and flying.fleet["uav1"].p_home_cam[0] > 4.0)
    flying.fleet["uav2"].refuses = {"GOTO": "stuck"}
    most_m = 0.0
    while flying.machine.phase == "CONFIGURATIONS":
        flying.wait(0.1)
        a, b = (flying.fleet[n].p_home_cam for n in PAIR)
        most_m = max(most_m, float(np.linalg.norm(a - b)))
    assert flying.machine.phase == "LAND" and "uav2" in flying.machine.detail
    assert most_m < 3.5 + 1.3


# ---- calibrating in flight -----------------------------------------------------------------------


@pytest.fixture
def calibrating(flight):
    f = flight(mission(stations=CALIBRATING))
    f.up_to_configurations()
    return f


def test_the_column_sways_and_is_calibrated_once_at_each_station(calibrating):
    swayed_m, recorded = {n: [] for n in PAIR}, []
    while calibrating.machine.phase == "CONFIGURATIONS":
        calibrating.wait(0.1)
        if calibrating.machine.stage == "calibrates" and not calibrating.machine.captures:
            for name in PAIR:
                swayed_m[name].append(calibrating.fleet[name].p_home_cam[1])
        recorded.append((len(calibrating.calibrated_s), len(calibrating.machine.captures)))
    assert calibrating.captured == [0, 1, 2]
    assert (0, 1) not in recorded and (1, 3) not in recorded, "calibrated before pictures"
    assert len(calibrating.calibrated_s) == 2, "not again at another heading"
    assert np.ptp(swayed_m["uav1"]) > 1.4 and np.ptp(swayed_m["uav2"]) < 0.3
    assert "not calibrated" not in calibrating.machine.detail


def test_a_tracker_that_drifts_ends_the_flight(calibrating):
    calibrating.calibration = {
        "success": False,
        "message": "uav2 is 0.9 m off uav1: a tracker drifts",
        "drifted": True,
    }
    calibrating.phase("LAND", 200.0)
    assert "a tracker drifts: landing everybody" in calibrating.machine.detail
    calibrating.phase("ABORTED", 60.0)


def test_a_calibration_that_is_refused_is_tried_again_and_then_left_out(calibrating):
    calibrating.calibration = {"success": False, "message": "uav2 does not see uav1's tag"}
    calibrating.phase("LAND", 400.0)
    assert calibrating.captured == [0, 1, 2] and len(calibrating.calibrated_s) == 4
    assert "not calibrated at east: uav2 does not see uav1's tag" in calibrating.machine.detail


def test_a_pause_while_it_calibrates_begins_it_again(calibrating):
    calibrating.until(lambda: calibrating.calibrated_s)
    calibrating.wait(3.0)
    assert calibrating.operator.control("pause") == ""
    calibrating.wait(20.0)
    assert calibrating.machine.memory().flight_list.calibrated == ""
    assert calibrating.operator.control("resume") == ""
    calibrating.phase("LAND", 400.0)
    assert calibrating.captured == [0, 1, 2] and len(calibrating.calibrated_s) == 3


def test_the_operator_skips_a_calibration(calibrating):
    calibrating.until(lambda: calibrating.calibrated_s)
    assert calibrating.operator.control("skip") == ""
    calibrating.phase("LAND", 400.0)
    assert calibrating.captured == [0, 1, 2] and len(calibrating.calibrated_s) == 2
    assert "not calibrated at east: left out by the operator" in calibrating.machine.detail


def test_a_restart_keeps_where_the_column_was_calibrated(calibrating):
    calibrating.until(lambda: calibrating.captured == [0])
    kept = calibrating.machine.memory()
    assert kept.flight_list.calibrated == "east"
    calibrating.machine = MissionMachine(calibrating.machine.mission, calibrating.machine.vehicles)
    calibrating.machine.restore(kept)
    calibrating.phase("LAND", 400.0)
    assert calibrating.captured == [0, 1, 2] and len(calibrating.calibrated_s) == 2


def test_where_a_mission_calibrates():
    near = MissionStation([0.0], (2.0, 1.0), name="near")
    m = mission(stations=[near, *CALIBRATING, dataclasses.replace(near, name="again")])
    calibrates = [m.calibrates(view) for view in range(len(m.viewpoints))]
    assert calibrates == [False, False, True, True, True, True] and m.calibrates_in_flight
    assert not mission(stations=CALIBRATING, tracker="ground").calibrates_in_flight
    assert mission(stations=[dataclasses.replace(near, calibrate=True)]).calibrates(1)
    assert not mission().calibrates_in_flight and not mission(stations=[]).calibrates_in_flight
    with pytest.raises(ValueError, match=r"stations\[0\].calibrate: a tracker on the ground"):
        mission(stations=[dataclasses.replace(near, calibrate=True)], tracker="ground")


def test_the_plan_counts_calibrations_and_where_they_sway():
    def paper(stations, **more):
        m = mission(stations=stations, **more)
        return plan_check.fly_on_paper(m, plan_check.on_the_ground(m, PAIR, {}))

    plain, calibrating = paper(STATIONS), paper(CALIBRATING)
    assert not calibrating.wrong
    assert calibrating.flight_s - plain.flight_s == pytest.approx(2 * 20.0)
    corners = [(-6.0, -0.5), (12.0, -0.5), (12.0, 0.5), (-6.0, 0.5)]
    ahead = [MissionStation([0.0], (10.0, 0.0), name="east")]
    wrong = paper(ahead, fence=Fence(polygon=corners)).wrong
    assert "the column that calibrates at east at 0 deg: (10.0, " in wrong[0]


# ---- another flight goes on ----------------------------------------------------------------------


def again(f, **unfinished):
    """All are down; the mission's node starts anew, with what it finds, and people fly to home."""
    kept = f.machine.memory()
    f.machine = MissionMachine(f.machine.mission, f.machine.vehicles)
    if unfinished:
        f.machine.unfinished = unfinished["unfinished"]
    else:
        f.machine.restore(kept)
    for k, vehicle in enumerate(f.fleet.values()):
        vehicle.T_home_body[:3, 3] = [-3.5 * k, 0.0, 0.0]
        vehicle.target = None
    f.up_to_home()
    f.until(lambda: f.machine.waits_for == "execute")
    f.wait(1.1)


def test_a_flight_after_a_landing_goes_on_at_the_station_where_it_stopped(flying):
    flying.until(lambda: flying.machine.configuration == 1 and flying.fleet["uav2"].recording)
    assert flying.operator.control("resume_station").startswith("'resume_station' takes the place")
    flying.operator.control("abort")
    flying.phase("ABORTED", 60.0)
    again(flying)
    assert flying.machine.detail == "set; resume_station goes on at east"
    assert flying.operator.control("resume_station") == ""
    flying.until(lambda: flying.machine.captures and flying.machine.viewpoint.station == "north")
    assert flying.captured == [0, 1], "east from its beginning: its pictures need one home"
    assert flying.machine.memory().unfinished == [2]
    flying.operator.control("abort")
    flying.phase("ABORTED", 60.0)
    text = memories.to_text(flying.machine.memory())
    m = flying.machine.mission
    assert memories.unfinished_of(text, "memory", m, PAIR) == [2]
    assert memories.unfinished_of(text, "memory", mission(name="other"), PAIR) == []
    assert memories.unfinished_of("{", "memory", m, PAIR) == []
    again(flying, unfinished=[2])
    assert flying.operator.control("resume_station") == ""
    flying.phase("DONE", 300.0)
    assert flying.captured == [2] and flying.machine.memory().unfinished == []


def test_where_nothing_was_left_all_is_flown(flight):
    f = flight(mission())
    f.up_to_home()
    f.until(lambda: f.machine.waits_for == "execute")
    f.wait(1.1)
    said = f.operator.control("resume_station")
    assert said == "no station is left of a flight before; 'execute' flies all"
    assert f.machine.memory().unfinished == []


# ---- the list ------------------------------------------------------------------------------------


def told(list_):
    return [
        f"{'+' * t.joins}{t.vehicle}{' to' if t.changes else ' at'} {t.view}"
        + ("" if t.index is None else f" for {t.index}")
        for t in list_
    ]


def test_the_column_is_whole_before_it_leaves():
    assert told(tasks(mission(), PAIR, [0, 2])) == [
        "uav1 to 1",
        "+uav2 to 1",
        "uav2 at 1 for 0",
        "uav2 at 1",
        "uav1 to 3",
        "+uav2 to 3",
        "uav2 at 3 for 2",
        "uav2 at 3",
        "uav1 to 0",
        "+uav2 to 0",
    ]


def test_skipping_on_the_way_leads_to_the_next_station():
    left = TaskList(mission(), PAIR, tasks(mission(), PAIR))
    left.depart()
    assert left.skip() == "" and told(left.left)[:3] == [
        "uav1 to 2",
        "+uav2 to 2",
        "uav2 at 2 for 1",
    ]
    left.depart()
    left.done()
    assert left.at == 2 and told(left.moment) == ["uav2 at 2 for 1"]
    assert left.before() == "" and told(left.left)[:3] == ["uav2 at 2", "uav1 to 1", "+uav2 to 1"]
    left.go_back()
    assert told(left.left) == ["uav2 at 2", "uav1 to 0", "+uav2 to 0"]


def test_a_station_is_skipped_with_all_its_headings():
    left = TaskList(mission(), PAIR, tasks(mission(), PAIR))
    assert left.skip_station() == "" and left.flown == [0, 1]
    assert told(left.left)[:3] == ["uav1 to 3", "+uav2 to 3", "uav2 at 3 for 2"]
    assert left.skip_station() == "" and told(left.left) == []
    assert left.skip_station() == "no station is left that could be skipped"


def test_a_station_is_flown_again_with_all_its_headings():
    left = TaskList(mission(), PAIR, tasks(mission(), PAIR))
    for _ in range(3):  # to the first heading, its list, back to the column
        left.done()
    left.depart()
    left.done()
    assert left.at == 2 and left.flown == [0]
    assert left.station_again() == "" and left.flown == []
    assert told(left.left)[:3] == ["uav2 at 2", "uav1 to 1", "+uav2 to 1"]
    assert [t.index for t in left.left if t.index is not None] == [0, 1, 2]


def test_on_the_last_way_back_the_last_station_is_flown_again():
    left = TaskList(mission(), PAIR, tasks(mission(), PAIR, [0, 2]))
    while left.running is not None:
        left.done()
    assert left.station_again() == "" and left.flown == [0]
    assert [t.index for t in left.left if t.index is not None] == [2]


def test_without_stations_there_is_none_to_skip_or_repeat():
    plain = Mission("plain", [StereoConfiguration("horizontal", 4.0)])
    left = TaskList(plain, PAIR, tasks(plain, PAIR))
    assert left.skip_station() == left.station_again() == "the mission has no stations"


def test_one_of_three_that_is_down_leaves_a_column_of_two():
    three = [*PAIR, "uav3"]
    left = TaskList(mission(), three, tasks(mission(), three))
    left.depart()
    assert left.leave("uav3") == []
    assert told(left.left)[:3] == ["uav1 to 1", "+uav2 to 1", "uav2 at 1 for 0"]
    left.go_back()
    assert left.leave("uav2") == [] and told(left.left) == ["uav1 to 0"]


def test_a_memory_of_the_way_is_read_again(flying):
    flying.until(lambda: changing(flying))
    m = flying.machine.mission
    kept = dataclasses.replace(flying.machine.memory(), saved_s=100.0)
    assert memories.from_text(memories.to_text(kept), "memory", m, PAIR, 120.0) == kept
    bad = dataclasses.replace(kept, flight_list=dataclasses.replace(kept.flight_list, at=9))
    with pytest.raises(memories.SessionError, match="lacks"):
        memories.from_text(memories.to_text(bad), "memory", m, PAIR, 120.0)


# ---- the plan ------------------------------------------------------------------------------------


def on_the_ground(m, share=1.0):
    return plan_check.on_the_ground(m, PAIR, dict.fromkeys(PAIR, share))


def test_the_plan_tells_when_each_station_is_flown():
    m = mission()
    flight = plan_check.fly_on_paper(m, on_the_ground(m))
    assert flight.wrong == [] and [v.view for v in flight.views] == [1, 2, 3]
    times_s = [t for v in flight.views for t in (v.begins_s, v.ends_s)]
    assert times_s == sorted(times_s)
    # 10 m at 2 m/s with 1.5 m/s^2 and the figure's seconds
    assert math.isclose(flight.views[0].begins_s, 10.0 / 2.0 + 2.0 / 1.5 + 4.0)


def test_batteries_say_after_which_station_to_come_back():
    m = mission(flight=FlightBounds(endurance_s=430.0))
    here = on_the_ground(m, 0.96)
    flight = plan_check.fly_on_paper(m, here)
    reached = plan_check.reached(m, here, flight)
    assert [v.view for v in reached] == [1, 2]
    assert plan_check.check_plan(m, here) == [], "some stations can be flown"
    wrong = plan_check.check_plan(m, here, indices=[0, 1, 2])
    assert len(wrong) == 2 and "the flight needs" in wrong[0]
    assert "the flight needs" in plan_check.check_plan(m, on_the_ground(m, 0.4))[0]


def test_check_says_when_each_station_is_flown():
    assert (
        plan_words.stations_in_words(Mission("a", [StereoConfiguration("vertical", 5.0)]), PAIR)
        == ""
    )
    words = plan_words.stations_in_words(mission(), PAIR)
    assert (
        words.startswith("east at 0 deg 0:10 to 0:22, east at 90 deg 0:33") and "home 1:26" in words
    )
    short = mission(flight=FlightBounds(endurance_s=400.0))
    assert "full batteries reach to east at 90 deg" in plan_words.stations_in_words(short, PAIR)


def test_a_flight_that_batteries_cut_short_says_so(flight):
    f = flight(mission(flight=FlightBounds(endurance_s=400.0)))
    f.up_to_home()
    for vehicle in f.fleet.values():
        vehicle.battery_share = 0.54
    f.press("execute")
    f.phase("DONE", 300.0)
    assert f.captured == [0, 1]
    assert "the batteries reach to east at 90 deg and back, left out: north" in f.machine.detail
    assert f.machine.memory().unfinished == [2], "for another flight to go on with"


@pytest.mark.parametrize(
    "more, words",
    [
        ({"fence": Fence(radius_m=12.0)}, "way of the column to north at 0 deg: 12 m from home"),
        ({"fence": Fence(ceiling_m=9.0)}, "10 m above take-off, the fence ends at 9 m"),
        ({"column_spacing_m": 1.8}, "uav1 and uav2 are 1.8 m apart in the column"),
    ],
)
def test_ways_of_the_column_that_cannot_be_flown(more, words):
    m = mission(**more)
    wrong = plan_check.check_plan(m, on_the_ground(m))
    assert any(words in line for line in wrong)


def test_a_turning_column_leaves_a_fence_that_both_ends_keep():
    """The follower's arc about the reference bulges out, 3.5 m behind it."""
    turning = [MissionStation([0.0, 180.0], (0.0, 0.0))]
    listed = [StereoConfiguration("vertical", 5.0)]
    wide, narrow = (Fence(polygon=[(-5.0, -y), (5.0, -y), (5.0, y), (-5.0, y)]) for y in (4.0, 3.0))
    for fence, wrongs in ((wide, 0), (narrow, 2)):
        m = Mission("turning", listed, stations=turning, fence=fence)
        wrong = plan_check.check_plan(m, on_the_ground(m))
        assert len(wrong) == wrongs and all("way of the column" in line for line in wrong)


def test_the_figure_stays_rigid_and_turns_the_short_way():
    figure = {
        "uav1": T_HOME_CAM_AT_HOME,
        "uav2": transforms.from_xyz_yaw([-3.5, 0.2, 0.0], 0.0) @ T_HOME_CAM_AT_HOME,
    }
    T_from = transforms.from_xyz_yaw([1.0, 2.0, 0.0], math.radians(170.0))
    T_to = transforms.from_xyz_yaw([5.0, -1.0, 2.0], math.radians(-170.0))
    straight, turn = formation_legs(T_from, T_to, figure, FlightBounds())
    assert math.isclose(turn.turn_rad, math.radians(20.0))
    for leg in (straight, turn):
        for share in (0.0, 0.3, 1.0):
            at = leg.places(figure, share)
            apart_m = np.linalg.norm(at["uav1"][:3, 3] - at["uav2"][:3, 3])
            assert math.isclose(apart_m, np.linalg.norm(figure["uav2"][:3, 3]))
    assert (
        np.allclose(turn.frame(1.0), T_to)
        and formation_legs(T_to, T_to, figure, FlightBounds()) == []
    )


@pytest.mark.parametrize("module", [formation, gliding, plan_words])
def test_examples(module):
    assert doctest.testmod(module).failed == 0
