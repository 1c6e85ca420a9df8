# SPDX-License-Identifier: Apache-2.0
"""Pilots fly the simulated autopilot by hand: with the sticks of ArduCopter's own defaults, and
with those advised."""

import math

import numpy as np
import pytest
from support.autopilots import PROFILE

from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot.parameters import DEFAULTS, STICKS_AS_DELIVERED
from fcsv_sim.autopilot.sticks import LoiterVelocity, StickParameters
from fcsv_sim.people.operator import Field, Pilot
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle, Start
from fcsv_sim.trials.formation import formation_vehicle
from fcsv_sim.vehicles.vehicle import PASS_S

_LOOKS_EVERY = 5  # passes
ADVISED = {
    "THR_DZ": 40,
    "LOIT_SPEED": 300,
    "LOIT_ACC_MAX": 330,
    "LOIT_BRK_DELAY": 0.2,
    "LOIT_ANG_MAX": 20,
}
_SETS = {"as delivered": STICKS_AS_DELIVERED, "advised": ADVISED}


def sticks_of(changed):
    return StickParameters.of({**DEFAULTS, **{name: (value, 9) for name, value in changed.items()}})


class ByHand:
    """One vehicle and its pilot."""

    def __init__(self, changed, seed=1):
        self.vehicle = RehearsedVehicle(formation_vehicle(1), Start((0.0, 0.0, 0.0, 0.0)), seed)
        self.vehicle.autopilot.stick_parameters = sticks_of(changed)
        self.pilot, self.now_s, self.track = Pilot(0, Field(), seed), 0.0, []

    def run(self, seconds, phase):
        """(n, 3) where it flew."""
        self.track = []
        for k in range(int(seconds / PASS_S)):
            self.now_s += PASS_S
            self.vehicle.step(self.now_s)
            if k % _LOOKS_EVERY == 0:
                self.vehicle.sticks(
                    self.now_s, self.pilot.sticks(self.now_s, phase, self.vehicle.sight())
                )
                self.track.append(self.vehicle.p_world_m.copy())
        return np.array(self.track)

    def in_column(self):
        self.run(4.0, "WAIT_VEHICLES")
        self.run(25.0, "TAKE_OFF")
        assert self.vehicle.autopilot.armed and self.vehicle.state.mode == Mode.LOITER
        self.run(10.0, "COLUMN")
        return self


@pytest.mark.parametrize("changed", _SETS.values(), ids=_SETS)
def test_a_pilot_holds_his_place_and_sways_as_he_wants(changed):
    """Before, with the sticks as delivered he stayed half a metre too low, and swayed by up to 3.7
    m."""
    flown = ByHand(changed).in_column()
    goal = flown.pilot.goal(flown.now_s, "COLUMN")[0]
    stood = flown.run(5.0, "COLUMN") - goal
    assert np.abs(stood[:, 2]).max() < 0.25 and np.hypot(*stood[:, :2].T).max() < 0.4
    swayed = flown.run(8.0, "CALIBRATE")
    assert 1.0 < np.ptp(swayed[:, 1]) < 2.2 and np.ptp(swayed[:, 0]) < 0.6
    assert np.abs(np.gradient(swayed[:, 1], _LOOKS_EVERY * PASS_S)).max() < 1.5, (
        "slower than calibration accepts"
    )


def test_the_profile_advises_them():
    rules = {rule.name: rule for rule in PROFILE}
    for name, value in ADVISED.items():
        assert not rules[name].must and rules[name].complaint(STICKS_AS_DELIVERED[name])
        assert rules[name].complaint(value) == "" and DEFAULTS[name][0] == value


@pytest.mark.parametrize("changed, dead", [({"THR_DZ": 100}, 0.2), ({"THR_DZ": 40}, 0.08)])
def test_the_throttle_begins_at_the_edge_of_its_dead_band(changed, dead):
    sticks = sticks_of(changed)
    assert sticks.climb_rate(dead - 0.01) == sticks.climb_rate(0.01 - dead) == 0.0
    assert 0.0 < sticks.climb_rate(dead + 0.01) < 0.05
    assert sticks.climb_rate(1.0) == pytest.approx(2.5) and sticks.climb_rate(
        -1.0
    ) == pytest.approx(-2.5)
    assert sticks_of({**changed, "PILOT_SPEED_DN": 150}).climb_rate(-1.0) == pytest.approx(-1.5)


def loiter(changed, stick, seconds, released_s=0.0):
    """Speed (m/s) after a stick forward for so long, and some time after it was let go."""
    sticks, loiters = sticks_of(changed), LoiterVelocity()
    for k in range(int((seconds + released_s) / PASS_S)):
        v = loiters.step(sticks, 0.0, stick if k * PASS_S < seconds else 0.0, 0.0, PASS_S)
    return math.hypot(*v)


def test_the_whole_stick_ends_at_loit_speed_and_the_lean_says_how_soon():
    assert loiter(ADVISED, 1.0, 20.0) == pytest.approx(3.0, rel=0.02)
    assert loiter(STICKS_AS_DELIVERED, 1.0, 60.0) == pytest.approx(12.5, rel=0.02)
    assert loiter(ADVISED, 0.03, 20.0) == 0.0, "within the dead band of 20 us"
    tau_s = 12.5 / (9.81 * math.tan(math.radians(20.0)))  # of the drag
    assert loiter(STICKS_AS_DELIVERED, 1.0, tau_s + 0.15) == pytest.approx(
        12.5 * (1.0 - math.exp(-1.0)), rel=0.05
    )


def test_it_brakes_some_time_after_the_stick_was_let_go():
    gone = lambda changed, s: loiter(changed, 0.4, 10.0, s) / loiter(changed, 0.4, 10.0)  # noqa: E731
    assert gone(STICKS_AS_DELIVERED, 0.9) > 0.75, "the drag alone"
    assert gone(ADVISED, 0.9) < 0.35
    assert gone(STICKS_AS_DELIVERED, 6.0) < 0.15
