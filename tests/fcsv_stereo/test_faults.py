# SPDX-License-Identifier: Apache-2.0
"""Bad input: a map without the bad part, which is named, or an error in one line; never a confident
wrong map.

A claim is a pixel whose sigma is below 3 % of its depth, and it is refuted by an error of more than
10 %; of the claims at most 5 % may be. With two good pictures it makes claims on 31 % of its
pixels, of which 0.2 % are wrong (measured 2026-11-24; a third of the picture is sky, and 320x240
pixels know 250 m only to 10 %). Faults of refinement alone are in test_refinement.py, of joint
matching alone in test_joint.py.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import boards, faulty
from support.photographs import model
from support.sessions import T0, write_session

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo import pipeline
from fcsv_stereo.errors import InputError, MatchingError, OutputError, StereoError
from fcsv_stereo.joint import JointOptions, map_joint
from fcsv_stereo.model import Picture
from fcsv_stereo.sessions.read import read_session
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import MATCHERS

MAP = pipeline.METHODS


def quiet(*_):
    pass


@pytest.fixture(scope="module")
def flown():
    return faulty.flight()


@pytest.fixture(scope="module")
def truth(flown):
    return boards.depth(flown[0].T_home_cam, faulty.TOWN, faulty.CAMERA)


def joint(reference, others):
    return MAP["joint"].map(faulty.given(reference, others), JointOptions(), quiet)


def of_the_reference(flown):
    return lambda p: replace(p, image=flown[0].image.copy())


def at_the_reference(flown):
    return lambda p: replace(p, T_home_cam=flown[0].T_home_cam)


def looking_back(_):
    return lambda p: boards.with_prior(p, rpy_deg=(0.0, 180.0, 0.0))


FAULTS = {
    "does not overlap": looking_back,
    "another scene": lambda _: faulty.elsewhere,
    "blurred": lambda _: faulty.blurred,
    "over-exposed": lambda _: faulty.over_exposed,
    "under-exposed": lambda _: faulty.under_exposed,
    "no texture": lambda _: faulty.flat,
    "sky": lambda _: faulty.of_sky,
    "no baseline": at_the_reference,
    "the reference's own picture": of_the_reference,
}

#: what a person sees in the picture is said, too
WORDS = {
    "over-exposed": "over-exposed",
    "under-exposed": "under-exposed",
    "blurred": "blurred",
    "the reference's own picture": "no parallax",
    "no baseline": "baseline of 0.00 m",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_one_bad_picture_of_three_is_left_out_and_named(flown, truth, fault):
    reference, _, priors = flown
    bad = FAULTS[fault](flown)
    result = joint(reference, faulty.replaced(priors, 2, bad))
    sure, wrong = faulty.claims(result, truth)
    assert sure > 0.28 and wrong <= 0.01
    assert [p.other_name for p in result.pairs] == [p.name for p in priors[:2]]
    said = [w for w in result.warnings if priors[2].name in w and "left out" in w]
    assert said and WORDS.get(fault, "") in said[0], result.warnings


@pytest.mark.parametrize("fault", FAULTS)
def test_with_nothing_but_a_bad_picture_there_is_no_map(flown, truth, fault):
    """An error in one line that names it; or, where a little can be made out, hardly a claim."""
    reference, _, priors = flown
    bad = FAULTS[fault](flown)(priors[1])
    try:
        result = joint(reference, [bad])
    except StereoError as error:
        assert "\n" not in str(error) and (bad.name in str(error) or "texture" in str(error)), str(
            error
        )
    else:
        assert faulty.claims(result, truth)[0] < 0.01
        assert any(bad.name in w for w in result.warnings)


@pytest.mark.parametrize(
    "method, options", [("joint", JointOptions()), ("thesis", ThesisOptions())]
)
@pytest.mark.parametrize("spoil", [faulty.flat, faulty.of_sky], ids=["no texture", "sky"])
def test_no_texture_and_only_sky(flown, method, options, spoil):
    reference, _, priors = flown
    with pytest.raises(MatchingError) as error:
        MAP[method].map(
            faulty.given(spoil(reference), [spoil(p) for p in priors[:2]]), options, quiet
        )
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("rpy_deg", [(0.0, 5.0, 0.0), (5.0, 0.0, 0.0)])
def test_a_prior_wrong_by_five_degrees(flown, truth, rpy_deg):
    """The pictures' own pose is taken, and the map is as good as without the fault."""
    reference, _, priors = flown
    result = joint(
        reference, faulty.replaced(priors, 2, lambda p: boards.with_prior(p, rpy_deg=rpy_deg))
    )
    sure, wrong = faulty.claims(result, truth)
    assert sure > 0.2 and wrong <= faulty.MOST_WRONG and len(result.pairs) == 3
    assert any(priors[2].name in w and "prior was wrong in rotation" in w for w in result.warnings)


@pytest.mark.parametrize("skew_s", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("velocity", [(1.5, 0, 0), (0, 1.5, 0), (0, 0, 1.5)])
def test_a_skewed_pair_of_three(flown, truth, skew_s, velocity):
    """A vehicle at 1.5 m/s, its picture stamped up to 200 ms late: 0.3 m, also along the baseline
    (scale)."""
    reference, _, priors = flown
    late = faulty.replaced(priors, 2, lambda p: boards.with_prior(p, np.multiply(velocity, skew_s)))
    result = joint(reference, late)
    sure, wrong = faulty.claims(result, truth)
    assert sure > 0.2 and wrong <= faulty.MOST_WRONG


def test_an_object_that_moved(truth):
    """A board at 14 m is 1 m further on in one of three pictures: the other two tell its depth, or
    sigma does not."""
    board = boards.Board((14.0, -2.0, -1.0), (1.5, 1.2), 55)
    scene, after = [*faulty.TOWN, board], [*faulty.TOWN, replace(board, xyz=(14.0, -1.0, -1.0))]
    reference, _, priors = faulty.flight(scene=scene, of_other={2: after})
    true = boards.depth(reference.T_home_cam, scene, faulty.CAMERA)
    on_it = np.isfinite(boards.depth(reference.T_home_cam, [board], faulty.CAMERA))
    result = joint(reference, priors)
    assert faulty.claims(result, true)[1] <= faulty.MOST_WRONG
    assert faulty.claims(result, true, on_it)[1] <= faulty.MOST_WRONG


# so much further along at 4 and 8 m: a quarter of the baseline, 14 m look like 11.2 m
IN_STEP_M = (0.0, 1.0, 2.0)


def in_step(metres=IN_STEP_M):
    """A board at 14 m that moves along the baselines as they grow: the session, the truth, and
    where the board is."""
    board = boards.Board((14.0, -2.0, -1.0), (1.5, 1.2), 55)
    given = faulty.session(
        [[*faulty.TOWN, replace(board, xyz=(14.0, -2.0 + d, -1.0))] for d in metres]
    )
    T = given.configurations[0].references[0].T_home_cam
    on_it = np.isfinite(boards.depth(T, [board], faulty.CAMERA))
    return given, boards.depth(T, [*faulty.TOWN, board], faulty.CAMERA), on_it


def test_an_object_that_moves_in_step_with_the_baselines():
    """Two of three pairs agree on a wrong depth; the reference pictures of their moments tell that
    it moved."""
    given, truth, on_it = in_step()
    seen = map_joint(given, JointOptions(), quiet)
    # what matching alone makes of it: this is no easy case
    assert faulty.claims(seen, truth, on_it)[1] > 0.5
    result = MAP["joint"].map(given, JointOptions(complete=True), quiet)
    sure, wrong = faulty.claims(result, truth, on_it)
    assert sure * wrong < faulty.MOST_WRONG * on_it.mean()  # of the board's pixels
    assert faulty.claims(result, truth)[1] <= faulty.MOST_WRONG
    assert any("something moved" in w and "horizontal 8 m" in w for w in result.warnings), (
        result.warnings
    )
    assert result.points == np.isfinite(result.depth).sum() == np.isfinite(result.sigma).sum()
    # what is left out is the board and where it was to be seen later
    assert result.coverage > seen.coverage - 3.0 * on_it.mean()


def test_the_other_axis_tells_of_an_object_that_moves_in_step():
    """One reference picture for all, as photographs have: vertical pairs see elsewhere what looks
    nearer to others."""
    board = boards.Board((14.0, -2.0, -1.0), (1.5, 1.2), 55)
    along = lambda d: [*faulty.TOWN, replace(board, xyz=(14.0, -2.0 + d, -1.0))]  # noqa: E731
    reference, _, across = faulty.flight(
        scene=along(0.0), of_other={i: along(b / 4) for i, b in enumerate((2, 4, 8))}
    )
    up = [
        faulty.shot(f"uav3 at {b:g} m", boards.pose([0, 0.02, b]), along(d))
        for b, d in ((2.0, 1.0), (3.0, 2.0))
    ]
    given = faulty.given(reference, [*across, *up])
    vertical = [
        replace(c, configuration=replace(c.configuration, axis="vertical"))
        for c in given.configurations[3:]
    ]
    given = replace(
        given, kind="photographs", configurations=[*given.configurations[:3], *vertical]
    )
    truth = boards.depth(reference.T_home_cam, along(0.0), faulty.CAMERA)
    on_it = np.isfinite(boards.depth(reference.T_home_cam, [board], faulty.CAMERA))
    sure, wrong = faulty.claims(map_joint(given, JointOptions(), quiet), truth, on_it)
    # what matching alone makes of it: this is no easy case
    assert sure * wrong > 0.3 * on_it.mean()
    sure, wrong = faulty.claims(MAP["joint"].map(given, JointOptions(), quiet), truth, on_it)
    assert sure * wrong < faulty.MOST_WRONG * on_it.mean()


def test_nothing_is_left_out_where_nothing_moved():
    given, _, _ = in_step((0.0, 0.0, 0.0))
    whole = JointOptions(complete=True)
    seen, result = map_joint(given, whole, quiet), MAP["joint"].map(given, whole, quiet)
    assert result.coverage >= seen.coverage - 0.001 and not any(
        "moved" in w for w in result.warnings
    )


def test_a_configuration_without_pictures_is_left_out_and_named(tmp_path):
    session = write_session(tmp_path / "session", windows=[(T0, T0 + 1.0), (T0 + 50.0, T0 + 51.0)])
    given = read_session(session)
    assert len(given.configurations) == 1
    assert any("horizontal 0.8 m (1)" in w and "uav1, uav2" in w for w in given.warnings), (
        given.warnings
    )


@pytest.mark.parametrize("matcher", MATCHERS)
def test_every_matcher_on_pictures_without_texture(flown, matcher):
    reference, _, priors = flown
    with pytest.raises(MatchingError, match="too little texture"):
        given = faulty.given(faulty.flat(reference), [faulty.flat(priors[0])])
        MAP["thesis"].map(given, ThesisOptions(matcher=matcher), quiet)


@pytest.mark.parametrize(
    "way_m, words", [((4, 0.3, 0), "along the line of sight"), ((0, -4, 0), "too little texture")]
)
def test_why_no_pixel_has_a_depth(flown, way_m, words):
    """One that flew forward is told to move sideways; the other had a wall without texture before
    it."""
    reference = faulty.flat(flown[0])
    other = replace(reference, name="later", T_home_cam=reference.T_home_cam.copy())
    other.T_home_cam[:3, 3] += way_m
    with pytest.raises(MatchingError, match=words):
        MAP["joint"].map(faulty.given(reference, [other]), JointOptions(refine_poses=False), quiet)


@pytest.mark.parametrize(
    "method, options",
    [("joint", JointOptions()), *(("thesis", ThesisOptions(matcher=m)) for m in MATCHERS)],
    ids=["joint", *MATCHERS],
)
@pytest.mark.parametrize("size", [(1, 1), (7, 5)])
def test_hardly_a_pixel(method, options, size):
    camera = PinholeCamera(*size, 50.0, 50.0, (size[0] - 1) / 2, (size[1] - 1) / 2)
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    a, b = (
        Picture(n, "uav", 0.0, image, camera, boards.pose((0, y, 0)))
        for n, y in (("a", 0.0), ("b", -1.0))
    )
    with pytest.raises(StereoError) as error:
        MAP[method].map(faulty.given(a, [b]), options, quiet)
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def large():
    """A pair of 12 megapixels, 4 m apart: the map, and the true depth."""
    camera = PinholeCamera.from_fov(4000, 3000, np.radians(56.0))
    poses = [boards.pose([0, -b, 0]) for b in (0.0, 4.0)]
    pictures = [
        Picture(f"{i}", "uav", 0.0, boards.draw(T, faulty.TOWN, camera), camera, T)
        for i, T in enumerate(poses)
    ]
    return joint(pictures[0], pictures[1:]), boards.depth(poses[0], faulty.TOWN, camera)


@pytest.mark.slow
def test_twelve_megapixels(large):
    """The boards are 70 % of the picture, and the other picture sees 61 %: the left edge is not in
    it."""
    result, truth = large
    assert result.depth.shape == truth.shape == (3000, 4000)
    disparity_px = result.reference.camera.fx * 4.0 / truth
    seen = np.isfinite(truth) & (np.arange(4000) >= disparity_px)
    assert 0.6 < seen.mean() < 0.65
    assert result.coverage > 0.7 * seen.mean() and any(i.refined for i in result.images)
    assert np.isfinite(result.depth[seen]).mean() > 0.7


@pytest.mark.slow
def test_claims_of_twelve_megapixels(large):
    result, truth = large
    assert faulty.claims(result, truth)[1] <= faulty.MOST_WRONG


@pytest.mark.parametrize(
    "method, options", [("joint", JointOptions()), ("thesis", ThesisOptions())]
)
def test_an_error_leaves_nothing_in_out(tmp_path, method, options):
    """Two grey pictures; the folder above OUT is as it was, and an earlier map stays."""
    folder, out = model(tmp_path / "model"), tmp_path / "out"
    with pytest.raises(StereoError):
        pipeline.run(pipeline.MapRequest(folder, out, method, options), quiet)
    assert [p.name for p in tmp_path.iterdir()] == ["model"]
    out.mkdir()
    (out / "map.ply").write_text("an earlier map")
    with pytest.raises(StereoError):
        pipeline.run(pipeline.MapRequest(folder, out, method, options), quiet)
    assert (
        sorted(p.name for p in tmp_path.iterdir()) == ["model", "out"]
        and (out / "map.ply").exists()
    )


def test_a_picture_that_ends_early_is_named(tmp_path):
    """A fortieth of a PNG, and a file of no bytes."""
    folder = model(tmp_path / "model")
    whole = cv2.imencode(".png", np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8))[
        1
    ].tobytes()
    for content, words in (
        (whole[: len(whole) // 40], "ends in the middle"),
        (b"", "cannot be read as a picture"),
    ):
        (folder / "images" / "b.png").write_bytes(content)
        with pytest.raises(InputError, match=rf"b\.png: {words}"):
            pipeline.run(pipeline.MapRequest(folder, tmp_path / "out", "joint"), quiet)
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match="is a file"):
        pipeline.run(pipeline.MapRequest(folder, tmp_path / "out", "joint"), quiet)
