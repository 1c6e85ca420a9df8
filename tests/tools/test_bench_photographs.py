# SPDX-License-Identifier: Apache-2.0
"""The bench's real photographs: what counts as truth, and whose poses are compared."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from support.photographs import model

from bench import photographs
from fcsv_geometry import transforms
from fcsv_stereo.posed import colmap


def test_where_a_disparity_is_unknown_there_is_no_truth(tmp_path, monkeypatch):
    """Infinite and zero disparities are holes of the scanner, not depths of zero that every map
    would miss."""
    (tmp_path / "motorcycle").mkdir()
    monkeypatch.setattr(photographs, "SHARED", tmp_path)
    disparity = np.full((48, 64), 20.0, np.float32)
    disparity[:5], disparity[5:7] = np.inf, 0.0
    np.savez(tmp_path / "motorcycle" / "motorcycle_disp.npz", disparity)
    for side in ("left", "right"):
        cv2.imwrite(
            str(tmp_path / "motorcycle" / f"motorcycle_{side}.png"), np.zeros((48, 64, 3), np.uint8)
        )
    case = photographs.motorcycle()
    assert np.isinf(case.true_depth[:7]).all()
    np.testing.assert_allclose(case.true_depth[7:], 994.978 * 0.193001 / (20.0 + 31.086), rtol=1e-6)


def test_without_the_photographs_there_are_no_lines(tmp_path, monkeypatch):
    monkeypatch.setattr(photographs, "SHARED", tmp_path)
    assert photographs.motorcycle() is None and photographs.measure_fountain() == []


def test_rotations_are_compared_relative_to_the_reference(tmp_path):
    """Whatever world the surveyed poses are in; a turn of 2 degrees is one of 2 degrees."""
    given = colmap.read_photographs(model(tmp_path))
    (c,) = given.configurations
    T_world_home = transforms.from_xyz_rpy([3, 2, 1], [0.3, -0.2, 1.0])
    names = [c.references[0].name, c.others[0].name]
    turned = c.others[0].T_home_cam @ transforms.from_xyz_rpy([0, 0, 0], np.radians([0, 2.0, 0]))
    surveyed = {
        names[0]: T_world_home @ c.references[0].T_home_cam,
        names[1]: T_world_home @ turned,
    }
    exact = photographs._exact(given, surveyed)
    images = [
        SimpleNamespace(name=n, T_home_cam=p.T_home_cam)
        for n, p in zip(names, (c.references[0], exact.configurations[0].others[0]))
    ]
    map_ = SimpleNamespace(
        images=images,
        reference=SimpleNamespace(name=names[0], T_home_cam=c.references[0].T_home_cam),
    )
    before, after = photographs.rotation_errors_deg(given, [map_], surveyed)
    assert before == [pytest.approx(2.0)] and after == [pytest.approx(0.0, abs=1e-5)]
