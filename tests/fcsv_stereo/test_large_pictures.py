# SPDX-License-Identifier: Apache-2.0
"""What is done in parts in large pictures is what it is of the whole, and takes no more memory than
it says."""

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import boards, faulty
from support.scenes import CAMERA, camera_pose, given, picture

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.depth import cloud_of, points_from_depth
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.joint.checks.sigma import _matching_sigma, matching_sigma
from fcsv_stereo.joint.match import MatchOptions
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.refine.subpixel import Fine, refine
from fcsv_stereo.joint.views import grey, views
from fcsv_stereo.model import Picture
from fcsv_stereo.report import figures

SHAPE = 700, 90  # several bands of rows, the last one a part


def drawn(*shape):
    return np.random.default_rng(4).uniform(0.1, 1.0, shape).astype(np.float32)


def test_a_cloud_of_bands_is_that_of_the_whole_picture():
    camera = PinholeCamera(SHAPE[1], SHAPE[0], 80.0, 81.0, 44.0, 350.0)
    image = (255 * drawn(*SHAPE, 3)).astype(np.uint8)
    view = replace(
        picture("a", "uav1", 0.0, camera_pose([1.0, 2.0, 3.0])), image=image, camera=camera
    )
    depth = 20.0 * drawn(*SHAPE)
    depth[::7, ::3] = np.nan
    cloud = cloud_of(view, depth, depth, np.zeros(SHAPE))
    known = np.isfinite(depth)
    points = transforms.apply(view.T_home_cam, points_from_depth(depth, camera.K)[known])
    assert np.abs(cloud.points_home_m - points).max() < 1e-5 and np.array_equal(
        cloud.colors, image[known]
    )


def test_sigma_of_bands_is_that_of_the_whole_picture():
    fine = Fine(drawn(*SHAPE), 1e-4 * drawn(*SHAPE), Residuals(*drawn(5, 2, *SHAPE)))
    known = drawn(*SHAPE) > 0.5
    window = np.ones((9, 9), np.uint8)
    step = cv2.dilate(fine.w, window) - cv2.erode(fine.w, window)
    assert np.array_equal(matching_sigma(fine, known), _matching_sigma(fine, known, step))


@pytest.mark.parametrize("step", [1, 3, 4])
def test_rays_of_some_pixels_are_those_of_all(step):
    camera = replace(CAMERA, distortion=(-0.1, 0.02, 0.001, -0.001, 0.0))
    assert np.array_equal(camera.rays(step), camera.rays()[::step, ::step])


def test_the_subpixel_step_holds_one_set_of_residuals(pool):
    """Five images of each pair; those of the step before were held besides, and as many again on
    the way to sums."""
    reference = picture("reference", "uav1", 0.0, camera_pose([0, 0, 0]))
    others = [
        picture(f"other {k}", "uav2", 0.0, camera_pose([0, -0.2 * k, 0])) for k in range(1, 7)
    ]
    found = views(reference, others, 1.0, [grey(p) for p in (reference, *others)])
    w = np.full(found.shape, 0.1, np.float32)
    refine(found, w, 0.01 * w, 2, pool)
    tracemalloc.start()
    refine(found, w, 0.01 * w, 2, pool)
    images = tracemalloc.get_traced_memory()[1] / w.nbytes
    tracemalloc.stop()
    # measured 2026-11-27: 8.0, with what two threads hold; before: 13.0
    assert images < 10 * len(others)


@pytest.mark.slow
def test_a_large_match_holds_few_images():
    """As one of 25 megapixels: the volume is small beside the pictures."""
    camera = PinholeCamera.from_fov(1600, 1200, np.radians(56.0))
    poses = [boards.pose([0, -b, 0]) for b in (0.0, 2.0, 4.0)]
    shots = [
        Picture(f"{b}", "uav", 0.0, boards.draw(T, faulty.TOWN, camera), camera, T)
        for b, T in enumerate(poses)
    ]
    matching = MatchOptions(volume_pixels=20000, most_levels=200)
    tracemalloc.start()
    result = Joint().map(
        faulty.given(shots[0], shots[1:]), JointOptions(refine_poses=False, matching=matching)
    )
    images = tracemalloc.get_traced_memory()[1] / result.depth.nbytes
    tracemalloc.stop()
    # measured 2026-11-27, two pairs: 27.4; before: 37.3
    assert result.depth.shape == (1200, 1600) and images < 33


def test_one_pair_at_a_time_keeps_what_is_made_for_looking_at_it():
    scene = given(((0, -0.6, 0), "horizontal"), ((0, -1.2, 0), "horizontal"))
    result = Joint().map(
        scene, JointOptions(refine_poses=False, matching=MatchOptions(volume_pixels=5000))
    )
    first, second = result.pairs
    one, rectified = first.disparity, first.reference_rectified
    assert first.disparity is one and first.reference_rectified is rectified
    assert second.disparity is second.disparity
    assert first.disparity is not one and np.array_equal(first.disparity, one, equal_nan=True)
    agrees = np.isfinite(first.depth)
    assert agrees.any() and np.array_equal(first.depth[agrees], result.depth[agrees])
    assert agrees.mean() <= first.match_rate  # what no pair supports is left out later


@pytest.mark.parametrize("shape", [(100, 200), (4000, 6000)])
def test_figures_hold_no_more_than_they_show(shape):
    rgb, kind = np.zeros((*shape, 3), np.uint8), np.ones(shape, np.uint8)
    for figure in (
        figures.picture(rgb, ""),
        figures.depth(np.ones(shape, np.float32), ""),
        figures.kinds(kind),
    ):
        held = figure.axes[0].images[0].get_array().shape[:2]
        figures.plt.close(figure)
        assert max(held) <= min(1000, max(shape)) and held[0] / held[1] == pytest.approx(
            shape[0] / shape[1], rel=0.01
        )
