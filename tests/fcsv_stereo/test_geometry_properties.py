# SPDX-License-Identifier: Apache-2.0
"""Identities of the geometry for poses, cameras and depths of any kind; rectification's own are in
test_rectify.py.

Bounds without another word are rounding: 1e-9 for float64, 1e-5 for float32.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenes import camera_pose

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.depth import points_from_depth, resample
from fcsv_stereo.equations import ErrorThreshold, baseline_for, depth_error, farthest, segment_ends
from fcsv_stereo.posed.exposure import Exposure
from fcsv_stereo.refinement import geometry
from fcsv_stereo.thesis.fuse import fuse_axes, segments, trim

QUICK = settings(max_examples=25, deadline=None)
SEEDS = st.integers(0, 10000)

cameras = st.builds(
    PinholeCamera.from_fov, st.integers(20, 60), st.integers(20, 60), st.floats(0.4, 1.6).map(float)
)
poses = st.builds(
    camera_pose, st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(-20, 20)] * 3)
)
thresholds = st.one_of(
    st.floats(0.01, 20.0).map(lambda v: ErrorThreshold(v, False)),
    st.floats(0.01, 0.5).map(lambda v: ErrorThreshold(v, True)),
)


def points_before(T_home_cam, seed, count=30, least_m=3.0, most_m=300.0):
    """Points (N, 3) in home that the camera sees well inside its view."""
    random = np.random.default_rng(seed)
    z = np.geomspace(least_m, most_m, count)
    p_cam = np.column_stack([random.uniform(-0.3, 0.3, (count, 2)) * z[:, None], z])
    return transforms.apply(T_home_cam, p_cam)


def rays(T_home_cam, p_home):
    """Rays (N, 3) with z = 1 in the camera, and depths (N,)."""
    p = transforms.apply(transforms.invert(T_home_cam), p_home)
    return p / p[:, 2:], p[:, 2]


@QUICK
@given(cameras, poses, SEEDS)
def test_back_projection_is_the_inverse_of_projection(camera, T_home_cam, seed):
    depth = (
        np.random.default_rng(seed)
        .uniform(1.0, 400.0, (camera.height, camera.width))
        .astype(np.float32)
    )
    p_cam = points_from_depth(depth, camera.K)
    v, u = np.indices(depth.shape)
    uv = camera.project(p_cam.reshape(-1, 3)).reshape(*depth.shape, 2)
    # px: float32 at 60 px, OpenCV's projection
    assert np.abs(uv - np.stack([u, v], -1)).max() < 1e-3
    p_home = transforms.apply(T_home_cam, p_cam.astype(float))
    again = resample(p_home.reshape(-1, 3), T_home_cam, camera)
    # through home and back into the same view: every pixel its own
    assert np.allclose(again, depth, rtol=1e-5)


@QUICK
@given(cameras, SEEDS)
def test_no_depth_is_no_point(camera, seed):
    random = np.random.default_rng(seed)
    depth = np.where(random.random((camera.height, camera.width)) < 0.5, 7.0, np.nan).astype(
        np.float32
    )
    p = points_from_depth(depth, camera.K)
    assert np.array_equal(np.isfinite(p).all(axis=-1), np.isfinite(depth))


@QUICK
@given(poses, st.floats(0.2, 10.0), st.tuples(*[st.floats(-6, 6)] * 3), SEEDS)
def test_rays_of_one_point_lie_on_each_others_epipolar_lines(T_home_a, baseline_m, rpy_deg, seed):
    """And give its inverse depth, and project into each other."""
    T_a_b = transforms.from_xyz_rpy([baseline_m, 0.1, 0.2], np.radians(rpy_deg))
    p_home = points_before(T_home_a, seed)
    rays_a, depth_a = rays(T_home_a, p_home)
    rays_b, depth_b = rays(T_home_a @ T_a_b, p_home)
    seen = depth_b > 0.5
    rays_a, rays_b, depth_a = rays_a[seen], rays_b[seen], depth_a[seen]
    error, _ = geometry.epipolar_error(T_a_b, rays_a, rays_b)
    assert np.abs(error).max() < 1e-9
    rho, parallax = geometry.inverse_depth(T_a_b, rays_a, rays_b)
    assert np.allclose(rho, 1.0 / depth_a, atol=1e-9) and (parallax > 0).all()
    assert np.allclose(geometry.project(T_a_b, rays_a, rho), rays_b, atol=1e-7)


@QUICK
@given(st.floats(0.5, 8.0), st.tuples(*[st.floats(-0.3, 0.3)] * 3), SEEDS)
def test_a_pair_is_turned_back_to_where_it_was(baseline_m, rpy_deg, seed):
    """fit_pair on exact rays, a third of them wrong, from a prior that is off by up to a standard
    deviation."""
    T_a_b = transforms.from_xyz_rpy([baseline_m, 0.0, 0.0], np.radians([1.0, -2.0, 0.5]))
    p_a = points_before(np.eye(4), seed, 90, 2.0 * baseline_m, 60.0 * baseline_m)
    rays_a, _ = rays(np.eye(4), p_a)
    rays_b, _ = rays(T_a_b, p_a)
    wrong = np.arange(90) % 3 == 0
    sides = np.where(np.arange(30) % 2, 1, -1)
    rays_b[wrong, 1] += np.random.default_rng(seed).uniform(0.02, 0.05, 30) * sides  # 12 to 30 px
    off = transforms.from_xyz_rpy([0, 0, 0], np.radians(rpy_deg))
    prior = geometry.PairPrior(T_a_b @ off, np.radians(0.3), 0.05)
    found, error_px = geometry.fit_pair(prior, rays_a, rays_b, 600.0, 12.0, 0.5)
    # the truth costs the prior 3 at most (a standard deviation in three axes), and the best pose
    # costs no more than it: 60 right rays of 0.5 px each have an rms of at most 0.5 sqrt(3/60) =
    # 0.11 px, and a little for the wrong ones
    assert np.sqrt(np.mean(error_px[~wrong] ** 2)) < 0.15
    before = transforms.rotation_angle(prior.T_a_b, T_a_b)
    assert transforms.rotation_angle(found, T_a_b) <= before + np.radians(0.03)
    assert np.abs(error_px[~wrong]).max() < 0.5 < 5.0 < np.abs(error_px[wrong]).min()


@QUICK
@given(poses, poses, poses, st.floats(0, 1))
def test_interpolation_does_not_know_its_frame(T_a_b0, T_a_b1, T_w_a, alpha):
    """What is between two poses is the same seen from any frame, from either end, and keeps its
    share of the angle."""
    T = transforms.interpolate(T_a_b0, T_a_b1, alpha)
    assert np.allclose(
        transforms.interpolate(T_w_a @ T_a_b0, T_w_a @ T_a_b1, alpha), T_w_a @ T, atol=1e-7
    )
    assert np.allclose(transforms.interpolate(T_a_b1, T_a_b0, 1.0 - alpha), T, atol=1e-7)
    whole = transforms.rotation_angle(T_a_b0, T_a_b1)
    assert transforms.rotation_angle(T_a_b0, T) == pytest.approx(alpha * whole, abs=1e-6)


@QUICK
@given(st.lists(st.floats(0.01, 0.09), min_size=2, max_size=12), st.floats(0, 1), poses, SEEDS)
def test_a_steady_flight_is_interpolated_exactly_at_any_stamps(gaps_s, where, T_start, seed):
    """Constant velocity and constant turn about one axis, sampled unevenly: no error but
    rounding."""
    random = np.random.default_rng(seed)
    velocity, yaw_rate = random.uniform(-3, 3, 3), random.uniform(-1, 1)

    def at(t):
        return transforms.from_xyz_yaw(T_start[:3, 3] + velocity * t, 0.3 + yaw_rate * t)

    stamps = np.concatenate([[0.0], np.cumsum(gaps_s)])
    track = Trajectory(gap_s=0.1)
    assert all(track.add(t, at(t)) for t in stamps)
    t = float(where * stamps[-1])
    assert np.allclose(track.at(t), at(t), atol=1e-7)


@QUICK
@given(thresholds, st.floats(200, 3000), st.floats(0.2, 20), st.floats(0.05, 2))
def test_equations_3_1_and_3_2_undo_each_other_and_meet_2_12(
    threshold, focal_px, baseline_m, error_px
):
    far_m = farthest(baseline_m, focal_px, threshold, error_px)
    accepted_m = threshold.value * (far_m if threshold.relative else 1.0)
    assert depth_error(far_m, baseline_m, focal_px, error_px) == pytest.approx(accepted_m)
    assert baseline_for(far_m, focal_px, threshold, error_px) == pytest.approx(baseline_m)


@QUICK
@given(st.floats(200, 3000), st.floats(0.2, 20), st.floats(1, 500))
def test_equation_2_12_is_the_slope_of_2_5(focal_px, baseline_m, z_m):
    """One pixel of disparity more or less, to first order."""
    step_px = 1e-4
    d = focal_px * baseline_m / z_m
    slope = (focal_px * baseline_m / (d - step_px) - focal_px * baseline_m / (d + step_px)) / (
        2 * step_px
    )
    assert depth_error(z_m, baseline_m, focal_px) == pytest.approx(slope, rel=1e-3)


@QUICK
@given(
    st.lists(st.floats(0.5, 12).map(lambda b: round(b, 1)), min_size=1, max_size=6, unique=True),
    thresholds,
)
def test_segments_cover_the_range_once(baselines_m, threshold):
    found = sorted(segments(baselines_m, 602.0, threshold))
    assert found[0][0] == 0.0 and all(a[1] == b[0] for a, b in zip(found, found[1:]))
    depth = np.linspace(0.01, found[-1][1], 999, dtype=np.float32)
    inside = sum(np.isfinite(trim(depth, r)).astype(int) for r in found)
    # float32 against float64
    edge = np.min([np.abs(depth / r[1] - 1.0) for r in found], axis=0) < 1e-5
    assert (inside[~edge] == 1).all()


@QUICK
@given(st.floats(0, 50), st.floats(51, 900), st.integers(1, 12))
def test_equation_3_3_divides_evenly(nearest_m, range_m, count):
    ends = np.concatenate([[nearest_m], segment_ends(nearest_m, range_m, count)])
    assert ends[-1] == pytest.approx(range_m) and np.allclose(
        np.diff(ends), (range_m - nearest_m) / count
    )


@QUICK
@given(SEEDS)
def test_fusing_axes_keeps_to_what_they_say(seed):
    """3.4: between both where both know, never an answer that neither has; the order does not
    matter."""
    random = np.random.default_rng(seed)
    h, v = random.uniform(1, 90, (2, 9, 11)).astype(np.float32)
    h[random.random(h.shape) < 0.4], v[random.random(v.shape) < 0.4] = np.nan, np.nan
    fused = fuse_axes(h, v)
    assert np.array_equal(np.isfinite(fused), np.isfinite(h) | np.isfinite(v))
    known = np.isfinite(fused)
    assert (fused[known] >= np.fmin(h, v)[known] - 1e-4).all() and (
        fused[known] <= np.fmax(h, v)[known] + 1e-4
    ).all()
    assert np.array_equal(fused, fuse_axes(v, h), equal_nan=True)


@QUICK
@given(SEEDS, st.integers(1, 60000))
def test_16_bits_keep_their_order(seed, most):
    image = np.random.default_rng(seed).integers(0, most + 1, (40, 50)).astype(np.uint16)
    table = Exposure.common([image]).table.astype(int)
    assert (np.diff(table) >= 0).all() and table[int(image.max())] >= 250
