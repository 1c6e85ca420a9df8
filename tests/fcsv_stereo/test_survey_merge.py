# SPDX-License-Identifier: Apache-2.0
"""Survey: one cloud from several depths, on walls with known truth."""

import numpy as np
import pytest
from support.survey_views import camera_at, cast, view

from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.placing.adjust import Placed
from fcsv_stereo.survey.surface import merge

A, B, FAR = camera_at(0, 0), camera_at(0, 3), camera_at(-60, 0)


def placed(v, T, scale=1.0, sigma=0.0):
    C = sigma**2 * np.eye(7)
    return Placed(v.name, similarity.of_pose(T, scale), C, C, False, v.name)


def joined(*views_and_poses, scales=None):
    views = [v for v, _ in views_and_poses]
    at = {
        v.name: placed(v, T, 1.0 if scales is None else scales[v.name]) for v, T in views_and_poses
    }
    return merge.join(views, at, np.zeros(3))


def test_one_view_keeps_its_points_and_sigmas():
    v = view("a", A)
    cloud, parts = joined((v, A))
    assert len(cloud) == v.depth.size and (cloud.baseline_index == 1).all() and parts[0].agreed == 0
    assert np.allclose(cloud.points_home_m[:, 0], 40.0, atol=1e-3)
    of_plane = tuning.PLANE_SIGMA * v.own_sigma[v.known]
    assert np.allclose(cloud.sigma_m, of_plane, rtol=1e-3)


def test_where_a_surface_bends_it_is_less_sure_and_a_step_is_not_worse():
    """A wall that stands back by 1 % on the left, and by half on the right: 4 px about a bend, and
    2 px more."""
    v = view("a", A)
    v.depth[:, :30] *= 1.01
    v.depth[:, 70:] *= 1.5
    times = v.point_sigma / v.own_sigma
    assert np.allclose(times[:, [10, 23, 36, 50, 63, 76]], tuning.PLANE_SIGMA, rtol=1e-3)
    bend_m = 0.5 * 0.01 * v.depth[:, 25:34]
    bent = np.hypot(tuning.PLANE_SIGMA, tuning.BEND_SIGMA * bend_m / v.own_sigma[:, 25:34])
    assert np.allclose(times[:, 25:34], bent, rtol=0.02)  # 1 % of 1 / 0.99
    most = np.hypot(tuning.PLANE_SIGMA, tuning.BEND_SIGMA * tuning.MOST_BEND)
    assert np.allclose(times[:, 66:74], most, rtol=1e-3)


def test_two_views_of_a_wall_tell_it_once_and_better():
    """Errors of both are independent, and halve the variance; sigma does not count on that."""
    a, b = (
        view(n, T, sigma_share=0.03, noise=1.0, seed=i)
        for i, (n, T) in enumerate((("a", A), ("b", B)))
    )
    cloud, parts = joined((a, A), (b, B))
    alone, _ = joined((a, A))
    both = cloud.baseline_index == 2
    assert both.mean() > 0.6 and len(cloud) < 1.4 * len(alone)
    assert np.std(cloud.points_home_m[both, 0]) < 0.85 * np.std(alone.points_home_m[:, 0])
    assert 0.8 * alone.sigma_m.mean() < cloud.sigma_m[both].mean() < alone.sigma_m.mean()


def test_the_surer_view_tells_what_both_see():
    """The far view's sigma is 25 times larger: its points on the wall are told by the near one."""
    near, far = view("near", A, sigma_share=0.004), view("far", FAR, sigma_share=0.04)
    cloud, (of_near, of_far) = joined((near, A), (far, FAR))
    assert of_far.duplicates > 200 and of_near.duplicates == 0
    in_sight = of_near.cloud.baseline_index == 2
    assert in_sight.mean() > 0.95 and np.allclose(
        of_near.cloud.points_home_m[:, 0], 40.0, atol=0.05
    )


@pytest.mark.parametrize("surer", [True, False])
def test_what_one_view_sees_through_is_gone_unless_it_is_surer(surer):
    """A plate that only the first view has, before a wall that the second one sees."""
    plate = [(20.0, -3.0, 3.0, -3.0, 3.0)]
    a = view("a", A, cast(A, boxes=plate), sigma_share=0.0002 if surer else 0.03)
    b = view("b", B, sigma_share=0.008)
    cloud, parts = joined((a, A), (b, B))
    left = (cloud.points_home_m[:, 0] < 30.0).sum()
    count = int((cast(A, boxes=plate) < 30.0).sum())
    assert count > 100
    assert (
        left == count if surer else (left < 0.15 * count and parts[0].seen_through > 0.85 * count)
    )


def test_a_plate_that_both_views_see_stays():
    plate = [(20.0, -3.0, 3.0, -3.0, 3.0)]
    a, b = (view(n, T, cast(T, boxes=plate)) for n, T in (("a", A), ("b", B)))
    cloud, parts = joined((a, A), (b, B))
    near = cloud.points_home_m[:, 0] < 30.0
    assert (
        near.sum() >= (cast(A, boxes=plate) < 30.0).sum() * 0.9
        and (cloud.baseline_index[near] == 2).mean() > 0.8
    )


def test_a_point_before_another_views_sky_is_gone():
    plate = [(20.0, -3.0, 3.0, -3.0, 3.0)]
    depth = cast(A, boxes=plate)
    a = view("a", A, np.where(depth < 30.0, depth, np.nan))
    b = view("b", B, np.full(depth.shape, np.nan))
    b.kind[:] = DepthKind.SKY
    cloud, parts = joined((a, A), (b, B))
    assert len(cloud) == 0 and parts[0].seen_through == np.isfinite(a.depth).sum()


def test_scales_of_the_adjustment_are_applied():
    a, b = view("a", A), view("b", B, scale=1.05)
    cloud, _ = joined((a, A), (b, B), scales={"a": 1.0, "b": 1.05})
    assert np.allclose(cloud.points_home_m[:, 0], 40.0, atol=0.02)
    apart, _ = joined((a, A), (b, B))  # b's wall, 5 % too near, is beyond two of its sigmas
    assert (apart.points_home_m[:, 0] < 39.0).any()


def test_an_origin_is_left_out_of_float32():
    v, far = view("a", A), np.array([500000.0, 5824000.0, 0.0])
    T = camera_at(*far)
    cloud, _ = merge.join([v], {"a": placed(v, T)}, far)
    assert np.allclose(cloud.points_home_m[:, 0], 40.0, atol=1e-3)


def test_what_the_view_does_not_know_of_itself_is_in_sigma():
    v = view("a", A)
    unsure = merge.site_view(v, placed(v, A, sigma=0.02), np.zeros(3))
    sure = merge.site_view(v, placed(v, A), np.zeros(3))
    aside = np.square(v.camera.rays()[..., :2]).sum(-1)  # turns move what is aside of the axis
    stated = (tuning.POSE_SIGMA * 0.02) ** 2 * (1 + (1 + aside) * v.depth**2)
    assert np.allclose(unsure.sigma**2 - sure.sigma**2, stated, rtol=1e-2)


def test_a_turn_moves_flatly_seen_ground_and_sigma_says_how_much():
    """Ground 10 m beneath the view, 8 degrees below the horizon, moved by 2,000 similarities: sigma
    within 5 %, three times what 2,000 draws scatter."""
    draws = 0.002 * np.random.default_rng(0).normal(size=(2000, 7)) * [1, 1, 1, 10, 10, 10, 1]
    v = view("a", A)
    with np.errstate(divide="ignore"):
        ground = 10.0 / v.camera.rays()[..., 1]
    v.depth[:] = np.where((ground > 0) & (ground < 200), ground, np.nan)
    row, column = 60, 48
    moved = []
    for d in draws:
        M = similarity.matrix(similarity.gtsam.Similarity3.Expmap(d))
        normal = np.linalg.inv(M).T @ [0.0, 1.0, 0.0, -10.0]  # of the plane y = 10
        moved.append(-normal[3] / (normal[:3] @ v.camera.rays()[row, column]))
    C = np.diag((0.002 * np.array([1, 1, 1, 10, 10, 10, 1])) ** 2)
    assert np.std(moved) == pytest.approx(np.sqrt(v.pose_variance(C)[row, column]), rel=0.05)
    assert np.std(moved) > 3 * 0.002 * v.depth[row, column]  # three times that of its scale


def test_what_one_pair_alone_tells_is_less_sure():
    v = view("a", A)
    v.kind[:, :48] = 1
    times = v.point_sigma[0] / v.own_sigma[0]
    assert np.allclose(times[:48], tuning.ONE_PAIR_SIGMA * times[48:], rtol=1e-3)


def test_a_scale_that_a_map_states_is_not_counted_twice():
    """Sigma of 1 % of which 1 % is scale: only a floor of it is the depth's own; sigma without any
    scale stays."""
    stated = view("a", A, sigma_share=0.01)
    assert np.allclose(stated.own_sigma[stated.known], 0.25 * stated.sigma[stated.known], rtol=1e-3)
    wide = view("a", A, sigma_share=0.03)
    assert np.allclose(wide.own_sigma, np.sqrt(0.03**2 - 0.01**2) * wide.depth, rtol=1e-3)


def test_only_views_that_may_see_it_are_asked():
    """Twenty cameras about a wall: one that sees any of its points is always asked."""
    a, asked = view("a", A), 0
    own = merge.site_view(a, placed(a, A), np.zeros(3))
    for i in range(20):
        T = camera_at(-20.0 + 4.0 * i, 10.0 * np.sin(i), heading_deg=36.0 * i)
        v = view("b", T)
        other = merge.site_view(v, placed(v, T), np.zeros(3))
        sees = other.look(own.points()[0])[0].any()
        found = merge.overlapping(a, [a, v], {"a": placed(a, A), "b": placed(v, T)})
        asked += len(found)
        assert [o.name for o in found] == ["b"] or (not found and not sees)
    assert 5 < asked < 18
    blank = view("a", A, np.full_like(a.depth, np.nan))
    assert merge.overlapping(blank, [v], {"a": placed(a, A), "b": placed(v, T)}) == []
