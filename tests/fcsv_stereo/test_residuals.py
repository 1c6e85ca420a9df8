# SPDX-License-Identifier: Apache-2.0
"""How pictures differ at a map of inverse depth: values and slopes between the pixels."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from fcsv_stereo.joint.refine.residuals import residuals
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
        r = residuals(found, np.full(SIZE, w, np.float32), pool)
    x, y = u + w * b[0], v + w * b[1]
    inside = (x >= 1) & (x <= SIZE[1] - 3) & (y >= 1) & (y <= SIZE[0] - 3)
    slope = b[0] * (0.3 + 0.1 * x + 0.02 * y) + b[1] * (-0.2 - 0.06 * y + 0.02 * x)
    assert inside.sum() > 400
    assert np.abs(-r.difference[0] - picture(x, y))[inside].max() < 1e-3
    assert np.abs(r.slope[0] - slope)[inside].max() < 1e-3
    assert np.allclose(r.speed[0], np.hypot(b[0], b[1]))
    assert np.array_equal(r.seen[0] > 0, (x <= SIZE[1] - 1) & (y <= SIZE[0] - 1))
