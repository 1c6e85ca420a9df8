# SPDX-License-Identifier: Apache-2.0
"""Pilots on a vehicle that answers sticks as LOITER and ALT_HOLD do, and the one who presses the
buttons."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.people.operator import ButtonPresser, Field, Pilot, PilotSight

STEP_S = 0.02
LOITER_SPEED_MPS, MAX_CLIMB_MPS, MAX_SINK_MPS = 3.0, 2.5, 1.5  # of the whole stick
LAG_S = 0.4  # how fast the velocity follows the stick
WIND_MPS2 = 0.3  # in ALT_HOLD nothing holds against it but the pilot


class StickVehicle:
    """Velocity from sticks in LOITER, acceleration from lean in ALT_HOLD; arms by the rudder
    gesture."""

    def __init__(self, xy, seed, yaw_rad=0.0):
        self.p = np.array([*xy, 0.0])
        self.v = np.zeros(3)
        self.yaw_rad = yaw_rad
        self.armed = False
        self.mode = Mode.STABILIZE
        self.refuses_loiter = 0  # so many times
        self._switch = None
        self._gesture_s = 0.0
        self._wind = np.random.default_rng(seed).uniform(-WIND_MPS2, WIND_MPS2, 2)

    def step(self, s):
        if s.mode != self._switch:
            self._switch = s.mode
            if s.mode == Mode.LOITER and self.refuses_loiter:
                self.refuses_loiter -= 1
            else:
                self.mode = s.mode
        self._gesture_s = self._gesture_s + STEP_S if s.throttle < -0.9 and s.yaw > 0.9 else 0.0
        if self._gesture_s > 2.0:
            self.armed = True
        climb = (
            0.0
            if abs(s.throttle) < 0.1
            else s.throttle * (MAX_CLIMB_MPS if s.throttle > 0 else MAX_SINK_MPS)
        )
        self.yaw_rad -= (
            STEP_S
            * np.radians(100.0)
            * (s.yaw if abs(s.yaw) > 0.05 and self.armed and self.p[2] > 0 else 0)
        )
        if not self.armed or (self.p[2] <= 0 and climb <= 0):
            return
        c, si = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        forward, left = s.pitch, -s.roll
        body = np.array([c * forward - si * left, si * forward + c * left])
        if self.mode == Mode.LOITER:
            body = np.array([0.0 if abs(x) < 0.05 else x for x in (forward, left)])
            target = LOITER_SPEED_MPS * np.array(
                [c * body[0] - si * body[1], si * body[0] + c * body[1]]
            )
            self.v[:2] += (target - self.v[:2]) * STEP_S / LAG_S
        elif self.mode == Mode.ALT_HOLD:
            self.v[:2] += (
                9.81 * np.tan(np.radians(30)) * body + self._wind - 0.2 * self.v[:2]
            ) * STEP_S
        if self.mode == Mode.LAND:
            climb, self.v[:2] = -1.0, 0.0
        self.v[2] += (climb - self.v[2]) * STEP_S / LAG_S
        self.p += self.v * STEP_S
        if self.p[2] <= 0 and self.mode == Mode.LAND:
            self.armed, self.p[2], self.v[:] = False, 0.0, 0.0

    def sight(self):
        return PilotSight(
            transforms.from_xyz_yaw(self.p, self.yaw_rad), self.v.copy(), self.armed, self.mode
        )


class Ground:
    """Two vehicles, two pilots, one at the buttons; the mission's phase is set by the test."""

    column_m = np.array([[0.0, 0.0], [-3.5, 0.0]])

    def __init__(self, seed=1, count=2):
        self.field = Field()
        self.now_s = 100.0
        self.phase, self.waits_for = "WAIT_VEHICLES", ""
        self.vehicles = {
            f"uav{i + 1}": StickVehicle((-3.5 * i, 0.3 * i), seed + i, 0.1 * (i - 0.5))
            for i in range(count)
        }
        self.pilots = [Pilot(i, self.field, seed) for i in range(count)]
        self.presser = ButtonPresser()
        self.pressed_s = []
        self.track = []
        self.loiter_heights_m = {}  # where each was switched to LOITER first
        self.sees_others, self.battery_share = False, 0.9

    def sight(self, name):
        others = tuple(
            v.p.copy() for n, v in self.vehicles.items() if n != name and self.sees_others
        )
        return replace(self.vehicles[name].sight(), battery_share=self.battery_share, others=others)

    def run(self, seconds):
        for _ in range(int(seconds / STEP_S)):
            self.now_s += STEP_S
            sights = {n: self.sight(n) for n in self.vehicles}
            self.sticks = [
                p.sticks(self.now_s, self.phase, s) for p, s in zip(self.pilots, sights.values())
            ]
            for vehicle, sticks in zip(self.vehicles.values(), self.sticks):
                assert (
                    max(abs(x) for x in (sticks.roll, sticks.pitch, sticks.throttle, sticks.yaw))
                    <= 1.0
                )
                vehicle.step(sticks)
            if self.presser.press(self.now_s, self.waits_for, self.phase, sights, self.pilots):
                self.pressed_s.append(self.now_s)
                self.waits_for = ""
            for name, vehicle in self.vehicles.items():
                if vehicle.mode == Mode.LOITER:
                    self.loiter_heights_m.setdefault(name, vehicle.p[2])
            self.track.append([v.p.copy() for v in self.vehicles.values()])

    def airborne(self):
        self.phase = "TAKE_OFF"
        self.run(25.0)
        return self

    def off(self, phase):
        goals = [p.goal(self.now_s, phase)[0] for p in self.pilots]
        return [float(np.linalg.norm(v.p - g)) for v, g in zip(self.vehicles.values(), goals)]


@pytest.mark.parametrize("seed", range(4))
def test_take_off_in_alt_hold_then_loiter(seed):
    ground = Ground(seed)
    ground.run(2.0)
    assert not any(v.armed for v in ground.vehicles.values()), (
        "nobody arms before the mission says so"
    )
    ground.airborne()
    for v in ground.vehicles.values():
        assert v.armed and v.mode == Mode.LOITER and abs(v.p[2] - ground.field.home_height_m) < 0.3
    switched = ground.loiter_heights_m
    assert all(3.0 < z < 5.5 for z in switched.values()), "LOITER only well off the ground"
    heights = np.array(ground.track)[:, :, 2]
    assert heights.max() < 8.8, "no overshoot that frightens anybody"
    wander = np.linalg.norm(np.array(ground.track)[:, :, :2] - ground.column_m, axis=-1)
    assert wander.max() < 1.2, "against the wind of ALT_HOLD the pilot keeps the column"


def test_a_refused_loiter_is_tried_again():
    ground = Ground()
    ground.vehicles["uav2"].refuses_loiter = 2
    ground.airborne()
    ground.run(5.0)
    assert ground.vehicles["uav2"].mode == Mode.LOITER


def test_without_a_position_he_flies_in_alt_hold_where_a_stick_is_a_lean():
    ground = Ground().airborne()
    ground.phase = "COLUMN"
    ground.run(5.0)
    vehicle = ground.vehicles["uav2"]
    vehicle.mode, vehicle.refuses_loiter = Mode.STABILIZE, 100
    ground.run(1.0)
    assert vehicle.mode == Mode.ALT_HOLD
    ground.run(30.0)
    # some 0.3 m of it for the wind
    assert vehicle.mode == Mode.ALT_HOLD and max(ground.off("COLUMN")) < 1.0


def test_the_column_is_in_line_and_still():
    ground = Ground().airborne()
    ground.phase = "COLUMN"
    ground.run(10.0)
    assert max(ground.off("COLUMN")) < 0.25
    front, back = ground.vehicles["uav1"], ground.vehicles["uav2"]
    # the tag of the one in front is in the middle of the picture: within a tenth of its 56 degrees
    bearing = np.arctan2(*(front.p - back.p)[1::-1]) - back.yaw_rad
    assert abs(np.degrees(bearing)) < 5.6 and abs(front.p[2] - back.p[2]) < 0.3
    still = np.array(ground.track[-150:])
    assert np.ptp(still, axis=0).max() < 0.15


def test_only_the_front_one_sways_while_calibrating():
    ground = Ground().airborne()
    ground.phase = "COLUMN"
    ground.run(8.0)
    start = len(ground.track)
    ground.phase = "CALIBRATE"
    ground.run(8.0)
    track = np.array(ground.track[start:])
    assert 1.0 < np.ptp(track[:, 0, 1]) < 2.2, "a metre and more to the sides: enough to tell yaw"
    assert np.ptp(track[:, 0, 2]) > 0.1 and np.ptp(track[:, 0, 0]) < 0.4
    assert np.ptp(track[:, 1], axis=0).max() < 0.3
    assert np.abs(np.gradient(track[:, 0, 1], STEP_S)).max() < 1.5, (
        "slower than what calibration accepts"
    )
    distance = np.linalg.norm(track[:, 0] - track[:, 1], axis=1)
    assert distance.min() > 2.5


def test_all_go_to_the_starting_point_together():
    ground = Ground().airborne()
    ground.phase = "MOVE_HOME"
    ground.run(15.0)
    assert max(ground.off("MOVE_HOME")) < 0.25 and ground.vehicles["uav1"].p[2] > 7.7
    distance = np.linalg.norm(np.diff(np.array(ground.track), axis=1)[:, 0], axis=1)
    assert distance.min() > 2.5, "in formation"


def test_buttons_are_pressed_once_it_looks_right():
    ground = Ground().airborne()
    ground.phase, ground.waits_for = "MOVE_HOME", "set_home"
    ground.run(1.0)
    assert not ground.pressed_s, "the vehicles are not there yet"
    began_s = ground.now_s
    ground.run(25.0)
    assert len(ground.pressed_s) == 1 and ground.pressed_s[0] - began_s > 1.5
    ground.phase, ground.waits_for = "SET_HOME", "execute"
    ground.run(3.0)
    assert len(ground.pressed_s) == 2


@pytest.mark.parametrize("phase", ["GUIDED", "CONFIGURATIONS"])
def test_hands_off_while_the_mission_flies(phase):
    ground = Ground().airborne()
    ground.phase = phase
    ground.run(20.0)
    for s in ground.sticks:
        assert (s.roll, s.pitch, s.throttle, s.yaw, s.mode) == (0.0, 0.0, 0.0, 0.0, Mode.LOITER)


@pytest.mark.parametrize("before", ["TAKE_OFF", "COLUMN"])
def test_the_switch_stays_when_the_mission_lands(before):
    """A switch that moves would take the vehicle out of LAND."""
    ground = Ground()
    ground.phase = "TAKE_OFF"
    ground.run(4.0 if before == "TAKE_OFF" else 25.0)
    modes = [s.mode for s in ground.sticks]
    ground.phase = "LAND"
    for v in ground.vehicles.values():
        v.mode = Mode.LAND
    ground.run(5.0)
    assert [s.mode for s in ground.sticks] == modes and all(
        s.throttle == 0.0 for s in ground.sticks
    )


def test_pilots_land_what_they_fly_by_hand_when_the_mission_ends():
    """The mission does not command them."""
    ground = Ground().airborne()
    ground.phase = "LAND"
    ground.run(0.5)
    assert all(v.mode == Mode.LOITER for v in ground.vehicles.values())
    ground.run(2.0)
    assert all(v.mode == Mode.LAND for v in ground.vehicles.values())


def test_pilots_land_by_hand_where_the_mission_cannot():
    ground = Ground().airborne()
    for v in ground.vehicles.values():
        v.mode = Mode.GUIDED
    ground.phase = "LAND"  # and no command comes through
    ground.run(10.0)
    assert all(v.mode == Mode.GUIDED for v in ground.vehicles.values())
    ground.run(20.0)
    assert not any(v.armed for v in ground.vehicles.values())
    assert all(v.p[2] == 0.0 for v in ground.vehicles.values())


def test_pilots_react_late_and_are_the_same_for_a_seed():
    pilot = Pilot(0, Field(), 1)
    here = lambda x: PilotSight(  # noqa: E731
        transforms.from_xyz_yaw([x, 0.0, 4.0], 0.0), np.zeros(3), True, Mode.LOITER
    )
    for i in range(50):
        pilot.sticks(i * STEP_S, "COLUMN", here(0.0))
    pushed = [pilot.sticks(1.0 + i * STEP_S, "COLUMN", here(2.0)).pitch for i in range(30)]
    first = next(i for i, p in enumerate(pushed) if p < -0.2)
    assert first * STEP_S == pytest.approx(0.3, abs=0.021)
    tracks = []
    for seed in (5, 5, 6):
        ground = Ground(seed=1)
        ground.pilots = [Pilot(i, ground.field, seed) for i in range(2)]
        ground.airborne()
        tracks.append(np.array(ground.track))
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert np.abs(tracks[0] - tracks[2]).max() > 1e-3


def test_a_mission_that_starts_again_in_flight_leaves_hands_where_they_are():
    """It says WAIT_VEHICLES until it has heard them: no throttle down, no other mode."""
    pilot = Pilot(0, Field(), 1)
    sight = PilotSight(np.eye(4), np.zeros(3), True, "GUIDED")
    before = [pilot.sticks(0.02 * k, "CONFIGURATIONS", sight) for k in range(50)][-1]
    after = [pilot.sticks(1.0 + 0.02 * k, "WAIT_VEHICLES", sight) for k in range(50)][-1]
    assert after == before and after.throttle == 0.0


# ---- what a person would do ----------------------------------------------------------------------


def test_who_flies_back_goes_around_another_vehicle():
    """Straight back from ten metres away would be exactly through it."""
    ground = Ground().airborne()
    ground.phase = "COLUMN"
    ground.vehicles["uav1"].p[:] = ground.pilots[0].goal(0.0, "COLUMN")[0]
    back = ground.vehicles["uav2"]
    back.p[:] = [10.0, 0.0, 8.0]
    began = len(ground.track)
    ground.sees_others = True
    ground.run(25.0)
    track = np.array(ground.track[began:])
    assert np.linalg.norm((track[:, 0] - track[:, 1])[:, :2], axis=1).min() > 2.0
    assert max(ground.off("COLUMN")) < 0.3


def test_where_the_place_is_taken_he_waits():
    ground = Ground().airborne()
    ground.phase, ground.sees_others = "COLUMN", True
    ground.pilots[1].goal = ground.pilots[0].goal
    ground.run(20.0)
    assert np.linalg.norm(ground.vehicles["uav1"].p - ground.vehicles["uav2"].p) > 2.2


@pytest.mark.parametrize("mode, lands", [(Mode.LOITER, True), ("GUIDED", False)])
def test_with_a_dead_control_pc_who_flies_by_hand_lands_after_half_a_minute(mode, lands):
    ground = Ground().airborne()
    ground.phase = "CONFIGURATIONS"
    ground.run(1.0)
    for v in ground.vehicles.values():
        v.mode = mode
    ground.phase = ""
    ground.run(28.0)
    assert all(v.armed and v.mode == mode for v in ground.vehicles.values())
    ground.run(25.0)
    assert all(v.armed != lands for v in ground.vehicles.values()), "in GUIDED it is the guardian's"


def test_a_low_battery_is_landed_by_hand_and_nobody_takes_off_again():
    ground = Ground().airborne()
    ground.battery_share = 0.15
    ground.phase = "COLUMN"
    ground.run(40.0)
    assert not any(v.armed for v in ground.vehicles.values())
    assert all(s.throttle == -1.0 and s.yaw == 0.0 for s in ground.sticks)


def test_who_is_above_another_flies_aside_before_he_lands():
    ground = Ground().airborne()
    ground.sees_others = True
    ground.vehicles["uav2"].p[:] = ground.vehicles["uav1"].p + [0.3, 0.0, 5.0]
    ground.vehicles["uav1"].mode = Mode.GUIDED
    ground.phase = "LAND"
    ground.run(12.0)
    upper, lower = ground.vehicles["uav2"], ground.vehicles["uav1"]
    assert upper.mode == Mode.LAND and np.linalg.norm((upper.p - lower.p)[:2]) > 2.5


def test_nobody_lets_go_in_stabilize():
    """A stick in the middle is more thrust than it takes: where LOITER is refused, it would climb
    for ever."""
    pilot = Pilot(0, Field(), 1)
    pilot._switch = Mode.LOITER
    by_hand, flown = (
        PilotSight(np.eye(4), np.zeros(3), True, mode) for mode in (Mode.STABILIZE, Mode.GUIDED)
    )
    modes = [pilot.sticks(100.0 + 0.1 * k, "CONFIGURATIONS", by_hand).mode for k in range(30)]
    assert modes[:10] == [Mode.LOITER] * 10 and modes[-1] == Mode.ALT_HOLD
    assert pilot.sticks(104.0, "CONFIGURATIONS", flown).throttle == 0.0


def test_what_runs_off_in_land_is_brought_down_in_alt_hold():
    """Its position is lost: LAND follows it and does not end."""
    pilot = Pilot(0, Field(), 1)
    sight = PilotSight(
        transforms.from_xyz_yaw([0.0, 0.0, 0.9], 0.0), np.array([4.0, 0.0, 0.0]), True, "LAND"
    )
    assert not any(pilot.sticks(k, "LAND", sight).throttle for k in range(71))
    assert pilot.sticks(79.0, "LAND", sight).mode == Mode.ALT_HOLD
    s = pilot.sticks(80.0, "LAND", sight)
    assert s.pitch < -0.1 and s.throttle < 0.0


def test_a_resume_is_confirmed_wherever_they_stand_still():
    ground = Ground().airborne()
    ground.phase = "CONFIGURATIONS"
    # out at a configuration, or moved aside
    ground.vehicles["uav2"].p = ground.vehicles["uav2"].p + [2.0, -5.0, 3.0]
    sights = {n: ground.sight(n) for n in ground.vehicles}
    moving = dict(sights, uav1=replace(sights["uav1"], v_world_mps=np.array([0.8, 0.0, 0.0])))

    def pressed(seen):
        presser = ButtonPresser()
        return [
            k
            for k in range(40)
            if presser.press(0.1 * k, "resume", "CONFIGURATIONS", seen, ground.pilots)
        ]

    assert pressed(sights)[0] == pytest.approx(15, abs=1) and pressed(moving) == []
    # one is down: no use to wait
    assert pressed(dict(moving, uav2=replace(sights["uav2"], armed=False)))
