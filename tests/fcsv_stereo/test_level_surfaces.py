# SPDX-License-Identifier: Apache-2.0
"""Level ground with little texture, seen from eight metres apart at eight metres height: it shears
from row to row."""

import cv2
import numpy as np
import pytest
from support import scenes

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint import match_jointly
from fcsv_stereo.joint.views import grey, inverse_depths, views
from fcsv_stereo.joint.volume.cost_volume import cost_volume
from fcsv_stereo.joint.volume.winner import highest_level, level_drift, match_volume
from fcsv_stereo.model import Picture

HEIGHT_M = 8.0
CONTRAST, NOISE = 3.0, 0.5  # grey levels: pale concrete
CAMERA = PinholeCamera(240, 160, 200.0, 200.0, 119.5, 79.5)
_PX_PER_M = 12
_GROUND = cv2.GaussianBlur(np.random.default_rng(5).normal(size=(1600, 1600)), (0, 0), 2.0)
_GROUND *= CONTRAST / _GROUND.std()


def rays_in_home(T_home_cam):
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(float)
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1
    )
    return rays @ T_home_cam[:3, :3].T


def picture(name, y_m, seed):
    """From HEIGHT_M above the ground, y_m to the left, looking 12 degrees down; above the horizon
    it is white."""
    T = scenes.camera_pose((0.0, y_m, HEIGHT_M), (0.0, 12.0, 0.0))
    rays = rays_in_home(T)
    depth = np.where(rays[..., 2] < -0.02, HEIGHT_M / np.maximum(-rays[..., 2], 1e-6), np.inf)
    at = np.nan_to_num(T[:3, 3] + rays * depth[..., None], posinf=0.0, neginf=0.0)
    x, y = (np.float32(at[..., i] * _PX_PER_M + o) for i, o in ((0, 0), (1, 800)))
    ground = cv2.remap(
        _GROUND.astype(np.float32), y, x, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    image = np.where(np.isfinite(depth), 150.0 + ground, 240.0)
    image += np.random.default_rng(seed).normal(size=image.shape) * NOISE
    image = np.clip(np.round(image), 0, 255).astype(np.uint8)
    return Picture(name, name, 0.0, np.repeat(image[..., None], 3, 2), CAMERA, T), depth


@pytest.fixture(scope="module")
def ground():
    reference, depth = picture("reference", 0.0, 1)
    others = [picture(f"at {y:g} m", -y, 10 + i)[0] for i, y in enumerate((2.0, 4.0, 8.0))]
    return reference, others, depth


def seen(ground):
    reference, others, _ = ground
    return views(reference, others, 1.0, [grey(p) for p in (reference, *others)])


def test_windows_in_level_planes_find_the_ground(ground, pool):
    found, depth = seen(ground), ground[2]
    levels = inverse_depths(found, 1.0, 768)
    everywhere = np.full(found.shape[0], np.inf)
    rows, columns = np.mgrid[100:156, 60:180]
    true = np.searchsorted(levels, 1.0 / depth[rows, columns]).clip(0, len(levels) - 1)
    upright, level = (
        cost_volume(found, levels, everywhere, h, pool)[0][rows, columns] for h in (0.0, np.inf)
    )
    at_truth = [np.take_along_axis(v, true[..., None], 2).mean() for v in (upright, level)]
    assert at_truth[1] < 0.9 * at_truth[0]
    right = [(np.abs(v.argmin(axis=2) - true) < 3).mean() for v in (upright, level)]
    assert right[1] > right[0]
    assert (level <= upright).all()


def test_a_level_surface_drifts_by_the_fall_of_its_rays(ground):
    found = seen(ground)
    levels = inverse_depths(found, 1.0, 768)
    drift = level_drift(found, levels)
    _, _, depth = ground
    for row, neighbour, way in ((120, 119, 0), (120, 121, 1)):
        here, there = (
            np.interp(1.0 / depth[r, 120], levels, np.arange(len(levels))) for r in (row, neighbour)
        )
        assert np.interp(here, np.arange(len(levels)), drift[way, row]) == pytest.approx(
            there - here, abs=0.02
        )
    horizon = np.isinf(depth[:, 120]).sum()
    assert horizon > 20 and (drift[:, : horizon - 2] == 0.0).all()


def test_the_ground_is_what_lies_lowest(ground, pool):
    found = seen(ground)
    rough = match_volume(found, np.full(found.shape[0], np.inf), np.inf, 768, pool)
    assert 1.0 / HEIGHT_M < highest_level(rough, found) < 2.5 / HEIGHT_M


def test_pale_ground_is_mapped(ground):
    reference, others, depth = ground
    found = match_jointly(reference, others)
    near = np.isfinite(depth) & (depth < 60.0)
    near[:, :80] = near[:, -80:] = False  # not all pictures see the sides
    right = np.abs(found.depth[near] / depth[near] - 1.0) < 0.1
    assert right.mean() > 0.98  # measured 2026-11-24: 1.000
