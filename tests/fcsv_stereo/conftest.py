# SPDX-License-Identifier: Apache-2.0
"""What several tests of stereo use."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose

from fcsv_stereo.model import Cloud, MapResult, Reference


@pytest.fixture(scope="session")
def pool():
    """Two threads, as many as a map is made with."""
    with ThreadPoolExecutor(2) as threads:
        yield threads


@pytest.fixture(scope="session")
def tiny_map():
    """Depths of 1 cm to 2 km, sigma of 0.1 to 30 % of them, every kind; none in the first row but a
    corner."""
    random = np.random.default_rng(3)
    shape = (CAMERA.height, CAMERA.width)
    depth = np.exp(random.uniform(np.log(0.01), np.log(2000.0), shape)).astype(np.float32)
    sigma = (depth * random.uniform(0.001, 0.3, shape)).astype(np.float32)
    kind = random.choice(np.array([0, 1, 2, 3, 199, 201, 202, 203, 204, 205, 206], np.uint8), shape)
    depth[0, 1:] = sigma[0, 1:] = np.nan
    image = random.integers(0, 255, (*shape, 3), np.uint8)
    reference = Reference("uav1/10.000", 10.0, "uav1", image, CAMERA, camera_pose([1.0, -2.0, 3.0]))
    none = Cloud(
        np.empty((0, 3), np.float32),
        np.empty((0, 3), np.uint8),
        np.empty(0, np.float32),
        np.empty(0, np.uint8),
    )
    return MapResult("joint", reference, [], [], depth, sigma, none, kind=kind)
