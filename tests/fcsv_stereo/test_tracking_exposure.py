# SPDX-License-Identifier: Apache-2.0
"""Corners measured in pictures of another exposure: a companion's camera exposes for itself."""

import cv2
import numpy as np
import pytest

from fcsv_stereo.refinement import tracking

SIZE = (160, 120)
SHIFT = np.array([0.37, -0.28])  # px, of the second picture's content


def texture(random, softness_px=1.2):
    """(H, W) float32, 60 to 200: as sharp as a lens lets it be."""
    noise = cv2.GaussianBlur(
        random.normal(0.0, 1.0, SIZE[::-1]).astype(np.float32), (0, 0), softness_px
    )
    return 130.0 + 70.0 * np.clip(noise / (2.5 * noise.std()), -1.0, 1.0)


def shifted(image):
    move = np.array([[1.0, 0.0, SHIFT[0]], [0.0, 1.0, SHIFT[1]]])
    return cv2.warpAffine(image, move, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def as_taken(image, random):
    return np.clip(np.round(image + random.normal(0.0, 0.5, image.shape)), 0, 255).astype(np.uint8)


def places(rows=(30, 90), count=60):
    random = np.random.default_rng(2)
    return np.column_stack([random.uniform(30, 130, count), random.uniform(*rows, count)])


@pytest.mark.parametrize(["gain", "offset"], [(1.0, 0.0), (0.6, 5.0), (1.2, -25.0)])
def test_a_gain_and_an_offset_move_no_corner(gain, offset):
    """To 0.06 px: half a grey level of noise in both pictures, places by straight lines between
    pixels (0.03 px without any noise), from half a pixel away."""
    random = np.random.default_rng(1)
    scene, uv = texture(random), places()
    a, b = as_taken(scene, random), as_taken(gain * shifted(scene) + offset, random)
    off = tracking.in_any_exposure(a, b, uv, uv) - uv - SHIFT
    assert (
        np.isfinite(off).all()
        and np.median(np.abs(off)) < 0.06
        and np.abs(np.median(off, axis=0)).max() < 0.05
    )


@pytest.mark.parametrize(["gain", "offset"], [(0.5, 0.0), (1.3, -30.0)])
def test_pictures_are_brought_to_one_exposure_first(gain, offset):
    """To 3 grey levels: what was beyond 0 or 255 in the other is lost."""
    random = np.random.default_rng(5)
    scene, uv = texture(random), places((10, 110), 200)
    a, b = (np.clip(i, 0, 255).astype(np.uint8) for i in (scene, gain * scene + offset))
    there = np.ones(a.shape, bool)
    there[:, :50] = False
    b[:, :50] = 0  # where the turned picture has no source
    wrong = uv.copy()
    wrong[:40] = random.permutation(wrong[:40])  # a fifth of the places is of something else
    same = tracking.as_bright(b, there, wrong, a, uv).astype(float)
    assert np.abs(same - a)[there].max() <= 3.0 < np.abs(b.astype(float) - a)[there].max()
    assert (tracking.as_bright(b, there & ~there, uv, a, uv) == b).all(), (
        "nothing to compare: as it is"
    )


def test_where_there_is_nothing_to_see_places_stay():
    flat = np.full(SIZE[::-1], 130, np.uint8)
    assert np.allclose(tracking.in_any_exposure(flat, flat, places(), places()), places())
    assert tracking.in_any_exposure(flat, flat, np.empty((0, 2)), np.empty((0, 2))).shape == (0, 2)


def test_what_leads_elsewhere_is_left_out():
    random = np.random.default_rng(4)
    a, b = as_taken(texture(random), random), as_taken(texture(random), random)
    found = tracking.in_any_exposure(a, b, places(), places())
    off = np.linalg.norm(found - places(), axis=1)
    assert np.isnan(off).any() and np.nanmax(off) < 1.5
