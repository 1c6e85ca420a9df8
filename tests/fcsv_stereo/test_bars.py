# SPDX-License-Identifier: Apache-2.0
"""Straight thin things matched as wholes: drawn scenes of bars before something far, seen by two
cameras."""

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.joint.bars import with_bars
from fcsv_stereo.joint.bars.join import bars_of_pair
from fcsv_stereo.joint.tuning import BARS
from fcsv_stereo.model import Cloud, MapResult, Picture, Reference

CAMERA = PinholeCamera(320, 240, 300.0, 300.0, 159.5, 119.5)
BASELINE_M, BEHIND_M, WIDTH_M = 0.3, 60.0, 0.03
# how exactly the ends of an edge of 100 px and more are found in a picture with 2 grey levels of
# noise
EDGE_PX = 0.15


def picture(x_m, bars, side=0.0, background=None, lean=0.3):
    """Bars (x at the middle row in m, depth in m) that lean by ``lean``, drawn eight times as
    large; background far."""
    k, random = 8, np.random.default_rng(5)
    shift = CAMERA.fx * x_m / BEHIND_M
    texture = cv2.GaussianBlur(random.uniform(0, 255, (240, 400)).astype(np.float32), (0, 0), 2.0)
    texture = (
        110.0 + 4.0 * (texture - texture.mean())
        if background is None
        else np.full((240, 400), background)
    )
    move = np.float32([[1, 0, -40 - shift], [0, 1, 0]])
    image = cv2.warpAffine(
        texture.astype(np.float32), move, (320, 240), borderMode=cv2.BORDER_REFLECT
    )
    large = cv2.resize(image, (320 * k, 240 * k), interpolation=cv2.INTER_LINEAR)
    for at, z in bars:
        middle, half = CAMERA.fx * (at - x_m) / z + CAMERA.cx, 0.5 * CAMERA.fx * WIDTH_M / z
        rows = np.array([-5.0, 245.0])
        left, right = (middle + lean * (rows - CAMERA.cy) + s * half for s in (-1.0, 1.0))
        corners = np.array(
            [[left[0], rows[0]], [right[0], rows[0]], [right[1], rows[1]], [left[1], rows[1]]]
        )
        cv2.fillConvexPoly(
            large, np.round((corners + 0.5) * k * 16 - 8).astype(np.int32), 190.0, shift=4
        )
    image = cv2.resize(large, (320, 240), interpolation=cv2.INTER_AREA) + random.normal(
        0.0, 2.0 + side, (240, 320)
    )
    rgb = np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    T = transforms.transform(np.eye(3), [x_m, 0.0, 0.0])
    return Picture(f"{x_m:g}", "rig", 0.0, rgb, CAMERA, T)


def pair(bars, **how):
    return picture(0.0, bars, **how), picture(BASELINE_M, bars, side=0.1, **how)


def empty(reference):
    nothing = np.full((240, 320), np.nan, np.float32)
    cloud = Cloud(
        np.zeros((0, 3), np.float32),
        np.zeros((0, 3), np.uint8),
        np.zeros(0, np.float32),
        np.zeros(0, np.uint8),
    )
    return MapResult("joint", Reference.of(reference), [], [], nothing, nothing.copy(), cloud)


def at_middles(depth, bars):
    """Median depth of each bar about the middle row."""
    found = []
    for at, z in bars:
        column = int(round(CAMERA.fx * at / z + CAMERA.cx))
        found.append(float(np.nanmedian(depth[116:125, column - 1 : column + 2])))
    return found


def test_a_bar_before_something_far_has_its_depth_within_a_fraction_of_a_pixel():
    bars = [(0.1, 3.0)]
    reference, other = pair(bars)
    result = with_bars(empty(reference), [(reference, other)])
    # 2.12, both edges of the match
    z, allowed = 3.0, 3.0**2 / (BASELINE_M * CAMERA.fx) * 2.0 * EDGE_PX
    (found,) = at_middles(result.depth, bars)
    assert abs(found - z) < allowed + 0.5 * WIDTH_M
    known = np.isfinite(result.depth)
    assert known.sum() > 0.7 * 240 * CAMERA.fx * WIDTH_M / z and (result.kind[known] == 1).all()
    assert len(result.cloud) == known.sum() and np.allclose(
        result.cloud.points_home_m[:, 2], result.depth[known]
    )
    assert np.isfinite(result.sigma[known]).all()


def test_conductors_as_far_apart_as_the_cameras_are_not_taken_for_their_neighbours():
    """Each stands in one picture where its neighbour stands in the other: a match at infinity of
    two of three."""
    bars = [(-0.15, 3.0), (0.15, 3.0), (0.45, 3.0)]
    reference, other = pair(bars)
    result = with_bars(empty(reference), [(reference, other)])
    assert at_middles(result.depth, bars) == pytest.approx([3.0] * 3, abs=0.06)


def test_where_the_picture_ends_neighbours_are_not_told_apart_and_nothing_is_said():
    """At 0.6 m the reference shows two of three, the other picture another two: both ways explain
    one or two bars."""
    bars = [(-0.3, 0.6), (0.0, 0.6), (0.3, 0.6)]
    reference, other = pair(bars)
    result = with_bars(empty(reference), [(reference, other)])
    known = np.isfinite(result.depth)
    assert not known.any() or np.abs(result.depth[known] / 0.6 - 1.0).max() < 0.1


def test_a_bar_along_the_baseline_has_no_depth():
    reference, other = pair([(0.1, 3.0)], lean=3.5)  # 16 degrees from the rows
    assert not np.isfinite(with_bars(empty(reference), [(reference, other)]).depth).any()


@pytest.mark.parametrize("pictures", ["plain", "no bar"])
def test_pictures_without_bars_change_nothing(pictures):
    reference, other = pair([], background=120.0 if pictures == "plain" else None)
    before = empty(reference)
    assert not np.isfinite(with_bars(before, [(reference, other)]).depth).any()


def test_a_stripe_on_what_the_map_knows_is_left_out():
    bars = [(0.1, 3.0)]
    reference, other = pair(bars)
    known = empty(reference)
    known.depth[:], known.sigma[:] = 20.0, 0.1
    assert with_bars(known, [(reference, other)]) is known


def test_the_map_keeps_its_own_depth_where_both_agree():
    bars = [(0.1, 3.0)]
    reference, other = pair(bars)
    known = empty(reference)
    known.depth[:120], known.sigma[:120] = 3.01, 0.05
    result = with_bars(known, [(reference, other)])
    assert (result.depth[:120] == np.float32(3.01)).all() and np.isfinite(result.depth[120:]).any()


def test_what_the_map_knows_stays_whatever_a_bar_says():
    bars = [(0.1, 3.0)]
    reference, other = pair(bars)
    known = empty(reference)
    known.depth[60:70], known.sigma[60:70] = 20.0, 0.1
    result = with_bars(known, [(reference, other)])
    assert (result.depth[60:70] == 20.0).all() and np.isfinite(result.depth[100:]).any()


def test_a_camera_that_did_not_move_shows_no_bars():
    reference, _ = pair([(0.1, 3.0)])
    assert bars_of_pair(reference, reference, BARS) == []
