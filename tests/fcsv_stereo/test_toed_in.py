# SPDX-License-Identifier: Apache-2.0
"""Equation 2.12 where cameras are turned inward."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.equations import depth_error as parallel_error
from fcsv_stereo.planning.toed_in import depth_error

CAMERA = PinholeCamera(640, 480, 602.0, 590.0, 319.5, 239.5)


def turned(tilt_rad, baseline_m=0.2):
    """The other camera to the right, turned inward."""
    return transforms.from_xyz_rpy([baseline_m, 0.0, 0.0], [0.0, -tilt_rad, 0.0])


def test_parallel_it_is_equation_2_12_in_the_whole_picture():
    z = np.array([0.3, 1.0, 10.0])
    for xy in ([0.0, 0.0], [0.4, -0.3]):
        found = depth_error(z, np.broadcast_to(xy, (3, 2)), turned(0.0), CAMERA, 0.5)
        assert found == pytest.approx(parallel_error(z, 0.2, CAMERA.fx, 0.5))


@pytest.mark.parametrize("tilt_deg", [5.0, 20.0, 35.0])
def test_tilted_a_pixel_moves_the_point_by_so_much(tilt_deg):
    """Against the projection of two points that are one thousandth of a pixel apart."""
    T, xy, z = turned(np.radians(tilt_deg)), np.array([0.1, -0.2]), 0.5
    error = float(depth_error(z, xy, T, CAMERA, 1e-3))
    points = np.array([[*(xy * d), d] for d in (z - error / 2, z + error / 2)])
    uv = CAMERA.project(transforms.apply(transforms.invert(T), points))
    assert np.linalg.norm(uv[1] - uv[0]) == pytest.approx(1e-3, rel=1e-4)


def test_along_the_baseline_no_match_tells_a_depth():
    T = transforms.transform(np.eye(3), [0.0, 0.0, 0.2])
    assert np.isinf(depth_error(1.0, np.zeros(2), T, CAMERA))
