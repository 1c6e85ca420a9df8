# SPDX-License-Identifier: Apache-2.0
"""The simulated Tello, and who flies it to a place with poses that are late."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_sim.people.tello_pilot import Hand
from fcsv_sim.vehicles.tello import MAX_SPEED_MPS, SimulatedTello, TelloParameters

START_S = 1000.0


class Flown:
    """A Tello in simulated time; each step of 10 ms asks ``sticks(now)`` for velocity and turn."""

    def __init__(self, folder, seed=1):
        self.now_s = START_S
        self.tello = SimulatedTello(TelloParameters("tello1", str(folder), seed), self.now_s)

    def fly(self, seconds, sticks=None, every=5):
        for k in range(int(seconds * 100)):
            self.now_s += 0.01
            if sticks and k % every == 0:
                self.tello.stick(self.now_s, *sticks(self.now_s))
            self.tello.advance_to(self.now_s)
            yield self.tello.body.T_world_body

    def take_off(self):
        self.tello.take_off()
        return list(self.fly(6.0))[-1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_takes_off_hovers_and_lands(tmp_path, seed):
    flown = Flown(tmp_path, seed)
    assert list(flown.fly(1.0))[-1][2, 3] == 0.0 and not flown.tello.flying
    T = flown.take_off()
    assert flown.tello.mode == "FLY" and 0.9 < T[2, 3] < 1.6  # 0.9 m and what braking from 0.6 m/s takes
    flown.tello.land()
    path = list(flown.fly(8.0))
    assert flown.tello.mode == "LANDED" and path[-1][2, 3] == 0.0 and flown.tello.body.on_ground


def test_left_alone_it_drifts_by_no_more_than_its_flow_sensor_is_off(tmp_path):
    """0.02 m/s (standard deviation) of bias and gusts of 0.2 m/s that its hold takes out within a second."""
    flown = Flown(tmp_path, 4)
    before = flown.take_off()[:3, 3]
    after = list(flown.fly(10.0))[-1][:3, 3]
    assert 0.01 < np.linalg.norm(after - before) < 1.0


def test_sticks_are_speeds_with_a_limit_and_let_go_after_half_a_second(tmp_path):
    flown = Flown(tmp_path)
    flown.take_off()
    x = [T[0, 3] for T in flown.fly(4.0, lambda _now: ([9.0, 0.0, 0.0], 0.0))]
    assert (x[-1] - x[-101]) == pytest.approx(MAX_SPEED_MPS, abs=0.2)
    x = [T[0, 3] for T in flown.fly(4.0)]
    assert abs(x[-1] - x[-101]) < 0.2


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_is_held_at_a_place_with_poses_that_are_late(tmp_path, seed):
    """Poses 0.25 s late, five a second, as a gimbal on a busy machine gives them: there within 8 s from 2 m.

    What is left are gusts (0.2 m/s, taken out within a second by its own hold): in the 0.12 m that missions ask of a
    settled vehicle nearly always, never beyond the 0.2 m of a recording.
    """
    flown = Flown(tmp_path, seed)
    T = flown.take_off()
    target = tf.from_xyz_yaw(T[:3, 3] + [1.2, -1.6, 0.5], 0.3)
    past, hand = [(flown.now_s, T)], Hand()

    def sticks(now_s):
        late = [T for t, T in past if t < now_s - 0.25]
        return hand.sticks(0.2, late[-1], target) if late else (np.zeros(3), 0.0)

    errors = []
    for T in flown.fly(16.0, sticks, every=20):
        past.append((flown.now_s, T))
        errors.append(np.linalg.norm(T[:3, 3] - target[:3, 3]))
    assert np.percentile(errors[800:], 95) < 0.12 and max(errors[800:]) < 0.2
    assert abs(tf.yaw(past[-1][1]) - 0.3) < np.radians(3.0)
