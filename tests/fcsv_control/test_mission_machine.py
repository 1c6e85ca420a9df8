# SPDX-License-Identifier: Apache-2.0
"""The state machine on a fake clock: the ordinary way, and what must stop it."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_control.mission.activities.flight_list import tasks
from fcsv_control.mission.activities.stages import GOES_BACK, HOLDS, MOVES, RECORDS
from fcsv_control.mission.machine import MissionMachine
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_control.mission.watches import watch
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.flight_limits import PauseLimits
from fcsv_geometry.missions.mission import Mission, SettleBounds, StereoConfiguration
from fcsv_geometry.missions.phases import PHASES
from fcsv_geometry.missions.separation import SeparationRules
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import MissionState


def mission(*configurations, **more):
    configurations = configurations or (("horizontal", 4.0), ("horizontal", 8.0), ("vertical", 5.0))
    listed = [
        StereoConfiguration(c[0], c[1], record_s=2.0, **(c[2] if len(c) > 2 else {}))
        for c in configurations
    ]
    return Mission("test", listed, **more)


@pytest.fixture
def flying(flight):
    """A flight that has just come to the configurations."""
    f = flight(mission())
    f.up_to_configurations()
    return f


def kinds(flight, name, kind):
    return {o.number: o for _, o in flight.orders if o.vehicle == name and o.kind == kind}


# ---- the ordinary way ----------------------------------------------------------------------------


def test_phases_are_numbered_as_in_the_message():
    assert [getattr(MissionState, p) for p in PHASES] == list(range(len(PHASES)))


@pytest.mark.parametrize("seed", range(4))
def test_from_take_off_to_landing(flight, seed):
    f = flight(mission(), seed=seed)
    f.up_to_configurations()
    f.phase("DONE", 400.0)
    windows = f.machine.captures
    assert [w.index for w in windows] == [0, 1, 2] and {w.vehicle for w in windows} == {"uav2"}
    for w in windows:
        assert w.stop_s - w.start_s == pytest.approx(2.0) and w.position_error_m < 0.15
        # pictures were on all through the window, with room for a late one
        for name in ("uav1", "uav2"):
            inside = [t for t in f.pictures[name] if w.start_s - 0.1 <= t <= w.stop_s + 0.3]
            assert len(inside) >= 22, name
    assert len(f.pictures["uav1"]) < 3 * 40, "and off otherwise"
    assert f.closest_m > 1.5 - 0.05, (
        "nobody ever came nearer than the minimum separation (0.05: a step of the clock)"
    )
    apart = f.fleet["uav1"].landed_at - f.fleet["uav2"].landed_at
    assert np.linalg.norm(apart[:2]) > 2.0, (
        "the one that stood above did not come down upon the other"
    )
    assert f.machine.problems == []


def test_words_and_number_are_always_of_the_same_configuration(flying):
    listed = [c.title for c in flying.machine.mission.configurations]
    told = set()

    def note():
        told.update(
            {(flying.machine.configuration, t) for t in listed if t in flying.machine.detail}
        )
        return flying.machine.phase == "DONE"

    flying.until(note)
    assert sorted(told) == list(enumerate(listed))


def test_each_configuration_has_its_stages_and_the_way_back_is_none_of_it(flying):
    """Of a list flown one by one; a gust may send it back to holding."""
    seen = []

    def note():
        m = flying.machine
        if m.phase == "CONFIGURATIONS" and seen[-1:] != [(m.configuration, m.stage)]:
            seen.append((m.configuration, m.stage))
        return m.phase == "DONE"

    flying.until(note)
    count = len(flying.machine.mission.configurations)
    assert seen == [
        *((i, stage) for i in range(count) for stage in (MOVES, HOLDS, RECORDS)),
        (count - 1, GOES_BACK),
    ]
    assert flying.machine.stage == ""


@pytest.mark.parametrize("period_s, lasts_s", [(0.8, 4.4), (3.0, 8.0)])
def test_slow_cameras_are_waited_for_but_not_for_ever(flight, period_s, lasts_s):
    f = flight(mission())
    f.picture_period_s = period_s
    f.up_to_configurations()
    f.phase("DONE", 600.0)
    assert [w.index for w in f.machine.captures] == [0, 1, 2]
    for w in f.machine.captures:
        assert w.stop_s - w.start_s == pytest.approx(lasts_s, abs=period_s)


def test_the_thesis_list_with_a_slow_and_lossy_radio(flight, root):
    """Half of all commands get lost: repetition brings every one of them home."""
    from fcsv_geometry.missions.mission import load_mission

    f = flight(load_mission(root / "config" / "missions" / "outdoor.yaml"), seed=3)
    f.lossy = 0.5
    f.up_to_configurations()
    f.phase("DONE", 900.0)
    assert [w.index for w in f.machine.captures] == list(range(8)) and f.closest_m > 1.45


def test_three_vehicles_take_turns(flight):
    m = mission(("horizontal", 4.0), ("vertical", 5.0, {"vehicle": "uav3"}), ("horizontal", 2.0))
    names = ("uav1", "uav2", "uav3")
    assert [(t.vehicle, t.index) for t in tasks(m, names)] == [
        ("uav2", 0),
        ("uav2", None),
        ("uav3", 1),
        ("uav3", None),
        ("uav2", 2),
        ("uav2", None),
    ]
    f = flight(m, names)
    f.up_to_configurations()
    f.phase("DONE", 400.0)
    assert [w.vehicle for w in f.machine.captures] == [
        "uav2",
        "uav3",
        "uav2",
    ] and f.closest_m > 1.45
    assert not f.pictures["uav3"] or min(f.pictures["uav3"]) > f.machine.captures[0].stop_s


def test_waits_for_what_people_do(flight):
    f = flight(mission())
    f.fleet["uav2"].heard = False
    f.wait(3.0)
    assert f.machine.phase == "WAIT_VEHICLES" and "uav2" in f.machine.problems[0]
    f.fleet["uav2"].heard, f.fleet["uav2"].height_m = True, np.nan
    f.wait(3.0)
    assert f.machine.problems == ["uav2: its height is not heard"], "nor where its ground is"
    f.fleet["uav2"].height_m = 0.0
    f.phase("TAKE_OFF")
    f.take_off()
    f.fleet["uav2"].mode = Mode.ALT_HOLD  # not in LOITER yet
    f.wait(3.0)
    assert f.machine.phase == "TAKE_OFF"
    f.fleet["uav2"].mode = Mode.LOITER
    f.phase("COLUMN")
    f.fleet["uav2"].sees_front_s = 1.0  # not steady yet
    f.wait(3.0)
    assert f.machine.waits_for == "" and "COLUMN" in f.operator.proceed("calibrate")
    f.fleet["uav2"].sees_front_s = 2.5
    f.press("calibrate")
    f.machine.answer("calibrate", False, "too few detections")
    assert f.machine.phase == "COLUMN" and f.machine.detail == "too few detections"
    f.press("calibrate")
    f.machine.answer("calibrate", True, "good")
    assert f.machine.phase == "MOVE_HOME"
    f.press("set_home")
    f.machine.answer("set_home", False, "odometry is old")
    assert f.machine.phase == "MOVE_HOME" and f.machine.waits_for == "set_home"


def test_a_tag_that_is_lost_again_takes_the_button_away(flight):
    f = flight(mission())
    f.line_up()
    f.wait(0.2)
    assert f.machine.waits_for == "calibrate"
    f.fleet["uav2"].sees_front_s = 0.0
    f.wait(0.2)
    assert f.machine.waits_for == ""


def test_a_tracker_on_the_ground_calibrates_without_tags(flight):
    f = flight(mission(tracker="ground"))
    f.line_up()
    f.fleet["uav2"].sees_front_s = 0.0
    f.wait(0.2)
    assert f.machine.waits_for == "calibrate" and "tag" not in f.machine.detail


def test_a_refused_mode_is_said_and_asked_again(flight):
    f = flight(mission(limits=PauseLimits(handover_s=1000.0)))
    f.fleet["uav2"].refuses = {"SET_MODE": "Mode change to GUIDED failed: requires position"}
    with pytest.raises(AssertionError):
        f.up_to_configurations()
    assert f.machine.phase == "GUIDED" and "requires position" in f.machine.detail
    asked = len(kinds(f, "uav2", "SET_MODE"))
    assert 20 < asked < 200, "about every two seconds, not with every step"
    f.fleet["uav2"].refuses = {}
    f.phase("CONFIGURATIONS", 10.0)


# ---- faults --------------------------------------------------------------------------------------


def paused(f, words):
    """Everybody holds, nothing is recorded, and the reason is said."""
    assert f.machine.phase == "CONFIGURATIONS"
    assert any(words in p for p in f.machine.problems), f.machine.problems
    before = {n: v.T_home_body.copy() for n, v in f.fleet.items()}
    f.wait(5.0)
    for name, v in f.fleet.items():
        assert not v.recording or not v.heard, name
        if v.heard:
            np.testing.assert_array_equal(v.T_home_body, before[name], err_msg=f"{name} went on")


def resumed(f, captures=(0, 1, 2)):
    f.phase("DONE", 400.0)
    assert [w.index for w in f.machine.captures] == list(captures) and f.closest_m > 1.45


def until_recording(f):
    f.until(lambda: f.fleet["uav2"].recording)
    f.wait(1.0)


@pytest.mark.parametrize("when", ["travelling", "recording"])
def test_a_lost_link_pauses_and_a_found_one_goes_on(flying, when):
    flying.wait(1.0) if when == "travelling" else until_recording(flying)
    flying.fleet["uav2"].heard = False
    flying.wait(1.0)
    paused(flying, "uav2: no state for 3.5 s and no pose for 2 s; check the radio link")
    assert not flying.machine.captures
    flying.fleet["uav2"].heard = True
    resumed(flying)


@pytest.mark.parametrize(
    "state_age_s, pose_age_s, words",
    [
        (3.4, 1.9, ""),
        (3.6, 1.9, "no state for 3.5 s;"),
        (3.4, 2.1, "no pose for 2 s;"),
        (3.6, 2.1, "no state for 3.5 s and no pose for 2 s;"),
    ],
)
def test_silence_is_told_with_the_limit_that_it_passed(state_age_s, pose_age_s, words):
    view = VehicleView(state_age_s=state_age_s, pose_age_s=pose_age_s, connected=True, armed=True)
    found = watch.problems(mission(), "COLUMN", Snapshot(0.0, {"uav2": view}))
    assert found == ([f"uav2: {words} check the radio link"] if words else [])


@pytest.mark.parametrize(
    "phase, told",
    [
        ("WAIT_VEHICLES", False),
        ("TAKE_OFF", False),
        ("COLUMN", False),
        ("MOVE_HOME", True),
        ("CONFIGURATIONS", True),
    ],
)
def test_a_tracker_on_the_ground_need_not_see_who_is_still_flown_by_hand(phase, told):
    """It knows a heading once people have moved the vehicle in its view
    (docs/design/trackers.md)."""
    view = VehicleView(
        state_age_s=0.1, connected=True, armed=True, battery_share=0.9, recorder_age_s=0.1
    )
    found = watch.problems(mission(tracker="ground"), phase, Snapshot(0.0, {"uav2": view}))
    assert any("no pose" in text for text in found) == told
    assert any(
        "no pose" in t for t in watch.problems(mission(), phase, Snapshot(0.0, {"uav2": view}))
    )


@pytest.mark.parametrize("when", ["travelling", "recording"])
def test_a_radio_that_is_dead_for_longer_than_a_flight_leg_is_waited_for(flying, when):
    flying.wait(1.0) if when == "travelling" else until_recording(flying)
    for vehicle in flying.fleet.values():
        vehicle.heard = False
    flying.wait(40.0)
    assert flying.machine.phase == "CONFIGURATIONS" and not flying.machine.captures
    for vehicle in flying.fleet.values():
        vehicle.heard = True
    resumed(flying)


def orders_that_move(f, name):
    return {o.number: o for _, o in f.orders if o.vehicle == name and o.kind != "RECORD"}


@pytest.mark.parametrize(
    "mode", [Mode.LOITER, Mode.ALT_HOLD, Mode.STABILIZE, Mode.LAND, Mode.BRAKE]
)
def test_a_pilot_who_takes_over_is_not_fought(flying, mode):
    """No mode and no way-point while he has it, nor when he gives it back, until the operator
    confirms."""
    flying.wait(1.0)
    flying.fleet["uav2"].mode = mode
    flying.fleet["uav2"].height_m = 200.0  # a landing that takes longer than this test
    flying.wait(0.3)
    before = set(orders_that_move(flying, "uav2"))
    flying.wait(60.0)
    assert flying.machine.phase == "CONFIGURATIONS" and not flying.fleet["uav2"].recording
    assert any(
        f"uav2: {mode} was not asked for by the mission" in p for p in flying.machine.problems
    )
    assert flying.machine.waits_for == ("resume" if mode == Mode.LOITER else "")
    flying.fleet["uav2"].mode = Mode.GUIDED
    flying.wait(20.0)
    assert set(orders_that_move(flying, "uav2")) == before, "given back, but not confirmed"


@pytest.mark.parametrize("mode", [Mode.BRAKE, Mode.STABILIZE])
def test_a_pilot_who_takes_it_just_before_guided_is_asked_for_is_not_fought(flight, mode):
    """The operator has confirmed, nothing is ordered yet (a link was silent), and the pilot
    switches."""
    f = flight(mission())
    f.up_to_home()
    f.fleet["uav2"].mode = mode
    f.press("execute")
    f.wait(20.0)
    assert f.machine.phase == "GUIDED" and kinds(f, "uav2", "SET_MODE") == {}
    assert f"uav2: {mode} was not asked for" in f.machine.problems[0]
    f.fleet["uav2"].mode = Mode.LOITER
    f.wait(1.0)
    assert kinds(f, "uav2", "SET_MODE") == {}, "given back, but not confirmed"
    f.press("resume")
    resumed(f)


def test_a_vehicle_that_is_given_back_goes_on_once_it_is_confirmed(flying):
    flying.wait(1.0)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(0.3)
    flying.fleet["uav2"].mode = Mode.GUIDED
    flying.wait(5.0)
    flying.press("resume")
    resumed(flying)


def test_a_pilot_who_takes_over_during_the_handing_over_is_not_sent_back_to_guided(flight):
    """uav2 was in GUIDED already while uav1 still refuses; its pilot takes it again."""
    f = flight(mission(limits=PauseLimits(handover_s=1000.0)))
    f.fleet["uav1"].refuses = {"SET_MODE": "requires position"}
    with pytest.raises(AssertionError):
        f.up_to_configurations()
    assert f.fleet["uav2"].mode == Mode.GUIDED
    f.fleet["uav2"].mode = Mode.ALT_HOLD
    f.wait(0.2)
    asked = len(kinds(f, "uav2", "SET_MODE"))
    f.wait(60.0)
    assert len(kinds(f, "uav2", "SET_MODE")) == asked and f.fleet["uav2"].mode == Mode.ALT_HOLD
    assert "uav2: ALT_HOLD was not asked for" in f.machine.problems[0]


def test_a_pilot_who_ends_a_landing_is_not_told_to_land_again(flying):
    flying.wait(1.0)
    flying.fleet["uav2"].height_m = 60.0
    flying.machine.abort("stop")
    flying.until(lambda: flying.fleet["uav2"].mode == Mode.LAND)
    flying.wait(0.5)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(0.2)
    asked = len(kinds(flying, "uav2", "LAND"))
    flying.wait(30.0)
    assert len(kinds(flying, "uav2", "LAND")) == asked and flying.machine.phase == "LAND"
    assert any("uav2 is flown by hand" in p for p in flying.machine.problems)


def test_a_reference_that_was_moved_goes_home_first(flying):
    flying.wait(1.0)
    flying.fleet["uav1"].mode = Mode.LOITER
    flying.wait(0.5)
    flying.fleet["uav1"].T_home_body[0, 3] += 6.0  # flown away by hand
    flying.fleet["uav1"].mode, flying.fleet["uav1"].target = Mode.GUIDED, None
    flying.press("resume")
    flying.phase("CONFIGURATIONS")
    flying.wait(0.2)
    mover = flying.fleet["uav2"].T_home_body.copy()
    flying.wait(1.5)
    assert "uav1 goes home" in flying.machine.detail
    np.testing.assert_array_equal(flying.fleet["uav2"].T_home_body, mover)
    resumed(flying)


def test_who_was_blown_into_the_references_place_goes_to_its_own_first(flying):
    """It is not the end of the mission: they were flown on, and never nearer to each other."""
    flying.wait(1.0)
    for name, p in (("uav1", [3.0, 0.0, 0.0]), ("uav2", [0.3, 0.2, 0.0])):
        flying.fleet[name].mode = Mode.LOITER
        # the reference is 2.7 m in front of its place, the other one in it
        flying.fleet[name].T_home_body[:3, 3] = p
    flying.wait(0.5)
    flying.closest_m = float("inf")
    for v in flying.fleet.values():
        v.mode, v.target = Mode.GUIDED, None
    flying.press("resume")
    flying.phase("CONFIGURATIONS")
    resumed(flying)
    # 2.7 m when they began, and what is kept is 2.5 m, less a fifth at a goal
    assert flying.closest_m > 2.3


# ---- a vehicle that comes down upon another ------------------------------------------------------


def clearance_when_heights_cross(f, upper, lower):
    """Least horizontal distance (m) while the upper one is within a metre above the lower one, or
    beneath."""
    least = float("inf")
    for _ in range(600):
        f.step()
        a, b = f.fleet[upper], f.fleet[lower]
        if a.armed and a.p_home_cam[2] < b.p_home_cam[2] + 1.0:
            least = min(least, float(np.linalg.norm(a.p_home_cam[:2] - b.p_home_cam[:2])))
    return least


@pytest.mark.parametrize("baseline_m", [3.0, 5.0, 10.0])
def test_who_hangs_beneath_a_vehicle_that_lands_by_itself_goes_aside(flight, baseline_m):
    """The upper vehicle's pose feed fails and its flight link lands it: holding beneath would be a
    collision."""
    f = flight(mission(("vertical", baseline_m)))
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav2"].recording)
    f.fleet["uav2"].mode, f.fleet["uav2"].height_m = Mode.LAND, baseline_m + 8.0
    f.wait(1.0)
    aside = [
        o for o in kinds(f, "uav1", "GOTO").values() if o.number == max(orders_that_move(f, "uav1"))
    ]
    assert aside, "the lower one was told to go, not to hold"
    assert clearance_when_heights_cross(f, "uav2", "uav1") > 1.5


@pytest.mark.parametrize("baseline_m", [3.0, 5.0, 10.0])
def test_an_abort_sends_the_lower_one_aside_where_the_upper_one_is_landing_already(
    flight, baseline_m
):
    f = flight(mission(("vertical", baseline_m)))
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav2"].recording)
    f.fleet["uav2"].mode, f.fleet["uav2"].height_m = Mode.LAND, baseline_m + 8.0
    f.machine.abort("stop")
    assert clearance_when_heights_cross(f, "uav2", "uav1") > 1.5
    f.phase("ABORTED", 60.0)


def test_a_low_battery_holds_and_an_empty_one_lands(flying):
    flying.wait(1.0)
    flying.fleet["uav1"].battery_share = 0.15
    flying.wait(0.2)
    paused(flying, "uav1: battery below 20%")
    flying.fleet["uav1"].battery_share = 0.05
    flying.phase("ABORTED", 60.0)
    assert "battery below 10%" in flying.machine.detail


def test_a_full_disk_pauses(flying):
    until_recording(flying)
    flying.fleet["uav2"].recorder_problem = "only 3 MiB left"
    flying.wait(0.2)
    paused(flying, "uav2: recorder: only 3 MiB left")


def test_motors_off_in_the_air_land_the_rest(flying):
    flying.wait(1.0)
    flying.fleet["uav2"].armed = False
    flying.phase("ABORTED", 60.0)
    assert "uav2: motors are off" in flying.machine.detail and not flying.fleet["uav1"].armed


def test_vehicles_that_meet_are_held(flying):
    flying.wait(1.0)
    place = flying.fleet["uav1"].T_home_body[:3, 3] + np.array([0.0, -0.5, 0.0])
    flying.fleet["uav2"].T_home_body[:3, 3] = place
    flying.wait(0.2)
    paused(flying, "uav1 and uav2 are too near")


def test_small_vehicles_are_held_where_their_own_air_begins(flight):
    """Of Tellos' size (0.63 m of air, as tall as wide): 1 m above each other is far enough, 0.4 m
    is not."""
    f = flight(
        mission(
            ("vertical", 1.2),
            air=SeparationRules(0.63, 1.0),
            min_separation_m=1.0,
            home_height_m=2.0,
        )
    )
    f.up_to_configurations()
    for height_m, found in (
        (1.0, []),
        (0.4, ["uav1 and uav2 are too near to each other; move them apart by hand"]),
    ):
        above = f.fleet["uav1"].T_home_body[:3, 3] + np.array([0.0, 0.0, height_m])
        f.fleet["uav2"].T_home_body[:3, 3] = above
        assert watch.problems(f.machine.mission, "CONFIGURATIONS", f.snapshot()) == found


@pytest.mark.parametrize("apart_m, age_s, found", [(1.2, 0.05, 0), (0.75, 0.05, 1), (1.2, 0.75, 1)])
def test_room_for_what_is_not_known_of_two_places_is_kept_in_flight_too(
    flight, apart_m, age_s, found
):
    """0.63 m of air and 0.15 m of doubt, as guardians count it; half a second more of age at 1 m/s
    is 0.5 m."""
    f = flight(
        mission(
            ("horizontal", 1.2),
            air=SeparationRules(1.0, 1.0),
            min_separation_m=1.0,
            home_height_m=2.0,
        )
    )
    f.up_to_configurations()
    f.fleet["uav2"].T_home_body[:3, 3] = f.fleet["uav1"].T_home_body[:3, 3] + np.array(
        [0.0, apart_m, 0.0]
    )
    seen = f.snapshot()
    late = replace(seen.vehicles["uav2"], pose_age_s=age_s, speed_mps=1.0)
    still = replace(seen.vehicles["uav1"], pose_age_s=0.05, speed_mps=0.0)
    seen = replace(seen, vehicles={"uav1": still, "uav2": late})
    said = watch.problems(f.machine.mission, "CONFIGURATIONS", seen)
    assert len([s for s in said if "too near" in s]) == found, said


def test_a_gust_while_recording_is_recorded_again(flying):
    until_recording(flying)
    flying.fleet["uav2"].push_m = np.array([0.0, 0.0, 0.2])
    flying.wait(0.5)
    flying.fleet["uav2"].push_m = np.zeros(3)
    resumed(flying)
    assert flying.machine.captures[0].position_error_m < 0.15
    on = [o for o in kinds(flying, "uav2", "RECORD").values() if o.arguments["flag"]]
    assert len(on) == 4, "three configurations, one of them twice"


@pytest.mark.parametrize("attempts", [1, 3])
def test_what_is_recorded_as_the_time_of_day_is_set_is_recorded_again(flight, attempts):
    """Pictures are compared with windows by the time of day. At the last attempt, too: such a
    window tells nothing."""
    f = flight(mission(("horizontal", 4.0), settle=SettleBounds(attempts=attempts)))
    f.up_to_configurations()
    until_recording(f)
    f.wait(0.5)
    f.clock_set += 1
    set_s = f.now_s
    f.phase("DONE", 60.0)
    (window,) = f.machine.captures
    assert window.start_s > set_s
    on = [o for o in kinds(f, "uav2", "RECORD").values() if o.arguments["flag"]]
    assert len(on) == 2


def test_a_time_of_day_that_is_set_before_a_recording_disturbs_none(flying):
    flying.clock_set += 1
    flying.phase("DONE", 120.0)
    on = [o for o in kinds(flying, "uav2", "RECORD").values() if o.arguments["flag"]]
    assert len(on) == len(flying.machine.captures) == 3


def test_gusts_at_every_attempt_leave_the_last_with_its_error(flying):
    """A recording that moves is worse than a still one and better than none; its error is told."""
    gusts = 0
    for _ in range(3000):
        on = flying.fleet["uav2"].recording and not flying.machine.captures
        flying.fleet["uav2"].push_m = np.array([0.0, 0.0, 0.2 if on else 0.0])
        gusts += on
        flying.step()
        if flying.machine.phase == "DONE":
            break
    assert gusts and flying.machine.captures[0].position_error_m == pytest.approx(0.2, abs=0.02)
    assert [w.index for w in flying.machine.captures] == [0, 1, 2]


def test_a_place_without_calm_is_left_out_and_said(flight):
    f = flight(
        mission(("horizontal", 4.0), ("horizontal", 6.0), settle=SettleBounds(timeout_s=5.0))
    )
    f.up_to_configurations()
    f.fleet["uav2"].push_m = np.array([0.0, 0.3, 0.0])
    f.until(lambda: f.machine.configuration == 1)
    f.fleet["uav2"].push_m = np.zeros(3)
    resumed(f, [1])
    assert "horizontal 4 m left out" in f.machine.detail


def test_nothing_recorded_at_all_is_no_success(flight):
    f = flight(mission(("horizontal", 4.0), settle=SettleBounds(timeout_s=5.0)))
    f.up_to_configurations()
    f.fleet["uav2"].push_m = np.array([0.0, 0.3, 0.0])
    f.phase("ABORTED", 100.0)
    assert "no configuration could be recorded" in f.machine.detail


def test_a_vehicle_that_does_not_move_ends_it(flying):
    flying.speed_mps = 0.0
    flying.phase("ABORTED", 100.0)
    assert "uav2 did not get to its next way-point in 30 s" in flying.machine.detail


def test_a_recorder_that_refuses_leaves_no_capture(flying):
    flying.fleet["uav1"].refuses = {"RECORD": "no recorder on board"}
    flying.wait(60.0)
    assert not flying.machine.captures and "uav1" not in flying.machine.detail.split(":")[0]
    assert "no recorder on board" in flying.machine.detail
    flying.fleet["uav1"].refuses = {}
    resumed(flying)


# ---- abort ---------------------------------------------------------------------------------------


def test_abort_on_the_ground_is_over_at_once(flight):
    f = flight(mission())
    f.wait(0.5)
    f.machine.abort("no")
    f.wait(0.2)
    assert f.machine.phase == "ABORTED"


def test_abort_before_anybody_was_heard_is_not_over(flight):
    """Two vehicles may be in the air: nobody knows."""
    f = flight(mission())
    for v in f.fleet.values():
        v.heard = False
    f.machine.abort("no")
    f.wait(5.0)
    assert f.machine.phase == "LAND" and any("uav1: not heard" in p for p in f.machine.problems)
    for v in f.fleet.values():
        v.heard = True
    f.phase("ABORTED", 5.0)


def test_two_quick_confirmations_are_one(flight):
    """Two calls at set_home used to hand over to GUIDED."""
    f = flight(mission())
    f.up_to_home()
    assert "a moment ago" in f.operator.proceed("execute") and f.machine.phase == "SET_HOME"
    f.wait(1.2)
    assert "'execute' is waited for, not 'set_home'" in f.operator.proceed("set_home")
    assert f.operator.proceed("execute") == "" and f.machine.phase == "GUIDED"


def test_abort_while_they_take_off_tells_the_pilot_of_who_is_in_the_air_to_land(flight):
    f = flight(mission())
    f.phase("TAKE_OFF")
    first = f.fleet["uav1"]
    first.armed, first.mode, first.height_m = True, Mode.ALT_HOLD, 1.0
    f.wait(0.5)
    f.machine.abort("stop")
    f.wait(5.0)
    assert (
        f.machine.phase == "LAND" and not kinds(f, "uav1", "LAND") and not kinds(f, "uav2", "LAND")
    )
    assert f.machine.problems == ["uav1 is flown by hand: land it (ALT_HOLD)"]
    first.mode = Mode.LAND
    f.phase("ABORTED", 30.0)


def test_abort_while_calibrating_lands_and_ignores_the_late_answer(flight):
    f = flight(mission())
    f.line_up()
    f.press("calibrate")
    f.machine.abort("stop")
    f.machine.answer("calibrate", True, "good")
    assert f.machine.phase == "LAND" and f.machine.waits_for == ""
    f.wait(30.0)
    assert not kinds(f, "uav1", "LAND") and not kinds(f, "uav2", "LAND"), (
        "hand-flown vehicles are not commanded"
    )
    assert [p for p in f.machine.problems if "is flown by hand: land it" in p]
    for v in f.fleet.values():
        v.mode = Mode.LAND  # their pilots do
    f.phase("ABORTED", 30.0)


def test_abort_above_the_reference_lands_beside_it(flight):
    f = flight(mission(("vertical", 5.0)))
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav2"].recording)
    f.machine.abort("stop")
    f.phase("ABORTED", 60.0)
    assert not any(v.recording for v in f.fleet.values())
    apart = f.fleet["uav1"].landed_at - f.fleet["uav2"].landed_at
    assert np.linalg.norm(apart[:2]) > 1.5


def test_who_hangs_above_in_a_pilots_hands_is_not_told_to_land(flight):
    f = flight(mission(("vertical", 5.0)))
    f.up_to_configurations()
    f.until(lambda: f.fleet["uav2"].recording)
    f.fleet["uav2"].mode = Mode.LOITER
    f.machine.abort("stop")
    f.wait(10.0)
    assert f.fleet["uav2"].armed and "uav2 is above uav1" in f.machine.problems[-1]
    f.fleet["uav2"].T_home_body[1, 3] -= 4.0
    f.wait(10.0)
    assert f.fleet["uav2"].armed and "uav2 is flown by hand: land it" in f.machine.problems[-1]
    f.fleet["uav2"].mode = Mode.LAND
    f.phase("ABORTED", 60.0)


def test_a_landing_that_is_not_heard_is_asked_for_again(flying):
    flying.wait(1.0)
    flying.fleet["uav2"].heard = False
    flying.machine.abort("stop")
    flying.wait(20.0)
    assert flying.machine.phase == "LAND" and not flying.fleet["uav1"].armed
    flying.fleet["uav2"].heard = True
    flying.phase("ABORTED", 60.0)


# ---- commands on their way -----------------------------------------------------------------------


def test_orders_repeat_until_acknowledged_and_expire():
    box = Outbox(lifetime_s=1.0)
    order = box.order(0.0, "uav1", "GOTO")
    assert [bool(box.due(t)) for t in (0.0, 0.1, 0.35, 0.5, 0.7)] == [
        True,
        False,
        True,
        False,
        True,
    ]
    box.acknowledged("uav2", order.number, "")  # somebody else's
    assert order.outcome is None
    box.acknowledged("uav1", order.number, "")
    assert order.done and not box.due(5.0)
    late = box.order(10.0, "uav1", "GOTO")
    assert box.due(10.9) and not box.due(11.1) and "did not acknowledge GOTO" in late.outcome


def test_a_newer_order_silences_the_older():
    """A way-point that is still being repeated would otherwise undo the hold that came after it."""
    box = Outbox()
    goto, record = box.order(0.0, "uav1", "GOTO"), box.order(0.0, "uav1", "RECORD", flag=True)
    other = box.order(0.0, "uav2", "GOTO")
    hold = box.order(1.0, "uav1", "HOLD")
    assert {o.number for o in box.due(1.0)} == {record.number, other.number, hold.number}
    assert goto.failed and "replaced" in goto.outcome
    box.acknowledged("uav1", goto.number, "")  # the late answer changes nothing
    assert goto.failed


def test_a_fleet_without_the_reference_is_refused():
    with pytest.raises(MissionError, match="reference 'uav1'"):
        MissionMachine(mission(), ["uav2", "uav3"])
