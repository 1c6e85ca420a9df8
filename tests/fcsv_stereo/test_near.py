# SPDX-License-Identifier: Apache-2.0
"""The near field: depth frames with noise, holes and wrong poses, summed in home, against a scene
that is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcsv_geometry import rotations, transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.near import DepthFrame, DepthSensor, NearRules, NearVolume, Thinning
from fcsv_stereo.near.surface import NearSurface

CAMERA = PinholeCamera.from_fov(160, 120, np.radians(70.0))
SENSOR = DepthSensor()
WALL_M, BOX_M, HALF_M = 6.0, 3.0, 0.6
SURE = np.diag([1e-4**2] * 3 + [1e-5**2] * 3)


def pose(y, yaw=0.0):
    R = rotations.exp([0.0, 0.0, yaw]) @ transforms.R_FLU_OPTICAL
    return transforms.transform(R, np.array([0.0, y, 0.0]))


def true_depth(T_home_cam, camera=CAMERA):
    """A wall at x = 6 m, before it a column 1.2 m wide at 3 m."""
    rays, p = camera.rays() @ T_home_cam[:3, :3].T, T_home_cam[:3, 3]
    column = (BOX_M - p[0]) / rays[..., 0]
    on_column = np.abs(p[1] + column * rays[..., 1]) < HALF_M
    return np.where(on_column, column, (WALL_M - p[0]) / rays[..., 0])


def frames(
    count=8, seed=1, noise=True, wrong=(0.0,) * 6, covariance=SURE, hole=0.0, vehicle="uav1"
):
    """Of a vehicle that flies 2 m sideways, turning; ``wrong`` (position, rotation) is the error of
    all its poses."""
    random, wrong = np.random.default_rng(seed), np.array(wrong)
    for i in range(count):
        T = pose(-1.0 + 2.0 * i / max(count - 1, 1), 0.05 * np.sin(i))
        depth = true_depth(T)
        if noise:
            depth = depth + random.standard_normal(depth.shape) * SENSOR.noise_m(depth)
        depth[random.random(depth.shape) < hole] = np.nan
        T_said = transforms.transform(rotations.exp(wrong[3:]) @ T[:3, :3], T[:3, 3] + wrong[:3])
        yield DepthFrame(vehicle, float(i), depth.astype(np.float32), CAMERA, T_said, covariance)


def summed(found, **rules):
    volume = NearVolume(SENSOR, NearRules(**rules))
    for frame in found:
        volume.integrate(frame)
    return volume.surface()


def errors(surface):
    """How far points are from wall or column along x, and their sigmas; those between both are of
    the column's edge."""
    points = surface.points()
    x = points.points_home_m[:, 0]
    on_column = np.abs(x - BOX_M) < np.abs(x - WALL_M)
    inside = ~on_column | (np.abs(points.points_home_m[:, 1]) < HALF_M - 0.1)
    return (x - np.where(on_column, BOX_M, WALL_M))[inside], points.sigma_m[inside]


def test_what_was_seen_stands_in_home_where_it_is():
    error, sigma = errors(summed(frames(noise=False)))
    assert len(error) > 5000 and np.percentile(np.abs(error), 95) < 0.01
    # of the wall: 0.03 px of the calibration at 6 m are 51 mm, 0.08 px of eight frames 48 mm
    assert 0.05 < np.median(sigma) < 0.10


def test_noise_averages_out_and_sigma_says_what_is_left():
    """A voxel's mean of eight frames: each depth is its own pixel's; 1/sqrt(8) of a frame's noise
    at 6 m is 48 mm."""
    few, many = errors(summed(frames(count=3)))[0], errors(summed(frames(count=12)))[0]
    assert many.std() < 0.75 * few.std()
    error, sigma = errors(summed(frames()))
    assert abs(np.median(error)) < 0.02
    # sigma counts the calibration's 51 mm, which is not wrong here
    assert 0.68 < (np.abs(error) < sigma).mean()


def test_a_pose_error_that_all_frames_share_stays_in_sigma():
    C = np.diag([0.2**2] * 3 + [1e-5**2] * 3)
    error, sigma = errors(summed(frames(wrong=(0.2, 0, 0, 0, 0, 0), covariance=C)))
    assert np.median(error) == pytest.approx(0.2, abs=0.03)
    assert np.median(sigma) == pytest.approx(np.hypot(0.2, 0.07), abs=0.03)


def test_a_turn_moves_points_by_their_distance():
    frame = next(frames(covariance=np.diag([1e-9] * 3 + [0.01**2] * 3)))
    variance = frame.pose_variance_m2(np.full((120, 160), 5.0, np.float32))
    # two of the three axes of a turn move a point 5 m ahead: 2 (5 m x 0.01)**2 / 3
    assert np.sqrt(variance[60, 80]) == pytest.approx(0.05 * np.sqrt(2 / 3), rel=0.01)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_poses_variance_is_that_of_a_point_moved(seed):
    """Against the whole covariance carried along, with correlations."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((6, 6)) * 0.01
    T = transforms.transform(rotations.exp(random.standard_normal(3)), random.standard_normal(3))
    camera = PinholeCamera(3, 2, 2.0, 2.0, 1.0, 0.5)
    depth = random.uniform(0.5, 9.0, (2, 3)).astype(np.float32)
    variance = DepthFrame("uav1", 0.0, depth, camera, T, A @ A.T).pose_variance_m2(depth)
    arm = T[:3, :3] @ (camera.rays()[1, 2] * depth[1, 2])
    F = np.hstack([np.eye(3), np.zeros((3, 3))])
    F[:, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
    assert variance[1, 2] == pytest.approx(np.trace(F @ A @ A.T @ F.T) / 3.0, rel=1e-3)


def test_a_sure_vehicle_counts_more_than_an_unsure_one():
    C = np.diag([0.3**2] * 3 + [1e-5**2] * 3)
    both = [*frames(), *frames(wrong=(0.15, 0, 0, 0, 0, 0), covariance=C, vehicle="uav2", seed=2)]
    error, _ = errors(summed(both))
    assert abs(np.median(error)) < 0.04  # alike they would be 75 mm off


def test_holes_are_filled_by_other_frames_and_what_nobody_saw_stays_empty():
    depth, sigma = summed(frames(count=16, hole=0.3)).seen(CAMERA, pose(0.0))
    assert np.isfinite(depth[20:100, 40:120]).mean() > 0.97
    assert (np.isfinite(depth) == np.isfinite(sigma)).all()
    behind, _ = summed(frames()).seen(CAMERA, pose(0.0, np.pi))
    assert not np.isfinite(behind).any()


def test_a_surface_is_seen_at_its_depth_and_the_column_hides_the_wall():
    depth, _ = summed(frames()).seen(CAMERA, pose(0.4, 0.1))
    # what three frames saw
    depth, true = (d[10:110, 40:] for d in (depth, true_depth(pose(0.4, 0.1))))
    known = np.isfinite(depth)
    right = np.abs(depth - true)[known] < 0.05 + 0.02 * true[known]
    assert known.mean() > 0.9 and right.mean() > 0.95


def test_surfaces_that_too_few_frames_saw_are_left_out():
    assert len(summed(frames(count=2))) == 0
    assert len(summed(frames(count=2), least_looks=1)) > 0


def test_depth_between_two_surfaces_and_out_of_range_does_not_count():
    depth = np.full((120, 160), 3.0, np.float32)
    depth[:, 80:] = 6.0
    depth[:, 80] = 4.5  # a window across the edge
    depth[0, 0], depth[0, 1] = 0.2, 11.0
    believed = DepthFrame("uav1", 0.0, depth, CAMERA, pose(0.0), SURE).believed(SENSOR)
    assert not np.isfinite(believed[:, 80]).any() and np.isfinite(believed[5:, :80]).all()
    assert np.isfinite(believed[:, 81:]).all() and not np.isfinite(believed[0, :2]).any()


def test_nothing_seen_is_an_empty_surface():
    empty = DepthFrame(
        "uav1", 0.0, np.full((120, 160), np.nan, np.float32), CAMERA, pose(0.0), SURE
    )
    surface = summed([empty])
    assert len(surface) == 0 and len(surface.points()) == 0
    assert not np.isfinite(surface.seen(CAMERA, pose(0.0))[0]).any()


def test_points_of_one_voxel_become_one():
    vertices = np.array([[0.01, 0.01, 0.01], [0.03, 0.01, 0.01], [0.01, 0.01, 0.06]], np.float32)
    surface = NearSurface(
        vertices, np.array([[0, 1, 2]]), np.array([0.01, 0.01, 0.02], np.float32), 0.05
    )
    points = surface.points()
    assert len(points) == 2
    assert np.allclose(sorted(points.points_home_m[:, 2]), [0.01, 0.06]) and np.allclose(
        sorted(points.sigma_m), [0.01, 0.02]
    )


def test_a_vehicle_that_stands_gives_a_frame_a_second():
    thinning, places = (
        Thinning(),
        [(0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (1.0, 0.0), (1.2, 0.2), (1.4, 0.2)],
    )
    assert [t for t, y in places if thinning.takes("uav1", t, pose(y))] == [0.0, 1.0, 1.2]


def test_millimetres_of_a_camera_with_distortion():
    camera = PinholeCamera(160, 120, 115.0, 115.0, 79.5, 59.5, (0.05, -0.08, 0.0, 0.0, 0.0))
    millimetres = np.full((120, 160), 2500, np.uint16)
    millimetres[10:20, 10:20] = 0
    frame = DepthFrame.of_millimetres("uav1", 0.0, millimetres, camera, pose(0.0), SURE)
    assert frame.camera == camera.undistorted() and not np.isfinite(frame.depth_m[14, 14])
    assert np.nanmax(frame.depth_m) == 2.5 and np.nanmin(frame.depth_m) == 2.5
    with pytest.raises(InputError, match="is 80x60, its camera 160x120"):
        DepthFrame.of_millimetres("uav1", 0.0, millimetres[:60, :80], camera, pose(0.0), SURE)


@pytest.mark.parametrize("wrong", [{"subpixel_px": 0.0}, {"baseline_m": -0.05}, {"least_m": 12.0}])
def test_a_sensor_that_is_none_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong)) if "least_m" not in wrong else "most_m"):
        DepthSensor(**wrong)
