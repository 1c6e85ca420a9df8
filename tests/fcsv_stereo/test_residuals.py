# SPDX-License-Identifier: Apache-2.0
"""How pictures differ at a map of inverse depth: values and slopes between the pixels."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from fcsv_stereo.joint.refine.residuals import detail, differences, residuals
from fcsv_stereo.joint.views import Views

SIZE = 24, 32


def picture(u, v):
    """A bent surface of grey: straight lines between pixels miss it, cubics do not."""
    return 100.0 + 0.3 * u - 0.2 * v + 0.05 * u * u - 0.03 * v * v + 0.02 * u * v


@pytest.mark.parametrize("w", [0.0, 0.125, 0.37, 0.5, 0.9])
def test_values_and_slopes_between_pixels_are_those_of_the_surface(w):
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    other = picture(u, v).astype(np.float32)[None]
    b = np.array([3.0, 1.6, 0.0])  # px per inverse depth
    projection = np.r_[np.eye(3).ravel(), b].astype(np.float32)[None]
    found = Views(np.zeros(SIZE, np.float32), other, np.array([SIZE]), projection, np.zeros(3))
    with ThreadPoolExecutor(1) as pool:
        at = np.full(SIZE, w, np.float32)
        r, difference = residuals(found, at, pool), differences(found, at, pool)[0]
    x, y = u + w * b[0], v + w * b[1]
    inside = (x >= 1) & (x <= SIZE[1] - 3) & (y >= 1) & (y <= SIZE[0] - 3)
    slope = b[0] * (0.3 + 0.1 * x + 0.02 * y) + b[1] * (-0.2 - 0.06 * y + 0.02 * x)
    assert inside.sum() > 400
    assert np.abs(-difference - picture(x, y))[inside].max() < 1e-3
    assert np.abs(r.slope[0] - slope)[inside].max() < 1e-3
    assert np.allclose(r.speed[0], np.hypot(b[0], b[1]))
    assert np.array_equal(r.seen[0] > 0, (x <= SIZE[1] - 1) & (y <= SIZE[0] - 1))


def thin_bar():
    """A bar of 4 px before a field that is bright on the left and dark on the right, infinitely
    far; the bar is before the bright part in the reference and before the dark one in the other
    picture. Views, inverse depth, the bar."""
    u = np.arange(64)
    field = np.where(u < 36, 170.0, 40.0) + np.random.default_rng(5).normal(0.0, 4.0, (40, 64))
    bar = np.random.default_rng(6).normal(100.0, 4.0, (40, 4))
    reference, other = field.copy(), field.copy()
    reference[:, 20:24], other[:, 44:48] = bar, bar
    projection = np.r_[np.eye(3).ravel(), 24.0, 0.0, 0.0].astype(np.float32)[None]
    found = Views(
        reference.astype(np.float32),
        other.astype(np.float32)[None],
        np.array([reference.shape]),
        projection,
        np.zeros(3),
    )
    here = np.zeros(reference.shape, bool)
    here[4:-4, 20:24] = True
    w = np.zeros(reference.shape, np.float32)
    w[:, 20:24] = 1.0
    return found, w, here


def test_a_thin_bar_is_trusted_before_another_background_in_each_picture():
    found, w, here = thin_bar()
    with ThreadPoolExecutor(1) as pool:
        right = residuals(found, w, pool).trust[0][here]
        of_means = residuals(detail(found), w, pool).trust[0][here]
        wrong = residuals(found, np.zeros_like(w), pool).trust[0][here]
    assert right.min() > 0.9
    assert np.median(of_means) < 0.4 and wrong.max() < 0.4


@pytest.mark.parametrize("brighter", [-30.0, 25.0])
def test_another_exposure_is_no_difference(brighter):
    found, w, here = thin_bar()
    with ThreadPoolExecutor(1) as pool:
        same = residuals(found, w, pool)
        other = residuals(replace(found, others=found.others + np.float32(brighter)), w, pool)
    assert np.abs(other.trust - same.trust)[0][here].max() < 0.05
