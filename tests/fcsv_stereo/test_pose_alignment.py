# SPDX-License-Identifier: Apache-2.0
"""Poses adjusted to the pictures: back to the truth, no further than texture tells, bounded in
large ones."""

from dataclasses import replace

import numpy as np
import pytest
from support import scenes

from fcsv_geometry import transforms
from fcsv_stereo.joint.refine import pose_alignment
from fcsv_stereo.joint.refine.pose_alignment import _corners, adjust
from fcsv_stereo.joint.refine.residuals import detail
from fcsv_stereo.joint.views import grey, views

PRIOR = np.diag(np.repeat([np.radians(0.15), 0.01], 3) ** 2)
PLACES = ((0, -0.5, 0), (0, -1.0, 0), (0, 0, 1.0))
OFF_DEG = 0.1


def scene():
    """The reference, the others with true poses and with poses turned by 0.1 degrees about each
    axis, inverse depth."""
    reference = scenes.picture("reference", "uav1", 0.0, scenes.camera_pose([0, 0, 0]))
    true = [
        scenes.picture(f"other {i}", "uav2", 0.0, scenes.camera_pose(p))
        for i, p in enumerate(PLACES)
    ]
    off = transforms.from_xyz_rpy(np.zeros(3), np.radians(np.full(3, OFF_DEG)))
    given = [replace(p, T_home_cam=p.T_home_cam @ off) for p in true]
    return (
        reference,
        true,
        given,
        (1.0 / scenes.true_depth(reference.T_home_cam)).astype(np.float32),
    )


def adjusted(reference, given, w, pool):
    found = detail(views(reference, given, 1.0, [grey(p) for p in (reference, *given)]))
    return adjust(reference, given, [PRIOR] * len(given), found, w, np.ones(w.shape, bool), 6, pool)


def turns_deg(pictures, true):
    rotations = [(p.T_home_cam[:3, :3], t.T_home_cam[:3, :3]) for p, t in zip(pictures, true)]
    return [np.degrees(transforms.rotation_angle(*pair)) for pair in rotations]


def test_turned_pictures_are_turned_back(pool):
    reference, true, given, w = scene()
    pictures, covariances, now = adjusted(reference, given, w, pool)
    errors = turns_deg(pictures, true)
    assert max(turns_deg(given, true)) > 0.17 and max(errors) < 0.02
    for error_deg, covariance in zip(errors, covariances):
        assert error_deg < 4.0 * np.degrees(np.sqrt(np.trace(covariance[:3, :3]))) < 0.2
    assert np.median(np.abs(now / w - 1.0)) < 0.01


def test_inverse_depth_that_is_off_does_not_turn_them(pool):
    """Depth and poses are found together: what is wrong in one is not made up for by the other."""
    reference, true, given, w = scene()
    pictures, _, _ = adjusted(reference, given, 1.03 * w, pool)
    assert max(turns_deg(pictures, true)) < 0.03


def test_a_pose_that_is_better_known_than_pixels_tell_stays(pool):
    """Turned by 0.17 degrees, which pixels would undo; but what they say may be wrong by 0.5
    degrees, and the pose is known to 0.05: it moves by hundredths of what they say, its sigma
    stays; the other pictures follow the pixels."""
    reference, true, given, w = scene()
    prior = [np.diag(np.repeat([np.radians(s), 0.01], 3) ** 2) for s in (0.05, 0.15, 0.15)]
    doubted = np.diag(np.repeat([np.radians(0.5), 0.05], 3) ** 2)
    found = detail(views(reference, given, 1.0, [grey(p) for p in (reference, *given)]))
    known = np.ones(w.shape, bool)
    pictures, covariances, _ = adjust(
        reference, given, prior, found, w, known, 6, pool, [doubted, None, None]
    )
    assert turns_deg(pictures, given)[0] < 0.02 and max(turns_deg(pictures, true)[1:]) < 0.03
    np.testing.assert_allclose(np.sqrt(np.diag(covariances[0])[:3]), np.radians(0.05), rtol=0.02)
    undone, *_ = adjust(reference, given, prior, found, w, known, 6, pool)
    assert turns_deg(undone, true)[0] < 0.03


def test_without_texture_all_stays_where_it_is(pool):
    reference, _, given, w = scene()
    noise = np.random.default_rng(1)
    flat = [
        replace(p, image=noise.integers(99, 102, p.image.shape).astype(np.uint8))
        for p in (reference, *given)
    ]
    pictures, covariances, now = adjusted(flat[0], flat[1:], w, pool)
    assert max(turns_deg(pictures, given)) < OFF_DEG
    assert np.isfinite(now).all() and now.max() < 2.0 * w.max()
    assert all(np.isfinite(c).all() for c in covariances)


@pytest.mark.parametrize("shape", [(240, 320), (480, 640), (2160, 3840)])
def test_cells_are_bounded_and_reach_everywhere(shape):
    corners = _corners(shape)
    assert 1000 < len(corners) <= 20000 and (corners + 4 <= shape).all()
    gaps = [np.diff(np.unique(corners[:, i])).max() for i in (0, 1)]
    assert (corners.min(axis=0) == 0).all() and (
        corners.max(axis=0) + 2 * np.array(gaps) + 4 > shape
    ).all()


@pytest.mark.parametrize("most_cells", [1200, 600, 300])
def test_cells_that_lie_apart_are_compared_as_in_the_whole_picture(most_cells, pool, monkeypatch):
    """Of a large picture only the cells and the windows about them are looked at."""
    reference, _, given, w = scene()
    monkeypatch.setattr(pose_alignment, "_MOST_CELLS", most_cells)
    pictures, covariances, now = adjusted(reference, given, w, pool)
    cells = _corners(w.shape)
    whole = pose_alignment._Sample(*map(np.arange, w.shape), cells, cells, True)
    assert not pose_alignment._Sample.of(cells, w.shape).whole
    monkeypatch.setattr(pose_alignment._Sample, "of", lambda *_: whole)
    expected, sure, then = adjusted(reference, given, w, pool)
    for a, b in zip(pictures, expected):
        np.testing.assert_allclose(a.T_home_cam, b.T_home_cam, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariances, sure, rtol=1e-6)
    np.testing.assert_allclose(now, then, rtol=1e-6)
