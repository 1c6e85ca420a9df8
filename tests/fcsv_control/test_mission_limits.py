# SPDX-License-Identifier: Apache-2.0
"""Every pause ends: after its limit the mission goes back and lands, or lands, or leaves the
configuration out."""

import dataclasses

import numpy as np
import pytest

from fcsv_control.mission.snapshot import RecorderView
from fcsv_control.mission.watches.telemetry import VehicleTelemetry
from fcsv_geometry.missions.flight_limits import PauseLimits
from fcsv_geometry.missions.mission import Mission, SettleBounds, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode

NAN = float("nan")


def mission(*baselines, **limits):
    listed = [StereoConfiguration("horizontal", b, record_s=2.0) for b in baselines or (4.0, 8.0)]
    return Mission("test", listed, limits=PauseLimits(**limits), settle=SettleBounds(time_s=0.5))


@pytest.fixture
def flying(flight):
    f = flight(mission())
    f.up_to_configurations()
    f.wait(1.0)
    return f


def ends(f, after_s, words):
    """The mission's patience ends between 0.8 and 1.2 of the limit; then all land without anybody's
    help."""
    begun_s = f.now_s
    f.until(lambda: words in f.machine.detail, 1.2 * after_s)
    assert f.now_s - begun_s > 0.8 * after_s
    f.phase("ABORTED", 120.0)
    assert words in f.machine.detail and not any(v.armed for v in f.fleet.values())


def back_in_the_column(f):
    """The moving vehicle came down behind the reference, not where it hung when the pause began."""
    apart = f.fleet["uav2"].landed_at - f.fleet["uav1"].landed_at
    assert apart[0] == pytest.approx(-3.5, abs=0.5) and abs(apart[1]) < 0.5


@pytest.mark.parametrize("share", [0.15, NAN])
def test_a_battery_that_is_low_or_unknown_goes_back_and_lands(flying, share):
    flying.fleet["uav1"].battery_share = share
    flying.wait(0.2)
    assert any("uav1: battery" in p for p in flying.machine.problems)
    assert "a battery: after 20 s back to the column, then landing" in flying.machine.problems
    ends(flying, 20.0, "a battery for 20 s")
    back_in_the_column(flying)


def test_a_battery_that_is_not_known_forbids_guided(flight):
    f = flight(mission())
    f.up_to_home()
    f.fleet["uav2"].battery_share = NAN
    f.press("execute")
    f.wait(10.0)
    assert f.machine.phase == "GUIDED" and not [o for _, o in f.orders if o.kind == "SET_MODE"]
    assert any("uav2: battery is not known" in p for p in f.machine.problems)
    f.fleet["uav2"].battery_share = 0.9
    f.phase("CONFIGURATIONS", 10.0)


def test_nobody_takes_off_with_a_battery_that_is_not_known(flight):
    f = flight(mission())
    f.fleet["uav2"].battery_share = NAN
    f.wait(3.0)
    assert f.machine.phase == "WAIT_VEHICLES" and f.machine.problems[0].startswith(
        "uav2: battery is not known"
    )


def test_a_full_disk_goes_back_and_lands(flying):
    flying.fleet["uav2"].recorder_problem = "only 3 MiB left"
    ends(flying, 60.0, "a recorder for 60 s")
    back_in_the_column(flying)


def test_the_control_pc_s_own_recorder_counts_like_those_of_the_vehicles(flying):
    """Without its bag there is no map: calibration, home and the times of the recordings are in
    it."""
    flying.recorder = RecorderView(age_s=0.5)
    flying.wait(1.0)
    assert not flying.machine.problems
    flying.recorder = RecorderView(age_s=6.0)
    flying.wait(1.0)
    assert "control PC: recorder: not heard" in flying.machine.problems
    flying.recorder = RecorderView(age_s=0.5)
    flying.wait(1.0)
    assert not flying.machine.problems, "it is up again within seconds: nothing is lost"
    flying.recorder = RecorderView(age_s=0.5, problem="only 3 MiB left")
    flying.wait(1.0)
    assert "control PC: recorder: only 3 MiB left" in flying.machine.problems
    ends(flying, 60.0, "a recorder for 60 s")
    back_in_the_column(flying)


def test_without_the_control_pc_s_recorder_no_vehicle_is_waited_for_longer(flight):
    f = flight(mission())
    f.recorder = RecorderView()
    f.wait(5.0)
    assert f.machine.phase == "WAIT_VEHICLES"
    assert f.machine.problems == ["control PC: recorder: not heard"]
    f.recorder = RecorderView(age_s=0.5)
    f.wait(1.0)
    assert f.machine.phase != "WAIT_VEHICLES"


def test_pictures_are_counted_over_the_restart_of_a_recorder():
    heard, counted = VehicleTelemetry(np.eye(4)), []
    for now_s, pictures in enumerate((0, 10, 25, 0, 5, 2, 9)):
        heard.recorder(now_s, "", pictures)
        counted.append(heard.view(now_s, None).pictures)
    assert counted == [0, 10, 25, 25, 30, 32, 39]


def test_a_battery_that_is_not_told_any_more_is_not_known_while_its_vehicle_is_heard():
    heard = VehicleTelemetry(np.eye(4))
    heard.battery(0.0, 0.7)
    heard.state(9.0, Mode.GUIDED, True, True)
    assert heard.view(30.0, None).battery_share == 0.7, "a cut radio is another pause"
    heard.state(11.0, Mode.GUIDED, True, True)
    assert np.isnan(heard.view(11.0, None).battery_share)


def test_a_recorder_that_refuses_costs_its_configurations(flight):
    f = flight(mission(recorder_s=10.0))
    f.up_to_configurations()
    f.fleet["uav1"].refuses = {"RECORD": "no recorder on board"}
    f.until(lambda: f.machine.configuration == 1, 60.0)
    assert not f.fleet["uav2"].recording, "the other recorder is off again"
    f.fleet["uav1"].refuses = {}
    f.phase("DONE", 100.0)
    assert [w.index for w in f.machine.captures] == [1]
    assert (
        "horizontal 4 m left out, recorders do not start: no recorder on board" in f.machine.detail
    )


def test_a_pose_that_stays_away_lands_everybody(flying):
    flying.fleet["uav2"].heard = False
    flying.wait(65.0)
    assert flying.machine.phase == "LAND" and flying.fleet["uav1"].mode == Mode.LAND
    flying.fleet["uav2"].heard = True
    flying.phase("ABORTED", 60.0)


def test_pauses_that_are_short_but_never_end_pass_the_limit_of_a_configuration(flight):
    """A recorder that is slow for 3 s of every 6: no pause lasts, and nothing is ever recorded."""
    f = flight(mission(task_s=60.0))
    f.up_to_configurations()
    begun_s = f.now_s
    for k in range(2000):
        f.fleet["uav2"].recorder_problem = "" if k % 60 < 30 else "the disk is too slow"
        f.step()
        if f.machine.phase != "CONFIGURATIONS":
            break
    # task_s and 3 attempts of 4 times 2 s
    assert f.machine.phase == "LAND" and f.now_s - begun_s < 100.0
    assert "uav2 is not done with horizontal 4 m after 84 s: landing" in f.machine.detail


def test_a_pilot_who_does_not_give_back_keeps_his_vehicle_and_the_other_lands(flying):
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(0.3)
    before = len([o for _, o in flying.orders if o.vehicle == "uav2" and o.kind != "RECORD"])
    flying.wait(110.0)
    assert flying.machine.phase == "CONFIGURATIONS"
    flying.wait(60.0)
    assert (
        flying.machine.phase == "LAND"
        and not flying.fleet["uav1"].armed
        and flying.fleet["uav2"].mode == Mode.LOITER
    )
    assert (
        len([o for _, o in flying.orders if o.vehicle == "uav2" and o.kind != "RECORD"]) == before
    )
    assert "a vehicle in a pilot's hands for 120 s" in flying.machine.detail


def test_a_pilot_who_takes_the_reference_is_not_waited_for_and_the_other_goes_back(flying):
    flying.fleet["uav1"].mode = Mode.ALT_HOLD
    flying.until(lambda: not flying.fleet["uav2"].armed, 200.0)
    assert flying.fleet["uav1"].mode == Mode.ALT_HOLD
    apart = flying.fleet["uav2"].landed_at - flying.fleet["uav1"].p_home_cam
    assert apart[0] == pytest.approx(-3.5, abs=0.5) and abs(apart[1]) < 0.5


def test_guided_that_is_refused_for_ever_ends_with_a_landing(flight):
    f = flight(mission())
    f.fleet["uav2"].refuses = {"SET_MODE": "requires position"}
    f.up_to_home()
    f.press("execute")
    f.until(lambda: f.machine.phase == "LAND", 65.0)
    assert "GUIDED is not taken for 60 s: landing" in f.machine.detail
    f.wait(20.0)
    assert not f.fleet["uav1"].armed and f.fleet["uav2"].mode == Mode.LOITER
    assert "uav2 is flown by hand: land it (LOITER)" in f.machine.problems


@pytest.mark.parametrize("confirmed", [0, 1, 2])
def test_an_operator_who_never_confirms_is_not_waited_for(flight, confirmed):
    f = flight(mission())
    f.line_up()
    if confirmed > 0:
        f.press("calibrate")
        f.machine.answer("calibrate", True, "good")
    if confirmed > 1:
        f.press("set_home")
        f.home_known = True
        f.machine.answer("set_home", True, "set")
    f.wait(200.0)
    told = "the operator has not confirmed: after 300 s the mission ends, pilots land by hand"
    assert f.machine.phase in ("COLUMN", "MOVE_HOME", "SET_HOME") and told in f.machine.problems
    f.wait(110.0)
    assert (
        f.machine.phase == "LAND"
        and "uav1 is flown by hand: land it (LOITER)" in f.machine.problems
    )
    assert not [o for _, o in f.orders if o.kind != "RECORD"], (
        "hand-flown vehicles are not commanded"
    )


def test_a_calibration_that_never_answers_is_not_waited_for(flight):
    f = flight(mission(operator_s=30.0))
    f.line_up()
    f.press("calibrate")
    f.wait(29.0)
    assert f.machine.phase == "CALIBRATE"
    f.wait(3.0)
    assert f.machine.phase == "LAND"


def test_nobody_is_hurried_on_the_ground(flight):
    f = flight(mission())
    f.wait(400.0)
    assert f.machine.phase == "TAKE_OFF" and f.machine.problems == []


def test_a_way_back_that_is_lost_too_ends_with_a_landing(flight):
    f = flight(mission(30.0))
    f.up_to_configurations()
    f.wait(12.0)  # so far away that the way back takes longer than the rest of this test needs
    f.fleet["uav1"].battery_share = 0.15
    f.wait(22.0)
    assert f.machine.phase == "CONFIGURATIONS" and "a battery for 20 s" in f.machine.detail
    for v in f.fleet.values():
        v.heard = False
    f.wait(65.0)
    assert f.machine.phase == "LAND"
    for v in f.fleet.values():
        v.heard = True
    f.phase("ABORTED", 60.0)


def test_on_the_way_back_nobody_crosses_below_one_that_lands_by_itself(flight):
    f = flight(mission(30.0))
    f.up_to_configurations()
    f.wait(12.0)
    f.fleet["uav1"].battery_share = 0.15
    f.wait(22.0)
    assert f.machine.phase == "CONFIGURATIONS"
    f.fleet["uav1"].mode = Mode.LAND
    f.wait(0.3)
    assert f.machine.phase == "LAND" and f.fleet["uav2"].mode == Mode.LAND
    f.phase("ABORTED", 60.0)


def test_who_is_silent_since_it_stood_on_the_ground_may_fly_by_now(flight):
    f = flight(mission())
    f.phase("TAKE_OFF")
    f.fleet["uav2"].heard = False
    f.wait(1.0)
    f.machine.abort("stop")
    f.wait(10.0)
    assert f.machine.phase == "LAND" and any("uav2: not heard" in p for p in f.machine.problems)
    f.fleet["uav2"].heard = True
    f.phase("ABORTED", 5.0)


def test_a_second_abort_is_not_refused(flying):
    assert flying.operator.control("abort") == ""
    flying.wait(0.3)
    assert flying.machine.phase == "LAND" and flying.operator.control("abort") == ""
    flying.phase("ABORTED", 60.0)
    assert "the mission is over" in flying.operator.control("abort")


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(PauseLimits)])
@pytest.mark.parametrize("value", [0.0, -1.0, NAN, np.inf])
def test_a_limit_that_is_none_is_refused(field, value):
    with pytest.raises(ValueError, match=field):
        PauseLimits(**{field: value})


@pytest.mark.parametrize(
    "heard_first, height_m", [("disarmed", 8.0), ("armed", 8.3), ("height", 8.3)]
)
def test_height_of_one_that_flew_before_anything_was_heard_is_that_of_its_estimate(
    heard_first, height_m
):
    """Its estimate began at 0.3 m on the ground where it was heard there."""
    heard = VehicleTelemetry(np.eye(4))
    assert np.isnan(heard.view(0.0, None).height_m), "nothing is heard yet"
    if heard_first == "disarmed":
        heard.state(0.0, Mode.LOITER, False, True)
        heard.position(0.3)
    if heard_first != "height":
        heard.state(0.5, Mode.LOITER, True, True)
    heard.position(8.3)
    heard.state(1.0, Mode.LOITER, True, True)
    assert heard.view(1.0, None).height_m == pytest.approx(height_m)
