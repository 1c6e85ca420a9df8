# SPDX-License-Identifier: Apache-2.0
"""What must be true before take-off: each line by what was heard, with an age; the table, its exit
status, its page."""

import doctest
import importlib
import math
import re
from dataclasses import fields, replace

import pytest

from fcsv_control.agent.messages import AgentAlive
from fcsv_control.conditions import Grade
from fcsv_control.flight.messages import AutopilotLimits, LinkLives, ParametersChecked
from fcsv_control.flight_check import speeds, table
from fcsv_control.flight_check.acceptance import Acceptances
from fcsv_control.flight_check.fleet import (
    CONTROL_CHECKS,
    FLEET_CHECKS,
    FleetCheckRules,
    FleetTable,
)
from fcsv_control.flight_check.keys import Keys
from fcsv_control.flight_check.lines import Judged, Line, worst
from fcsv_control.flight_check.links import CHECKS, TELLO_CHECKS
from fcsv_control.flight_check.pace import Pace
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import VEHICLE_CHECKS, Disk, VehicleFacts
from fcsv_control.guardian.messages import Cause, Forbidden, GuardianVerdict
from fcsv_control.guardian.rules import GuardianRules
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry import config
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_tracking.devices.clocks import ClockOffset

NAN, INF = float("nan"), float("inf")
G, A, R, U = Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN


def link(**changed):
    """The flight link of a vehicle that may take off."""
    well = {
        "connected": True,
        "ekf_flags": 0x33F,
        "ekf_variance": 0.1,
        "ekf_age_s": 0.1,
        "throttle": -1.0,
        "throttle_age_s": 0.1,
        "origin_set": True,
        "feed_rate_hz": 30.0,
        "feed_age_s": 0.03,
        "estimate_apart_m": 0.02,
        "doubt": "",
        "in_the_air": False,
        "prearm_ok": True,
        "system_status": 3,
        "parameters_ok": True,
        "parameter": "",
        "pid": 1,
    }
    return LinkLives(**{**well, **changed})


def parameters(limits=None, **changed):
    told = {"profile": "t265", "firmware": "", "complete": True, "blocks": [], "advises": []}
    return ParametersChecked(
        **{**told, "unknown": [], "limits": AutopilotLimits(limits or {}), **changed}
    )


def recorder(problem="", dropped=0):
    return RecorderReport("/out/uav1.bag", False, 0, 0, dropped, NAN, problem)


def agent(problem=""):
    return AgentAlive("agent-1", 0.0, 0.0, problem=problem)


STICK, NO_POSES, NO_ORIGIN = (
    Forbidden("the throttle stick", Cause.STICK),
    Forbidden("no poses", Cause.NO_POSES),
    Forbidden("the autopilot has no origin yet"),
)


def guardian(*forbids, **changed):
    """``forbids``: the stick, where nothing is given."""
    return GuardianVerdict(forbidden=forbids or (STICK,), **changed)


class Vehicle:
    """A vehicle that is well; what is told to ``facts`` afterwards counts. Time stands still at 100
    s."""

    now_s = 100.0

    def __init__(self):
        self.facts = f = VehicleFacts()
        self.judged = Judged("uav1", VEHICLE_CHECKS)
        for k in reversed(range(90)):
            f.positions.tell(self.now_s - k / 30.0)
        for k in reversed(range(6)):
            f.pictures.tell(self.now_s - k)
        self.tell(
            link=link(),
            parameters=parameters(),
            armed=False,
            battery_share=0.9,
            tracker_variance_m2=1e-3,
            recorder=recorder(),
            disk=Disk(50000.0),
            guardian=guardian(),
            agent=agent(),
            keys=Keys(False),
        )

    def tell(self, **facts):
        for name, value in facts.items():
            getattr(self.facts, name).tell(self.now_s, value)

    def lines(self, later_s=0.0):
        lines = self.judged.lines(self.now_s + later_s, self.facts, VehicleCheckRules())
        return {line.name: line for line in lines}

    def not_green(self, later_s=0.0):
        return {n: line.state for n, line in self.lines(later_s).items() if line.state is not G}


def test_a_vehicle_that_is_well_is_green():
    v = Vehicle()
    assert v.not_green() == {} and len(v.lines()) == len(VEHICLE_CHECKS)
    assert not any(line.remedy for line in v.lines().values())


def test_nothing_heard_is_never_green():
    lines = Judged("uav1", VEHICLE_CHECKS).lines(5.0, VehicleFacts(), VehicleCheckRules())
    assert {line.state for line in lines} == {R, U} and all(
        line.what and line.remedy for line in lines
    )


def test_what_was_heard_long_ago_is_never_green():
    assert set(Vehicle().not_green(later_s=10.0)) == {check.name for check in VEHICLE_CHECKS}


@pytest.mark.parametrize(
    "told, found, words",
    [
        ({"link": link(connected=False)}, {"link": R}, "no heartbeat"),
        ({"link": link(ekf_age_s=INF)}, {"streams": R, "ekf": U}, "filter"),
        ({"link": link(prearm_ok=False)}, {"pre-arm": R}, "not ready to arm"),
        ({"link": link(prearm_ok=None)}, {"pre-arm": U}, "has not said"),
        ({"link": link(prearm_ok=False), "armed": True}, {}, ""),
        ({"link": link(origin_set=False)}, {"origin": R}, "no origin"),
        (
            {"parameters": parameters(blocks=["A is 1", "B is 2"])},
            {"parameters": R},
            "A is 1, and 1 more",
        ),
        (
            {"parameters": parameters(blocks=["A is 1"], complete=False)},
            {"parameters": R},
            "A is 1",
        ),
        ({"parameters": parameters(complete=False)}, {"parameters": U}, "are being read"),
        ({"parameters": parameters(advises=["C is 3"])}, {"parameters": A}, "C is 3"),
        ({"link": link(ekf_flags=0x33F & ~0x10)}, {"ekf": R}, "no horizontal position"),
        ({"link": link(ekf_flags=0x33F | 0x80)}, {"ekf": R}, "constant position"),
        ({"link": link(ekf_variance=0.6)}, {"ekf": A}, "0.6"),
        ({"link": link(ekf_variance=0.9)}, {"ekf": R}, "0.9"),
        ({"link": link(ekf_variance=NAN)}, {"ekf": U}, "not known"),
        ({"link": link(estimate_apart_m=0.3)}, {"estimate": A}, "0.3 m"),
        ({"link": link(estimate_apart_m=0.6)}, {"estimate": R}, "0.6 m"),
        ({"link": link(estimate_apart_m=0.4, in_the_air=True), "armed": True}, {}, ""),
        (
            {"link": link(estimate_apart_m=1.1, in_the_air=True), "armed": True},
            {"estimate": R},
            "1.1 m",
        ),
        ({"link": link(estimate_apart_m=NAN)}, {"estimate": U}, "not known"),
        ({"link": link(feed_rate_hz=12.0)}, {"feed": A}, "12 poses"),
        ({"link": link(feed_rate_hz=5.0)}, {"feed": R}, "5 poses"),
        ({"link": link(feed_age_s=0.6)}, {"feed": R}, "no pose"),
        ({"link": link(feed_age_s=NAN)}, {"feed": R}, "no pose"),
        ({"link": link(doubt="it is frozen")}, {"feed": R}, "frozen"),
        ({"link": link(throttle=NAN)}, {"transmitter": R}, "no transmitter"),
        ({"link": link(throttle_age_s=3.0)}, {"transmitter": R}, "no transmitter"),
        ({"tracker_variance_m2": 0.1}, {}, ""),
        ({"tracker_variance_m2": 1.0}, {"tracker": R}, "low confidence"),
        ({"tracker_variance_m2": 0.0}, {"tracker": A}, "tells no confidence"),
        ({"battery_share": 0.39}, {"battery": A}, "39%"),
        ({"battery_share": 0.19}, {"battery": R}, "19%"),
        ({"battery_share": NAN}, {"battery": R}, "is not known"),
        ({"recorder": recorder("disk full", 0)}, {"recorder": R}, "disk full"),
        ({"recorder": recorder("", 3)}, {"recorder": A}, "3 messages"),
        ({"disk": Disk(5000.0, math.inf)}, {"disk": A}, "4.9 GiB free"),
        ({"disk": Disk(5000.0, 8561.0)}, {"disk": A}, "enough for over 99 h"),
        ({"disk": Disk(5000.0, 12.0)}, {"disk": A}, "enough for 12 min"),
        ({"disk": Disk(900.0)}, {"disk": R}, "0.9 GiB"),
        ({"guardian": guardian(STICK, NO_ORIGIN)}, {"guardian": R}, "no origin"),
        (
            {"guardian": guardian(action="hold", reasons=("the agent is silent",))},
            {"guardian": R},
            "hold: the agent",
        ),
        ({"guardian": guardian(lost=True)}, {"guardian": R}, "lost"),
        ({"agent": agent("a twin lives")}, {"agent": R}, "twin"),
        ({"keys": Keys(True)}, {}, ""),
        ({"keys": Keys(True, "they run out on 2026-12-01")}, {"keys": A}, "run out"),
        (
            {"keys": Keys(True, "", "ROS is open to the network: 10.0.0.1:11311")},
            {"keys": R},
            "open",
        ),
    ],
)
def test_one_fault_changes_its_own_lines_only(told, found, words):
    v = Vehicle()
    v.tell(**told)
    if "no heartbeat" in words:  # whatever the autopilot says is not known then
        assert found.items() <= v.not_green().items()
    else:
        assert v.not_green() == found
    for name in found:
        line = v.lines()[name]
        assert line.remedy == {c.name: c.remedy for c in VEHICLE_CHECKS}[name]
    assert not found or any(words in v.lines()[name].what for name in found)


def test_a_low_rate_of_positions_and_pictures():
    v = Vehicle()
    v.facts.positions, v.facts.pictures = VehicleFacts().positions, VehicleFacts().pictures
    for k in reversed(range(30)):
        v.facts.positions.tell(v.now_s - k / 10.0)
    v.facts.pictures.tell(v.now_s - 5.0)
    assert v.not_green() == {"streams": A, "camera": A}
    assert v.not_green(later_s=1.5)["camera"] is R


def test_the_autopilots_own_words():
    v = Vehicle()
    v.tell(link=link(prearm_ok=False))
    v.facts.texts.add(v.now_s - 31.0, "PreArm: RC not found")
    v.facts.texts.add(v.now_s - 1.0, "PreArm: AHRS: waiting for home")
    v.facts.texts.add(v.now_s - 0.9, "PreArm: VisOdom: not healthy")
    v.facts.texts.add(v.now_s - 0.8, "Field Elevation Set: 0m")
    assert v.lines()["pre-arm"].what == "AHRS: waiting for home; VisOdom: not healthy"


def test_since_when_a_line_is_so():
    v = Vehicle()
    judged = Judged("uav1", [c for c in VEHICLE_CHECKS if c.name == "battery"])

    def battery(at_s, share):
        v.facts.battery_share.tell(at_s, share)
        return judged.lines(at_s, v.facts, VehicleCheckRules())[0]

    assert battery(0.0, 0.9).since_s == 0.0 and battery(7.0, 0.8).since_s == 7.0
    assert battery(9.0, 0.3).since_s == 0.0 and battery(12.0, 0.25).since_s == 3.0


def test_bounds_that_forbid_guided_are_those_of_the_guardian():
    rules, guard = VehicleCheckRules(), GuardianRules()
    assert (rules.red_feed_hz, rules.red_ekf_variance, rules.red_apart_m, rules.red_battery) == (
        guard.feed_warn_hz,
        guard.ekf_variance,
        guard.apart_m,
        guard.low_battery,
    )


@pytest.mark.parametrize(
    "wrong",
    [{"red_battery": 0.5}, {"amber_feed_hz": 5.0}, {"silent_s": 0.0}, {"amber_disk_mib": NAN}],
)
def test_bounds_that_contradict_each_other_are_refused(wrong):
    with pytest.raises(ValueError, match="_"):
        VehicleCheckRules(**wrong)


# ---- behind other flight links -------------------------------------------------------------------


@pytest.fixture
def tello(root):
    """A Tello that is well, and what is not green of it after it was told something."""
    v, rules = Vehicle(), config.load(root / "config/tello/flight_check.yaml", VehicleCheckRules)
    v.judged = Judged("tello1", TELLO_CHECKS)
    v.tell(link=tello_link())
    v.lines = lambda later_s=0.0: {
        li.name: li for li in v.judged.lines(v.now_s + later_s, v.facts, rules)
    }
    return v


def tello_link(**changed):
    """A Tello's has no filter and no pre-arm state."""
    return link(
        ekf_flags=0,
        ekf_variance=NAN,
        ekf_age_s=0.0,
        throttle=0.0,
        feed_rate_hz=8.0,
        feed_age_s=0.4,
        estimate_apart_m=NAN,
        prearm_ok=None,
        **changed,
    )


def test_a_tello_that_is_well_is_green_and_nothing_heard_is_not(tello):
    assert tello.not_green() == {} and set(tello.not_green(later_s=10.0)) == {
        c.name for c in TELLO_CHECKS
    }
    lines = Judged("tello1", TELLO_CHECKS).lines(5.0, VehicleFacts(), VehicleCheckRules())
    assert {line.state for line in lines} == {R, U} and all(
        line.what and line.remedy for line in lines
    )


@pytest.mark.parametrize(
    "told, found, words, remedy",
    [
        (
            {"link": {"connected": False}},
            {"link": R, "flight data": U, "transmitter": U},
            "",
            "Wi-Fi",
        ),
        (
            {"link": {"in_the_air": None}},
            {"flight data": R},
            "does not say whether it flies",
            "firmware",
        ),
        ({"link": {"feed_rate_hz": 5.0}}, {"feed": A}, "5 poses", "tracker on the ground"),
        (
            {"link": {"feed_rate_hz": 2.0, "in_the_air": True}},
            {"feed": R},
            "2 poses",
            "tracker on the ground",
        ),
        (
            {"link": {"feed_age_s": 0.9, "in_the_air": True}},
            {"feed": R},
            "no pose",
            "tracker on the ground",
        ),
        (
            {"link": {"feed_age_s": 0.9, "in_the_air": False}},
            {"feed": A},
            "it stands",
            "tracker on the ground",
        ),
        (
            {"link": {"doubt": "poses that cannot be", "in_the_air": False}},
            {"feed": R},
            "cannot be",
            "tracker on the ground",
        ),
        ({"link": {"throttle": NAN}}, {"transmitter": R}, "no transmitter", "joy_node"),
        ({"guardian": guardian(STICK, NO_POSES)}, {}, "", ""),
        ({"battery_share": NAN}, {"battery": R}, "is not known", "change it"),
        ({"battery_share": 0.3}, {"battery": A}, "30%", "change it"),
    ],
)
def test_one_fault_of_a_tello(tello, told, found, words, remedy):
    tello.tell(**({"link": replace(tello_link(), **told["link"])} if "link" in told else told))
    assert tello.not_green() == found
    for name in list(found)[:1]:
        line = tello.lines()[name]
        assert words in line.what and remedy in line.remedy


def test_in_the_air_a_tello_that_no_tracker_sees_may_not_be_handed_over(tello):
    tello.tell(link=tello_link(in_the_air=True), guardian=guardian(NO_POSES))
    assert tello.not_green() == {"guardian": R}


def test_mavros_has_the_same_lines_with_remedies_of_its_own(root):
    text = (
        (root / "docs/user/flight_check.md")
        .read_text()
        .split("| line of MAVROS |")[1]
        .split("\n\n")[0]
    )
    said = dict(re.findall(r"^\| `([a-z]+)` \| (.+) \|$", text, re.M))
    ours, theirs = ({c.name: c for c in CHECKS[kind]} for kind in ("mavlink", "mavros"))
    assert list(ours) == list(theirs) and all(ours[n].grade is theirs[n].grade for n in ours)
    assert {n: c.remedy for n, c in theirs.items() if c.remedy != ours[n].remedy} == said
    assert "does not sign" in said["signing"]


def test_beside_a_tracker_on_the_ground_no_radio_clock_or_tag_is_looked_for():
    table = FleetTable(["tello1"], {"tello1": 0}, FleetCheckRules(), "relay", ground=True)
    names = [(line.vehicle, line.name) for line in table.lines(9.0)]
    assert ("tello1", "check") in names and len(names) == len(CONTROL_CHECKS)
    assert ("control", "keys") not in names and "tello.launch" in table.lines(9.0)[-1].remedy


# ---- the table -----------------------------------------------------------------------------------


def test_the_worst_line_decides():
    line = lambda state, accepted=False: Line("uav1", "battery", state, "31%", accepted=accepted)  # noqa: E731
    assert (
        worst([line(G), line(A)]) is A
        and worst([line(U), line(A)]) is U
        and worst([line(U), line(R)]) is R
    )
    assert (
        table.exit_status([line(G), line(A)]) == 1
        and table.exit_status([line(G), line(A, True)]) == 0
    )
    assert table.exit_status([]) == 2
    assert [line(s, True).passes for s in (G, A, R, U)] == [True, True, False, False]


def test_colours_change_no_word():
    lines = list(Vehicle().lines().values()) + [Line("uav2", "feed", R, "no pose", "check it", 3.0)]
    plain = table.render(lines)
    assert re.sub(r"\033\[\d+m", "", table.render(lines, colours=True)) == plain
    assert len(plain.splitlines()) == len(lines) + 2 and "RED" in plain and "-> check it" in plain


def test_a_report_of_a_vehicle_that_is_well_comes_every_second():
    """161 bytes of content and 80 around it (measured 2026-11-25), in 2 kbit/s."""
    from fcsv_control.ros.checks.flight_check_messages import size_bytes
    from fcsv_msgs.msg import FlightCheck

    green = " ".join(check.name for check in VEHICLE_CHECKS)
    assert Pace().period_s(size_bytes(FlightCheck(vehicle="uav1", green=green)) + 80) == 1.0


def test_reports_take_no_more_of_the_radio_than_they_may():
    """As much as a wholly red report in which something changes at every step for a minute."""
    pace, sent = Pace(bytes_per_s=250.0, burst_bytes=4000.0), 0
    for k in range(120):
        sent += 2000 * pace.due(0.5 * k, 2000, changed=True)
    assert 60 * 250 - 2000 <= sent <= 60 * 250 + 4000


@pytest.mark.parametrize(
    "name", ["lines", "pre_arm_texts", "pace", "table", "vehicle", "sightings", "acceptance"]
)
def test_examples(name):
    assert doctest.testmod(importlib.import_module(f"fcsv_control.flight_check.{name}")).failed == 0


# ---- the fleet -----------------------------------------------------------------------------------


class Fleet:
    """Three vehicles that are well, with a control PC that is, at 100 s."""

    now_s = 100.0
    names = ("uav1", "uav2", "uav3")

    def __init__(self, planned=None):
        tags = {n: i for i, n in enumerate(self.names)}
        self.table = FleetTable(self.names, tags, FleetCheckRules(), "relay", planned=planned)
        c = self.table.control
        c.mission.tell(self.now_s, "WAIT_VEHICLES")
        c.stop_all.tell(self.now_s, True)
        c.recorder.tell(self.now_s, recorder())
        c.disk.tell(self.now_s, Disk(9000.0))
        c.keys.tell(self.now_s, Keys(False))
        for v in self.table.vehicles.values():
            v.report.tell(self.now_s, [Line(v.name, "feed", G, "30 poses a second", since_s=7.0)])
            v.patience_s = 4.0
            v.clock.tell(self.now_s, ClockOffset(self.now_s, 0.001, 0.002))
            for k in reversed(range(90)):
                v.poses.tell(self.now_s - k / 30.0)
        self.see(self.now_s - 1.0)
        self.see(self.now_s)

    def see(self, at_s):
        self.table.sightings.saw(at_s, "uav2", [0])
        self.table.sightings.saw(at_s, "uav3", [1, 99])

    def lines(self, later_s=0.0):
        return {(li.vehicle, li.name): li for li in self.table.lines(self.now_s + later_s)}

    def not_green(self, later_s=0.0):
        return {key: line.state for key, line in self.lines(later_s).items() if line.state is not G}


def test_a_fleet_that_is_well_is_green():
    fleet = Fleet()
    assert fleet.not_green() == {}
    assert len(fleet.lines()) == len(CONTROL_CHECKS) + 3 * (len(FLEET_CHECKS) + 1)
    assert fleet.lines(3.0)["uav1", "feed"].since_s == pytest.approx(10.0)


def test_nothing_heard_of_a_fleet_is_never_green_but_that_one_flies_in_front():
    table = FleetTable(["uav1", "uav2"], {"uav1": 0, "uav2": 1}, FleetCheckRules(), "relay")
    green = [(line.vehicle, line.name) for line in table.lines(9.0) if line.state is G]
    assert green == [("uav1", "tags")]
    assert table.lines(9.0)[-1].what == "does not see uav1, and never did; seen by nobody"


def test_a_vehicle_that_is_not_heard_any_more_shows_none_of_its_own_lines():
    lines = Fleet().lines(later_s=4.5)
    assert ("uav2", "feed") not in lines and lines[
        "uav2", "check"
    ].what == "its own flight check is not heard any more"
    assert lines["uav2", "radio"].state is R


def test_who_does_not_see_its_tag_and_since_when():
    fleet = Fleet()
    assert fleet.lines()["uav2", "tags"].what == "sees uav1, for 1 s; seen by uav3"
    line = fleet.lines(12.0)["uav2", "tags"]
    assert line.state is A and line.what == "does not see uav1, for 12 s; seen by nobody"
    v = fleet.table.vehicles["uav2"]
    v.epoch, v.calibrated = 7, 7
    assert fleet.lines(12.0)["uav2", "tags"].state is G
    v.epoch = 8  # its odometry began anew: it must be seen again, and calibrated
    assert fleet.lines(12.0)["uav2", "tags"].state is A


@pytest.mark.parametrize(
    "offset_s, uncertainty_s, state",
    [(0.019, 0.0, G), (-0.021, 0.0, A), (0.03, 0.02, G), (0.6, 0.01, R)],
)
def test_clocks_count_as_apart_where_they_are_so_for_sure(offset_s, uncertainty_s, state):
    fleet = Fleet()
    fleet.table.vehicles["uav3"].clock.tell(
        fleet.now_s, ClockOffset(fleet.now_s, offset_s, uncertainty_s)
    )
    assert fleet.not_green() == ({} if state is G else {("uav3", "clock"): state})


def test_the_control_pcs_own_programs():
    fleet = Fleet()
    c = fleet.table.control
    c.recorder.tell(fleet.now_s, recorder("disk full", 0))
    c.disk.tell(fleet.now_s, Disk(1500.0))
    c.link = "fkie"
    assert fleet.not_green() == {
        ("control", "recorder"): R,
        ("control", "disk"): A,
        ("control", "keys"): A,
    }
    gone = {
        n for (v, n), s in fleet.not_green(later_s=20.0).items() if v == "control" and s in (R, U)
    }
    assert gone == {"mission", "stop-all", "recorder", "disk"}


def limits(**changed):
    """The parameters of an autopilot that flies as fast as missions plan with, but for
    what is changed."""
    values = {**FlightBounds().autopilot_parameters, **changed}
    return parameters(values)


@pytest.mark.parametrize(
    "planned, report, state, words",
    [
        ({}, limits(), G, "2 m/s, as planned"),
        ({}, limits(WPNAV_SPEED=201.0), G, "as planned"),
        ({"speed_mps": 1.0}, limits(), R, "faster than planned: WPNAV_SPEED is 200, planned 100"),
        ({"speed_mps": 1.0}, limits(WPNAV_SPEED=100.0), G, "1 m/s"),
        (
            {"speed_mps": 1.0, "acceleration_mps2": 0.5},
            limits(),
            R,
            "WPNAV_SPEED is 200, planned 100; WPNAV_ACCEL is 150",
        ),
        (
            {},
            limits(WPNAV_SPEED_DN=50.0),
            A,
            "slower than planned: WPNAV_SPEED_DN is 50, planned 150",
        ),
        (
            {},
            limits(WPNAV_SPEED_DN=50.0, WPNAV_SPEED_UP=160.0),
            R,
            "faster than planned: WPNAV_SPEED_UP is 160",
        ),
        ({}, limits(WPNAV_ACCEL_Z=NAN), A, "not known of it: WPNAV_ACCEL_Z"),
        ({}, parameters(), A, "WPNAV_SPEED, WPNAV_SPEED_UP"),
        ({}, replace(limits(WPNAV_SPEED=NAN), complete=False), U, "being read"),
        ({}, None, U, "not heard"),
    ],
)
def test_an_autopilot_flies_as_fast_as_the_mission_plans(planned, report, state, words):
    fleet = Fleet(FlightBounds(**planned))
    for v in fleet.table.vehicles.values():
        v.parameters = limits(
            WPNAV_SPEED=100.0 * planned.get("speed_mps", 2.0),
            WPNAV_ACCEL=100.0 * planned.get("acceleration_mps2", 1.5),
        )
    fleet.table.vehicles["uav2"].parameters = report
    assert fleet.not_green() == ({} if state is G else {("uav2", "speed"): state})
    line = fleet.lines()["uav2", "speed"]
    assert words in line.what and (
        state is G or "parameters write LINE --set NAME=PLANNED" in line.remedy
    )
    assert fleet.lines(later_s=20.0)["uav2", "speed"].state is U, "of a vehicle that is not heard"


def test_beside_a_tracker_on_the_ground_speeds_are_not_compared():
    table = FleetTable(
        ["tello1"], {"tello1": 0}, FleetCheckRules(), "relay", ground=True, planned=FlightBounds()
    )
    assert "speed" not in {line.name for line in table.lines(9.0)}


# ---- what the operator accepts -------------------------------------------------------------------


def test_an_acceptance_ends_where_its_line_becomes_red_or_was_green_for_a_minute():
    def battery(state):
        return [Line("uav1", "battery", state, "31%")]

    def accepted(at_s, state):
        return acceptances.apply(at_s, battery(state))[0].accepted

    for between, seconds, lasts in (
        (R, 0.5, False),
        (U, 0.5, False),
        (G, 30.0, True),
        (G, 90.0, False),
    ):
        acceptances = Acceptances()
        assert acceptances.accept(battery(A), "uav1", "battery") == "" and accepted(0.0, A)
        assert not accepted(1.0, between) and not accepted(1.0 + seconds, between)
        assert accepted(2.0 + seconds, A) is lasts
    assert acceptances.apply(99.0, []) == []


def test_only_what_is_amber_is_accepted_and_by_its_name():
    acceptances, lines = (
        Acceptances(),
        [Line("uav1", "feed", R, ""), Line("control", "disk", A, "")],
    )
    assert "feed is RED: only amber" in acceptances.accept(lines, "uav1", "feed")
    assert "'uav9' is not one of uav1, control" in acceptances.accept(lines, "uav9", "feed")
    assert "it has feed" in acceptances.accept(lines, "uav1", "disk")
    assert acceptances.accept(lines, "control", "disk") == ""
    assert [line.passes for line in acceptances.apply(0.0, lines)] == [False, True]


# ---- its page ------------------------------------------------------------------------------------


def rows(root, heading):
    """Name -> (must, remedy) of every row under a heading of the page that is a line's."""
    text = (
        (root / "docs/user/flight_check.md")
        .read_text()
        .split(f"\n## {heading}\n")[1]
        .split("\n## ")[0]
    )
    cells = [
        [c.strip() for c in row.strip("|").split("|")]
        for row in text.splitlines()
        if row.startswith("| `")
    ]
    return {c[0].strip("`"): (c[1], c[-1]) for c in cells}


@pytest.mark.parametrize(
    "heading, checks",
    [
        ("Lines of a vehicle", VEHICLE_CHECKS),
        ("Lines about a vehicle", (*FLEET_CHECKS, speeds.check(FlightBounds()))),
        ("Lines of the control PC", CONTROL_CHECKS),
        ("Lines of a Tello", TELLO_CHECKS),
    ],
)
def test_the_page_has_every_line_as_the_code_has_it(root, heading, checks):
    assert rows(root, heading) == {c.name: (c.must, c.remedy) for c in checks}


def test_the_page_has_the_bounds_of_the_fleets_lines(root):
    text, r = (root / "docs/user/flight_check.md").read_text(), FleetCheckRules()
    said = {
        "silent_s": f"not heard for {r.silent_s:g} s",
        "slow_silent_s": f"({r.slow_silent_s:g} s where",
        "clock_silent_s": f"no answer for {r.clock_silent_s:g} s",
        "amber_radio_hz": f"fewer than {r.amber_radio_hz:g} a second",
        "red_radio_hz": f"fewer than {r.red_radio_hz:g}",
        "amber_clock_s": f"over {r.amber_clock_s:g} s apart",
        "red_clock_s": f"over {r.red_clock_s:g} s apart",
        "amber_disk_mib": f"under {r.amber_disk_mib:g} MiB",
        "red_disk_mib": f"under {r.red_disk_mib:g} MiB",
    }
    assert set(said) == {f.name for f in fields(FleetCheckRules)}
    assert not [words for words in said.values() if words not in text]


def test_the_page_has_the_bounds_of_the_code(root):
    text, r = (root / "docs/user/flight_check.md").read_text(), VehicleCheckRules()
    said = {
        "amber_position_hz": f"fewer than {r.amber_position_hz:g} positions",
        "red_position_hz": f"fewer than {r.red_position_hz:g};",
        "amber_feed_hz": f"fewer than {r.amber_feed_hz:g} a second",
        "red_feed_hz": f"fewer than {r.red_feed_hz:g}, none",
        "red_feed_age_s": f"none for {r.red_feed_age_s:g} s, or doubted",
        "amber_ekf_variance": f"variance over {r.amber_ekf_variance:g}",
        "red_ekf_variance": f"over {r.red_ekf_variance:g}, or",
        "amber_apart_m": f"over {r.amber_apart_m:g} m apart",
        "red_apart_m": f"over {r.red_apart_m:g} m apart",
        "red_apart_in_flight_m": f"may be {r.red_apart_in_flight_m:g} m apart",
        "amber_battery": f"under {100 * r.amber_battery:g} %",
        "red_battery": f"under {100 * r.red_battery:g} %",
        "amber_disk_mib": f"under {r.amber_disk_mib:g} MiB",
        "red_disk_mib": f"under {r.red_disk_mib:g} MiB",
        "amber_picture_hz": f"fewer than one in {1 / r.amber_picture_hz:g} s",
        "silent_s": f"older than {r.silent_s:g} s",
        "slow_silent_s": f"({r.slow_silent_s:g} s where",
    }
    assert set(said) == {f.name for f in fields(VehicleCheckRules)}
    assert not [words for words in said.values() if words not in text]
