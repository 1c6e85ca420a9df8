# SPDX-License-Identifier: Apache-2.0
"""What differs between two pictures of one camera, and what does not."""

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.checks import moved
from fcsv_stereo.model import Picture, Reference

CAMERA = PinholeCamera(320, 240, 300.0, 300.0, 159.5, 119.5)
TURNED_PX = 6


@pytest.fixture
def pictures():
    """A plain at 20 m, taken twice, the second time turned by a few pixels; both with the borders
    that taking out the distortion leaves."""
    noise = np.random.default_rng(1).uniform(40, 255, (240, 400, 3))
    wall = cv2.GaussianBlur(noise, (0, 0), 2.0)
    wall = np.clip(120 + 4.0 * (wall - wall.mean()), 1, 255).astype(np.uint8)
    out = []
    for start in (40, 40 + TURNED_PX):
        image = wall[:, start : start + 320].copy()
        image[:, :4] = image[:3] = 0
        out.append(image)
    return out


def changed(first, second):
    T_second = transforms.from_xyz_rpy([0.0, 0.0, 0.0], [0.0, np.arctan(TURNED_PX / 300.0), 0.0])
    depth = np.full((240, 320), 20.0, np.float32)
    reference = Reference("a", 0.0, "uav1", first, CAMERA, np.eye(4))
    still = moved._still(reference, depth, 0.01 * depth)
    return moved.changes(reference, Picture("b", "uav1", 1.0, second, CAMERA, T_second), still)


def test_black_borders_have_not_moved(pictures):
    found = changed(*pictures)
    assert found is not None and not found.changed.any() and found.comparable.mean() > 0.9


def test_what_came_is_seen_up_to_near_the_border(pictures):
    pictures[1][100:140, 20:60] = 30
    found = changed(*pictures).changed
    assert found[110:130, 30 + TURNED_PX : 50 + TURNED_PX].all() and found.mean() < 0.06


def moment(stamp_s, changed_px, comparable_px=(0, 1, 2, 3)):
    """Of a picture of four pixels."""
    return moved.Moment(
        stamp_s, *(np.isin(np.arange(4), px)[None] for px in (changed_px, comparable_px))
    )


@pytest.mark.parametrize(
    "moments, moves",
    [
        ([moment(10.0, [1, 2])], [1, 2]),  # one other moment: it may be either that moved
        ([moment(10.0, [1, 2]), moment(20.0, [1])], [1]),  # the third pixel was only passed by
        # no witness: it does not show the third
        ([moment(10.0, [1, 2]), moment(20.0, [1], [0, 1])], [1, 2]),
        ([moment(10.0, [1]), moment(1.9, [])], [1]),  # too near in time to say that it stands
        ([moment(1.0, [1])], []),
    ],
)
def test_what_no_other_moment_shows_moves(moments, moves):
    assert np.flatnonzero(moved._never_again(0.0, moments)).tolist() == moves
