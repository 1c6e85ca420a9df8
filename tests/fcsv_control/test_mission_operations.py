# SPDX-License-Identifier: Apache-2.0
"""What the operator may change while the list is flown: pause, resume, skip, repeat, next,
previous, which ones."""

import numpy as np
import pytest

from fcsv_control.mission.plans.task_list import TaskList, tasks
from fcsv_geometry.missions.flight_limits import PauseLimits
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode


def mission(*movers, **limits):
    movers = movers or (None, None, None)
    listed = [
        StereoConfiguration("horizontal", 4.0 + 2 * i, record_s=2.0, vehicle=v)
        for i, v in enumerate(movers)
    ]
    return Mission("test", listed, limits=PauseLimits(**limits))


@pytest.fixture
def flying(flight):
    f = flight(mission())
    f.up_to_configurations()
    return f


def until_recording(f, index):
    f.until(lambda: f.machine.configuration == index and f.fleet["uav2"].recording)
    f.wait(0.5)


def test_a_pause_holds_until_it_is_resumed(flying):
    until_recording(flying, 0)
    assert flying.operator.control("pause") == ""
    flying.wait(1.0)
    before = {n: v.T_home_body.copy() for n, v in flying.fleet.items()}
    flying.wait(60.0)
    for name, v in flying.fleet.items():
        np.testing.assert_array_equal(v.T_home_body, before[name])
        assert not v.recording and v.mode == Mode.GUIDED
    assert (
        flying.machine.waits_for == "resume"
        and "paused by the operator" in flying.machine.problems[0]
    )
    assert flying.operator.control("resume") == ""
    flying.phase("DONE", 200.0)
    assert flying.captured == [0, 1, 2]


def gone(f):
    return [at_s for at_s, order in f.orders if order.kind == "GOTO" and order.vehicle == "uav2"]


@pytest.mark.parametrize("change", ["resume", "skip", "repeat", "next"])
def test_nobody_sets_out_before_all_stand(flying, change):
    """Rehearsed with ten vehicles: who still swung back to where it was told to hold flew its next
    way 0.4 m beside the planned one, into another's downwash."""
    flying.until(lambda: flying.machine.stage == "moves" and len(gone(flying)) == 1)
    flying.wait(0.5)
    if change == "resume":
        flying.operator.control("pause")
        flying.wait(0.2)
    flying.fleet["uav2"].swings_mps = 0.5
    before, told_s = len(gone(flying)), flying.now_s
    assert flying.operator.control(change) == ""
    flying.wait(3.0)
    assert len(gone(flying)) == before and flying.machine.detail == "all come to a stand"
    flying.fleet["uav2"].swings_mps = 0.1  # as it turns, and then it swings back
    flying.wait(0.5)
    flying.fleet["uav2"].swings_mps = 0.5
    flying.wait(1.0)
    assert len(gone(flying)) == before
    flying.fleet["uav2"].swings_mps = 0.1
    flying.until(lambda: len(gone(flying)) > before)
    assert 5.5 < gone(flying)[before] - told_s < 6.5


def test_who_never_stands_is_not_waited_for(flying):
    flying.until(lambda: flying.machine.stage == "moves" and len(gone(flying)) == 1)
    flying.fleet["uav1"].swings_mps = 0.5  # in gusts
    flying.operator.control("repeat")
    told_s = flying.now_s
    flying.until(lambda: len(gone(flying)) > 1)
    assert 8.0 < gone(flying)[1] - told_s < 9.0


def test_a_pause_that_the_operator_forgets_ends(flight):
    f = flight(mission(operator_s=20.0))
    f.up_to_configurations()
    f.operator.control("pause")
    f.phase("ABORTED", 60.0)
    assert "the operator has not confirmed for 20 s" in f.machine.detail


def test_skip_leaves_the_running_one_out(flying):
    until_recording(flying, 1)
    assert flying.operator.control("skip") == ""
    flying.wait(0.3)
    assert not flying.fleet["uav2"].recording and flying.machine.configuration == 2
    flying.phase("DONE", 200.0)
    assert (
        flying.captured == [0, 2]
        and "horizontal 6 m left out by the operator" in flying.machine.detail
    )


def test_repeat_begins_the_running_one_again(flying):
    until_recording(flying, 1)
    assert flying.operator.control("repeat") == ""
    flying.wait(0.3)
    assert not flying.fleet["uav2"].recording
    flying.phase("DONE", 200.0)
    assert flying.captured == [0, 1, 2]


def test_next_puts_the_running_one_off(flying):
    until_recording(flying, 0)
    assert flying.operator.control("next") == ""
    flying.phase("DONE", 200.0)
    assert flying.captured == [1, 2, 0]


def test_previous_flies_the_one_before_again(flying):
    until_recording(flying, 1)
    assert flying.operator.control("previous") == ""
    flying.phase("DONE", 200.0)
    assert flying.captured == [0, 0, 1, 2]


def test_on_the_last_way_back_the_last_one_can_be_repeated(flying):
    flying.until(lambda: len(flying.machine.captures) == 3)
    assert "no configuration is left" in flying.operator.control("skip")
    assert flying.operator.control("repeat") == ""
    flying.phase("DONE", 200.0)
    assert flying.captured == [0, 1, 2, 2]


def test_what_cannot_be_done_is_said(flight):
    f = flight(mission())
    assert "is not one of pause, resume, skip" in f.operator.control("jump")
    assert "this is WAIT_VEHICLES" in f.operator.control("pause")
    assert "nothing is waited for" in f.operator.control("resume")
    f.up_to_configurations()
    assert "no configuration was flown before" in f.operator.control("previous")
    f.machine.finish("enough")
    assert "go back and land: enough" in f.operator.control("skip")
    f.phase("ABORTED", 60.0)


def test_who_is_away_goes_back_before_another_moves(flight):
    f = flight(mission("uav2", "uav3"), ("uav1", "uav2", "uav3"))
    f.up_to_configurations()
    until_recording(f, 0)
    f.operator.control("next")
    f.phase("DONE", 200.0)
    assert [(w.index, w.vehicle) for w in f.machine.captures] == [
        (1, "uav3"),
        (0, "uav2"),
    ] and f.closest_m > 1.45


def test_every_change_keeps_one_vehicle_away_at_a_time():
    """Random changes at random moments: nobody is sent out while another is not back in the
    column."""
    random = np.random.default_rng(7)
    m, names = mission("uav2", "uav3", "uav2", "uav3"), ("uav1", "uav2", "uav3")
    for _ in range(200):
        found = TaskList(m, names, tasks(m, names))
        away = None
        for _ in range(40):
            if not found.left:
                break
            task = found.left[0]
            assert away in (None, task.vehicle), "another one is still out"
            change = [found.skip, found.put_off, found.before, found.again][random.integers(4)]
            if random.random() < 0.4:
                away = task.vehicle  # it has begun to move
                change()
                continue
            away = None if task.index is None else task.vehicle
            found.done()


def test_chosen_configurations_are_flown_in_their_order(flight):
    f = flight(mission())
    f.line_up()
    assert "'execute' is not waited for in COLUMN" in f.operator.execute([0])
    f.press("calibrate")
    f.machine.answer("calibrate", True, "good")
    f.press("set_home")
    f.home_known = True
    f.machine.answer("set_home", True, "set")
    f.wait(1.2)
    assert "numbered 0..2, each once; got [3]" in f.operator.execute([3])
    assert "each once" in f.operator.execute([1, 1])
    assert f.operator.execute([2, 0]) == ""
    shares = []
    f.until(lambda: shares.append(f.machine.progress) or f.machine.phase == "DONE", 200.0)
    assert (
        f.captured == [2, 0] and sorted(set(shares)) == [0.0, 0.5, 1.0] and shares == sorted(shares)
    )


def test_finish_goes_back_to_the_column_and_lands(flying):
    until_recording(flying, 1)
    flying.machine.finish("cancelled")
    flying.phase("ABORTED", 100.0)
    apart = flying.fleet["uav2"].landed_at - flying.fleet["uav1"].landed_at
    assert apart[0] == pytest.approx(-3.5, abs=0.5) and flying.captured == [0]
