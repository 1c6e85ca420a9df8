# SPDX-License-Identifier: Apache-2.0
"""Gimbals on a robot that moves: what was seen is carried along by its wheels."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_geometry.errors import PoseUnavailable
from fcsv_tracking.gimbal.base_motion import BaseMotion, BasePlace
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


T_HOME_START = tf.from_xyz_yaw([1.0, -2.0, -1.8], 2.5)


def driving(until_s=2.0, places_until_s=1.5):
    """A robot whose places in home come late, and whose wheels count from elsewhere."""
    motion = turning(until_s=until_s)
    base = BasePlace(motion)
    base.set_home(T_HOME_START)
    for t in np.arange(0.0, places_until_s + 1e-9, 0.1):
        here = T_HOME_START @ motion.at(t)
        here[2, 3] = 0.0  # its place is level
        base.add(t, here, np.eye(6) * 1e-4)
    return motion, base


def test_a_vehicle_that_holds_keeps_its_place_while_the_robot_drives_and_turns():
    motion, base = driving()
    T_S_D = tf.from_xyz_yaw([3.0, 1.0, 1.4], 0.7)
    for t in (0.55, 1.5, 1.9):  # between places, at the last, after it
        seen = tf.invert(motion.at(t)) @ T_S_D
        found, covariance = base.standing(t, seen, np.eye(6) * 1e-4)
        assert found == pytest.approx(T_S_D, abs=2e-3)
        away_m = np.linalg.norm(seen[:2, 3])
        assert covariance[0, 0] + covariance[1, 1] == pytest.approx(
            1e-4 * (4 + away_m**2 + 2 * seen[2, 3] ** 2), rel=0.02
        ), "the robot's yaw counts by the vehicle's distance"


def test_before_its_place_is_known_the_robot_stands_and_a_new_home_begins_anew():
    motion = turning()
    base = BasePlace(motion)
    base.add(0.5, tf.from_xyz_yaw([9.0, 9.0, 0.0], 1.0), np.eye(6))
    assert np.array_equal(base.at(1.0), np.eye(4)), "no home was set yet"
    _, base = driving()
    assert base.at(1.5)[0, 3] > 0.4
    base.set_home(T_HOME_START)
    assert np.array_equal(base.at(1.5), np.eye(4))


def test_a_picture_from_before_what_is_remembered_has_no_place():
    _, base = driving()
    with pytest.raises(PoseUnavailable, match="before the first pose"):
        base.standing(-5.0, np.eye(4), np.eye(6))
