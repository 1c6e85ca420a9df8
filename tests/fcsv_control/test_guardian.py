# SPDX-License-Identifier: Apache-2.0
"""The guardian on board: what it sees, what it does about it, and that it leaves the pilot
alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fcsv_control.guardian.air import LinkReport, Other
from fcsv_control.guardian.core import Guardian
from fcsv_control.guardian.messages import AskMode, HoldAt, RestartLink, Warned
from fcsv_control.guardian.rules import GuardianRules
from fcsv_geometry import config, transforms
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.vehicles.modes import Mode

STEP_S = 0.05
SQUARE = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)]
PILOTS_MODES = (Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.LAND, Mode.BRAKE)


class Aloft:
    """A guardian aboard a vehicle that hovers 8 m above its take-off place in GUIDED, all well.
    ``obeys``: the autopilot takes the modes that are asked for; what is listed in ``silent`` says
    nothing."""

    def __init__(self, rules=None, obeys=True):
        self.now_s, self.obeys, self.silent = 100.0, obeys, set()
        self.guardian = Guardian("uav1", rules, self.now_s)
        self.p, self.feed_off = np.array([0.0, 0.0, 0.0]), np.zeros(3)
        self.report, self.battery, self.confidence, self.feed_every = (
            LinkReport(throttle=0.0),
            0.8,
            3.0,
            1,
        )
        self.others, self.T_home_odom, self.lean_rad = {}, np.eye(4), 0.0
        self.mode, self.armed = Mode.STABILIZE, False
        self.asked, self.held, self.texts, self.restarts, self.steps = [], [], [], [], 0
        self.run(2.0)
        self.mode, self.armed = Mode.LOITER, True
        self.run(0.5)
        self.p[2] = 8.0
        self.run(1.0)
        self.hand_over()
        self.run(0.5)
        self.forget()

    def hand_over(self):
        self.guardian.mode_asked(self.now_s, Mode.GUIDED)
        self.mode = Mode.GUIDED

    def forget(self):
        self.asked, self.held, self.texts = [], [], []

    @property
    def modes(self):
        return [mode for _, mode in self.asked]

    def _hear(self):
        g, now_s = self.guardian, self.now_s
        T = transforms.from_xyz_rpy(self.p, [self.lean_rad, 0.0, 0.0])
        if "feed" not in self.silent and self.steps % self.feed_every == 0:
            g.pose(now_s, transforms.from_xyz_yaw(self.p + self.feed_off, 0.0))
        g.estimate(now_s, T)
        g.state(now_s, self.mode, self.armed)
        if "link" not in self.silent:
            g.link(now_s, self.report)
        if "battery" not in self.silent:
            g.battery(now_s, self.battery)
        g.confidence(self.confidence)
        if "agent" not in self.silent:
            g.agent_lives(now_s)
        if "control" not in self.silent:
            g.control_lives(now_s)
        g.home(self.T_home_odom)
        for name, fields in self.others.items():
            if name not in self.silent:
                g.other(name, Other(heard_s=now_s, **fields))

    def run(self, seconds):
        """Time passes; the vehicle flies at 2 m/s to where it is held."""
        until_s = self.now_s + seconds
        while self.now_s < until_s - 1e-9:
            self.now_s += STEP_S
            self.steps += 1
            self._hear()
            self.guardian.step(self.now_s)
            for output in self.guardian.outgoing():
                self._do(output)
            if self.held and self.mode == Mode.GUIDED:
                way = self.held[-1][1] - self.p
                self.p = self.p + way * min(
                    1.0, 2.0 * STEP_S / max(float(np.linalg.norm(way)), 1e-9)
                )
        return self

    def _do(self, output):
        if isinstance(output, AskMode):
            self.asked.append((self.now_s, output.mode))
            if self.obeys:
                self.mode = output.mode
        elif isinstance(output, HoldAt):
            self.held.append((self.now_s, output.T_odom_body[:3, 3]))
        elif isinstance(output, RestartLink):
            self.restarts.append(self.now_s)
        elif isinstance(output, Warned):
            self.texts.append(output.text)


def below(height_m=3.0):
    return {"p_home_m": np.array([0.0, 0.3, height_m]), "mode": Mode.GUIDED}


def test_it_leaves_a_vehicle_alone_that_is_well():
    air = Aloft().run(60.0)
    assert (air.asked, air.held, air.texts) == ([], [], [])
    assert air.guardian.verdict.action == "" and not air.guardian.verdict.holds


def test_a_silent_tracker_means_land_within_a_second():
    air = Aloft()
    air.silent.add("feed")
    air.run(1.0)
    assert air.modes == ["LAND"]
    assert air.guardian.verdict.uncontrolled, (
        "the others are told that it comes down without a position"
    )


@pytest.mark.parametrize(
    "every, asked, said", [(2, False, False), (3, False, True), (7, True, True)]
)
def test_poses_that_come_too_seldom(every, asked, said):
    """At 20, 10, 6.7 and 2.9 Hz."""
    air = Aloft()
    air.feed_every = every
    air.run(4.0)
    assert bool(air.asked) == asked and bool(air.texts) == said


def test_a_doubted_tracker_means_land_at_once():
    air = Aloft()
    air.report = LinkReport("the tracker has not moved at all for 0.3 s: frozen", throttle=0.0)
    air.run(0.1)
    assert air.modes[0] == Mode.LAND and "frozen" in air.texts[0]


def test_a_filter_that_disagrees_means_land():
    air = Aloft()
    air.report = LinkReport(ekf_variance=0.9, throttle=0.0)
    assert air.run(0.4).asked == []
    assert air.run(0.4).modes == ["LAND"]


def test_low_confidence_holds_then_lands():
    air = Aloft()
    air.confidence = 1.0
    air.run(2.0)
    assert air.held and not air.asked
    assert air.run(3.0).modes == ["LAND"]


def test_a_lean_that_nobody_flies_lands():
    air = Aloft()
    air.lean_rad = math.radians(60.0)
    assert air.run(0.6).modes == ["LAND"]


@pytest.mark.parametrize("share, after_s", [(0.15, 60.5), (0.05, 2.5), (math.nan, 60.5)])
def test_a_battery_that_is_low_empty_or_unknown_lands(share, after_s):
    air = Aloft()
    air.battery = share
    air.run(after_s - 1.0)
    assert not air.asked
    air.run(2.0)
    assert air.modes == ["LAND"]


def test_a_battery_that_is_not_told_any_more_is_not_known():
    air = Aloft()
    air.silent.add("battery")
    air.run(9.0)
    assert not air.texts
    air.run(4.0)
    assert air.texts == ["uav1: battery is not known"] and not air.asked
    air.mode = Mode.LOITER
    air.run(0.1)
    assert any("battery is not known" in reason for reason in air.guardian.verdict.forbids)


def test_without_the_control_pc_it_holds_then_lands():
    air = Aloft()
    air.silent.add("control")
    air.run(29.5)
    assert not air.asked and air.texts == ["uav1: nothing from the control PC for 2 s"]
    assert air.run(1.0).modes == ["LAND"]


def test_never_must_be_written():
    air = Aloft(GuardianRules(link_loss="never"))
    air.silent.add("control")
    assert air.run(300.0).asked == []
    with pytest.raises(ValueError, match="link_loss: 'no' is not one of land, never"):
        GuardianRules(link_loss="no")


@pytest.mark.parametrize("height_m", [3.0, 5.0, 7.0])
def test_who_must_land_moves_aside_of_who_is_beneath(height_m):
    air = Aloft()
    air.others = {"uav2": below(height_m)}
    air.guardian.air.control_s = -100.0
    air.silent.add("control")
    air.run(8.0)
    assert air.modes == ["LAND"]
    assert np.linalg.norm(air.p[:2] - [0.0, 0.3]) > 2.0, "clear of the column of air"
    assert air.p[2] == pytest.approx(8.0), "at its own height"


@pytest.mark.parametrize("speed_mps, aside", [(0.0, False), (2.0, True)])
def test_who_flies_towards_anothers_column_counts_as_above_it(speed_mps, aside):
    """It would come to a stand 2.1 m further on; rehearsed abort, seed 510996."""
    air = Aloft()
    air.others = {"uav2": below()}
    air.battery = 0.05
    air.p = np.array([3.2 + 2.0 * speed_mps, 0.3, 8.0])
    while not (air.held or air.asked):
        air.p = air.p - [speed_mps * STEP_S, 0.0, 0.0]
        air.run(STEP_S)
    assert 3.0 < air.p[0] < 3.3 and bool(air.held) == aside
    air.run(10.0)
    assert air.modes == ["LAND"] and np.hypot(*(air.p - below()["p_home_m"])[:2]) > 2.0


def test_who_was_stopped_above_another_moves_aside_too_before_it_lands():
    """After /stop_all both are in BRAKE; without a control PC both land, but not the upper one
    straight down."""
    air = Aloft()
    air.others = {"uav2": below()}
    air.guardian.mode_asked(air.now_s, Mode.BRAKE)
    air.mode = Mode.BRAKE
    air.run(1.0)
    air.silent.add("control")
    air.run(29.0).forget()
    air.run(20.0)
    assert air.modes == ["GUIDED", "LAND"] and np.hypot(*(air.p - below()["p_home_m"])[:2]) > 2.0
    assert air.asked[-1][0] - air.asked[0][0] < 15.0


@pytest.mark.parametrize("heard", ["nothing", "a pilot's BRAKE"])
def test_a_stop_is_left_for_nothing_else(heard):
    air = Aloft()
    air.others = {"uav2": below()}
    if heard == "nothing":
        air.guardian.mode_asked(air.now_s, Mode.BRAKE)
    else:
        air.silent.add("control")
    air.mode = Mode.BRAKE
    assert air.run(60.0).modes == []


def test_who_has_no_position_lands_where_it_is():
    air = Aloft()
    air.others = {"uav2": below()}
    air.silent.add("feed")
    air.run(1.0)
    assert air.modes == ["LAND"] and not air.held


@pytest.mark.parametrize(
    "fields", [{"mode": Mode.LAND}, {"mode": Mode.GUIDED, "uncontrolled": True}]
)
def test_who_is_beneath_moves_aside_within_a_second(fields):
    air = Aloft()
    air.others = {"uav2": {"p_home_m": np.array([0.2, 0.1, 12.0]), **fields}}
    begun_s = air.now_s
    air.run(1.0)
    assert air.held[0][0] - begun_s <= 1.0
    assert air.guardian.verdict.holds, "the agent is quiet meanwhile"
    air.run(4.0)
    assert not air.asked
    assert np.linalg.norm(air.p[:2] - [0.2, 0.1]) > 2.5


def test_who_was_stopped_beneath_one_that_comes_down_moves_aside():
    air = Aloft()
    air.guardian.mode_asked(air.now_s, Mode.BRAKE)  # /stop_all
    air.mode = Mode.BRAKE
    air.run(1.0)
    air.others = {"uav2": {"p_home_m": np.array([0.2, 0.1, 12.0]), "mode": Mode.LAND}}
    air.run(5.0)
    assert air.modes[0] == Mode.GUIDED and np.linalg.norm(air.p[:2] - [0.2, 0.1]) > 2.5


@pytest.mark.parametrize("higher_m", [0.0, 0.05, 0.4])
def test_who_was_beside_at_one_height_and_is_silent_sends_nobody_aside(higher_m):
    """A radio that carries nothing silences everybody at once: each would think that the other
    falls upon it."""
    air = Aloft()
    air.others["uav2"] = {"p_home_m": air.p + [2.0, 0.0, higher_m], "mode": Mode.GUIDED}
    air.run(2.0)
    air.silent |= {"uav2", "control"}
    air.run(15.0)
    assert not air.held and not air.asked


def test_two_who_dodge_a_third_and_hear_nobody_do_not_meet():
    """Rehearsed with ten vehicles and a radio that was held up: both flew away from the third, to
    one place."""

    def dodges_to(here, other, heard):
        air = Aloft()
        above = {
            "p_home_m": np.array([-5.0, 0.6, 13.0]),
            "mode": Mode.GUIDED,
            "going_to_m": np.array([0.0, 0.0, 13.0]),
        }
        air.others = {"uav6": above, "uav2": {"p_home_m": np.array(other), "mode": Mode.GUIDED}}
        air.p[:] = here
        air.run(1.0).forget()
        air.silent |= {"uav6", "uav2", "control"} if not heard else {"uav6", "control"}
        air.run(2.5)
        return air.held[-1][1]

    front, rear = [0.0, 0.0, 8.0], [-3.5, -0.3, 8.0]
    to_front, to_rear = dodges_to(front, rear, heard=False), dodges_to(rear, front, heard=False)
    for share in np.linspace(0.0, 1.0, 20):  # both are on their way
        apart_m = np.linalg.norm(
            (np.array(front) + share * (to_front - front) - rear - share * (to_rear - rear))[:2]
        )
        assert apart_m > 3.0


def test_two_above_each_other_that_do_not_hear_each_other_do_not_meet():
    """Rehearsed: the upper one's radio was cut on its way. Each flew away from where it had heard
    the other."""
    upper, lower = np.array([0.0, 0.0, 13.0]), np.array([-0.1, 0.0, 8.0])
    below, above = Aloft(), Aloft()
    below.others = {
        "uav2": {"p_home_m": np.array([0.1, -1.1, 12.3]), "mode": Mode.GUIDED, "going_to_m": upper}
    }
    below.others["uav2"]["speed_mps"] = 2.0
    above.others = {"uav2": {"p_home_m": lower, "mode": Mode.GUIDED}}
    below.p[:], above.p[:] = lower, upper
    for air, seconds in ((below, 3.0), (above, 35.0)):
        air.run(1.0).forget()
        air.silent |= {"uav2", "control"}
        air.run(seconds)
    assert np.linalg.norm((above.held[-1][1] - below.held[0][1])[:2]) > 5.0


@pytest.mark.parametrize(
    "beside_m, up_m, goes_aside",
    [(1.5, -0.1, True), (1.5, 0.3, True), (2.0, 0.0, False), (1.5, 0.8, False)],
)
def test_who_lands_beside_another_at_its_height_goes_out_of_its_way_first(
    beside_m, up_m, goes_aside
):
    """Rehearsed: the agent of one died 1.4 m beside the other; 15 s later it came down there."""
    air = Aloft()
    air.others = {"uav2": {"p_home_m": air.p + [0.0, beside_m, up_m], "mode": Mode.GUIDED}}
    air.run(1.0).forget()
    air.silent.add("agent")
    air.run(25.0)
    assert "LAND" in air.modes
    assert abs(air.p[1] - beside_m) == pytest.approx(1.8 if goes_aside else beside_m, abs=0.1)


def test_where_it_comes_to_a_stand_by_its_autopilots_own_acceleration():
    air = Aloft()
    for _ in range(15):  # at 1 m/s
        air.p[0] += STEP_S
        air.run(STEP_S)
    for told_mps2, stops_m in (
        (None, 0.73),
        (0.5, 1.4),
        (float("nan"), 1.4),
        (0.0, 1.4),
        (1.0, 0.9),
    ):
        if told_mps2 is not None:
            air.guardian.slows(told_mps2)
        assert air.guardian.air.p_home_stop_m[0] - air.p[0] == pytest.approx(stops_m, abs=0.05)


@pytest.mark.parametrize("fallen", [{"mode": Mode.LAND}, {"uncontrolled": True}])
def test_who_comes_down_as_it_flies_is_not_dodged_along_its_way(fallen):
    """Rehearsed: its autopilot restarted at 1.7 m/s. It went on, over the other, which flew the
    same way."""
    air = Aloft()
    here = air.p.copy()
    p = np.array([0.0, -1.3, 12.0])
    for k in range(8):
        air.others = {
            "uav2": {"p_home_m": p + [0.0, 1.7 * STEP_S * (k - 8), 0.0], "mode": Mode.GUIDED}
        }
        air.run(STEP_S)
    air.others = {"uav2": {"p_home_m": p, "mode": Mode.GUIDED, **fallen}}
    air.forget()
    air.run(0.5)
    goes = air.held[0][1] - here
    assert abs(goes[0]) > 2.0 * abs(goes[1]), "across its way"


def test_how_another_moves_is_known_from_what_was_heard():
    other = Other(np.array([0.0, 0.0, 8.0]), heard_s=10.0)
    for k in range(1, 41):
        other = Other(np.array([0.06 * k, 0.0, 8.0]), heard_s=10.0 + 0.04 * k).after(other)
        other = replace(other, v_home_mps=np.zeros(3)).after(other)  # the same message again
    assert other.v_home_mps == pytest.approx([1.5, 0.0, 0.0], abs=0.1)
    lost = Other(np.array([9.0, 9.0, 9.0]), heard_s=12.0, uncontrolled=True).after(other)
    assert (lost.p_home_m == other.p_home_m).all() and (lost.v_home_mps == other.v_home_mps).all()
    assert (
        len(lost.places_m(12.0, 1.5)) == 4
        and len(replace(lost, armed=False).places_m(12.0, 1.5)) == 1
    )


def test_who_was_above_and_is_silent_may_come_down():
    air = Aloft()
    air.others = {"uav2": {"p_home_m": np.array([0.2, 0.1, 12.0]), "mode": Mode.GUIDED}}
    air.run(5.0)
    assert not air.held
    air.silent.add("uav2")
    air.run(8.0)
    assert np.linalg.norm(air.p[:2] - [0.2, 0.1]) > 2.5


def test_who_was_sent_to_a_place_above_is_looked_for_there_once_it_is_silent():
    """It was heard last at one height, out of the way, and its radio was cut there."""
    air = Aloft()
    air.others["uav2"] = {
        "p_home_m": air.p + [-3.0, 0.0, 0.2],
        "mode": Mode.GUIDED,
        "going_to_m": air.p + [0.0, 0.0, 5.0],
    }
    air.run(5.0)
    assert not air.held, "while it is heard it is where it says"
    air.silent.add("uav2")
    air.run(1.4)
    assert not air.held
    air.run(3.5)
    assert np.linalg.norm(air.p[:2]) > 2.5 and np.linalg.norm(air.p[:2] - [-3.0, 0.0]) > 2.5


def test_who_lands_looks_for_a_silent_one_where_it_was_sent():
    air = Aloft()
    air.others["uav2"] = {
        "p_home_m": air.p + [6.0, 0.0, 0.0],
        "mode": Mode.GUIDED,
        "going_to_m": air.p - [0.0, 0.0, 4.0],
    }
    air.silent |= {"uav2", "control"}
    air.guardian.other("uav2", Other(heard_s=air.now_s, **air.others["uav2"]))
    air.run(40.0)
    assert air.modes and air.modes[0] == Mode.LAND and np.linalg.norm(air.p[:2]) > 2.5


def test_it_tells_where_it_flies():
    air = Aloft()
    there = transforms.from_xyz_yaw([1.0, 2.0, 9.0], 0.3)
    assert air.guardian.verdict.going_to_m is None
    air.guardian.moved(air.now_s, there)
    air.run(0.2)
    assert air.guardian.verdict.going_to_m == (1.0, 2.0, 9.0)
    air.others = {"uav2": {"p_home_m": air.p + [0.2, 0.1, 4.0], "mode": Mode.LAND}}
    air.run(0.2)
    assert air.guardian.verdict.going_to_m == tuple(air.held[-1][1]), "where the guardian leads it"
    air.others.clear()
    air.guardian.moved(air.now_s, there)
    air.guardian.epoch(7)
    air.run(9.0)
    assert air.guardian.verdict.going_to_m is None, (
        "the odometry began anew: that place is elsewhere"
    )
    air.guardian.moved(air.now_s, there)
    air.mode = Mode.LOITER
    air.run(0.2)
    assert air.guardian.verdict.going_to_m is None


def test_two_in_one_column_go_to_different_sides():
    """Each aboard its own vehicle, in odometry frames that are turned against each other."""
    places = {}
    for yaw, own, other in ((0.0, 8.0, 5.0), (2.0, 5.0, 8.0)):
        air = Aloft()
        air.T_home_odom = transforms.from_xyz_yaw([0.0, 0.0, own - 8.0], yaw)
        air.others = {
            "uav2": {
                "p_home_m": np.array([0.0, 0.0, other]),
                "mode": Mode.LAND if other > own else "GUIDED",
            }
        }
        if other < own:
            air.silent.add("control")
            air.run(31.0)
        air.run(5.0)
        places[own] = (air.T_home_odom @ np.append(air.p, 1.0))[:2]
    assert np.linalg.norm(places[8.0] - places[5.0]) > 5.0


def test_the_way_aside_passes_nobody():
    """In a column the way from the one behind would lead through the one in front."""
    air = Aloft()
    air.others = {
        "uav3": {"p_home_m": np.array([-2.0, 0.1, 8.3]), "mode": Mode.LAND},
        "uav1": {"p_home_m": np.array([2.8, 0.0, 8.0]), "mode": Mode.GUIDED},
    }
    nearest_m = np.inf
    for _ in range(60):
        air.run(0.1)
        nearest_m = min(nearest_m, float(np.linalg.norm(air.p[:2] - [2.8, 0.0])))
    assert np.linalg.norm(air.p[:2] - [-2.0, 0.1]) > 2.5 and nearest_m > 1.9


def test_too_near_to_another_means_apart():
    air = Aloft()
    air.others = {"uav2": {"p_home_m": np.array([0.6, 0.0, 8.0]), "mode": Mode.GUIDED}}
    air.run(3.0)
    assert air.p[0] < -1.0 and not air.asked


def test_a_guardian_that_slept_blames_nobody():
    air = Aloft()
    air.now_s += 3.0  # the computer did not let it run
    assert air.run(0.3).asked == [] and air.held == []


def test_on_the_ground_it_gives_no_set_points():
    """They would replace the take-off."""
    air = Aloft()
    air.p[2] = 0.0
    air.report = LinkReport(throttle=0.0, in_the_air=False)
    air.silent.add("agent")
    assert air.run(3.0).held == []


def test_a_silent_agent_is_held_for_then_landed():
    air = Aloft()
    air.silent.add("agent")
    air.run(2.0)
    assert air.held and not air.asked and "agent" in air.texts[0]
    air.silent.clear()
    air.run(4.0)
    assert not air.guardian.verdict.holds, "it is back: the mission goes on"
    air.silent.add("agent")
    air.run(15.5)
    assert air.modes == ["LAND"]


def test_a_link_that_hangs_is_ended_once():
    air = Aloft()
    air.silent.add("link")
    begun_s = air.now_s
    air.run(10.0)
    assert [at_s - begun_s for at_s in air.restarts] == [pytest.approx(2.0, abs=0.1)]
    air.silent.clear()
    air.run(1.0)
    air.silent.add("link")
    assert len(air.run(3.0).restarts) == 2


def test_an_autopilot_that_is_not_heard_is_said_and_nothing_else_done():
    """Nothing would reach it: it flies on by its own failsafes, and the link is alive."""
    air = Aloft()
    air.report = LinkReport(throttle=0.0, connected=False)
    air.run(5.0)
    assert any("hears no autopilot" in text for text in air.texts)
    assert not air.asked and not air.held and not air.restarts
    air.report = LinkReport(throttle=0.0)
    air.forget()
    assert not air.run(15.0).texts, "it is heard again"


def test_who_is_held_in_flight_is_held_where_it_comes_to_rest():
    air = Aloft()
    air.silent.add("agent")
    while not air.held:
        air.p = air.p + [3.0 * STEP_S, 0.0, 0.0]
        air.run(STEP_S)
    ahead_m = float(air.held[0][1][0] - air.p[0])
    assert 1.0 < ahead_m < 2.5, "v^2 / 2a at 3 m/s"


def test_a_place_that_calibration_knows_badly_needs_more_room():
    for sigma_m, held in ((0.02, False), (0.3, True)):
        air = Aloft()
        air.others["uav2"] = {"p_home_m": np.array([0.0, 1.2, 8.0]), "sigma_m": sigma_m}
        air.run(1.0)
        assert bool(air.held) is held, sigma_m


def test_a_fence_brakes_once_per_crossing():
    air = Aloft(GuardianRules(fence=Fence(ceiling_m=10.0)))
    air.p[2] = 11.0
    assert air.run(2.0).modes == [Mode.BRAKE]
    air.hand_over()
    assert air.run(5.0).modes == [Mode.BRAKE], "who flies on means it"
    air.p[2] = 9.0
    air.run(1.0)
    air.p[2] = 11.0
    assert air.run(1.0).modes == [Mode.BRAKE, Mode.BRAKE]


def test_the_fence_of_a_mission_counts_besides_its_own():
    air = Aloft()
    air.guardian.mission_fence(Fence(ceiling_m=20.0, polygon=SQUARE))
    air.p[0] = 10.8
    assert air.run(1.0).asked == [], "a way along the fence is flown with errors"
    air.T_home_odom, air.p[0] = None, 12.0
    assert air.run(1.0).asked == [], "before home is set nobody knows where the polygon is"
    air.T_home_odom = np.eye(4)
    assert air.run(1.0).modes == [Mode.BRAKE]


def test_a_polygon_of_its_own_brakes_whom_it_bounds():
    air = Aloft(config.from_mapping({"fence": {"polygon": SQUARE}}, GuardianRules, "test"))
    air.p[1] = -10.5
    assert air.run(1.0).modes == [Mode.BRAKE]


def test_a_take_off_begins_under_the_floor():
    air = Aloft()
    air.report, air.p[2] = LinkReport(throttle=0.0, in_the_air=False), 0.0
    air.run(1.0)
    air.report = LinkReport(throttle=0.0, in_the_air=True)
    air.p[2] = 0.1
    assert air.run(1.0).asked == []
    air.p[2] = 3.0
    air.run(1.0)
    air.p[2] = 0.1
    assert air.run(1.0).modes == [Mode.BRAKE], "who sinks to the ground in GUIDED"


def test_who_is_armed_again_at_once_may_take_off():
    """The autopilot says a second late that it stands: no flight under the floor."""
    air = Aloft()
    air.report = LinkReport(throttle=0.0, in_the_air=True)
    air.p[2] = 3.0
    air.run(1.0)
    air.guardian.mode_asked(air.now_s, Mode.LAND)
    air.mode, air.p[2] = Mode.LAND, 0.0
    air.run(0.5)
    air.armed = False
    air.run(0.5)
    air.hand_over()
    air.armed = True
    assert air.run(1.0).asked == []


def test_a_brake_that_does_not_show_becomes_land():
    air = Aloft(GuardianRules(fence=Fence(radius_m=5.0)), obeys=False)
    air.p[0] = 7.0
    air.run(3.0)
    assert air.modes[0] == Mode.BRAKE and air.modes[-1] == Mode.LAND


def test_far_outside_the_fence_it_lands():
    air = Aloft(GuardianRules(fence=Fence(radius_m=5.0)))
    air.p[0] = 12.0
    assert air.run(0.2).modes == ["LAND"]


def test_battery_outranks_fence():
    air = Aloft(GuardianRules(fence=Fence(ceiling_m=9.0)))
    air.battery, air.p[2] = 0.05, 8.0
    air.run(1.9)
    air.p[2] = 10.0
    air.run(0.3)
    assert air.modes[-1] == Mode.LAND


ALARMS = {
    "silent tracker": lambda air: air.silent.add("feed"),
    "doubt": lambda air: setattr(air, "report", LinkReport("frozen", ekf_variance=2.0)),
    "battery": lambda air: setattr(air, "battery", 0.03),
    "control": lambda air: air.silent.update(("control", "agent")),
    "fence": lambda air: air.p.__setitem__(0, 300.0),
    "above": lambda air: air.others.update(
        uav2={"p_home_m": air.p + [0.1, 0.0, 4.0], "mode": Mode.LAND}
    ),
}


@pytest.mark.parametrize("mode", PILOTS_MODES)
@pytest.mark.parametrize("alarm", ALARMS)
def test_in_a_pilots_mode_it_only_speaks(mode, alarm):
    air = Aloft()
    air.mode = mode
    air.run(0.2)
    air.forget()
    ALARMS[alarm](air)
    air.run(60.0)
    assert (air.asked, air.held) == ([], [])
    assert air.texts, "but it speaks"


def test_what_a_pilot_gives_back_is_the_operators_to_confirm():
    air = Aloft()
    air.mode = Mode.LOITER
    air.run(1.0)
    air.mode = Mode.GUIDED  # by the pilot's switch
    air.silent.add("feed")
    assert air.run(20.0).asked == []
    air.silent.clear()
    air.run(2.0)
    air.guardian.moved(air.now_s)  # the operator has confirmed: the mission moves it
    air.silent.add("feed")
    assert air.run(1.0).modes == ["LAND"]


def test_a_pilot_who_changes_his_own_modes_is_not_told_of_them():
    """At each take-off he goes from ALT_HOLD to LOITER; a take-over, and a landing that nobody
    asked for, are told."""
    air = Aloft()
    air.mode = Mode.LOITER
    assert any("LOITER was not asked for" in text for text in air.run(1.0).texts)
    air.forget()
    for mode in (Mode.ALT_HOLD, Mode.STABILIZE):
        air.mode = mode
        assert air.run(1.0).texts == []
    air.mode = Mode.LAND
    assert any("LAND was not asked for" in text for text in air.run(1.0).texts)


def test_a_pilot_who_takes_over_from_a_landing_keeps_it():
    air = Aloft()
    air.silent.add("feed")
    air.run(1.5)
    air.mode = Mode.ALT_HOLD
    air.forget()
    assert air.run(60.0).asked == []


def test_a_guardian_started_in_flight_knows_guided_and_leaves_other_modes_alone():
    for mode, asks in ((Mode.GUIDED, True), (Mode.LAND, False), (Mode.LOITER, False)):
        air = Aloft()
        air.mode = mode
        air.guardian = Guardian("uav1", None, air.now_s)
        air.run(1.0)
        air.silent.add("feed")
        assert bool(air.run(2.0).asked) == asks, mode


@pytest.mark.parametrize(
    "what, reason",
    [
        (lambda air: setattr(air, "battery", math.nan), "battery"),
        (lambda air: setattr(air, "battery", 0.1), "battery"),
        (lambda air: setattr(air, "report", LinkReport(throttle=-1.0)), "throttle"),
        (lambda air: setattr(air, "report", LinkReport()), "no transmitter"),
        (lambda air: setattr(air, "report", LinkReport("frozen", throttle=0.0)), "frozen"),
        (lambda air: setattr(air, "confidence", 0.0), "confidence"),
        (
            lambda air: setattr(air, "report", LinkReport(throttle=0.0, origin_set=False)),
            "no origin",
        ),
        (
            lambda air: setattr(air, "report", LinkReport(throttle=0.0, parameters_ok=False)),
            "parameters",
        ),
        (lambda air: setattr(air, "report", LinkReport(throttle=0.0, ekf_variance=1.2)), "filter"),
        (lambda air: air.silent.add("feed"), "no poses"),
    ],
)
def test_what_forbids_guided(what, reason):
    air = Aloft()
    air.mode = Mode.LOITER
    air.run(1.0)
    assert air.guardian.verdict.forbids == ()
    what(air)
    air.run(1.0)
    assert reason in " ".join(air.guardian.verdict.forbids)


def test_an_estimate_apart_from_the_feed_forbids_guided_on_the_ground():
    """A height that runs away while disarmed."""
    air = Aloft()
    air.mode, air.armed, air.p[2] = Mode.LOITER, False, 2.0
    air.feed_off = np.array([0.0, 0.0, -1.9])
    air.run(1.0)
    assert "more than 0.5 m apart" in " ".join(air.guardian.verdict.forbids)


@pytest.mark.parametrize(
    "wrong, said",
    [
        ({"feed_warn_s": 0.9}, "feed_warn_s"),
        ({"low_battery": -1.0}, "low_battery"),
        ({"empty_battery": 0.5}, "empty"),
        ({"clear_m": math.nan}, "clear_m"),
    ],
)
def test_rules_that_cannot_be_are_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        GuardianRules(**wrong)


@pytest.mark.parametrize(
    "wrong, said",
    [
        ({"floor_m": 50.0}, "ceiling_m"),
        ({"radius_m": 0.0}, "radius_m"),
        ({"polygon": [(1.0, 2.0)]}, "polygon"),
        ({"polygon": [(math.nan, 0.0)] * 3}, "polygon"),
    ],
)
def test_fences_that_cannot_be_are_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        Fence(**wrong)


# ---- one that lost its position, or is in other hands --------------------------------------------


@pytest.mark.parametrize(
    "fields",
    [{"uncontrolled": True, "mode": Mode.LAND}, {"lost": True, "armed": False}, {"taken": True}],
)
def test_nobody_stays_above_one_that_lost_its_position_or_that_a_pilot_has(fields):
    air = Aloft()
    air.others = {"uav2": below()}
    air.run(3.0)
    assert not air.held
    air.others["uav2"].update(fields)
    air.run(1.5)
    assert air.held and air.guardian.verdict.action == "aside"
    air.run(8.0)
    assert np.hypot(*(air.p[:2] - [0.0, 0.3])) > (2.5 if "taken" in fields else 6.0)
    assert not air.asked, "it stays in the air"


def test_a_pilot_beside_it_in_the_column_moves_nobody():
    air = Aloft()
    air.others = {
        "uav2": {"p_home_m": np.array([-3.5, 0.0, 7.0]), "mode": Mode.LOITER, "taken": True}
    }
    assert not air.run(10.0).held


def test_where_one_is_that_lost_its_position_is_where_it_was_last():
    """Its tracker tells places 100 m away; it lies on the ground beneath."""
    air = Aloft()
    air.others = {"uav2": {"p_home_m": np.array([0.5, 0.0, 3.0]), "taken": False}}
    air.run(1.0)
    air.others["uav2"] = {
        "p_home_m": np.array([90.0, 40.0, 3.0]),
        "uncontrolled": True,
        "mode": Mode.LAND,
    }
    air.run(0.2)
    air.others["uav2"] = {"p_home_m": np.array([-50.0, 70.0, 0.0]), "lost": True, "armed": False}
    air.battery = 0.05
    air.run(12.0)
    assert air.modes == ["LAND"] and np.hypot(*(air.p[:2] - [0.5, 0.0])) > 6.0


def lost_for(air, flown_s):
    """uav2 lies on the ground, as high as it was known last, after so long without a position."""
    air.others = {
        "uav2": {
            "p_home_m": np.array([0.0, 10.0, 8.0]),
            "lost": True,
            "lost_s": flown_s,
            "armed": False,
        }
    }
    return air


@pytest.mark.parametrize("flown_s, reach_m", [(2.0, 6.0), (13.0, 17.6)])
def test_who_lands_keeps_out_of_all_where_a_lost_one_may_lie(flown_s, reach_m):
    """The longer it flew without a position, the further away it may be: it is never believed to
    lie in one place."""
    air = lost_for(Aloft(), flown_s)
    assert not air.run(5.0).held, "on the ground it endangers nobody who flies"
    air.battery = 0.05
    air.run(20.0)
    assert air.modes == ["LAND"] and np.hypot(*(air.p[:2] - [0.0, 10.0])) > reach_m
    assert bool(air.held) is (reach_m > 10.0)


def test_it_goes_out_of_the_way_within_the_fence_where_it_can():
    air = lost_for(
        Aloft(
            GuardianRules(
                fence=Fence(0.3, 45.0, 100.0, [(-30, -12), (30, -12), (30, 30), (-30, 30)])
            )
        ),
        20,
    )
    air.battery = 0.05
    air.run(20.0)
    assert np.hypot(*(air.p[:2] - [0.0, 10.0])) > 17.6 and air.p[1] > -12.0


def test_it_counts_how_long_it_flew_without_a_position():
    air = Aloft()
    air.silent.add("feed")
    air.run(5.0)
    assert air.guardian.verdict.lost_s == pytest.approx(4.3, abs=0.1)  # 0.7 s until it is sure
    air.armed, air.p[2] = False, 0.0
    air.run(30.0)
    assert air.guardian.verdict.lost_s == pytest.approx(4.3, abs=0.2)


def test_one_that_is_lost_and_falls_silent_flies_on():
    heard = Other(np.zeros(3), 100.0, lost=True, lost_s=10.0)
    assert heard.reach_m(100.0) < heard.reach_m(120.0)
    assert Other(np.zeros(3), 100.0, lost=True, lost_s=10.0, armed=False).reach_m(
        120.0
    ) == heard.reach_m(100.0)


def test_it_says_that_it_lost_its_position_until_its_next_take_off():
    air = Aloft()
    air.silent.add("feed")
    air.run(1.0)
    assert air.guardian.verdict.lost
    air.silent.clear()
    air.armed, air.p[2] = False, 0.0
    air.run(5.0)
    assert air.guardian.verdict.lost and not air.guardian.verdict.uncontrolled
    air.mode, air.armed = Mode.LOITER, True
    assert not air.run(0.5).guardian.verdict.lost


def test_who_is_calibrated_anew_after_it_was_lost_is_found():
    """The tracker was silent while people flew it; what it told later began anew, and was
    calibrated."""
    air = Aloft()
    air.guardian.epoch(1)
    air.guardian.calibrated(1)
    air.silent.add("feed")
    assert air.run(1.0).guardian.verdict.lost
    air.guardian.epoch(2)
    air.silent.clear()
    assert air.run(2.0).guardian.verdict.lost, "the calibration is of the frame that is gone"
    air.guardian.calibrated(2)
    assert not air.run(1.0).guardian.verdict.lost and air.guardian.verdict.lost_s == 0.0


@pytest.mark.parametrize("finds_again", [False, True])
def test_a_tracker_on_the_ground_finds_again_who_was_lost(finds_again):
    """One on board adds up ways: what it tells after it was silent is another frame."""
    air = Aloft(GuardianRules(finds_again=finds_again))
    air.silent.add("feed")
    air.run(1.0)
    air.silent.clear()
    assert air.run(0.5).guardian.verdict.lost
    assert air.run(1.5).guardian.verdict.lost is not finds_again


def test_it_says_whose_it_is():
    air = Aloft()
    assert not air.guardian.verdict.taken
    air.mode = Mode.BRAKE  # the pilot's
    assert air.run(0.5).guardian.verdict.taken


def landing(height_m, rules=None):
    """On its way down, as the mission ordered it."""
    air = Aloft(rules)
    air.guardian.mode_asked(air.now_s, Mode.LAND)
    air.mode, air.p[2] = Mode.LAND, height_m
    return air.run(0.5)


def test_who_lands_goes_out_of_the_way_of_one_that_comes_down_without_control():
    air = landing(6.0)
    assert not air.asked
    air.others = {
        "uav2": {"p_home_m": np.array([3.0, 0.0, 7.0]), "mode": Mode.LAND, "uncontrolled": True}
    }
    begun_s = air.now_s
    air.run(8.0)
    assert air.modes[0] == Mode.GUIDED and air.asked[0][0] - begun_s < 1.0
    assert air.mode == Mode.LAND and np.hypot(*(air.p[:2] - [3.0, 0.0])) > 6.0, (
        "then it lands there"
    )


def test_near_the_ground_it_is_sooner_down_than_away():
    air = landing(1.5)
    air.others = {
        "uav2": {"p_home_m": np.array([3.0, 0.0, 7.0]), "mode": Mode.LAND, "uncontrolled": True}
    }
    assert not air.run(3.0).asked


def lying(x_m, y_m):
    return {"uav2": {"p_home_m": np.array([x_m, y_m, 0.0]), "armed": False}}


def test_a_land_that_came_above_one_that_lies_is_left_for_a_place_aside():
    air = landing(6.0)
    air.others = lying(0.0, 0.3)
    air.run(6.0)
    assert air.modes[0] == Mode.GUIDED and air.mode == Mode.LAND
    assert np.hypot(*(air.p[:2] - [0.0, 0.3])) > 2.1  # clear_m less what counts as there
    assert "uav1: uav2 is beneath" in air.texts


@pytest.mark.parametrize("x_m, modes", [(0.3, [Mode.GUIDED, Mode.LAND]), (0.9, []), (1.4, [])])
def test_small_vehicles_that_keep_less_do_not_take_turns(x_m, modes):
    """Between LAND and aside: one metre is enough for a Tello, and 0.72 m for its LAND to go on."""
    air = landing(6.0, GuardianRules(clear_m=1.0, uncontrolled_clear_m=3.0))
    air.others = lying(x_m, 0.0)
    air.run(8.0)
    asked = [mode for k, mode in enumerate(air.modes) if k == 0 or mode != air.modes[k - 1]]
    assert asked == modes and air.mode == Mode.LAND


@pytest.mark.parametrize("height_m, x_m", [(6.0, 2.0), (1.5, 0.3)])
def test_a_land_beside_one_that_lies_or_near_the_ground_goes_on(height_m, x_m):
    air = landing(height_m)
    air.others = lying(x_m, 0.0)
    assert not air.run(3.0).asked and not air.held


def test_a_pilots_land_above_one_that_lies_is_only_told():
    air = Aloft()
    air.mode, air.others = Mode.LAND, lying(0.0, 0.3)
    air.run(3.0)
    assert not air.asked and not air.held and "uav1: uav2 is beneath" in air.texts


def test_a_landing_beside_another_that_lands_goes_on():
    air = landing(6.0)
    air.others = {"uav2": {"p_home_m": np.array([2.0, 0.0, 7.0]), "mode": Mode.LAND}}
    assert not air.run(3.0).asked


def alone(share=0.15, p=(6.0, 0.0, 8.0), **others):
    """One whose battery is low, away from its take-off place, with the control PC silent; others by
    their places."""
    air = Aloft()
    air.p = np.array(p)
    air.run(1.0)
    air.others = {
        name: {"p_home_m": np.array(p_other), "mode": Mode.GUIDED}
        for name, p_other in others.items()
    }
    air.battery = share
    air.silent.add("control")
    air.forget()
    return air


def words(air):
    return "; ".join(air.texts)


def test_who_has_a_low_battery_and_nobody_to_command_it_flies_home_and_lands_there():
    air = alone(uav2=(12.0, 0.0, 8.0)).run(9.5)
    assert not air.held and not air.asked, "a mission that is started again may bring it down"
    air.run(1.0)
    assert air.guardian.verdict.action == "home" and air.guardian.verdict.holds
    air.run(5.0)
    assert np.allclose(air.held[0][1], [0.0, 0.0, 8.0]), "at the height that it had"
    assert air.modes == ["LAND"] and np.linalg.norm(air.p[:2]) < 0.5
    assert "nothing from the control PC" in words(air) and "above its take-off place" in words(air)


def test_a_mission_that_lives_brings_it_down_itself():
    air = alone()
    air.silent.clear()
    assert air.run(50.0).held == [] and air.asked == []


@pytest.mark.parametrize("share", [0.05, math.nan, 0.8])
def test_a_battery_that_is_empty_unknown_or_well_flies_nobody_home(share):
    air = alone(share).run(29.0)
    assert not air.held and air.modes == (["LAND"] if share == 0.05 else [])


def test_a_mission_that_is_heard_again_stops_it_on_the_way():
    air = alone(p=(20.0, 0.0, 8.0)).run(13.0)
    air.silent.clear()
    here = air.p.copy()
    air.run(2.0)
    assert np.linalg.norm(air.p - here) < 2.0 and np.linalg.norm(air.held[-1][1] - here) < 2.0
    air.run(2.0)
    assert not air.guardian.verdict.holds and not air.asked


@pytest.mark.parametrize(
    "others, why",
    [
        ({"uav2": (6.0, 0.3, 3.0)}, "uav2 is beneath"),
        ({"uav2": (3.0, 0.5, 8.0)}, "uav2 is too near to the way"),
        ({"uav2": (3.0, 0.5, 1.0)}, "uav2 is too near to the way"),
        ({"uav2": (-2.0, 0.0, 0.0)}, "uav2 is too near to the way, or to the take-off place"),
    ],
)
def test_where_the_way_or_the_place_is_not_clear_it_stays_and_lands_as_ever(others, why):
    air = alone(**others).run(29.0)
    assert not air.held and not air.asked and f"it does not fly home: {why}" in words(air)
    air.run(8.0)
    assert air.modes == ["LAND"]


def test_who_comes_into_the_way_stops_it_there():
    air = alone(p=(20.0, 0.0, 8.0), uav2=(9.0, 12.0, 8.0)).run(13.0)
    assert 12.0 < air.p[0] < 16.0
    air.others["uav2"]["p_home_m"] = np.array([4.0, 1.0, 8.0])
    air.run(4.0)
    assert (
        air.p[0] > 11.0
        and air.guardian.verdict.action == "hold"
        and "uav2 is too near to the way" in words(air)
    )
    air.others.clear()
    air.guardian.air.others.clear()
    air.run(5.0)
    assert air.p[0] > 11.0, "two that stop for each other do not go on by turns"


@pytest.mark.parametrize("speed_mps, flies", [(0.2, True), (2.0, False)])
def test_who_moves_may_be_in_the_way_by_then(speed_mps, flies):
    air = alone(uav2=(6.0, 9.0, 8.0))
    air.others["uav2"]["speed_mps"] = speed_mps
    assert bool(air.run(11.0).held) == flies


def test_who_is_not_heard_may_be_anywhere():
    air = alone(uav2=(12.0, 0.0, 8.0))
    air.run(1.0)
    air.silent.add("uav2")
    assert not air.run(12.0).held and "it does not fly home: uav2 is not heard" in words(air)


def unsure(air):
    air.confidence = 1.0


def began_anew(air):
    air.guardian.epoch(7)


def not_in_home(air):
    air.T_home_odom = None


def off(air):
    air.feed_off = np.array([1.2, 0.0, 0.0])


def fenced(air):
    air.guardian.mission_fence(Fence(polygon=[(4.0, -9.0), (9.0, -9.0), (9.0, 9.0), (4.0, 9.0)]))


@pytest.mark.parametrize(
    "spoil, why",
    [
        (began_anew, "its take-off place is not known"),
        (not_in_home, "its place among the others is not known"),
        (unsure, "its position is not good"),
        (off, "its position is not good"),
        (fenced, "the way leaves the fence"),
    ],
)
def test_who_does_not_know_the_way_stays(spoil, why):
    air = alone()
    air.run(9.0)
    spoil(air)
    air.run(2.0)
    assert f"it does not fly home: {why}" in words(air)
    assert all(np.linalg.norm(p - [6.0, 0.0, 8.0]) < 0.1 for _, p in air.held)


def test_a_pilot_is_not_flown_home():
    air = alone(p=(20.0, 0.0, 8.0)).run(12.0)
    assert air.held
    air.mode = Mode.LOITER
    air.run(0.1)
    air.forget()
    assert air.run(90.0).held == [] and air.asked == []
    air.mode = Mode.GUIDED  # by himself
    assert air.run(20.0).held == [] and air.asked == []


def test_who_comes_too_near_on_the_way_home_outranks_it():
    air = alone(p=(20.0, 0.0, 8.0), uav2=(30.0, 0.0, 8.0)).run(12.0)
    air.others["uav2"]["p_home_m"] = air.p + [0.3, 0.3, 0.0]
    air.run(0.2)
    assert air.guardian.verdict.action == "aside"
