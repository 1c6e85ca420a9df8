# SPDX-License-Identifier: Apache-2.0
"""Pictures at a scale: with other poses, of one pair, of some rows; and where their pixels are."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from support import scenes

from fcsv_geometry import transforms
from fcsv_stereo.joint.pictures import MatchPictures, usable
from fcsv_stereo.joint.projecting import motion, place, ray
from fcsv_stereo.joint.views import grey, views
from fcsv_stereo.model import PoseUncertainty

PLACES = ((0, -0.5, 0), (0, -1.0, 0), (0, 0, 1.0))


@pytest.fixture(scope="module")
def pictures():
    reference = scenes.picture("reference", "uav1", 0.0, scenes.camera_pose([0, 0, 0]))
    return reference, [
        scenes.picture(f"other {i}", "uav2", 0.0, scenes.camera_pose(p))
        for i, p in enumerate(PLACES)
    ]


def seen(reference, others, scale=0.5):
    return views(reference, others, scale, [grey(p) for p in (reference, *others)])


def test_other_poses_give_what_views_made_anew_would(pictures):
    reference, others = pictures
    off = transforms.from_xyz_rpy(np.array([0.1, 0.2, -0.1]), np.radians([1.0, -2.0, 0.5]))
    turned = [replace(p, T_home_cam=p.T_home_cam @ off) for p in others]
    anew, given = seen(reference, turned), seen(reference, others).with_poses(reference, turned)
    assert (
        np.array_equal(anew.projections, given.projections)
        and anew.fastest_px_m == given.fastest_px_m
    )
    assert np.array_equal(anew.others, given.others) and np.array_equal(anew.falling, given.falling)


def test_the_fastest_pair_is_that_of_the_longest_baseline(pictures):
    reference, others = pictures
    found = seen(reference, others[:2])
    K = reference.camera.resized(*found.shape[::-1])
    assert found.fastest_px_m == pytest.approx(K.fx * 1.0, rel=1e-3)
    assert found.only(0).fastest_px_m == pytest.approx(K.fx * 0.5, rel=1e-3)
    assert len(found.only(1)) == 1 and np.array_equal(found.only(1).others[0], found.others[1])


@njit
def projected(projections, i, u, v, w):
    a, b, c = ray(projections, i, u, v)
    x, y, z, inverse = place(a, b, c, projections, i, w)
    dx, dy = motion(x, y, inverse, projections, i)
    return x, y, z, dx, dy


@pytest.mark.parametrize("rows", [slice(0, 120), slice(30, 60)])
def test_a_pixel_is_projected_as_its_point_is(pictures, rows):
    """Through the camera models, from the point in home; and its motion by a small step of inverse
    depth."""
    reference, others = pictures
    found = seen(reference, others).rows(rows)
    K, u, v, w = reference.camera.resized(*seen(reference, others).shape[::-1]), 70, 11, 0.05
    ray_cam = np.array([(u - K.cx) / K.fx, (rows.start + v - K.cy) / K.fy, 1.0])
    point_home = reference.T_home_cam[:3, :3] @ (ray_cam / w) + reference.T_home_cam[:3, 3]
    for i, other in enumerate(others):
        p = transforms.invert(other.T_home_cam) @ np.r_[point_home, 1.0]
        x, y, z, dx, dy = projected(found.projections, i, u, v, w)
        assert z > 0.0 and np.allclose(
            (x, y), (K.fx * p[0] / p[2] + K.cx, K.fy * p[1] / p[2] + K.cy), atol=1e-2
        )
        further = np.array(projected(found.projections, i, u, v, w + 1e-3)[:2])
        assert np.allclose((further - (x, y)) / 1e-3, (dx, dy), rtol=1e-2, atol=1e-2)


def test_what_cannot_serve_is_named_in_order(pictures):
    reference, others = pictures
    away = replace(others[0], T_home_cam=scenes.camera_pose((0, -1, 0), (0, 0, 180.0)), name="away")
    small = replace(others[1], image=others[1].image[:8], name="small")
    used, left_out = usable(reference, [away, others[0], reference, small, others[1]])
    assert used == [1, 4] and list(left_out) == [0, 2, 3]
    assert ["overlap" in left_out[0], "one place" in left_out[2], "smaller" in left_out[3]] == [
        True
    ] * 3


def test_poses_are_adjusted_only_where_their_uncertainty_is_given(pictures):
    reference, others = pictures
    poses = [PoseUncertainty(np.eye(6))] * 3
    assert MatchPictures.of(reference, others, poses, True).prior is not None
    for known, adjust in ((poses, False), (None, True)):
        assert MatchPictures.of(reference, others, known, adjust).prior is None
    assert MatchPictures.of(reference, others, None, True).covariances == [None] * 3
