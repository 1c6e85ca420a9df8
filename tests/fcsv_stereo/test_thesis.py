# SPDX-License-Identifier: Apache-2.0
"""The thesis's method on synthetic walls with known depth, and its equations."""

import dataclasses
import doctest

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, given, picture, true_depth

from fcsv_stereo import depth as depth_module
from fcsv_stereo import equations
from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest, parse_threshold
from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput
from fcsv_stereo.rectify import RECTIFIERS
from fcsv_stereo.thesis import ThesisOptions, fuse, map_thesis
from fcsv_stereo.thesis.matchers import MATCHERS, DisparityWindow, match
from fcsv_stereo.thesis.selection import SelectionOptions, select

WIDE = ErrorThreshold(5.0, False)  # everything in the scene is in range


def quiet(*_):
    pass


@pytest.mark.parametrize("module", [equations, fuse])
def test_numbers_of_the_thesis(module):
    result = doctest.testmod(module)
    assert result.attempted and not result.failed


def test_equation_2_12_and_3_1_meet():
    for threshold in (ErrorThreshold(0.5, False), ErrorThreshold(0.1, True)):
        z = farthest(3.0, 602.0, threshold)
        allowed = threshold.value * (z if threshold.relative else 1.0)
        assert depth_error(z, 3.0, 602.0) == pytest.approx(allowed)


@pytest.mark.parametrize("text", ["", "x", "-1", "10%%", "nan", "0", "100%", "1.2.3"])
def test_bad_thresholds(text):
    with pytest.raises(InputError):
        parse_threshold(text)


@pytest.mark.parametrize("rectifier", sorted(RECTIFIERS))
@pytest.mark.parametrize(
    "xyz, axis",
    [
        ((0, -0.8, 0), "horizontal"),
        ((0, 0.8, 0), "horizontal"),
        ((0, 0, 0.8), "vertical"),
        ((0, 0, -0.8), "vertical"),
        ((0.3, -0.8, 0.05), "horizontal"),
    ],
)
def test_depth_in_every_direction(xyz, axis, rectifier):
    """Right, left, above, below, and a camera that stands ahead: whole-pixel disparity is half a
    pixel off at most."""
    scene = given((xyz, axis))
    result = map_thesis(
        scene,
        ThesisOptions(rectifier=rectifier, threshold=WIDE, window=DisparityWindow(4, 200)),
        quiet,
    )
    truth = true_depth(result.reference.T_home_cam)
    known = np.isfinite(result.depth)
    error = np.abs(result.depth[known] - truth[known])
    bound = depth_error(20.0, 0.8, CAMERA.fx)  # 2.12 for one pixel at the far wall
    # measured 2026-11-24: 0.863 to 0.917; 0.673 where Bouguet turns both pictures to an oblique
    # baseline
    assert known.mean() > (0.64 if xyz[0] and rectifier == "bouguet" else 0.84)
    assert np.median(error) < 0.6 * bound and np.percentile(error, 85) < 1.6 * bound


@pytest.mark.parametrize("matcher", sorted(MATCHERS))
def test_every_matcher(matcher):
    scene = given(((0, -0.8, 0), "horizontal"))
    options = ThesisOptions(matcher=matcher, threshold=WIDE, window=DisparityWindow(4, 100))
    result = map_thesis(scene, options, quiet)
    known = np.isfinite(result.depth)
    relative = np.abs(result.depth / true_depth(result.reference.T_home_cam) - 1)[known]
    # measured 2026-11-24: 0.855 to 0.916, 0.0031
    assert known.mean() > 0.83 and np.median(relative) < 0.005


@pytest.mark.parametrize("matcher", ["sgbm", "bm"])
@pytest.mark.parametrize("xyz, axis", [((0, -0.8, 0), "horizontal"), ((0, 0, 0.8), "vertical")])
def test_a_wide_window_costs_no_border(matcher, xyz, axis):
    """Up to 220 px of 240: only what the other camera does not see may be missing (25 px at the
    near wall, and the blocks at the edges), not a border as wide as the largest disparity."""
    scene = given((xyz, axis)).configurations[0]
    pair = RECTIFIERS["home"](scene.references[0], scene.others[0], axis)
    wide, narrow = (match(pair, matcher, DisparityWindow(4, most)) for most in (220, 60))
    # measured 2026-11-24: 0.9956 and more
    assert np.isfinite(wide).mean() > 0.98 * np.isfinite(narrow).mean()


def test_baselines_share_the_range():
    """Near wall by the short baseline, far wall by the long one (3.2)."""
    scene = given(((0, -0.6, 0), "horizontal"), ((0, -1.2, 0), "horizontal"))
    f = CAMERA.fx
    between = (12.0 + 20.0) / 2
    # 3.1: the short one's farthest lies between the walls
    threshold = ErrorThreshold(between / (0.6 * f), True)
    result = map_thesis(
        scene, ThesisOptions(threshold=threshold, window=DisparityWindow(4, 200)), quiet
    )
    z = result.cloud.points_home_m[:, 0]
    short = result.cloud.baseline_index == 0
    assert np.median(z[short]) == pytest.approx(12.0, rel=0.05) and np.median(
        z[~short]
    ) == pytest.approx(20.0, rel=0.05)
    assert result.pairs[0].effective_range_m == (0.0, pytest.approx(between))


def test_horizontal_and_vertical_fill_each_other():
    one = map_thesis(given(((0, -0.8, 0), "horizontal")), ThesisOptions(threshold=WIDE), quiet)
    both = map_thesis(
        given(((0, -0.8, 0), "horizontal"), ((0, 0, 0.8), "vertical")),
        ThesisOptions(threshold=WIDE),
        quiet,
    )
    assert both.coverage > one.coverage


def test_four_cases_of_3_4():
    nan = np.nan
    h, v = np.array([[nan, 2.0, nan, 4.0]]), np.array([[nan, nan, 3.0, 6.0]])
    assert np.array_equal(
        fuse.fuse_axes(h, v), np.array([[nan, 2.0, 3.0, 5.0]], np.float32), equal_nan=True
    )


def test_selection_takes_the_middle_and_the_bracket():
    T = camera_pose([0, 0, 0])
    references = [picture(f"r{i}", "uav1", 10.0 + 0.2 * i, T) for i in range(16)]
    others = [picture(f"o{i}", "uav2", 10.05 + 0.2 * i, T) for i in range(16)]
    chosen, near = select(
        ConfigurationInput(Configuration("horizontal", 1.0), references, others), SelectionOptions()
    )
    assert abs(chosen.stamp_s - 11.5) <= 0.11
    assert [o for o in others if abs(o.stamp_s - chosen.stamp_s) <= 0.5] == near and len(near) == 5


def test_the_buffer_ends_after_5_s_or_30_pictures():
    """5.4, at 2 Hz for 20 s and at 20 Hz: what comes later is not looked at."""
    T = camera_pose([0, 0, 0])
    (one,) = [picture("p", "uav1", 0.0, T)]
    for rate_hz, middle_s in ((2.0, 5.0 - 1.5), (20.0, 29 / 20.0 / 2)):
        stamps = np.arange(0.0, 20.0, 1 / rate_hz)
        pictures = [dataclasses.replace(one, stamp_s=float(t)) for t in stamps]
        chosen, near = select(
            ConfigurationInput(Configuration("horizontal", 1.0), pictures, pictures),
            SelectionOptions(),
        )
        assert abs(chosen.stamp_s - middle_s) <= 0.5 / rate_hz + 1e-9
        assert all(abs(p.stamp_s - chosen.stamp_s) <= 0.5 for p in near) and len(near) >= 3


def test_without_a_picture_in_the_bracket_the_nearest_is_tried():
    one = picture("p", "uav1", 10.0, camera_pose([0, 0, 0]))
    others = [dataclasses.replace(one, stamp_s=t) for t in (8.0, 12.5)]
    assert (
        select(
            ConfigurationInput(Configuration("horizontal", 1.0), [one], others), SelectionOptions()
        )[1]
        == others[:1]
    )


def test_trim_points_by_hand():
    """6.6: the walls at 12 and 20 m fall to the baselines that the person gave them to."""
    scene = given(((0, -0.6, 0), "horizontal"), ((0, -1.2, 0), "horizontal"))
    window = DisparityWindow(4, 200)
    for ends, far_wall in (([15, 30], 1), ([30, 40], 0)):
        options = ThesisOptions(trim_m={"horizontal": ends}, window=window)
        cloud = map_thesis(scene, options, quiet).cloud
        far = np.abs(cloud.points_home_m[:, 0] - 20.0) < 3.0
        assert far.sum() > 1000 and (cloud.baseline_index[far] == far_wall).mean() > 0.99
    for trim_m, words in (
        ({"horizontal": [15]}, "2 baselines"),
        ({"horizontal": [15, 9]}, "not fall"),
        ({"vertical": [15]}, "vertical"),
        ({"horizontal": [15, float("nan")]}, "trim"),
    ):
        with pytest.raises(InputError, match=words):
            map_thesis(scene, ThesisOptions(trim_m=trim_m, window=window), quiet)
    with pytest.raises(InputError, match="--across-axes"):
        ThesisOptions(trim_m={"all": [15, 30]})


def test_two_configurations_at_once_make_one_depth_image():
    """3.6: horizontal for the near wall, vertical for the far one, no averaging in between."""
    scene = given(((0, -0.6, 0), "horizontal"), ((0, 0, 1.2), "vertical"))
    options = ThesisOptions(
        trim_m={"all": [15, 30]}, across_axes=True, window=DisparityWindow(4, 200)
    )
    result = map_thesis(scene, options, quiet)
    assert [p.effective_range_m for p in result.pairs] == [(0, 15), (15, 30)]
    known = np.isfinite(result.depth)
    horizontal = result.depth[known] <= 15.0
    assert (
        np.array_equal(result.cloud.baseline_index == 0, horizontal)
        and 0.05 < horizontal.mean() < 0.95
    )


def test_equal_baselines_of_both_axes_are_averaged_in_their_range():
    nan = np.nan
    h, v, far = (
        np.array([a], np.float32)
        for a in ([10.0, nan, 10.0, 50.0], [12.0, 12.0, nan, nan], [nan] * 3 + [55.0])
    )
    layers = [
        fuse.Layer("horizontal", 2.0, 2.0, 600.0, h),
        fuse.Layer("vertical", 2.0, 2.0, 600.0, v),
        fuse.Layer("horizontal", 4.0, 4.0, 600.0, far),
    ]
    ranges = fuse.effective_ranges(layers, ErrorThreshold(0.1, True), {"all": [30, 60]}, True)
    assert ranges == [(0, 30), (0, 30), (30, 60)]
    depth, sigma, source = fuse.fuse_layers(layers, ranges, True)
    assert depth.tolist() == [[11.0, 12.0, 10.0, 55.0]] and source.tolist() == [[0, 1, 0, 2]]
    one = depth_error(np.array([10.0, 12.0]), 2.0, 600.0)
    assert sigma[0, 0] == pytest.approx(np.hypot(*one) / 2)


def test_the_better_candidate_wins():
    scene = given(((0, -0.8, 0), "horizontal"))
    c = scene.configurations[0]
    blank = picture("uav2/blank", "uav2", 10.0, c.others[0].T_home_cam)
    blank.image[:] = 127
    pair = map_thesis(
        MapInput(
            "session", [ConfigurationInput(c.configuration, c.references, [blank, c.others[0]])]
        ),
        ThesisOptions(threshold=WIDE),
        quiet,
    ).pairs[0]
    assert pair.other_name == "uav2/0" and dict(pair.candidates)["uav2/blank"] < 0.05


def test_nothing_to_match_is_an_error_not_an_empty_map():
    scene = given(((0, -0.8, 0), "horizontal"))
    for p in (*scene.configurations[0].references, *scene.configurations[0].others):
        p.image[:] = 127
    with pytest.raises(MatchingError):
        map_thesis(scene, ThesisOptions(), quiet)


def test_disparity_window_is_kept():
    scene = given(((0, -0.8, 0), "horizontal")).configurations[0]
    pair = RECTIFIERS["home"](scene.references[0], scene.others[0], "horizontal")
    disparity = match(pair, "quasi-dense", DisparityWindow(15.0, 18.0))
    known = disparity[np.isfinite(disparity)]
    assert known.size and known.min() >= 15.0 and known.max() <= 18.0


def test_single_holes_are_closed_and_edges_are_not_blurred():
    depth = np.full((9, 9), 10.0, np.float32)
    depth[4, 4] = np.inf
    depth[:, 7:] = np.inf
    closed = depth_module.close_holes(depth)
    assert closed[4, 4] == pytest.approx(10.0) and np.isnan(closed[:, 8]).all()
