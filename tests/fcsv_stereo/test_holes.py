# SPDX-License-Identifier: Apache-2.0
"""Holes of the orthophoto: of ground 8 m below a camera that looks ahead, with a wall 20 m before
it."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Cloud, Reference
from fcsv_stereo.products import holes
from fcsv_stereo.products.from_above import Raster, rasterize
from fcsv_stereo.products.holes import (
    BELOW,
    FILLED,
    HIDDEN,
    OPEN,
    UNANSWERED,
    UNSEEN,
    HoleShares,
    hole_shares,
    why_empty,
)
from fcsv_stereo.products.spanned import Surfaces

CELL_M = 0.5
CAMERA = PinholeCamera(160, 120, 150.0, 150.0, 79.5, 59.5)
RAYS = CAMERA.rays()
SKY = RAYS[..., 1] <= 0.1
WALL = (np.abs(RAYS[..., 0]) < 0.1) & (RAYS[..., 1] < 0.3) & ~SKY


def view(roll_deg=0.0):
    R_home_cam = (
        transforms.R_FLU_OPTICAL
        @ transforms.from_xyz_rpy([0, 0, 0], [0, 0, np.radians(roll_deg)])[:3, :3]
    )
    return Reference(
        "",
        0.0,
        "",
        np.zeros((120, 160, 3), np.uint8),
        CAMERA,
        transforms.transform(R_home_cam, np.zeros(3)),
    )


def town():
    depth = np.where(SKY, np.nan, 8.0 / np.maximum(RAYS[..., 1], 0.1))
    return np.where(WALL, 20.0, depth)


def cloud_of(depth, reference):
    known = np.isfinite(depth)
    points = transforms.apply(reference.T_home_cam, (RAYS * depth[..., None])[known])
    n = len(points)
    return Cloud(
        points.astype(np.float32),
        np.full((n, 3), 100, np.uint8),
        np.ones(n, np.float32),
        np.zeros(n, np.uint8),
    )


def why(depth, spanning=True):
    reference = view()
    cloud = cloud_of(depth, reference)
    raster = rasterize(cloud, CELL_M, reference if spanning else None)
    found = why_empty(raster, Surfaces.of(cloud, reference), reference, SKY)

    def at(x_m, y_m):
        return found[int((raster.y0_m - y_m) / CELL_M), int((x_m - raster.x0_m) / CELL_M)]

    return at, found


@pytest.mark.parametrize(
    "place, code",
    [
        ((50.0, 0.0), HIDDEN),
        ((30.0, 1.0), HIDDEN),
        ((60.0, -9.0), FILLED),
        ((40.0, 12.0), FILLED),
        ((40.0, 30.0), UNSEEN),
    ],
)
def test_what_nobody_saw_is_hidden_and_what_was_seen_is_filled(place, code):
    at, _ = why(town())
    assert at(*place) == code


def test_points_alone_leave_holes_where_a_surface_was_seen_and_spanned_ones_none():
    at, alone = why(town(), spanning=False)
    assert (alone == OPEN).sum() > 500 and any(
        at(x, -9.0) == OPEN for x in np.arange(60.0, 74.0, 0.5)
    )
    _, spanned = why(town())
    # by the half pixels that places are rounded to
    assert (spanned == OPEN).sum() < 0.002 * (spanned >= FILLED).sum()


def test_ground_without_a_depth_stays_a_hole_that_says_so():
    # 33 to 40 m ahead
    unsure = (np.abs(RAYS[..., 0]) > 0.2) & (RAYS[..., 1] > 0.2) & (RAYS[..., 1] < 0.24)
    at, _ = why(np.where(unsure, np.nan, town()))
    assert at(36.0, 9.0) == UNANSWERED and at(36.0, 5.0) == FILLED


def test_ground_below_the_picture_says_so():
    reference = view()
    raster = Raster(
        np.array([[np.nan, np.nan, -8.0]], np.float32),
        np.zeros((1, 3, 3), np.uint8),
        5.0,
        12.0,
        2.5,
    )
    surfaces = Surfaces.of(cloud_of(np.where(WALL, np.nan, town()), reference), reference)
    # begins at 20.2 m
    assert why_empty(raster, surfaces, reference, SKY).tolist() == [[UNSEEN, BELOW, FILLED]]
    empty = Raster(
        np.full((2, 2), np.nan, np.float32), np.zeros((2, 2, 3), np.uint8), 5.0, 12.0, 2.5
    )
    assert not why_empty(empty, surfaces, reference, SKY).any()
    assert HoleShares.of(np.zeros((2, 2), np.uint8)).to_dict()["cells"] == 0


def test_the_last_pixels_of_a_surface_cover_half_a_pixel_more():
    """One pixel of ground 32 m ahead is 1.7 m long and 0.2 m wide: so much is filled, and nothing
    beyond."""
    reference = view()
    depth = np.full(SKY.shape, np.nan)
    depth[95:98, 80] = (8.0 / RAYS[..., 1])[95:98, 80]
    x = 8.0 * 150.0 / (np.array([97.5, 94.5]) - 59.5)  # where its three rows begin and end
    raster = rasterize(cloud_of(depth, reference), 0.1, reference)
    filled_x = raster.x0_m + 0.1 * (0.5 + np.flatnonzero(np.isfinite(raster.height).any(axis=0)))
    assert np.isfinite(raster.height).all(axis=0).any()
    assert x[0] - 0.1 < filled_x.min() and filled_x.max() < x[1] + 0.1  # a cell's side
    # the rim goes on in a straight line of inverse depth
    assert np.nanmax(np.abs(raster.height + 8.0)) < 0.1


@pytest.mark.parametrize("roll_deg", [0.0, 20.0, 90.0])
def test_a_camera_that_rolls_sees_as_much(roll_deg):
    """A wall across the line of sight at 20 m, all the picture: what is behind it is hidden."""
    reference = view(roll_deg)
    cloud = cloud_of(np.full(SKY.shape, 20.0), reference)
    height = np.full((1, 80), np.nan, np.float32)
    height[0, 0] = 0.0
    raster = Raster(height, np.zeros((1, 80, 3), np.uint8), CELL_M, 10.0, 0.25)
    found = why_empty(raster, Surfaces.of(cloud, reference), reference, np.zeros(SKY.shape, bool))[
        0
    ]
    assert (found[22:] == HIDDEN).all() and (found[1:19] == BELOW).all()


def test_shares_of_a_large_raster_are_those_of_some_of_its_cells(monkeypatch):
    monkeypatch.setattr(holes, "_ENOUGH_CELLS", 1000)
    reference = view()
    cloud = cloud_of(town(), reference)
    raster = rasterize(cloud, CELL_M, reference)
    whole = HoleShares.of(why_empty(raster, Surfaces.of(cloud, reference), reference, SKY))
    some = hole_shares(raster, cloud, reference, SKY)
    assert some.cells < whole.cells / 3
    for name in ("filled", "hidden", "unanswered", "below", "open"):
        # of some thousand cells
        assert getattr(some, name) == pytest.approx(getattr(whole, name), abs=0.02)
    assert some.filled + some.without_evidence + some.open == pytest.approx(1.0)
