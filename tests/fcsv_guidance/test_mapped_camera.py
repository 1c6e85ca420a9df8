# SPDX-License-Identifier: Apache-2.0
"""A camera whose calibration is off, corrected by a map that refined one of its pictures."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_guidance.place.mapped_camera import MappedCamera, RefinedCamera

T_HOME_ODOM = transforms.from_xyz_yaw([-20.0, 13.0, -10.0], 1.9)
# the truth of it: half a degree and 0.1 m beside
WRONG = transforms.from_xyz_yaw([0.1, -0.05, 0.02], np.radians(1.0))


def told(xyz_m, yaw_rad=0.0):
    """T_odom_cam of a camera that its tracker places there in home."""
    T_home_cam = transforms.from_xyz_yaw(xyz_m, yaw_rad) @ T_HOME_CAM_AT_HOME
    return transforms.invert(T_HOME_ODOM) @ T_home_cam


def refined(stamp_s=10.0, at=(0.0, -10.0, 0.0)):
    T = T_HOME_ODOM @ told(at)
    return RefinedCamera("uav3", stamp_s, T, transforms.invert(WRONG) @ T)


def test_what_a_map_refined_corrects_later_poses_too():
    """The true pose is inv(WRONG) of what the tracker tells, everywhere."""
    camera, far = MappedCamera(), told((25.0, 8.0, -7.0), 0.7)
    assert camera.corrected(9.0, T_HOME_ODOM, told((0.0, -10.0, 0.0))) is None
    camera.refine(refined())
    T, C = camera.corrected(40.0, T_HOME_ODOM, far)
    np.testing.assert_allclose(T, transforms.invert(WRONG) @ T_HOME_ODOM @ far, atol=1e-9)
    assert np.linalg.eigvalsh(C).min() > 0
    off_m = np.linalg.norm(T[:3, 3] - (T_HOME_ODOM @ far)[:3, 3])
    # without it: beyond what is stated now
    assert off_m > 0.25 > np.sqrt(np.trace(C[:3, :3])) > T265_PROFILE.scale * 31.0


def test_it_drifts_from_the_picture_on():
    """By its way since, also where nothing was heard of the way in between."""
    late, whole = MappedCamera(), MappedCamera()
    for k in range(41):
        whole.corrected(10.0 + k, T_HOME_ODOM, told((0.6 * k, -10.0, 0.0)))
    for camera in (late, whole):
        camera.refine(refined())
    end = told((24.6, -10.0, 0.0))
    sigmas = [
        np.sqrt(np.trace(c.corrected(51.0, T_HOME_ODOM, end)[1][:3, :3])) for c in (late, whole)
    ]
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.05)
    here = MappedCamera()
    here.refine(refined())
    _, C = here.corrected(11.0, T_HOME_ODOM, told((0.0, -10.0, 0.0)))
    assert np.sqrt(np.trace(C[:3, :3])) < 0.6 * sigmas[0]


def test_a_later_calibration_or_home_takes_it_back_and_the_newest_map_counts():
    camera, here = MappedCamera(), told((5.0, 0.0, 0.0))
    camera.framed(5.0)
    camera.refine(refined(10.0))
    camera.refine(RefinedCamera("uav3", 8.0, np.eye(4), np.eye(4)))  # older
    T, _ = camera.corrected(12.0, T_HOME_ODOM, here)
    np.testing.assert_allclose(T, transforms.invert(WRONG) @ T_HOME_ODOM @ here, atol=1e-9)
    camera.framed(11.0)
    assert camera.corrected(13.0, T_HOME_ODOM, here) is None
    camera.refine(refined(10.5))  # of a picture before it
    assert camera.corrected(14.0, T_HOME_ODOM, here) is None
    camera.refine(refined(15.0))
    assert camera.corrected(16.0, T_HOME_ODOM, here) is not None
