# SPDX-License-Identifier: Apache-2.0
"""Everybody is stopped: the core of /stop_all by hand, and a mission that goes on only when it is
told to."""

import pytest

from fcsv_control.mission.watches.telemetry import FrameEpochs, VehicleTelemetry
from fcsv_control.stopping.core import LAND, STOP, StopAll
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode

NAMES = ("uav1", "uav2")


class Desk:
    """The control PC's node, its time, and what it sent."""

    def __init__(self):
        self.core, self.now_s, self.sent = StopAll(NAMES), 50.0, []
        self.modes = dict.fromkeys(NAMES, Mode.GUIDED)
        self.armed = dict.fromkeys(NAMES, True)
        self.heard = set(NAMES)

    def run(self, seconds=0.02):
        """What was sent in this time, as (name, number, mode)."""
        sent = []
        for _ in range(max(1, int(round(seconds / 0.02)))):
            for name in self.heard:
                self.core.state(self.now_s, name, self.modes[name], self.armed[name])
            sent += [(o.vehicle, o.number, o.mode) for o in self.core.due(self.now_s)]
            self.now_s += 0.02
        return sent

    def report(self):
        return self.core.report(self.now_s)


@pytest.fixture
def desk():
    return Desk()


def test_nothing_is_sent_before_somebody_calls(desk):
    assert not desk.run(5.0) and desk.report().asked == ""


def test_who_was_stopped_and_lands_later_is_not_stopped_again(desk):
    """Rehearsed: a guardian that lands for its tracker's sake and this node took turns, once a
    second."""
    desk.core.begin(desk.now_s, STOP, "by hand")
    desk.modes["uav1"] = Mode.LAND  # before the call: it is stopped
    assert {name for name, _, _ in desk.run(0.5)} == {"uav1", "uav2"}
    desk.modes.update(uav1=Mode.BRAKE, uav2=Mode.BRAKE)
    assert not desk.run(1.0)
    desk.modes["uav1"] = Mode.LAND
    assert not desk.run(10.0) and desk.report().done == ["uav1", "uav2"]
    desk.modes["uav1"] = Mode.GUIDED
    assert {name for name, _, _ in desk.run(0.5)} == {"uav1"}
    desk.core.begin(desk.now_s, STOP, "again")
    desk.modes["uav1"] = Mode.LAND
    assert {name for name, _, _ in desk.run(0.5)} == {"uav1"}, "a new call stops who lands"


def test_everybody_is_told_at_once_and_again_every_fifth_of_a_second_until_the_mode_shows(desk):
    desk.run()
    desk.core.begin(desk.now_s, STOP, "by hand")
    assert desk.run() == [("uav1", 1, Mode.BRAKE), ("uav2", 2, Mode.BRAKE)]
    assert len(desk.run(2.0)) == pytest.approx(20, abs=2)
    desk.modes["uav1"] = Mode.BRAKE
    assert {name for name, _, _ in desk.run(1.0)} == {"uav2"}
    desk.core.acknowledged(desk.now_s, "uav2", 2, "")  # acknowledged is not enough
    assert not desk.run(0.9) and desk.run(0.3) == [("uav2", 3, Mode.BRAKE)], (
        "it showed on board for a moment"
    )
    report = desk.report()
    assert (report.done, report.under_way) == (["uav1"], ["uav2"])
    assert "stop all (by hand); done: uav1; under way: uav2" in report.in_words()
    desk.modes["uav2"] = Mode.BRAKE
    assert not desk.run(5.0)


def test_who_is_not_heard_is_named_and_told_for_as_long_as_it_takes(desk):
    desk.heard = {"uav1"}
    desk.modes["uav1"] = Mode.BRAKE
    desk.core.begin(desk.now_s, STOP, "")
    sent = desk.run(600.0)
    assert {(n, k) for n, k, _ in sent} == {("uav2", 1)} and len(sent) == pytest.approx(
        3000, rel=0.1
    )
    assert desk.report().unheard == ["uav2"] and "NOT HEARD: uav2" in desk.report().in_words()
    desk.core.end()
    assert not desk.run(1.0) and desk.report().asked == ""


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.ALT_HOLD, Mode.STABILIZE, Mode.RTL])
@pytest.mark.parametrize("asked", [STOP, LAND])
def test_who_is_flown_by_hand_is_not_commanded_but_named(desk, mode, asked):
    desk.modes["uav1"] = mode
    desk.run()
    desk.core.begin(desk.now_s, asked, "")
    assert {name for name, _, _ in desk.run(5.0)} == {"uav2"}
    assert desk.report().by_hand == ["uav1"] and "tell the pilot: uav1" in desk.report().in_words()


def test_a_brake_that_the_agent_knows_to_be_a_pilots_is_left_alone_and_told(desk):
    desk.modes["uav1"] = Mode.BRAKE
    desk.run()
    desk.core.begin(desk.now_s, LAND, "")
    [(_, number, _)] = [s for s in desk.run(1.2) if s[0] == "uav1"][:1]
    desk.core.acknowledged(
        desk.now_s, "uav1", number, "uav1 is flown by hand (BRAKE); tell its pilot", by_hand=True
    )
    assert desk.report().by_hand == ["uav1"]
    assert not [s for s in desk.run(0.9) if s[0] == "uav1"]
    assert {k for n, k, _ in desk.run(0.4) if n == "uav1"} == {number + 2}, (
        "asked anew: he may have given it back"
    )


def test_a_mission_that_lives_lands_everybody_itself(desk):
    desk.run()
    desk.core.begin(desk.now_s, LAND, "")
    assert not desk.run(0.9), "it is given a second to begin"
    for _ in range(10):
        desk.core.mission(desk.now_s, "LAND")
        assert not desk.run(0.5)
    assert desk.run(1.2), "it died"
    desk.armed = dict.fromkeys(NAMES, False)
    assert not desk.run(2.0) and desk.report().done == list(NAMES)


def test_stopping_waits_for_no_mission(desk):
    desk.core.mission(desk.now_s, "LAND")
    desk.core.begin(desk.now_s, STOP, "")
    assert desk.run()


# ---- the mission ---------------------------------------------------------------------------------


@pytest.fixture
def flying(flight):
    listed = [
        StereoConfiguration(axis, b, record_s=2.0)
        for axis, b in (("horizontal", 4.0), ("vertical", 5.0))
    ]
    f = flight(Mission("test", listed))
    f.up_to_configurations()
    f.wait(2.0)
    return f


def brake(flying):
    """The stop-all node's own commands."""
    flying.machine.stopped("by hand")
    for vehicle in flying.fleet.values():
        vehicle.mode, vehicle.target = Mode.BRAKE, None


def moving(flying, since):
    return [o.kind for _, o in flying.orders[since:] if o.kind not in ("RECORD", "HOLD")]


@pytest.mark.parametrize("slow_s", [0.0, 1.0])
def test_a_stopped_mission_orders_nothing_until_the_operator_resumes(flying, slow_s):
    begun = len(flying.orders)
    flying.machine.stopped("by hand")
    flying.wait(slow_s)  # the modes show later
    brake(flying)
    flying.wait(60.0)
    machine = flying.machine
    assert not moving(flying, begun) and machine.waits_for == "resume"
    assert any("everybody was stopped (by hand)" in p for p in machine.problems)
    assert not any(v.recording for v in flying.fleet.values())
    assert flying.operator.proceed("resume") == ""
    flying.phase("DONE", 600.0)
    assert len(machine.captures) == 2, "BRAKE was asked for by our side: it took them again"


def test_after_a_stop_a_pilots_vehicle_is_waited_for(flying):
    brake(flying)
    flying.wait(1.0)
    flying.fleet["uav2"].mode = Mode.ALT_HOLD
    flying.wait(1.0)
    assert flying.machine.waits_for == "" and "uav2" in " ".join(flying.machine.problems)
    flying.fleet["uav2"].mode = Mode.LOITER
    flying.wait(1.0)
    assert flying.operator.proceed("resume") == ""
    flying.phase("DONE", 600.0)


def test_an_abort_lands_from_a_stop(flying):
    brake(flying)
    flying.wait(1.0)
    flying.machine.abort("aborted by the operator")
    flying.phase("ABORTED", 120.0)


@pytest.mark.parametrize(
    "refuses, apart_m", [({}, 2.0), ({"SET_MODE": "its odometry began anew"}, 0.0)]
)
def test_who_was_stopped_above_another_goes_aside_before_it_lands_where_it_can(
    flying, refuses, apart_m
):
    flying.until(lambda: flying.fleet["uav2"].p_home_cam[2] > 4.9, 300.0)
    brake(flying)
    flying.wait(1.0)
    flying.fleet["uav2"].refuses = refuses
    flying.machine.abort("aborted by the operator")
    flying.phase("ABORTED", 120.0)
    apart = flying.fleet["uav1"].landed_at - flying.fleet["uav2"].landed_at
    assert (apart[0] ** 2 + apart[1] ** 2) ** 0.5 > apart_m


def test_a_landing_that_was_stopped_goes_on_when_the_operator_says_so(flying):
    flying.machine.abort("aborted by the operator")
    flying.wait(1.0)
    begun = len(flying.orders)
    brake(flying)
    flying.wait(20.0)
    assert (
        flying.machine.phase == "LAND"
        and not moving(flying, begun)
        and flying.machine.waits_for == "resume"
    )
    assert flying.operator.proceed("resume") == ""
    flying.phase("ABORTED", 120.0)


def test_before_the_mission_flies_a_stop_changes_nothing(flight):
    f = flight(Mission("test", [StereoConfiguration("horizontal", 4.0, record_s=2.0)]))
    f.machine.stopped("by hand")
    f.up_to_configurations()


# ---- the odometry's epoch, and ages --------------------------------------------------------------


def test_an_odometry_that_began_anew_holds_everybody_at_once_and_is_named(flying, monkeypatch):
    import dataclasses

    begun, snapshot = len(flying.orders), flying.snapshot
    problem = FrameEpochs(8, "the tracker was silent for 0.7 s", 7).problem

    def outdated():
        s = snapshot()
        return dataclasses.replace(
            s,
            vehicles={
                **s.vehicles,
                "uav2": dataclasses.replace(s.vehicles["uav2"], frame_problem=problem),
            },
        )

    monkeypatch.setattr(flying, "snapshot", outdated)
    flying.wait(0.2)
    assert [(o.vehicle, o.kind) for _, o in flying.orders[begun:] if o.kind != "RECORD"] == [
        ("uav1", "HOLD"),
        ("uav2", "HOLD"),
    ]
    assert flying.machine.problems[:1] == [
        "uav2: its odometry began anew (the tracker was silent for 0.7 s): calibrate and set home again"
    ]
    flying.wait(30.0)
    assert not moving(flying, begun)


def test_ages_are_counted_from_when_a_message_came():
    import numpy as np

    heard = VehicleTelemetry(np.eye(4))
    assert heard.view(5.0, None).pose_age_s == float("inf")
    heard.odometry(10.0, np.eye(4), (0.1, 0.0, 0.0))
    heard.state(10.5, Mode.GUIDED, True, True)
    heard.recorder(11.0, "", 3)
    view = heard.view(40.0, np.eye(4))
    assert (view.pose_age_s, view.state_age_s, view.recorder_age_s) == (30.0, 29.5, 29.0)
