# SPDX-License-Identifier: Apache-2.0
"""From above: ground between pixels is filled where it is one surface, and steps of depth stay open."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.depth import points_from_depth
from fcsv_stereo.model import Cloud, Reference
from fcsv_stereo.products.from_above import rasterize
from fcsv_stereo.products.surfaces import with_surfaces

CAMERA = PinholeCamera.from_fov(160, 120, np.radians(56.0))
HEIGHT_M, CELL_M, FAR_M = 8.0, 0.5, 60.0
STEP = 0.25 / (CAMERA.fx * 8.0)  # a quarter of a pixel for a baseline of 8 m


def seen(depth):
    """Cloud and reference of a depth picture; the camera looks along x, home is its place."""
    T_home_cam = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
    known = np.isfinite(depth)
    points = points_from_depth(depth, CAMERA.K)[known] @ T_home_cam[:3, :3].T
    n = len(points)
    rows, columns = np.nonzero(known)
    colours = np.stack([rows, columns, np.full(n, 9)], axis=1).astype(np.uint8)
    cloud = Cloud(points.astype(np.float32), colours, np.ones(n, np.float32), np.zeros(n, np.uint8))
    return cloud, Reference("r", 0.0, "uav1", np.zeros((*depth.shape, 3), np.uint8), CAMERA, T_home_cam)


def ground():
    """Depth of level ground 8 m below, to 60 m."""
    rays = CAMERA.rays()
    with np.errstate(divide="ignore"):
        z = HEIGHT_M / rays[..., 1]
    return np.where((z > 0) & (z < FAR_M), z, np.nan)


def test_ground_that_is_far_has_no_holes():
    """At 50 m rows lie 2 m apart and cells are half a metre: all are filled, at the ground's height."""
    cloud, reference = seen(ground())
    filled = with_surfaces(cloud, reference, CELL_M, STEP)
    assert np.array_equal(filled.points_home_m[: len(cloud)], cloud.points_home_m)  # what was there stays
    new = filled.points_home_m[len(cloud) :]
    assert len(new) > len(cloud) and np.abs(new[:, 2] + HEIGHT_M).max() < 1e-4  # float32 of 60 m
    uv = CAMERA.project(new.astype(float) @ transforms.R_FLU_OPTICAL)
    assert np.abs(filled.colors[len(cloud) :, :2] - uv[:, ::-1]).max() < 0.51  # colours are pixels' rows and columns
    before = rasterize(cloud, CELL_M)
    after = rasterize(cloud, CELL_M, lambda c, cell_m: with_surfaces(c, reference, cell_m, STEP))
    # a strip of ground that the camera sees from edge to edge
    row, column = (int((before.y0_m - 0.0) / CELL_M), int((52.0 - before.x0_m) / CELL_M))
    strip = np.s_[row - 20 : row + 20, column - 10 : column + 10]
    assert np.isfinite(before.height[strip]).mean() < 0.9 and np.isfinite(after.height[strip]).all()


def test_a_step_of_depth_stays_open():
    """A wall at 20 m before one at 30 m: a step of 16 px of disparity at 8 m; nothing is put between them."""
    depth = np.full((CAMERA.height, CAMERA.width), 30.0)
    depth[:, :80] = 20.0
    cloud, reference = seen(depth)
    filled = with_surfaces(cloud, reference, 0.05, STEP)
    x = filled.points_home_m[len(cloud) :, 0]
    assert len(x) and not ((x > 20.01) & (x < 29.99)).any()


def test_what_is_not_known_is_not_filled():
    depth = ground()
    depth[:, 60:100] = np.nan
    cloud, reference = seen(depth)
    new = with_surfaces(cloud, reference, CELL_M, STEP).points_home_m[len(cloud) :].astype(float)
    u = CAMERA.project(new @ transforms.R_FLU_OPTICAL)[:, 0]
    assert len(new) and not ((u > 59.01) & (u < 99.99)).any()


@pytest.mark.parametrize("count", [0, 1])
def test_hardly_any_points_have_nothing_between(count):
    depth = np.full((CAMERA.height, CAMERA.width), np.nan)
    depth[60, 80 : 80 + count] = 20.0
    cloud, reference = seen(depth)
    assert len(with_surfaces(cloud, reference, CELL_M, STEP)) == count
