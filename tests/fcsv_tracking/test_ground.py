# SPDX-License-Identifier: Apache-2.0
"""The level frame of a tracker on the ground, and the odometry in it."""

import numpy as np
import pytest

from fcsv_geometry import transforms as tf
from fcsv_tracking.ground import GroundTrack, LevelFrame, LevelRules

KNOWN_RAD = np.radians(0.15)


def leaning(deg):
    return tf.from_xyz_rpy([0, 0, 0], np.radians([deg, 0.0, 0.0]))[:3, :3]


def test_it_is_fixed_once_level_is_known_and_stays():
    """It stands still while vehicles fly by it, however much better level is known later."""
    frame = LevelFrame(LevelRules(sigma_deg=0.2, leans_deg=2.5))
    assert not frame.offer(leaning(0.0), np.radians(0.6)) and frame.T_tracker_level is None
    assert frame.offer(leaning(0.4), KNOWN_RAD)
    first = frame.T_tracker_level.copy()
    assert not frame.offer(leaning(0.0), KNOWN_RAD / 10) and np.array_equal(
        frame.T_tracker_level, first
    )


def test_a_tracker_that_is_moved_begins_another_frame_and_says_so():
    frame = LevelFrame()
    frame.offer(leaning(0.0), KNOWN_RAD)
    assert not frame.offer(leaning(6.0), np.radians(5.0))  # nobody knows
    assert (
        frame.offer(leaning(6.0), KNOWN_RAD) and "leans by 6.0 degrees: it was moved" in frame.why
    )


@pytest.mark.parametrize(
    "R, sigma", [(np.full((3, 3), np.nan), KNOWN_RAD), (np.eye(3), float("nan"))]
)
def test_what_is_no_level_is_not_taken(R, sigma):
    assert not LevelFrame().offer(R, sigma)


def test_poses_and_covariances_are_turned_into_the_level_frame():
    """A tracker that looks up by 45 degrees: what it sees ahead of it is ahead and above."""
    T_tracker_level = tf.from_xyz_rpy([0, 0, 0], np.radians([0.0, 45.0, 0.0]))
    covariance = np.diag([4.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    found = GroundTrack().add(
        1.0, tf.from_xyz_yaw([2.0, 0.0, 0.0], 0.0), covariance, T_tracker_level
    )
    half = np.sqrt(0.5)
    assert found.T_odom_body[:3, 3] == pytest.approx([2 * half, 0.0, 2 * half])
    assert found.covariance[:3, :3] == pytest.approx(
        np.array([[2.5, 0.0, 1.5], [0.0, 1.0, 0.0], [1.5, 0.0, 2.5]])
    )


def test_velocity_is_in_the_bodys_axes_and_forgets_gaps():
    """1 m/s along x with the nose to the left: to its right. 6 time constants: within 1 %."""
    track, level = GroundTrack(), np.eye(4)
    T = lambda x: tf.from_xyz_yaw([x, 0.0, 1.0], np.pi / 2.0)  # noqa: E731
    for k in range(37):
        found = track.add(0.05 * k, T(0.05 * k), np.eye(6), level)
    assert found.v_body_mps == pytest.approx([0.0, -1.0, 0.0], abs=0.01)
    assert track.add(1.8, T(9.0), np.eye(6), level) is None  # its stamp is not after the one before
    assert np.array_equal(track.add(9.0, T(2.0), np.eye(6), level).v_body_mps, np.zeros(3))


def test_after_a_clock_that_was_set_back_it_goes_on():
    track = GroundTrack()
    track.add(1000.0, np.eye(4), np.eye(6), np.eye(4))
    assert track.add(10.0, np.eye(4), np.eye(6), np.eye(4)) is None
    assert track.add(10.1, np.eye(4), np.eye(6), np.eye(4)) is not None
