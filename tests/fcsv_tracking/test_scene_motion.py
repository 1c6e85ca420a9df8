# SPDX-License-Identifier: Apache-2.0
"""Pictures held against a tracker's motion: a wall of noise before a camera that moves, and points
of a scene."""

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.transforms import R_FLU_OPTICAL
from fcsv_tracking.errors import TrackingError
from fcsv_tracking.scene.epipolar import off_lines
from fcsv_tracking.scene.scene_motion import SceneWatch, look

CAMERA = PinholeCamera.from_fov(320, 240, np.radians(56.0))
WALL_M = 8.0
T_ODOM_CAM = transforms.transform(R_FLU_OPTICAL, [0.0, 0.0, 4.0])  # looks along x
BOUND_RAD = 0.02  # of SceneCheckRules


@pytest.fixture(scope="module")
def wall():
    """240x320 grey of a wall with texture of all sizes, as the camera sees it that stands before
    its middle."""
    random = np.random.default_rng(1)
    fine, coarse = (cv2.resize(random.random((240 // k, 320 // k)), (320, 240)) for k in (4, 20))
    return np.clip(255.0 * (0.6 * fine + 0.4 * coarse), 0, 255).astype(np.uint8)


def pictured(wall, p_cam, turn_rad=0.0):
    """The wall from a place (m, optical frame of the camera that stood still), turned about the
    upright."""
    R = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[0]
    H = (
        CAMERA.K
        @ R.T
        @ (np.eye(3) - np.outer(p_cam, [0.0, 0.0, 1.0]) / WALL_M)
        @ np.linalg.inv(CAMERA.K)
    )
    return cv2.warpPerspective(wall, H, (320, 240), borderMode=cv2.BORDER_REFLECT)


def looks(wall, moved_m, told_m, turn_rad=0.0):
    """Of a camera that moves by ``moved_m`` (3,; optical) in a second, and whose tracker tells
    ``told_m``."""
    watch, seen = SceneWatch(), []
    for k in range(4):
        share = k / 3.0
        R = cv2.Rodrigues(np.array([0.0, share * turn_rad, 0.0]))[0]
        T_odom_cam = T_ODOM_CAM @ transforms.transform(R, share * np.array(told_m))
        grey = pictured(wall, share * np.array(moved_m), share * turn_rad)
        seen.append(watch.observe(10.0 + share, grey, CAMERA, T_odom_cam))
    assert seen[0] is None
    return seen[1:]


@pytest.mark.parametrize(
    "moved_m", [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, -0.3, 0.0], [0.2, 0.1, 0.6]]
)
@pytest.mark.parametrize("turn_rad", [0.0, 0.08])
def test_a_tracker_that_tells_the_truth_agrees(wall, moved_m, turn_rad):
    last = looks(wall, moved_m, moved_m, turn_rad)[-1]
    assert last.points >= 15 and last.off_rad < 0.25 * BOUND_RAD
    assert last.span_s == pytest.approx(1.0) and last.turn_rad == pytest.approx(turn_rad, abs=1e-6)


def test_who_holds_a_place_by_a_tracker_that_drifts_is_seen_to_fly(wall):
    last = looks(wall, [0.4, 0.0, 0.0], [0.0, 0.0, 0.0])[-1]
    assert last.off_rad == pytest.approx(0.4 / WALL_M, rel=0.1)  # the angle by which the wall moved
    # another way than it tells
    assert looks(wall, [0.0, 0.3, 0.0], [0.3, 0.0, 0.0])[-1].off_rad > BOUND_RAD


def test_a_drift_along_the_way_is_not_seen(wall):
    """What a single camera cannot tell: how far it went along a way that it did go."""
    assert looks(wall, [0.3, 0.0, 0.0], [0.45, 0.0, 0.0])[-1].off_rad < 0.25 * BOUND_RAD


def test_no_texture_no_look():
    grey, watch = np.full((240, 320), 90, np.uint8), SceneWatch()
    assert [watch.observe(0.3 * k, grey, CAMERA, T_ODOM_CAM) for k in range(5)] == [None] * 5


def test_points_that_move_by_themselves_are_outvoted():
    random = np.random.default_rng(2)
    xy = random.uniform(-0.4, 0.4, (50, 2))
    moved = xy + np.where(np.arange(50)[:, None] < 30, [0.2, 0.0], [0.0, 0.0])
    assert look(1.0, xy, moved, np.eye(4), R_FLU_OPTICAL).off_rad < 1e-9
    moved = xy + np.where(np.arange(50)[:, None] < 40, [0.2, 0.0], [0.0, 0.0])
    assert look(1.0, xy, moved, np.eye(4), R_FLU_OPTICAL).off_rad == pytest.approx(0.2)


def test_a_new_frame_or_another_picture_size_begins_anew(wall):
    watch = SceneWatch()
    assert (
        watch.observe(0.0, wall, CAMERA, T_ODOM_CAM) is None
        and watch.observe(0.3, wall, CAMERA, T_ODOM_CAM) is not None
    )
    watch.begin_again()
    assert watch.observe(0.6, wall, CAMERA, T_ODOM_CAM) is None
    assert watch.observe(0.9, wall[:200], CAMERA.resized(320, 200), T_ODOM_CAM) is None
    # a clock that was set back
    assert watch.observe(0.5, wall[:200], CAMERA.resized(320, 200), T_ODOM_CAM) is None
    with pytest.raises(TrackingError, match="320x240, its camera_info 320x200"):
        watch.observe(1.2, wall, CAMERA.resized(320, 200), T_ODOM_CAM)


def test_a_point_may_be_as_near_as_two_metres():
    T = transforms.transform(np.eye(3), [0.5, 0.0, 0.0])
    off = off_lines(np.zeros((2, 2)), np.array([[0.25, 0.0], [0.30, 0.0]]), T)
    assert off == pytest.approx([0.0, 0.05])
