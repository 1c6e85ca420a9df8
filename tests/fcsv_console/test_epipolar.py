# SPDX-License-Identifier: Apache-2.0
"""The epipolar error of two pictures against places that are known to be right, and wrong by a
known turn."""

import math

import cv2
import numpy as np
import pytest
from support import scenes

from fcsv_console.model import facts, samples, stereo
from fcsv_console.model.epipolar import EpipolarPicture, EpipolarWatch, measured

CAMERA = scenes.CAMERA  # 301 px of focal length


def seen(xyz, rpy_deg=(0.0, 0.0, 0.0), told_rpy_deg=None, told_xyz=None):
    """A picture from one place, told to be from another."""
    bgr = scenes.photograph(scenes.camera_pose(xyz, rpy_deg))[:, :, ::-1]
    data = cv2.imencode(".png", bgr)[1].tobytes()
    told = scenes.camera_pose(
        xyz if told_xyz is None else told_xyz, rpy_deg if told_rpy_deg is None else told_rpy_deg
    )
    return EpipolarPicture(1.0, data, CAMERA, told)


LEFT = seen((0.0, 0.0, 0.0))
PAIR = ("uav1", "uav2")


def measured_px(a, b):
    told = measured(PAIR, a, b)
    return told.error_px, told.matches


def test_right_places_have_no_epipolar_error():
    """ORB finds a corner again to about half a pixel; a median over hundreds lies below that."""
    for place in ((0.0, -2.0, 0.0), (0.0, 0.0, 2.0)):
        error_px, matches = measured_px(LEFT, seen(place))
        assert error_px < 0.6 and matches > 100
    assert measured_px(LEFT, seen((0.0, -2.0, 0.0), (1.0, -2.0, 3.0)))[0] < 0.8, (
        "turned, and told so"
    )


@pytest.mark.parametrize(
    "place, turn_deg", [((0.0, -2.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, 2.0), (0.0, 0.0, 1.0))]
)
def test_a_wrong_turn_across_the_baseline_shows_as_many_pixels_as_it_is(place, turn_deg):
    error_px, _ = measured_px(LEFT, seen(place, told_rpy_deg=turn_deg))
    assert error_px == pytest.approx(CAMERA.fx * math.tan(math.radians(1.0)), abs=0.8)


def test_a_wrong_place_across_the_baseline_shows():
    """0.4 m sideways to a baseline of 2 m turns the epipolar lines by atan(0.2)."""
    error_px, _ = measured_px(LEFT, seen((0.0, -2.0, 0.0), told_xyz=(0.0, -2.0, 0.4)))
    far_px, near_px = (
        CAMERA.fx * 2.0 / z_m * math.sin(math.atan(0.2)) for z_m in (scenes.DEPTH_M, scenes.NEAR_M)
    )
    assert far_px - 0.8 < error_px < near_px + 0.8, "whichever wall has more of the features"


def test_pictures_without_anything_in_common_say_nothing():
    blank = EpipolarPicture(
        1.0,
        cv2.imencode(".png", np.full((CAMERA.height, CAMERA.width), 128, np.uint8))[1].tobytes(),
        CAMERA,
        scenes.camera_pose((0.0, -2.0, 0.0)),
    )
    noise = np.random.default_rng(3).integers(0, 255, (CAMERA.height, CAMERA.width), np.uint8)
    other = EpipolarPicture(1.0, cv2.imencode(".png", noise)[1].tobytes(), CAMERA, blank.T_home_cam)
    for right in (blank, other):
        assert math.isnan(measured_px(LEFT, right)[0])


def spoilt(change):
    """The right picture, with something wrong with its camera."""
    right = seen((0.0, -2.0, 0.0))
    pixels = cv2.imdecode(np.frombuffer(right.data, np.uint8), cv2.IMREAD_COLOR)
    data = cv2.imencode(".png", np.ascontiguousarray(change(pixels)))[1].tobytes()
    return EpipolarPicture(1.0, data, CAMERA, right.T_home_cam)


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda p: p // 60, "picture of uav2 shows nothing to compare: dark, out of focus"),
        (lambda p: cv2.GaussianBlur(p, (0, 0), 8.0), "picture of uav2 shows nothing to compare"),
        (lambda p: p[:, ::-1], "too little in common"),
        (lambda p: p, ""),
    ],
)
def test_a_camera_that_is_covered_blurred_or_looks_elsewhere_is_named(change, words):
    told = measured(PAIR, LEFT, spoilt(change))
    assert words in told.unlike and bool(words) == math.isnan(told.error_px)
    dark = measured(PAIR, spoilt(lambda p: p // 60), LEFT).unlike
    assert "picture of uav1 shows nothing" in dark
    plain = spoilt(lambda p: p // 60)
    assert measured(PAIR, plain, plain).unlike == "", "both show little: that is the scene"


def test_a_camera_that_gives_one_picture_again_and_again_is_named():
    watch, right = EpipolarWatch(["uav1", "uav2"]), seen((0.0, -2.0, 0.0))
    for k in range(4):
        for name, one in zip(PAIR, (LEFT, right)):
            noise = bytes([k]) if name == "uav1" else b""
            watch.tell_picture(name, 10.0 + k, one.data + noise, one.camera)
            watch.tell_pose(name, 10.0 + k, one.T_home_cam)
        told = watch.measure(PAIR)
        assert bool(told.unlike) == (k == 3)
    assert told.unlike == "the camera of uav2 gives one picture again and again"


def test_what_cannot_be_compared_is_no_go():
    c = samples.console("config/missions/outdoor.yaml")
    samples.flying(c)
    c.tell(samples.NOW_S - 0.5, facts.EpipolarReport(PAIR, math.nan, 3, unlike="covered"))
    judged = c.view(samples.NOW_S).stereo
    assert not judged.go and "covered" in judged.words


@pytest.mark.parametrize(
    "data, words",
    [
        (b"", "0 octets are no picture"),
        (b"\xff\xd8 no", "5 octets are no picture"),
        (
            cv2.imencode(".png", np.zeros((9, 7), np.uint8))[1].tobytes(),
            "the picture is 7 x 9, its camera 320 x 240",
        ),
    ],
)
def test_what_is_no_picture_is_told(data, words):
    with pytest.raises(ValueError, match=words):
        measured_px(LEFT, EpipolarPicture(1.0, data, CAMERA, LEFT.T_home_cam))


def test_the_watch_takes_the_newest_pictures_whose_places_are_known_and_each_pair_once():
    watch, right = EpipolarWatch(["uav1", "uav2"]), seen((0.0, -2.0, 0.0))
    pair = ("uav1", "uav2")
    assert (
        watch.measure(pair) is None
        and watch.measure(("", "")) is None
        and watch.measure(("uav1", "uav9")) is None
    )
    for name, one in zip(pair, (LEFT, right)):
        watch.tell_picture(name, 10.0, one.data, one.camera)
        watch.tell_pose(name, 9.8, np.eye(4))
    assert watch.measure(pair) is None, "no place of that moment"
    for name, one in zip(pair, (LEFT, right)):
        watch.tell_pose(name, 10.01, one.T_home_cam)
        watch.tell_picture(name, 11.0, b"later, and without a place yet", one.camera)
    told = watch.measure(pair)
    assert told.pair == pair and told.error_px < 0.6 and watch.measure(pair) is None


def test_reduced_live_pictures_are_read_by_the_camera_of_their_size():
    """Half as large: half as many pixels, the same angle; and nothing is measured before the camera
    is known."""
    watch, pair = EpipolarWatch(["uav1", "uav2"]), ("uav1", "uav2")
    right = seen((0.0, -2.0, 0.0), told_rpy_deg=(0.0, 2.0, 0.0))
    for name, one in zip(pair, (LEFT, right)):
        picture = cv2.imdecode(np.frombuffer(one.data, np.uint8), cv2.IMREAD_COLOR)
        small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        watch.tell_live(name, 10.0, cv2.imencode(".png", small)[1].tobytes())
        watch.tell_pose(name, 10.0, one.T_home_cam)
    assert watch.measure(pair) is None
    for name in pair:
        watch.tell_camera(name, CAMERA)
    told = watch.measure(pair)
    assert told.error_px == pytest.approx(0.5 * CAMERA.fx * math.tan(math.radians(2.0)), abs=1.0)


# ---- what follows from it ------------------------------------------------------------------------


def flying(error_px, *fitted, pair=("uav1", "uav2")):
    c = samples.console("config/missions/outdoor.yaml")
    samples.flying(c)
    c.tell(samples.NOW_S - 0.5, facts.EpipolarReport(pair, error_px, 212, *fitted))
    return c


def test_the_bounds_are_the_maps_own():
    """Its report's, its links' and that of its choice of pictures: a verdict here is a verdict
    there."""
    from fcsv_stereo import instants
    from fcsv_stereo.model import FLOWN
    from fcsv_stereo.refinement import links
    from fcsv_stereo.report import plain_words

    assert (stereo.MOST_REFINED_PX, stereo.MOST_SURPRISE) == (
        plain_words.MOST_EPIPOLAR_PX,
        links.SURPRISE,
    )
    assert (stereo.MOST_SKEW_S, stereo.MOST_TRACKED_RAD) == (
        instants.MOST_SKEW_S,
        FLOWN.rotation_rad,
    )


@pytest.mark.parametrize(
    "told, words",
    [
        ((1.3,), "GO: the pair is as planned"),
        ((4.5, 0.4, 1.4), "GO: the pair is as planned"),
        ((4.5,), "NO-GO: pictures and places disagree by 4 px across the epipolar lines"),
        ((12.0,), "NO-GO: pictures and places disagree by 12 px across the epipolar lines"),
        (
            (4.5, 2.2, 1.4),
            "NO-GO: pictures miss their epipolar lines by 2.2 px, however the map fits them",
        ),
        (
            (12.0, 0.4, 1.4),
            "NO-GO: pictures and places disagree by 12 px across the epipolar lines",
        ),
        (
            (9.0, 0.4, 4.1),
            "NO-GO: pictures put the cameras 4.1 standard deviations off their trackers",
        ),
    ],
)
def test_pictures_are_judged_by_what_the_map_makes_of_them(told, words):
    s = flying(*told).view(samples.NOW_S).stereo
    assert s.words == words and s.epipolar_px == told[0]


def test_a_live_picture_of_half_the_size_has_half_the_bound():
    nan = math.nan
    assert flying(2.0, nan, nan, 602.0).view(samples.NOW_S).stereo.go
    assert not flying(2.0, nan, nan, 301.0).view(samples.NOW_S).stereo.go


@pytest.mark.parametrize("turn_deg, doubted", [(0.0, False), (0.3, False), (5.0, True)])
def test_a_turn_that_the_map_corrects_is_no_error_and_one_that_it_doubts_is(turn_deg, doubted):
    """A baseline of 2 m is long enough for a prior of 0.15 m; sigma of a turn is 0.3 degrees."""
    told = measured(PAIR, LEFT, seen((0.0, -2.0, 0.0), told_rpy_deg=(0.0, turn_deg, 0.0)))
    assert told.refined_px < 0.8 and told.picture_focal_px == CAMERA.fx
    assert (told.surprise > stereo.MOST_SURPRISE) is doubted
    if turn_deg == 0.3:
        assert told.error_px > told.refined_px + 0.3


def test_what_the_map_would_not_fit_is_not_fitted():
    short = measured(PAIR, LEFT, seen((0.0, -0.4, 0.0)))
    column = measured(PAIR, seen((2.0, -0.1, 0.0)), LEFT)
    for told in (short, column):
        assert told.error_px < 1.0 and math.isnan(told.refined_px) and math.isnan(told.surprise)


def test_what_is_not_known_or_old_or_of_another_pair_decides_nothing():
    for c, now_s in (
        (flying(math.nan), samples.NOW_S),
        (flying(50.0, pair=("uav2", "uav1")), samples.NOW_S),
    ):
        judged = c.view(now_s).stereo
        assert not judged.judged and not judged.go and math.isnan(judged.epipolar_px)
    late = flying(50.0)
    samples.flying(late)
    assert math.isnan(late.view(samples.NOW_S + 5.0).stereo.epipolar_px)
