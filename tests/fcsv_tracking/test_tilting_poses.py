# SPDX-License-Identifier: Apache-2.0
"""Poses of a tilting rig's cameras at a picture's stamp, and the distance of what they look at."""

import numpy as np
import pytest

from fcsv_geometry.errors import PoseUnavailable
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.tilting.aim import crossing
from fcsv_tracking.tilting.poses import RigPoses, looked_at_m
from fcsv_tracking.tilting.rig import TiltAngles, load_rig
from fcsv_tracking.tilting.servos import TiltReading


@pytest.fixture(scope="module")
def rig(root):
    return load_rig(root / "config/tilting/rig.yaml")


def test_a_camera_that_stands_has_a_pose_and_one_that_turns_none(rig):
    poses = RigPoses(rig)
    with pytest.raises(PoseUnavailable):
        poses.latest("left")
    for k in range(20):  # still for 0.2 s, then 20 degrees per second
        turned = np.radians(20.0) * max(0.0, 0.02 * (k - 10))
        poses.add(TiltReading(10.0 + 0.02 * k, TiltAngles(0.1 + turned, 0.2 + turned)))
    at = poses.at("right", 10.11)
    assert np.allclose(at.T_rig_cam, rig.T_rig_cam("right", TiltAngles(0.1, 0.2)))
    assert np.allclose(at.covariance, rig.covariance("right", TiltAngles(0.1, 0.2)))
    with pytest.raises(SampleRejected, match="20.0 deg/s"):
        poses.at("left", 10.31)
    with pytest.raises(PoseUnavailable):
        poses.at("left", 10.7)
    with pytest.raises(SampleRejected):
        poses.add(TiltReading(10.2, TiltAngles(0.0, 0.0)))


def test_the_near_thing_in_the_middle_is_looked_at(rig):
    """A bar at 0.8 m over a third of the middle, a wall at 3 m behind; half of the picture's
    size."""
    angles = crossing(rig, 0.8)
    T = rig.T_rig_cam("left", angles)
    depth = np.full((240, 320), 3.0, np.float32)
    depth[:, 140:180] = 0.8 / T[0, 2]  # along the left camera's axis, which is turned inward
    assert looked_at_m(rig, T, depth) == pytest.approx(0.8, rel=0.03)
    depth[:, 140:180] = np.nan
    assert looked_at_m(rig, T, depth) > 2.5
    with pytest.raises(SampleRejected, match="0 pixels"):
        looked_at_m(rig, T, np.full((240, 320), np.nan, np.float32))
