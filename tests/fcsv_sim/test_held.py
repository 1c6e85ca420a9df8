# SPDX-License-Identifier: Apache-2.0
"""How a demo measures by the truth whether set-points were held."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_sim.demo.held import errors

T_WORLD_ODOM = transforms.from_xyz_yaw([0.0, 0.0, 0.3], 0.5)


def test_each_moment_is_compared_with_the_set_point_that_held_then():
    first, second = (
        transforms.from_xyz_yaw([1.0, 0.0, 1.7], 0.0),
        transforms.from_xyz_yaw([2.0, 0.0, 1.7], 0.1),
    )
    off = transforms.from_xyz_yaw([0.0, 0.05, 0.0], np.radians(2.0))
    true = [
        (t, T_WORLD_ODOM @ T @ off)
        for t, T in ((0.5, first), (1.5, first), (2.5, second), (3.5, first))
    ]
    found = errors([(1.0, 3.0)], [(1.0, first), (2.0, second)], true, T_WORLD_ODOM)
    assert found == pytest.approx(np.array([[0.05, 2.0], [0.05, 2.0]]))


def test_without_a_window_or_a_set_point_there_is_nothing_to_say():
    true = [(1.0, np.eye(4))]
    assert errors([], [(0.0, np.eye(4))], true, np.eye(4)).shape == (0, 2)
    assert errors([(0.0, 2.0)], [], true, np.eye(4)).shape == (0, 2)
