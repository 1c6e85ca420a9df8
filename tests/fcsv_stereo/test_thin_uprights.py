# SPDX-License-Identifier: Apache-2.0
"""Posts and masts: found as such, and not outvoted by what is behind them."""

import cv2
import numpy as np
import pytest
from support.boards import pose

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.checks.reliability import confirmed
from fcsv_stereo.joint.refine.residuals import residuals
from fcsv_stereo.joint.surfaces.select import Map, choose_surfaces
from fcsv_stereo.joint.surfaces.thin_uprights import thin_uprights
from fcsv_stereo.joint.views import grey, views
from fcsv_stereo.model import Picture


def stripe(top, left, height, width, nearer=2.0):
    w = np.full((60, 80), 0.02, np.float32)
    w[top : top + height, left : left + width] *= nearer
    return w, w > 0.02


@pytest.mark.parametrize("height, width", [(9, 1), (40, 4), (60, 8)])
def test_a_narrow_stripe_is_one(height, width):
    w, here = stripe(0, 30, height, width)
    assert (thin_uprights(w) == here).all()


@pytest.mark.parametrize(
    "height, width, nearer", [(8, 4, 2.0), (40, 9, 2.0), (4, 40, 2.0), (40, 4, 1.2), (40, 4, 0.5)]
)
def test_what_is_low_broad_lying_hardly_nearer_or_a_gap_is_none(height, width, nearer):
    assert not thin_uprights(stripe(10, 30, height, width, nearer)[0]).any()


def test_infinity_and_slopes_hold_none():
    rows = np.linspace(0.0, 0.2, 60, dtype=np.float32)[:, None] * np.ones((1, 80), np.float32)
    assert not thin_uprights(rows).any() and not thin_uprights(np.zeros((20, 20), np.float32)).any()


def post_before_a_wall(width, shape=(160, 240), f=600.0):
    """Reference, another 1 m beside it, and true inverse depth: a grey post at 10 m, a wall of its
    grey at 30 m."""
    random = np.random.default_rng(4)
    wall = 90.0 + 8.0 * cv2.GaussianBlur(
        random.normal(0.0, 1.0, (shape[0], shape[1] + 40)), (0, 0), 1.2
    )
    post = 82.0 + random.normal(0.0, 1.0, (shape[0], width))
    camera = PinholeCamera(shape[1], shape[0], f, f, (shape[1] - 1) / 2, (shape[0] - 1) / 2)
    w = np.full(shape, 1.0 / 30.0, np.float32)
    w[20:, 150 : 150 + width] = 1.0 / 10.0
    pictures = []
    for y_m, shift, left in ((0.0, 0, 150), (-1.0, 20, 90)):  # f / 30 and f / 10 px
        image = wall[:, shift : shift + shape[1]].copy()
        image[20:, left : left + width] = post[20:]
        image += random.normal(0.0, 1.0, shape)
        rgb = np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, 2)
        pictures.append(Picture(f"{y_m}", "uav", 0.0, rgb, camera, pose((0.0, y_m, 0.0))))
    return (*pictures, w)


@pytest.mark.parametrize("width, share", [(4, 0.65), (6, 0.9)])
def test_a_post_of_the_grey_of_the_wall_behind_it_stays(pool, width, share):
    """Known in the coarse map, but for its upper half, it is kept at full size, and no broader."""
    reference, other, true = post_before_a_wall(width)
    greys = [grey(reference), grey(other)]
    found, half = (views(reference, [other], scale, greys) for scale in (1.0, 0.5))
    w = true[::2, ::2].copy()
    known = np.ones(w.shape, bool)
    known[:45][w[:45] > 0.05] = False
    shown = confirmed(known, residuals(half, w, pool))
    chosen = choose_surfaces(found, Map(half, w, known, known, shown), reference.image, pool)
    right = np.abs(chosen / true - 1.0) < 0.1
    post = true > 0.05
    # measured 2026-11-24: 0.730 and 0.973 of the post, 0.998 of the rest; outvoted: 0.23 and 0.68
    # of the post
    assert right[post].mean() > share and right[~post].mean() > 0.99
