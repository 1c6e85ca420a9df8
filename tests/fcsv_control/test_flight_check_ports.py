# SPDX-License-Identifier: Apache-2.0
"""The flight check's ports: when a vehicle reports, what the control PC makes of it, and what an
operator accepts."""

import math

import pytest

from fcsv_control.agent.messages import AgentAlive
from fcsv_control.conditions import Grade
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import AutopilotLimits, ParametersChecked
from fcsv_control.flight_check.digest import ERROR, OK, Status
from fcsv_control.flight_check.fleet import FleetCheckRules
from fcsv_control.flight_check.fleet_port import FleetCheckPort
from fcsv_control.flight_check.keys import Keys
from fcsv_control.flight_check.lines import Line
from fcsv_control.flight_check.links import CHECKS, MAVLINK
from fcsv_control.flight_check.messages import (
    Accept,
    CheckReport,
    ClockMeasured,
    DiagnosticsCame,
    ParametersReported,
    PictureCounted,
    PositionCounted,
    StopStandsBy,
    TagsCame,
    TrackerTrusts,
    VehicleReported,
    WorstDiagnostics,
)
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import Disk
from fcsv_control.flight_check.vehicle_port import VehicleCheckPort
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_tracking.devices.clocks import ClockOffset

CHECKED = ParametersChecked(
    "t265", "", True, [], [], [], AutopilotLimits(FlightBounds().autopilot_parameters)
)
RECORDER = RecorderReport("/out/a.bag", False, 0, 0, 0, math.inf, "")


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


# ---- on board ------------------------------------------------------------------------------------


class OnBoard:
    """A vehicle's port, stepped as the node does; ``said``: its reports with their times."""

    def __init__(self, report_bytes=200):
        self.port = VehicleCheckPort(
            "uav1",
            CHECKS[MAVLINK],
            VehicleCheckRules(),
            lambda lines: report_bytes,
            lambda statuses: 60 * len(statuses),
        )
        self.said, self.worst = [], []

    def fly(self, begin_s, end_s, tell=lambda now_s: ()):
        for k in range(round(2 * begin_s), round(2 * end_s)):
            for message in tell(0.5 * k):
                self.port.receive(0.5 * k, message)
            out = self.port.step(0.5 * k)
            self.said += [(0.5 * k, r) for r in of(out, CheckReport)]
            self.worst += [(0.5 * k, w.statuses) for w in of(out, WorstDiagnostics)]

    def state(self, name):
        return next(li.state for li in self.said[-1][1].lines if li.name == name)


def test_a_report_comes_every_second_and_at_once_where_a_line_changes():
    v = OnBoard()
    v.fly(0.0, 5.0)
    assert [at_s for at_s, _ in v.said] == [0.0, 1.0, 2.0, 3.0, 4.0]
    v.fly(5.0, 6.0, lambda _: [AgentAlive("agent", 0.0, 0.0)])
    assert v.said[-1][0] in (5.0, 5.5) and v.state("agent") is Grade.GREEN
    assert all(report.next_s == 1.0 for _, report in v.said)


def test_a_report_that_is_large_comes_less_often_and_says_when():
    v = OnBoard(report_bytes=500)
    v.fly(0.0, 20.0)
    assert len(v.said) == pytest.approx(10, abs=1)
    assert {report.next_s for _, report in v.said} == {2.0}


@pytest.mark.parametrize(
    "message, name",
    [
        (TrackerTrusts(1e-3), "tracker"),
        (tm.BatteryCharge("uav1", "", 0.9), "battery"),
        (RECORDER, "recorder"),
        (Disk(50000.0), "disk"),
        (AgentAlive("agent", 0.0, 0.0), "agent"),
        (Keys(True), "keys"),
        (PictureCounted(), "camera"),
    ],
)
def test_what_is_heard_makes_its_own_line_green(message, name):
    v = OnBoard()
    v.fly(0.0, 6.0, lambda _: [message])
    green = {li.name for li in v.said[-1][1].lines if li.state is Grade.GREEN}
    assert green == {name}
    v.fly(6.0, 20.0)
    assert v.state(name) is not Grade.GREEN, "it is silent"


def test_diagnostics_that_are_wrong_go_out_at_once_and_so_does_their_end():
    v = OnBoard()
    v.fly(0.0, 4.0)
    v.fly(4.0, 5.0, lambda _: [DiagnosticsCame([Status("uav1/tags", ERROR, "no camera")])])
    assert v.worst[-1] == (4.0, (Status("uav1/tags", ERROR, "no camera"),)) or v.worst[-1][0] == 4.5
    v.fly(5.0, 7.0, lambda _: [DiagnosticsCame([Status("uav1/tags", OK, "")])])
    assert v.worst[-1][1] == ()


def test_what_a_vehicles_check_does_not_know_is_refused():
    with pytest.raises(TypeError, match="takes no str"):
        OnBoard().port.receive(0.0, "a text")


# ---- on the control PC ---------------------------------------------------------------------------


def reported(name, battery=Grade.GREEN, named=None):
    lines = [Line(name, "battery", battery, "31%")]
    return VehicleReported(name, named or name, lines, patience_s=4.0)


def heard(port, now_s, battery=Grade.GREEN):
    """A second of everything, of two vehicles that are well, but for the second's battery."""
    for name, state in (("uav1", Grade.GREEN), ("uav2", battery)):
        port.receive(now_s, reported(name, state))
        port.receive(now_s, ParametersReported(name, CHECKED))
        port.receive(now_s, ClockMeasured(name, 0.5, ClockOffset(now_s, 0.001, 0.002)))
        for k in range(30):
            port.receive(now_s + k / 30.0, PositionCounted(name))
    for message in (
        TagsCame("uav2", [0, 77]),
        tm.MissionPhase("COLUMN"),
        MissionAlive("mission", now_s),
        StopStandsBy(),
        RECORDER,
        Disk(9000.0),
        Keys(True),
    ):
        port.receive(now_s, message)


def wrong(out):
    (report,) = of(out, CheckReport)
    return {(li.vehicle, li.name): li.state for li in report.lines if not li.passes}


@pytest.fixture
def port():
    tags = {"uav1": 0, "uav2": 1}
    port = FleetCheckPort(tags, FleetCheckRules(), "relay", planned=FlightBounds())
    assert set(wrong(port.step(0.0)).values()) <= {Grade.RED, Grade.UNKNOWN, Grade.AMBER}
    for now_s in (1.0, 2.0, 3.0):
        heard(port, now_s)
    return port


def test_a_fleet_that_is_well_is_green(port):
    assert wrong(port.step(4.0)) == {}
    assert port.step(4.4) == [], "nothing changed, and a second has not passed"
    assert wrong(port.step(5.0)) == {}


def test_what_changed_is_told_at_once_and_an_acceptance_too(port):
    port.step(4.0)
    port.receive(4.1, reported("uav2", Grade.AMBER))
    assert wrong(port.step(4.2)) == {("uav2", "battery"): Grade.AMBER}
    answer, *out = port.serve(4.3, Accept("uav2", "battery"))
    assert answer == tm.Reply(True, "uav2 battery: accepted by the operator")
    assert wrong(out) == {}


def test_what_is_not_amber_is_not_accepted(port):
    port.step(4.0)
    answer, *_ = port.serve(4.1, Accept("uav1", "battery"))
    assert not answer.done and "only amber lines" in answer.text


def test_a_report_on_anothers_topic_is_dropped_and_named(port):
    port.step(4.0)
    port.receive(4.1, reported("uav2", Grade.RED, named="uav1"))
    (dropped,) = of(port.step(4.2), tm.Dropped)
    assert "on uav2's topic comes one of 'uav1'" in dropped.why
    assert wrong(port.step(5.0)) == {}


def test_an_odometry_that_began_anew_is_not_calibrated_any_more(port):
    def tags(now_s):
        (report,) = of(port.step(now_s), CheckReport)
        return next(li for li in report.lines if (li.vehicle, li.name) == ("uav2", "tags"))

    port.receive(20.0, tm.OdometryEpoch("uav2", "", 7, ""))
    assert tags(20.0).state is Grade.AMBER
    port.receive(21.0, tm.EpochsFound(tm.HOME, 21.0, {"uav2": 7}))
    assert tags(21.0).state is Grade.AMBER, "home is no calibration"
    port.receive(22.0, tm.EpochsFound(tm.CALIBRATION, 22.0, {"uav2": 7}))
    assert tags(22.0).state is Grade.GREEN
    port.receive(23.0, tm.OdometryEpoch("uav2", "", 8, "it jumped"))
    assert tags(23.0).state is Grade.AMBER


def test_what_the_fleets_check_does_not_know_is_refused(port):
    with pytest.raises(TypeError, match="takes no VehicleState"):
        port.receive(0.0, tm.VehicleState("uav1", "", Mode.LOITER, True, True))
    with pytest.raises(TypeError, match="does not serve str"):
        port.serve(0.0, "accept")
