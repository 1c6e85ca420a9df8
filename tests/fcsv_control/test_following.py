# SPDX-License-Identifier: Apache-2.0
"""Vehicles that follow a robot in steps: who is asked goes, one at a time, and all land where they
hold."""

import dataclasses
import json
import math

import numpy as np
import pytest
from support.simulated_column import vehicle

from fcsv_control.control_messages import FollowAsked
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.memory import FILE, Memory
from fcsv_control.mission.plans import plan_check, plan_words
from fcsv_control.mission.plans.task_list import TaskList, tasks
from fcsv_control.mission.port import MissionPort
from fcsv_control.mission.ways.places import FollowPlace
from fcsv_geometry import config, transforms
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.missions.stations import MissionStation
from fcsv_geometry.vehicles.modes import Mode

FOLLOW_S = 60.0
PLACES = {"uav1": (0.0, 0.0, 0.0), "uav2": (0.0, -3.0, 0.0)}  # of configuration 1, in home


def mission(recorded=1, returns=False, **fields):
    listed = [StereoConfiguration("horizontal", 4.0, record_s=2.0)] * recorded
    follow = StereoConfiguration("horizontal", 3.0, follow_s=FOLLOW_S, returns=returns)
    return Mission("follow", [*listed, follow], fence=Fence(radius_m=12.0), **fields)


@pytest.fixture
def following(flight):
    """Both hold at the places of the configuration in which they follow."""
    f = flight(mission())
    f.up_to_configurations()
    f.until(lambda: f.machine.stage == "follows")
    return f


def off_m(f, name, x_m, y_m, z_m=0.0):
    return float(np.linalg.norm(f.fleet[name].p_home_cam - (x_m, y_m, z_m)))


def moving(f):
    """Vehicles that move in the next step."""
    before = {n: v.p_home_cam for n, v in f.fleet.items()}
    f.step()
    return {n for n, v in f.fleet.items() if np.linalg.norm(v.p_home_cam - before[n]) > 0.02}


def ask(f, name, *place):
    assert f.machine.follow(name, FollowPlace(*place)) == ""


def test_all_hold_at_their_places_and_record_nothing(following):
    f = following
    taken = {n: len(p) for n, p in f.pictures.items()}
    f.wait(5.0)
    assert not moving(f) and f.captured == [0] and f.machine.configuration == 1
    assert {n: len(p) for n, p in f.pictures.items()} == taken
    assert all(off_m(f, n, *at) < 0.01 for n, at in PLACES.items())


def test_who_is_asked_goes_at_its_height_and_heading(following):
    f, before = following, following.fleet["uav2"].T_home_body.copy()
    ask(f, "uav2", 2.0, -4.0)
    f.wait(4.0)
    assert off_m(f, "uav2", 2.0, -4.0) < 0.01 and off_m(f, "uav1", *PLACES["uav1"]) < 0.01
    np.testing.assert_allclose(f.fleet["uav2"].T_home_body[:3, :3], before[:3, :3], atol=1e-6)
    assert f.machine.stage == "follows" and "all hold" in f.machine.detail


def test_who_is_asked_goes_to_another_height_and_heading(following):
    f = following
    ask(f, "uav2", 2.0, -4.0, -3.0, 0.5)
    f.wait(8.0)
    assert off_m(f, "uav2", 2.0, -4.0, -3.0) < 0.01
    assert transforms.yaw(f.fleet["uav2"].T_home_body) == pytest.approx(0.5, abs=1e-3)
    ask(f, "uav2", 3.0, -4.0, -7.5)
    f.wait(3.0)
    assert "0.5 m above the take-off place, 1 m at least" in f.machine.detail
    assert off_m(f, "uav2", 2.0, -4.0, -3.0) < 0.01


def test_two_that_are_asked_go_one_after_the_other_and_the_newest_place_counts(following):
    f, moved = following, []
    ask(f, "uav2", 3.0, -3.0)
    ask(f, "uav1", 1.0, 9.0)
    ask(f, "uav1", 3.0, 0.0)
    for _ in range(80):
        moved.append(moving(f))
    assert {"uav1"} in moved and {"uav2"} in moved
    # within 0.5 m a vehicle counts as there, and the next one sets out
    assert sum(len(m) == 2 for m in moved) <= 4
    assert moved.index({"uav2"}) < moved.index({"uav1"}) and f.closest_m > 1.45
    assert off_m(f, "uav2", 3.0, -3.0) < 0.01 and off_m(f, "uav1", 3.0, 0.0) < 0.01


def test_nobody_sets_out_before_all_stand(following):
    """Rehearsed: who was sent on at 1 m/s swung to 0.9 m from the other, off its planned way."""
    swings, fly = following.fleet["uav1"], following.fleet["uav1"].fly
    swings.fly = lambda dt_s, speed_mps: 0.5
    ask(following, "uav2", 2.0, -4.0)
    following.wait(2.0)
    assert not moving(following)
    swings.fly = fly
    following.wait(4.0)
    assert off_m(following, "uav2", 2.0, -4.0) < 0.01


def test_a_way_goes_around_the_other_vehicle(following):
    f = following
    ask(f, "uav2", 0.0, 2.5)
    f.wait(10.0)
    assert off_m(f, "uav2", 0.0, 2.5) < 0.01 and f.closest_m > 1.4


@pytest.mark.parametrize(
    "name, at, why",
    [
        ("uav2", (1.0, 0.0), "1.0 m from uav1's place, at least 1.5 m are needed"),
        ("uav2", (6.5, -3.0), "6.5 m away, 6 m at once at most"),
        ("uav1", (-4.0, -4.0), "from home, the fence ends at 5 m"),
    ],
)
def test_a_place_that_cannot_be_flown_to_is_refused(flight, name, at, why):
    f = flight(dataclasses.replace(mission(), fence=Fence(radius_m=5.0)))
    f.up_to_configurations()
    f.until(lambda: f.machine.stage == "follows")
    f.wait(0.5)
    ask(f, name, *at)
    f.wait(2.0)
    assert why in f.machine.detail and f.machine.stage == "follows"
    assert all(off_m(f, n, *p) < 0.01 for n, p in PLACES.items())
    ask(f, "uav2", 1.0, -4.0)  # and it goes on
    f.wait(3.0)
    assert why not in f.machine.detail and off_m(f, "uav2", 1.0, -4.0) < 0.01


def test_nobody_is_sent_to_the_place_to_which_another_flies(following):
    ask(following, "uav2", 3.0, -3.0)
    following.wait(0.3)
    ask(following, "uav1", 2.5, -2.5)
    following.wait(6.0)
    assert "0.7 m from uav2's place" in following.machine.detail


def landed_m(f):
    return {n: v.landed_at[:2] for n, v in f.fleet.items()}


def test_the_operator_ends_it_and_all_land_where_they_are(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(5.0)
    assert "'skip' ends it" in f.operator.control("previous")
    assert f.operator.control("skip") == ""
    f.phase("DONE", 30.0)
    assert f.machine.detail == "all configurations flown" and f.machine.progress == 1.0
    assert landed_m(f)["uav2"] == pytest.approx([4.0, -4.0], abs=0.01)
    assert landed_m(f)["uav1"] == pytest.approx([0.0, 0.0], abs=0.01)


def test_who_is_on_its_way_stands_before_it_ends(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(1.0)
    assert f.operator.control("skip") == ""
    skipped_s, here_m = f.now_s, f.fleet["uav2"].p_home_cam.copy()
    f.phase("DONE", 30.0)
    told = [(o.kind, s) for s, o in f.orders if o.vehicle == "uav2" and s > skipped_s]
    (hold, held_s), (land, landed_s) = (m for m in told if m[0] in ("HOLD", "LAND"))
    assert (hold, land) == ("HOLD", "LAND") and landed_s - held_s >= 1.0
    assert landed_m(f)["uav2"] == pytest.approx(here_m[:2], abs=0.5)


def test_its_time_ends_it(following):
    f = following
    f.wait(FOLLOW_S - 3.0)
    ask(f, "uav2", 2.0, -4.0)
    assert f.machine.stage == "follows"
    f.phase("DONE", 20.0)
    assert landed_m(f)["uav2"] == pytest.approx([2.0, -4.0], abs=0.01)
    assert "LAND" in f.machine.follow("uav2", FollowPlace(0.0, -3.0)) or f.machine.over


def test_a_pause_holds_and_then_it_goes_on(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(0.5)
    assert f.operator.control("pause") == ""
    f.wait(1.0)
    assert not moving(f) and off_m(f, "uav2", 4.0, -4.0) > 1.0
    ask(f, "uav1", 1.0, 1.0)  # waits
    f.wait(3.0)
    assert not moving(f)
    f.press("resume")
    f.phase("CONFIGURATIONS")
    f.wait(8.0)
    assert off_m(f, "uav2", 4.0, -4.0) < 0.01 and off_m(f, "uav1", 1.0, 1.0) < 0.01


def test_a_pose_that_is_late_for_a_moment_ends_nothing(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(0.5)
    f.fleet["uav1"].pose_age_s = 60.0
    f.wait(1.0)
    assert not moving(f) and f.machine.stage == "moves"
    f.fleet["uav1"].pose_age_s = 0.05
    f.wait(6.0)
    assert f.machine.stage == "follows" and off_m(f, "uav2", 4.0, -4.0) < 0.01


def test_a_pilot_takes_one_and_flies_it_where_he_likes(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(0.5)
    f.fleet["uav2"].mode = Mode.LOITER
    f.wait(1.0)
    assert f.machine.follow("uav2", FollowPlace(2.0, -4.0)) == "uav2 is in its pilot's hands"
    f.fleet["uav2"].T_home_body[:3, 3] = f.fleet["uav2"].T_home_body[:3, 3] + (0.0, -1.0, 0.5)
    there = f.fleet["uav2"].p_home_cam.copy()
    f.press("resume")
    f.until(lambda: f.machine.stage == "follows", 20.0)
    f.wait(3.0)
    assert off_m(f, "uav2", *there) < 0.01  # what was asked before is over
    ask(f, "uav2", 2.0, -5.0)
    f.wait(4.0)
    assert off_m(f, "uav2", 2.0, -5.0, there[2]) < 0.01


def restarted(f):
    saved = json.loads(json.dumps(dataclasses.asdict(f.machine.memory())))
    f.machine = MissionMachine(f.machine.mission, list(f.fleet))
    f.machine.restore(config.from_mapping(saved, Memory, FILE))


def test_a_restarted_mission_follows_from_where_they_are(following):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(1.0)
    restarted(f)
    f.until(lambda: f.machine.stage == "follows", 20.0)
    f.wait(1.0)
    here = {n: v.p_home_cam.copy() for n, v in f.fleet.items()}
    assert not moving(f) and 1.0 < off_m(f, "uav2", 4.0, -4.0) < 4.0
    ask(f, "uav1", 1.0, 1.0)
    f.wait(5.0)
    assert off_m(f, "uav1", 1.0, 1.0) < 0.01 and off_m(f, "uav2", *here["uav2"]) < 0.01
    f.phase("DONE", 90.0)


@pytest.mark.parametrize("end", ["battery", "cancel"])
def test_nobody_goes_back_to_the_column(following, end):
    f = following
    ask(f, "uav2", 4.0, -4.0)
    f.wait(5.0)
    if end == "battery":
        f.fleet["uav1"].battery_share = 0.17
        f.wait(1.0)
        assert any("a battery: after 20 s landing" in p for p in f.machine.problems)
    else:
        f.machine.finish("cancelled")
    f.phase("ABORTED", 60.0)
    assert landed_m(f)["uav2"] == pytest.approx([4.0, -4.0], abs=0.01)


@pytest.fixture
def returning(flight):
    """Three vehicles of which one followed to a place below the others; all go back afterwards."""
    f = flight(mission(returns=True), ("uav1", "uav2", "uav3"))
    f.up_to_configurations()
    column = {n: v.p_home_cam.copy() for n, v in f.fleet.items()}
    f.until(lambda: f.machine.stage == "follows")
    x_m, y_m, _ = f.fleet["uav3"].p_home_cam
    for k in range(3):
        ask(f, "uav3", x_m + 3.0 * (k + 1), y_m + 3.0 * (k + 1), -1.5 * (k + 1), 0.3)
        f.wait(7.0)
    assert off_m(f, "uav3", x_m + 9.0, y_m + 9.0, -4.5) < 0.01
    return f, column


@pytest.mark.parametrize("end", ["skip", "time", "cancel", "battery", "restart"])
def test_all_go_back_to_the_column_where_the_mission_says_so(returning, end):
    f, column = returning
    if end == "restart":
        restarted(f)
        f.until(lambda: f.machine.stage == "follows", 20.0)
    if end == "battery":
        f.fleet["uav1"].battery_share = 0.17
        f.wait(1.0)
        assert any("a battery: after 20 s back to the column" in p for p in f.machine.problems)
    elif end == "cancel":
        f.machine.finish("cancelled")
    elif end != "time":
        assert "all go back to the column" in f.operator.control("previous")
        assert f.operator.control("skip") == ""
    f.until(lambda: "uav3 goes up" in f.machine.detail, 90.0)
    low_m = f.fleet["uav3"].p_home_cam.copy()
    f.until(lambda: "goes up" not in f.machine.detail, 30.0)
    off_m = f.fleet["uav3"].p_home_cam - low_m  # straight up, before it goes back
    assert off_m[2] > 3.0 and np.hypot(*off_m[:2]) < 0.6
    assert not f.machine.follow("uav3", FollowPlace(0.0, 9.0)) == ""
    f.until(lambda: f.machine.over, 120.0)
    for name, (x_m, y_m) in landed_m(f).items():
        assert (x_m, y_m) == pytest.approx(tuple(column[name][:2]), abs=0.5)  # counts as there
    assert f.closest_m > 1.45


def test_a_pilot_lands_who_follows_and_the_others_go_back(returning):
    f, column = returning
    f.fleet["uav3"].mode = Mode.LAND
    f.until(lambda: not f.fleet["uav3"].armed, 60.0)
    f.press("resume")
    f.until(lambda: f.machine.stage == "follows", 20.0)
    f.operator.control("skip")
    f.until(lambda: f.machine.over, 120.0)
    assert landed_m(f)["uav2"] == pytest.approx(tuple(column["uav2"][:2]), abs=0.5)


def test_a_third_vehicle_follows_from_the_column(flight):
    names = ("uav1", "uav2", "uav3")
    f = flight(mission(), names)
    f.up_to_configurations()
    f.until(lambda: f.machine.stage == "follows")
    x_m, y_m, z_m = f.fleet["uav3"].p_home_cam
    ask(f, "uav3", x_m + 3.0, y_m)
    f.wait(4.0)
    assert off_m(f, "uav3", x_m + 3.0, y_m, z_m) < 0.01
    f.fleet["uav3"].mode = Mode.LAND  # its guardian lands it
    f.until(lambda: not f.fleet["uav3"].armed, 60.0)
    f.press("resume")
    f.until(lambda: f.machine.stage == "follows", 20.0)
    assert f.machine.follow("uav3", FollowPlace(x_m, y_m)) == "uav3 takes no part any more"
    ask(f, "uav2", 1.0, -4.0)
    f.wait(4.0)
    assert off_m(f, "uav2", 1.0, -4.0) < 0.01
    f.phase("DONE", 90.0)


def test_vehicles_follow_from_the_last_station_and_land_there(flight):
    listed, follow = mission().configurations
    stations = [
        MissionStation([0.0], (6.0, 0.0), name="near", calibrate=False),
        MissionStation([90.0], (8.0, 0.0), name="far", configurations=[follow], calibrate=False),
    ]
    f = flight(dataclasses.replace(mission(), configurations=[listed], stations=stations))
    f.up_to_configurations()
    f.until(lambda: f.machine.stage == "follows")
    f.wait(1.0)
    assert off_m(f, "uav1", 8.0, 0.0) < 0.01 and off_m(f, "uav2", 11.0, 0.0) < 0.01
    ask(f, "uav1", 8.0, 3.0)
    f.wait(4.0)
    f.operator.control("skip")
    f.phase("DONE", 30.0)
    assert landed_m(f)["uav1"] == pytest.approx([8.0, 3.0], abs=0.01) and f.captured == [0]
    assert ", landing 1:37," in plan_words.stations_in_words(f.machine.mission, list(PLACES))


def test_a_list_that_records_nothing_ends_well(flight):
    f = flight(mission(recorded=0))
    f.up_to_configurations()
    assert "no vehicle follows: " in f.machine.follow("uav2", FollowPlace(1.0, -3.0))
    f.until(lambda: f.machine.stage == "follows")
    f.operator.control("skip")
    f.phase("DONE", 30.0)
    assert f.captured == []


def test_who_follows_is_the_last_whatever_the_operator_changes():
    m = mission(recorded=2)
    assert [t.index for t in tasks(m, list(PLACES), [2, 1, 0])] == [1, 0, 2]
    left = TaskList(m, list(PLACES), tasks(m, list(PLACES)))
    assert left.put_off() == "" and [t.index for t in left.left] == [1, 0, 2]
    left.done()
    assert "no other configuration" in left.put_off()
    assert left.skip() == "" and [t.index for t in left.left] == [2]
    assert left.before() == "" and [t.index for t in left.left] == [0, 2]
    assert left.skip() == "" and left.skip() == "" and [t.index for t in left.left] == [None]


def test_the_batteries_must_last_for_it_and_no_way_back_is_planned():
    m = mission()
    flown = plan_check.fly_on_paper(m, plan_check.on_the_ground(m, list(PLACES), {}))
    assert not flown.wrong and FOLLOW_S + 2.0 < flown.flight_s < FOLLOW_S + 30.0
    back = plan_check.fly_on_paper(
        mission(returns=True), plan_check.on_the_ground(m, list(PLACES), {})
    )
    assert not back.wrong and flown.flight_s + 2.0 < back.flight_s < flown.flight_s + 30.0
    short = dataclasses.replace(m, flight=dataclasses.replace(m.flight, endurance_s=300.0))
    found = plan_check.check_plan(short, plan_check.on_the_ground(m, list(PLACES), {}))
    assert len(found) == 2 and "fewer configurations, or full batteries" in found[0]


@pytest.mark.parametrize(
    "asked, why",
    [
        (
            FollowAsked("uav1/odom", "uav2", FollowPlace(1.0, 2.0)),
            "its frame is 'uav1/odom', not home",
        ),
        (
            FollowAsked("home", "uav2", FollowPlace(math.nan, 2.0)),
            "FollowPlace(x_m=nan, y_m=2.0, z_m=None, yaw_rad=None) is no place",
        ),
        (FollowAsked("home", "uav9", FollowPlace(1.0, 2.0)), "uav9 is not one of uav1, uav2"),
        (FollowAsked("home", "uav2", FollowPlace(1.0, 2.0)), "no vehicle follows in WAIT_VEHICLES"),
    ],
)
def test_the_port_says_what_is_wrong_with_what_is_asked(asked, why):
    port = MissionPort(mission(), [vehicle("uav1", 1), vehicle("uav2", 2)], "mission", 0.0)
    (answer,) = port.serve(1.0, asked)
    assert (answer.done, answer.text) == (False, why)
