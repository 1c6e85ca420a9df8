# SPDX-License-Identifier: Apache-2.0
"""What is relied on: nothing near can be in front of what another picture is known to show behind
it."""

import numpy as np
import pytest
from support.scenes import camera_pose

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.checks.reliability import confirmed, consistent, relied_on
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.surfaces.select import Map, choose_surfaces
from fcsv_stereo.joint.views import grey, views
from fcsv_stereo.model import Picture

SHAPE, FOCAL_PX = (120, 260), 600.0
FAR, NEAR = np.float32(1.0 / 30.0), np.float32(1.0 / 10.0)  # 20 and 60 px from picture to picture
BOX, HIDDEN = slice(150, 190), slice(112, 150)  # the box hides 40 px of the wall on its left


def box_before_a_plain_wall():
    """Reference, others 1 m to its right and to its left, in colour, and the true inverse depth."""
    random = np.random.default_rng(7)
    height, width = SHAPE
    box = random.uniform(165.0, 195.0, (height, BOX.stop - BOX.start))
    camera = PinholeCamera(width, height, FOCAL_PX, FOCAL_PX, (width - 1) / 2, (height - 1) / 2)
    w = np.full(SHAPE, FAR)
    w[:, BOX] = NEAR
    pictures = []
    for y_m, shift in ((0.0, 0), (-1.0, 60), (1.0, -60)):
        image = np.full(SHAPE, 180.0)
        image[:, BOX.start - shift : BOX.stop - shift] = box
        image += random.normal(0.0, 1.0, SHAPE)
        rgb = np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, 2)
        pictures.append(Picture(f"{y_m}", "uav", 0.0, rgb, camera, camera_pose((0.0, y_m, 0.0))))
    return (*pictures, w)


@pytest.fixture(scope="module")
def box():
    reference, right, left, w = box_before_a_plain_wall()
    both = views(reference, [right, left], 1.0, [grey(p) for p in (reference, right, left)])
    one = [views(reference, [right], scale, [grey(reference), grey(right)]) for scale in (1.0, 0.5)]
    return reference, both, one, w


def agreement(trust):
    some = np.ones_like(trust)
    return Residuals(some, some, some, some, trust)


def trust_of(front, behind=0.9):
    """Of both pairs: all agree but the right one with what was drawn over the hidden wall, and what
    it shows there."""
    trust = np.full((2, *SHAPE), 0.9, np.float32)
    trust[0, :, HIDDEN] = front
    trust[0, :, HIDDEN.start - 40 : HIDDEN.stop - 40] = behind
    return agreement(trust)


@pytest.mark.parametrize(
    "front, behind, stays",
    [(0.6, 0.9, False), (0.9, 0.9, True), (0.6, 0.7, True), (0.1, 0.45, True)],
)
def test_a_front_drawn_over_what_is_hidden_is_seen_through(box, front, behind, stays):
    """The left picture has nothing else to show there; the right one shows the wall, and that is
    the better match."""
    _, both, _, w = box
    wrong = w.copy()
    wrong[:, HIDDEN] = NEAR
    assert (consistent(both, wrong, trust_of(front, behind))[:, HIDDEN] == stays).all()


def test_what_is_hidden_is_not_seen_through(box):
    """The wall agrees badly with the picture that shows the box instead, well with the other."""
    _, both, _, w = box
    assert consistent(both, w, trust_of(0.1))[:, 60:200].all()


def test_confirmed_is_by_each_pair_and_with_all_about_it():
    certain = np.ones((9, 20), bool)
    certain[4, 4] = False
    trust = np.full((2, 9, 20), 0.9, np.float32)
    trust[1, :, 10:] = 0.4
    first, second = confirmed(certain, agreement(trust))
    assert not first[3:6, 3:6].any() and first.sum() == first.size - 9
    assert (second == (first & (np.arange(20) < 9))).all()


def test_a_thin_thing_that_stands_is_known_whoever_agrees(box):
    _, both, _, _ = box
    w = np.full(SHAPE, FAR)
    w[30:, 100:105] = w[:, 150:190] = NEAR
    known, certain, shown = relied_on(both, w, agreement(np.zeros((2, *SHAPE), np.float32)))
    assert known[30:, 100:105].all() and known.sum() == 5 * (SHAPE[0] - 30)
    assert not certain.any() and not shown.any()


def test_the_wall_beside_a_box_is_not_the_boxs(box, pool):
    """Plain grey looks like plain grey at any depth, and the right one is hidden: only that the
    other picture shows the wall where the box would stand tells."""
    reference, _, (found, half), w = box
    coarse = w[::2, ::2].copy()
    known = np.ones(coarse.shape, bool)
    hidden = slice(HIDDEN.start // 2, HIDDEN.stop // 2)
    known[:, hidden] = False
    coarse[:, hidden] = NEAR
    share = []
    for shown in (known, np.zeros_like(known)):
        chosen = choose_surfaces(
            found, Map(half, coarse, known, known, shown[None]), reference.image, pool
        )
        share.append((np.abs(chosen / w - 1.0) < 0.1)[:, HIDDEN].mean())
    assert share[0] > 0.95 and share[1] < 0.85
