# SPDX-License-Identifier: Apache-2.0
"""Cameras that are not what is stated for them: found and said, refused, or in sigma; no pose is
blamed for it.

Drawn boards; docs/lab/refinement.md has the figures of rendered scenes.
"""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import boards, faulty
from support.boards import with_prior

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint import JointOptions, map_joint
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput
from fcsv_stereo.refinement import PosePrior, RefineOptions, refine
from fcsv_stereo.refinement.rolling_shutter import could_turn
from fcsv_stereo.refinement.turning import most_turn_rad

BASELINES_M = (2.0, 4.0, 6.0, 8.0)
PRIOR = PosePrior(np.radians(0.15), 0.0, 0.01)
OPTIONS = RefineOptions(prior=PRIOR)


def shots(turn_deg):
    """Five true pictures of a camera that is carried sideways and turns towards the scene by so
    much in all."""
    turns = [
        (0.0, 0.0, 0.0),
        (0.3, -0.2, 0.2),
        (-0.2, 0.3, 0.5),
        (0.2, 0.3, 0.7),
        (-0.3, -0.3, 1.0),
    ]
    poses = [
        boards.pose((0.0, -b, 0.0), turn_deg * np.array(t))
        for b, t in zip((0.0, *BASELINES_M), turns)
    ]
    return [faulty.shot(f"{k}.png", T, vehicle="camera") for k, T in enumerate(poses)]


@pytest.fixture(scope="module")
def turning():
    return shots(8.0)


@pytest.fixture(scope="module")
def still():
    return shots(0.0)


def as_stated(pictures, factors=1.0, off=1.0, seed=3):
    """With focal lengths times ``factors`` (one, or of each), and pose errors ``off`` times as
    large as PRIOR."""
    random, (first, *_) = np.random.default_rng(seed), pictures
    noisy = [first, *(boards.noisy(p, first, random, off * 0.15, off * 0.01) for p in pictures[1:])]
    factors = np.broadcast_to(factors, len(pictures))
    cameras = [
        replace(p.camera, fx=p.camera.fx * f, fy=p.camera.fy * f) for p, f in zip(pictures, factors)
    ]
    return [replace(p, camera=c) for p, c in zip(noisy, cameras)]


def one_of_five(factor, odd=3):
    return [factor if k == odd else 1.0 for k in range(5)]


def blamed(result):
    """Warnings that call a pose wrong, or find a rolling shutter."""
    return [
        w
        for w in result.warnings
        if re.search("prior was wrong|poses of all|rolling shutter|keeps the pose", w)
    ]


@pytest.mark.parametrize(
    "how, factor",
    [("turning", 0.8), ("turning", 1.11), ("turning", 1.05), ("still", 0.89), ("still", 1.2)],
)
def test_one_picture_of_five_with_another_focal_length(how, factor, request, wrong_input):
    """It is named, its focal length found to 0.5 %, and its pose is not called wrong."""
    pictures = as_stated(request.getfixturevalue(how), one_of_five(factor))
    result = refine(pictures[0], pictures[1:], OPTIONS)
    said = [w for w in result.warnings if "focal length" in w]
    assert len(said) == 1 and said[0].startswith(
        "3.png: against the other pictures its focal length is"
    )
    assert ("longer" if factor < 1.0 else "shorter") + " than the given one" in said[0]
    assert all(r.refined for r in result.others) and not blamed(result), result.warnings
    focals = [r.picture.camera.fx for r in result.others]
    assert np.allclose(focals, faulty.CAMERA.fx, rtol=0.005)
    if factor == 0.8:
        message = re.sub(r" is \d[\d.]*%", " is ...%", said[0])
        wrong_input(
            "Cameras",
            "one picture of five with another focal length",
            "corrected and said",
            message,
        )


def test_the_reference_with_another_focal_length(turning):
    pictures = as_stated(turning, one_of_five(1.15, odd=0))
    result = refine(pictures[0], pictures[1:], OPTIONS)
    assert any(w.startswith("0.png: against the other") for w in result.warnings), result.warnings
    assert result.reference.camera.fx == pytest.approx(faulty.CAMERA.fx, rel=0.005) and not blamed(
        result
    )


def test_a_pair_whose_focal_lengths_contradict_each_other_is_refused(turning, wrong_input):
    """Nothing tells which of both is wrong; --keep-camera maps and says it."""
    first, *_, last = as_stated(turning, (1.0, 1.0, 1.0, 1.0, 0.8))
    with pytest.raises(
        InputError, match=r"4\.png: the stated focal lengths do not fit those of 0\.png"
    ) as error:
        refine(first, [last], OPTIONS)
    kept = refine(first, [last], replace(OPTIONS, correct_camera=False))
    assert str(error.value) in kept.warnings
    message = re.sub(r"\d[\d.]*% (longer|shorter)", "...% longer", str(error.value))
    wrong_input("Cameras", "a pair whose focal lengths contradict each other", "refused", message)


def test_an_odd_focal_length_is_said_where_cameras_are_kept(still):
    pictures = as_stated(still, one_of_five(0.89))
    result = refine(pictures[0], pictures[1:], replace(OPTIONS, correct_camera=False))
    assert any("3.png" in w and "its focal length is" in w for w in result.warnings), (
        result.warnings
    )
    assert result.others[2].picture.camera == pictures[3].camera


@pytest.mark.parametrize(
    "factor, off", [(0.8, 1.0), (1.11, 1.0), (1.2, 1.0), (1.114, 4.0), (0.89, 4.0)]
)
def test_a_focal_length_that_is_far_off_in_all_pictures_of_a_turning_camera(
    turning, factor, off, wrong_input
):
    """It is found, no shutter and no single pose is blamed. One is 585 px for 525, poses 0.6
    degrees off."""
    pictures = as_stated(turning, factor, off)
    result = refine(pictures[0], pictures[1:], OPTIONS)
    said = [w for w in result.warnings if "the pictures fit a focal length" in w]
    assert len(said) == 1 and "it was taken" in said[0], result.warnings
    assert result.focal_scale == pytest.approx(1 / factor, rel=0.015)
    assert result.others[0].picture.camera.fx == pytest.approx(faulty.CAMERA.fx, rel=0.015)
    assert result.reference.camera.fx == pytest.approx(pictures[0].camera.fx * result.focal_scale)
    assert not [w for w in result.warnings if "rolling shutter" in w]
    assert off > 1.0 or not blamed(result), result.warnings
    if factor == 1.11:
        message = re.sub(r"\d[\d.]*%", "...%", said[0])
        wrong_input(
            "Cameras",
            "a focal length 11 % too long in all, cameras that turn",
            "corrected and said",
            message,
        )


def mapped(pictures):
    configurations = [
        ConfigurationInput(Configuration("horizontal", b, 0.0, p.name), [pictures[0]], [p])
        for b, p in zip(BASELINES_M, pictures[1:])
    ]
    return map_joint(
        MapInput("photographs", configurations, prior=PRIOR), JointOptions(), lambda *_: None
    )


@pytest.mark.parametrize("factor", [0.8, 1.11])
def test_a_focal_length_that_no_picture_tells_is_in_sigma(still, factor, wrong_input):
    """Cameras that look the same way: every depth is off by as much, and hardly one is called
    sure."""
    result = mapped(as_stated(still, factor))
    truth = boards.depth(still[0].T_home_cam, faulty.TOWN, faulty.CAMERA)
    sure, wrong = faulty.claims(result, truth)
    assert sure * wrong <= 0.02 * np.isfinite(result.depth).mean()
    (unseen,) = result.unseen
    assert unseen.startswith("Whether the focal length is right cannot be known")
    given = "a focal length 11 % too long in all, cameras that look the same way"
    if factor == 1.11:
        wrong_input("Cameras", given, "in sigma", unseen)


def test_poses_that_are_all_contradicted_are_said_in_one_sentence(turning, wrong_input):
    """Four times as wrong as stated, with the right camera: no camera is corrected, and none is
    cleared."""
    pictures = as_stated(turning, 1.0, 4.0, seed=5)
    result = refine(
        pictures[0], pictures[1:], replace(OPTIONS, prior=PosePrior(np.radians(0.05), 0.0, 0.003))
    )
    (said,) = [w for w in result.warnings if "all 4 others at once" in w]
    assert "or the camera is not the stated one" in said and result.focal_scale == 1.0
    assert not any("rolling shutter" in w or "prior was wrong" in w for w in result.warnings)
    message = re.sub(r"\d+\.\d+", "...", said)
    wrong_input(
        "Cameras",
        "poses or a camera that contradict all pictures at once",
        "read, with a warning",
        message,
    )


# rows that are read late


def read_by_rows(picture, turn_rad, strips=48):
    """The picture, of which each strip was seen from where the camera was turned to by then."""
    K, size = picture.camera.K, (picture.camera.width, picture.camera.height)
    edges, out = np.linspace(0, size[1], strips + 1).astype(int), picture.image.copy()
    for a, b in zip(edges, edges[1:]):
        R = cv2.Rodrigues((0.5 * (a + b) / size[1] - 0.5) * np.asarray(turn_rad))[0]
        seen = cv2.warpPerspective(
            picture.image,
            K @ R.T @ np.linalg.inv(K),
            size,
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REFLECT,
        )
        out[a:b] = seen[a:b]
    return replace(picture, image=out)


def straightened(result):
    return any("rolling shutter" in w for w in result.warnings)


@pytest.fixture(scope="module")
def by_rows(turning):
    random = np.random.default_rng(6)
    return [read_by_rows(p, random.normal(0.0, np.radians(0.35), 3)) for p in turning]


def test_rows_are_straightened_only_where_the_camera_can_have_turned(by_rows):
    """The same pictures: no odometry, odometry that turns, odometry that says that nothing did."""
    pictures = as_stated(by_rows)
    for turn_rad, expected in ((None, True), (0.01, True), (0.0005, False)):
        result = refine(pictures[0], pictures[1:], replace(OPTIONS, most_turn_rad=turn_rad))
        assert straightened(result) == expected, (turn_rad, result.warnings)


def test_a_rectified_pair_is_never_straightened(still):
    """Poses without a turn: a rig, a tripod, a rectified pair."""
    random = np.random.default_rng(8)
    a, b = (read_by_rows(p, random.normal(0.0, np.radians(0.35), 3)) for p in (still[0], still[4]))
    result = refine(a, [b], OPTIONS)
    assert not straightened(result) and result.reference.image is a.image
    turned = with_prior(b, rpy_deg=(0.0, 0.1, 0.0))
    assert (
        not could_turn([a, b], None)
        and could_turn([a, turned], None)
        and not could_turn([a, turned], 1e-4)
    )


@pytest.mark.parametrize("rate_deg_s, expected_deg", [(0.0, 0.0), (5.0, 0.25)])
def test_what_odometry_tells_of_a_turn(still, rate_deg_s, expected_deg):
    """Of 0.1 s between pictures; nothing of pictures that are alone, and nothing of photographs."""

    def recorded(p):
        turns = [
            transforms.from_xyz_rpy([0, 0, 0], [0, np.radians(rate_deg_s) * 0.1 * i, 0])
            for i in range(4)
        ]
        return [
            replace(p, stamp_s=0.1 * i, T_home_cam=p.T_home_cam @ T) for i, T in enumerate(turns)
        ]

    given = ConfigurationInput(
        Configuration("horizontal", 2.0, 0.0, "a"), recorded(still[0]), recorded(still[1])
    )
    assert most_turn_rad(MapInput("session", [given])) == pytest.approx(
        np.radians(expected_deg), abs=1e-9
    )
    assert most_turn_rad(MapInput("photographs", [given])) is None
    assert most_turn_rad(MapInput("session", [replace(given, others=given.others[:1])])) is None


# the same picture twice


def as_jpeg(picture):
    data = cv2.imencode(".jpg", picture.image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
    return replace(picture, image=cv2.imdecode(data, cv2.IMREAD_COLOR))


@pytest.mark.parametrize("change", [lambda p: p, as_jpeg], ids=["as it is", "compressed again"])
@pytest.mark.parametrize("of", [0, 1])
def test_the_same_picture_under_another_name_and_pose(turning, of, change, wrong_input):
    """It is left out for what it is; the picture that is where it is said to be stays, and so do
    all others."""
    pictures = as_stated(turning)
    copy = change(replace(pictures[4], image=pictures[of].image.copy(), name="copy.png"))
    result = refine(pictures[0], [*pictures[1:4], copy], OPTIONS)
    assert [r.refined for r in result.others] == [True, True, True, False], result.warnings
    assert f"pixel for pixel it is the same picture as {of}.png" in result.others[3].reason
    assert [w.split(":")[0] for w in result.warnings] == ["copy.png"]
    wrong_input(
        "Pictures",
        "the same picture twice, under two names and poses",
        "left out and named",
        result.warnings[0].replace(f" {of}.png", " 0.png"),
    )


def test_a_pair_of_one_picture(turning):
    copy = replace(turning[2], image=turning[0].image.copy())
    (r,) = refine(turning[0], [copy], OPTIONS).others
    assert not r.refined and "the same picture as 0.png" in r.reason
    for other in turning[1:]:  # no others are
        assert "the same picture" not in refine(turning[0], [other], OPTIONS).others[0].reason


def test_a_place_that_is_wrong_before_a_flat_scene_is_no_focal_length():
    """A wall, seen from 1 m nearer than stated: it looks as a longer lens does, and stays a wrong
    place."""
    wall = [boards.Board((15.0, 0.0, 0.0), (20.0, 15.0), 3)]
    pictures = [
        faulty.shot(f"{k}.png", boards.pose((x, -y, 0.0), (0.0, 0.0, 2.0 * k)), wall)
        for k, (x, y) in enumerate(((0.0, 0.0), (0.0, 1.0), (1.0, 2.0), (0.0, 3.0)))
    ]
    pictures[2] = with_prior(pictures[2], (-1.0, 0.0, 0.0))
    result = refine(pictures[0], pictures[1:], OPTIONS)
    assert not any("its focal length" in w for w in result.warnings), result.warnings
