# SPDX-License-Identifier: Apache-2.0
"""No evidence, no confident answer: what stands out, what plain places become, and what is left of
the map."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.scenes import CAMERA, given, true_depth

from fcsv_stereo.errors import MatchingError, StereoError
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.joint.checks.evidence import FEATURES, standing_out
from fcsv_stereo.joint.checks.kinds import kinds, sure_limit
from fcsv_stereo.joint.refine.residuals import Residuals, residuals
from fcsv_stereo.joint.tuning import EVIDENCE, SHARED
from fcsv_stereo.joint.views import grey, views
from fcsv_stereo.model import MapResult
from fcsv_stereo.model.kinds import WORDS, DepthKind, masks, supported

# numpy's: a user can do nothing about them
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
PAIRS = ((0, -1.0, 0), "horizontal"), ((0, -2.0, 0), "horizontal")
SKY_ROWS = 60


def changed(seen, change):
    """The input with every picture's image changed."""
    configurations = [
        replace(
            c,
            references=[replace(p, image=change(p.image)) for p in c.references],
            others=[replace(p, image=change(p.image)) for p in c.others],
        )
        for c in seen.configurations
    ]
    return replace(seen, configurations=configurations)


def with_grey_sky(image):
    """An overcast sky: one grey with the noise of a sensor, in the upper rows of every picture."""
    out = image.copy()
    noise = np.random.default_rng(int(image.sum()) % 1000).normal(
        0.0, 1.2, (SKY_ROWS, image.shape[1], 1)
    )
    out[:SKY_ROWS] = np.clip(205 + noise, 0, 255)
    return out


@pytest.mark.parametrize(
    "doubts, least, most",
    [
        (np.full(9, 0.01), 0.06, 0.06),
        (np.linspace(0.0, 0.06, 6001), 0.0249, 0.0251),
        (np.full(9, 0.04), 0.0, 0.04),
        (np.empty(0), 0.06, 0.06),
    ],
    ids=["sure", "even", "none", "empty"],
)
def test_of_what_agrees_few_are_expected_wrong(doubts, least, most):
    """Even doubts up to a limit have half of it as their mean: twice 1.25 %."""
    assert (EVIDENCE.sure_doubt, EVIDENCE.sure_share) == (0.06, 0.0125)
    assert least <= sure_limit(doubts) <= most


def test_one_limit_holds_for_a_whole_map():
    """What is in doubt by 5 % agrees where little is, and does not where half of the picture is."""
    shape, nothing = (20, 50), np.zeros((20, 50), bool)
    r = Residuals(*[None] * 3, seen=np.ones((2, *shape)), trust=np.ones((2, *shape)))
    for columns, code in ((2, 2), (25, 1)):
        doubt = np.full(shape, 0.01)
        doubt[:, :columns] = 0.05
        found = kinds(doubt, np.full((2, *shape), 3.0), r, np.full(shape, 9.0), nothing, nothing)
        assert (found[:, :columns] == code).all() and (found[:, columns:] == 2).all()


def test_what_no_other_picture_sees_has_no_evidence_however_small_the_doubt():
    """Beside a seen surface its depth goes on: at a map's lower edge as a wall of its own. A pixel
    is compared by its window, which must be in view."""
    shape, nothing = (20, 50), np.zeros((20, 50), bool)
    seen = np.ones((2, *shape))
    seen[0, 10:], seen[1, 15:] = 0, 0
    sides = SHARED.window_px // 2
    r = Residuals(*[None] * 3, seen=seen, trust=seen)
    found = kinds(
        np.full(shape, 0.01), np.full((2, *shape), 3.0), r, np.full(shape, 9.0), nothing, nothing
    )
    assert (found[:10] == 2).all() and (found[10 : 15 - sides] == 1).all()
    assert (found[15 - sides :] == DepthKind.OUTSIDE).all()


def test_the_weights_are_of_these_features():
    assert len(EVIDENCE.means) == len(EVIDENCE.scales) == len(FEATURES) == len(EVIDENCE.weights) / 3
    assert (
        np.isfinite([*EVIDENCE.means, *EVIDENCE.scales, *EVIDENCE.weights]).all()
        and min(EVIDENCE.scales) > 0
    )


def test_texture_stands_out_and_a_plain_place_does_not():
    seen = changed(given(PAIRS[0]), with_grey_sky)
    (c,) = seen.configurations
    reference, other = c.references[0], c.others[0]
    found = views(reference, [other], 1.0, [grey(reference), grey(other)])
    w = (1.0 / true_depth(reference.T_home_cam)).astype(np.float32)
    with ThreadPoolExecutor(2) as pool:
        out = standing_out(found, w, residuals(found, w, pool), w.shape, pool)[0]
    wall, sky = out[SKY_ROWS + 20 : -20, 60:-20], out[10 : SKY_ROWS - 10, 60:-20]
    assert np.median(wall) > 2.0, "a textured wall matches worse at every other depth"
    assert np.median(sky) < 1.2, "noise matches as well elsewhere"


def test_a_grey_sky_is_not_answered_and_the_wall_is():
    seen = changed(given(*PAIRS), with_grey_sky)
    result = Joint().map(seen)
    truth = true_depth(seen.configurations[0].references[0].T_home_cam)
    sky, wall = np.s_[: SKY_ROWS - 8], np.s_[SKY_ROWS + 8 :]
    assert np.isfinite(result.depth[sky]).mean() <= 0.01
    assert (result.kind[sky] == DepthKind.SKY).mean() > 0.9
    answered = np.isfinite(result.depth[wall])
    assert answered.mean() > 0.7
    assert (np.abs(result.depth[wall] / truth[wall] - 1.0) > 0.1)[answered].mean() < 0.02


def test_complete_adds_the_rest_and_marks_it():
    seen = given(*PAIRS)
    told, whole = Joint().map(seen), Joint().map(seen, JointOptions(complete=True))
    np.testing.assert_array_equal(told.kind, whole.kind)
    known = np.isfinite(told.depth)
    assert supported(told.kind)[known].all() and whole.coverage > told.coverage
    np.testing.assert_array_equal(told.depth[known], whole.depth[known])
    assert len(told.cloud) == known.sum() and len(whole.cloud) == np.isfinite(whole.depth).sum()
    assert (whole.kind == DepthKind.OUTSIDE).any(), (
        "the reference's left edge is in no other picture"
    )
    assert sum(mask.mean() for mask in masks(whole.kind).values()) == pytest.approx(1.0)
    assert set(masks(whole.kind)) == set(WORDS) - {"near"}


@pytest.mark.parametrize("complete", [False, True])
def test_the_same_picture_everywhere_is_no_map_of_it(complete):
    """Nothing moves between the pictures though their poses do: only infinity fits, and that is no
    answer."""
    seen = given(*PAIRS)
    image = seen.configurations[0].references[0].image
    same = changed(seen, lambda _: image)
    try:
        result = Joint().map(same, JointOptions(complete=complete))
    except StereoError:
        return
    sure = supported(result.kind) & (result.sigma < 0.1 * result.depth) & (result.depth < 100.0)
    assert sure.mean() < 0.02


def test_plain_pictures_of_one_grey_are_refused():
    with pytest.raises(StereoError):
        Joint().map(changed(given(*PAIRS), lambda image: np.full_like(image, 128)))


def test_pictures_of_another_place_are_refused_by_name_unless_poses_are_vouched_for():
    seen = given(*PAIRS)
    foreign = [
        replace(c, others=[replace(p, image=cv2.rotate(p.image, cv2.ROTATE_180)) for p in c.others])
        for c in seen.configurations
    ]
    names = [c.others[0].name for c in foreign]
    with pytest.raises(
        MatchingError, match=f"none of {', '.join(names)} could be compared .* --no-refine"
    ):
        Joint().map(replace(seen, configurations=foreign))
    vouched = Joint().map(replace(seen, configurations=foreign), JointOptions(refine_poses=False))
    assert not supported(vouched.kind).mean() > 0.1, (
        "and what no pair's texture supports is left out all the same"
    )


def test_a_method_that_does_not_tell_kinds_has_one_pair_where_there_is_a_depth():
    depth = np.array([[1.0, np.nan]], np.float32)
    assert MapResult("m", None, [], [], depth, depth, None).kind.tolist() == [[1, 0]]


def test_a_foreign_picture_does_not_count_as_a_pair_that_agrees():
    seen = given(*PAIRS, ((0, -1.5, 0), "horizontal"))
    c = seen.configurations[2]
    foreign = cv2.rotate(c.others[0].image, cv2.ROTATE_180)
    pasted = [*seen.configurations[:2], replace(c, others=[replace(c.others[0], image=foreign)])]
    result = Joint().map(replace(seen, configurations=pasted))
    truth = true_depth(seen.configurations[0].references[0].T_home_cam)
    answered = np.isfinite(result.depth)
    assert (
        answered.mean() > 0.6 and (np.abs(result.depth / truth - 1.0) > 0.1)[answered].mean() < 0.02
    )
    assert (result.kind[answered] <= 2).mean() > 0.99
    assert CAMERA.width == result.kind.shape[1]
