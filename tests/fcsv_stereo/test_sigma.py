# SPDX-License-Identifier: Apache-2.0
"""What sigma makes of how a pixel is known, of the match's noise and of steps of depth about it."""

import numpy as np
import pytest
from support.scenes import camera_pose, picture

from fcsv_stereo.joint.checks.sigma import geometry_sigma, matching_sigma
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.refine.subpixel import Fine
from fcsv_stereo.joint.tuning import RESIDUALS

SIZE, W = 40, 0.1
TRUSTED = np.ones((SIZE, SIZE), bool)


def match(trust=0.9, seen=1.0, noise=0.01, step=0.0):
    """A plane at 10 m, with a step half-way where one is given; ``noise`` and ``step`` are shares
    of inverse depth."""
    w = np.full((SIZE, SIZE), W, np.float32)
    w[:, SIZE // 2 :] *= 1.0 + step

    def pairs(value):
        return np.full((2, SIZE, SIZE), value, np.float32)

    residuals = Residuals(pairs(1.0), pairs(50.0), pairs(1000.0), pairs(seen), pairs(trust))
    return Fine(w, np.square(noise * w), residuals)


def relative(fine, known=TRUSTED):
    return matching_sigma(fine, known) / fine.w


def middle(fine, known=TRUSTED):
    return float(relative(fine, known)[SIZE // 2, SIZE // 2])


def test_the_better_a_place_is_known_the_smaller_is_its_sigma():
    agreed, half = middle(match()), middle(match(), ~TRUSTED)
    hidden = middle(match(trust=RESIDUALS.least_trust / 2), ~TRUSTED)
    unseen = middle(match(trust=0.0, seen=0.0), ~TRUSTED)
    # level ground goes on
    assert 0.0 < agreed < 0.03 and half < 0.03 and 0.2 < hidden < 0.4 and half < unseen < 0.1


def test_what_agrees_follows_its_noise_and_has_a_floor():
    quiet, usual, loud = (middle(match(noise=n)) for n in (0.0, 0.01, 0.04))
    assert 0.0 < quiet < usual < loud
    assert loud / usual == pytest.approx(4.0**0.69, rel=0.01)


@pytest.mark.parametrize("kind", [{}, {"trust": 0.1}, {"trust": 0.0, "seen": 0.0}])
def test_a_step_makes_its_surroundings_uncertain_and_no_more(kind):
    known = TRUSTED if not kind else ~TRUSTED
    s = relative(match(step=0.5, **kind), known)
    assert min(s[20, 17], s[20, 20]) > 1.3 * s[20, 2] and s[20, 10] == pytest.approx(s[20, 2])


def test_a_match_that_tells_nothing_says_so_whatever_else_speaks_for_it():
    assert middle(match(noise=2.0)) >= 2.0


def test_a_place_beside_a_camera_disturbs_no_other():
    """There the picture moves without end with inverse depth, which no float's square holds."""
    reference, other = (
        picture(n, n, 0.0, camera_pose([0.0, y, 0.0])) for n, y in (("a", 0.0), ("b", -1.0))
    )
    fine, covariance = match(trust=0.9), np.diag([1e-6] * 6)
    calm = geometry_sigma(reference, [other] * 2, [covariance] * 2, fine)
    fine.residuals.speed[1, 0, 0], fine.residuals.slope[1, 0, 0] = 1e30, np.inf
    fine.residuals.trust[1, 0, 0] = 0.0
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        found = geometry_sigma(reference, [other] * 2, [covariance] * 2, fine)
    assert np.isfinite(found).all() and np.allclose(
        found[SIZE // 2 :], calm[SIZE // 2 :], rtol=1e-3
    )


def test_infinity_has_a_sigma_that_is_a_number():
    fine = match()
    fine.w[:] = 0.0
    assert np.isfinite(matching_sigma(fine, TRUSTED)).all()
