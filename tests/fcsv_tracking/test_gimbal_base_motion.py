# SPDX-License-Identifier: Apache-2.0
"""Gimbals on a robot that moves: what was seen is carried along by its wheels."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_tracking.gimbal.base_motion import BaseMotion
from fcsv_tracking.gimbal.follow import Target


def turning(rate_radps=0.5, until_s=2.0):
    base = BaseMotion()
    for t in np.arange(0.0, until_s + 1e-9, 0.05):
        base.add(t, tf.from_xyz_yaw([0.3 * t, 0.0, 0.0], rate_radps * t))
    return base


def test_without_odometry_a_robot_stands():
    base, target = BaseMotion(), Target(0.0, np.array([3.0, 0.0, 1.0]), np.zeros(3))
    assert not base.moves and np.array_equal(base.at(5.0), np.eye(4))
    assert base.in_ground(target, 4.0, 0.5) is target


def test_a_standing_vehicle_moves_as_the_robot_turns_and_drives():
    base = turning()
    found = base.in_ground(Target(1.9, np.array([3.0, 0.0, 1.0]), np.zeros(3)), 2.0, 0.5)
    expected = tf.apply(tf.invert(base.at(2.0)), np.array([3.0, 0.0, 1.0]))
    assert found.at(2.0) == pytest.approx(expected, abs=1e-9)
    later = tf.apply(tf.invert(base.at(2.1)), np.array([3.0, 0.0, 1.0]))
    assert found.at(2.1) == pytest.approx(later, abs=1e-6), "to where it will be"
    assert found.last_sight_s == 1.9


def test_one_that_is_lost_stays_where_it_was_in_the_place_not_before_the_robot():
    base = turning()
    found = base.in_ground(
        Target(0.5, np.array([3.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])), 2.0, 0.5
    )
    expected = tf.apply(tf.invert(base.at(2.0)), np.array([3.0, 0.5, 1.0]))
    assert found.at(2.0) == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(found.v_ground_mps, np.zeros(3)) and found.last_sight_s == 0.5


def test_wheels_that_are_silent_stand_and_a_clock_that_is_set_back_begins_anew():
    base = turning()
    assert np.allclose(base.at(9.0), base.at(2.0))
    assert not np.allclose(base.at(2.2), base.at(2.0)), "on for a moment"
    base.add(-50.0, tf.from_xyz_yaw([7.0, 0.0, 0.0], 0.0))
    assert base.at(-50.0)[0, 3] == 7.0 and base.at(-60.0)[0, 3] == 7.0
