# SPDX-License-Identifier: Apache-2.0
"""Covariances of flown poses: from the chain of calibration, drift and tracker to what a map's
refinement takes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import boards

from fcsv_geometry import transforms
from fcsv_geometry.home import places_in_home
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_stereo import pose_covariance
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import FLOWN, Configuration, ConfigurationInput, PosePrior
from fcsv_stereo.refinement import RefineOptions, refine
from fcsv_stereo.refinement.adjust import Problem, _with_shared
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_tracking.column.calibration import Link
from fcsv_tracking.column.camera_covariance import camera_covariance
from fcsv_tracking.column.drift import Drift

DRAWS = 4000
#: five standard deviations of a variance that is estimated from so many draws; errors are a few
#: degrees at most, so that what is beyond first order is less than a tenth of it
TOLERANCE = 5.0 * np.sqrt(2.0 / DRAWS)
TRACKER = np.diag([0.01**2] * 3 + [0.002**2] * 3)
T_BODY_CAM = transforms.from_xyz_rpy([0.1, 0.0, 0.03], [0, 0, 0]) @ transforms.transform(
    transforms.R_FLU_OPTICAL, np.zeros(3)
)


def whitened(found, stated):
    """``found`` in units of ``stated``: the identity where they agree."""
    L = np.linalg.cholesky(stated)
    return np.linalg.solve(L, np.linalg.solve(L, found).T)


def small_turn(w):
    return Rotation.from_rotvec(w).as_matrix()


class Flight:
    """Two vehicles: a link with its error, each vehicle's odometry with drift since, and the
    tracker's own noise."""

    def __init__(self):
        random = np.random.default_rng(5)
        A = random.normal(0.0, 1.0, (4, 4)) * [0.02, 0.02, 0.02, 0.003]
        self.link = Link(
            "uav1", "uav2", transforms.from_xyz_yaw([3.0, -4.0, 0.5], 1.1), A.T @ A, 0, 0, 0, 1, 0
        )
        self.T_o1_home = transforms.from_xyz_yaw([2.0, 1.0, 6.0], 0.7)
        self.poses = {}  # T_odom_body
        self.drifts = {}
        for name, ends in (
            ("uav1", [[0, 0, 0], [1.0, 0.5, 6.0]]),
            ("uav2", [[4, 4, 5], [-3.0, 6.0, 5.5]]),
        ):
            drift = Drift(replace(T265_PROFILE, walk_m_per_sqrt_m=0.01, heading_deg_per_sqrt_m=0.1))
            for t, share in enumerate(np.linspace(0.0, 1.0, 40)):
                drift.add(t * 0.2, (1.0 - share) * np.array(ends[0]) + share * np.array(ends[1]))
            self.drifts[name] = drift
            self.poses[name] = transforms.from_xyz_rpy(ends[1], [0.02, -0.01, 0.3])

    def places(self, link=None):
        return places_in_home([link or self.link], "uav1", self.T_o1_home)

    def picture(self, name):
        place = self.places()[name]
        T_home_cam = place.T_a_b @ self.poses[name] @ T_BODY_CAM
        covariance = camera_covariance(
            place, self.poses[name], T_BODY_CAM, self.drifts[name], TRACKER
        )
        return boards.Picture(
            name, name, 0.0, None, boards.CAMERA, T_home_cam, covariance=covariance
        )

    def drawn(self, random):
        """T_home_cam of both with errors as they are stated to be."""
        d = random.multivariate_normal(np.zeros(4), self.link.covariance)
        T = self.link.T_parent_child
        link = replace(
            self.link,
            T_parent_child=transforms.from_xyz_yaw(T[:3, 3] + d[:3], transforms.yaw(T) + d[3]),
        )
        found = {}
        for name, place in self.places(link).items():
            drift = random.multivariate_normal(np.zeros(4), self.drifts[name].covariance)
            noise = random.multivariate_normal(np.zeros(6), TRACKER)
            T = self.poses[name]
            turn = small_turn(noise[3:] + [0.0, 0.0, drift[3]])
            T_odom_body = transforms.transform(turn @ T[:3, :3], T[:3, 3] + drift[:3] + noise[:3])
            found[name] = place.T_a_b @ T_odom_body @ T_BODY_CAM
        return found


def test_relative_covariance_agrees_with_monte_carlo_of_the_whole_chain():
    flight, random = Flight(), np.random.default_rng(6)
    reference, other = flight.picture("uav1"), flight.picture("uav2")
    R_home_ref = reference.T_home_cam[:3, :3]
    T_ref_other = transforms.invert(reference.T_home_cam) @ other.T_home_cam
    errors = []
    for _ in range(DRAWS):
        T = flight.drawn(random)
        off = transforms.invert(T["uav1"]) @ T["uav2"]
        turn = Rotation.from_matrix(off[:3, :3] @ T_ref_other[:3, :3].T).as_rotvec()
        errors.append([*(R_home_ref @ (off - T_ref_other)[:3, 3]), *(R_home_ref @ turn)])
    found = np.cov(np.array(errors).T)
    stated = pose_covariance.relative(reference, other)
    assert np.abs(whitened(found, stated) - np.eye(6)).max() < TOLERANCE
    alone = other.covariance  # the other's own in home is not it
    assert np.abs(whitened(found, alone) - np.eye(6)).max() > 2.0 * TOLERANCE


def random_covariance(random, position_m=0.05, rotation_rad=0.005):
    A = random.normal(0.0, 1.0, (6, 6)) * ([position_m] * 3 + [rotation_rad] * 3)
    return A.T @ A + np.diag([1e-6] * 6)


def test_what_two_pictures_share_agrees_with_monte_carlo():
    """The reference's error is in both; of one vehicle's two pictures the later has the earlier's,
    carried along."""
    random = np.random.default_rng(7)
    reference, early, late = (
        boards.Picture(f"{n}/{t}", n, t, None, boards.CAMERA, boards.pose(p))
        for n, t, p in (
            ("uav1", 0.0, [0, 0, 0]),
            ("uav2", 1.0, [0, -2, 0.5]),
            ("uav2", 9.0, [1, -8, 3]),
        )
    )
    F = pose_covariance.carried(late.T_home_cam[:3, 3] - early.T_home_cam[:3, 3])
    since = random_covariance(random, 0.03)
    reference, early = (
        replace(p, covariance=random_covariance(random)) for p in (reference, early)
    )
    late = replace(late, covariance=F @ early.covariance @ F.T + since)
    e_ref, e_early, e_since = (
        random.multivariate_normal(np.zeros(6), c, DRAWS)
        for c in (reference.covariance, early.covariance, since)
    )
    arms = [
        pose_covariance.carried(p.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
        for p in (early, late)
    ]
    both = np.hstack([e_early - e_ref @ arms[0].T, e_early @ F.T + e_since - e_ref @ arms[1].T])
    cross = pose_covariance.relative_common(reference, early, late)
    stated = np.block(
        [
            [pose_covariance.relative(reference, early), cross],
            [cross.T, pose_covariance.relative(reference, late)],
        ]
    )
    assert np.abs(whitened(np.cov(both.T), stated) - np.eye(12)).max() < TOLERANCE
    assert np.allclose(pose_covariance.relative_common(reference, late, early), cross.T)
    of_another = replace(late, vehicle="uav3")
    only_reference = arms[0] @ reference.covariance @ arms[1].T
    assert np.allclose(
        pose_covariance.relative_common(reference, early, of_another), only_reference
    )


def test_an_adjustment_knows_that_its_priors_errors_are_common():
    """Against the exact covariance of a linear estimate from data H and priors L: P (H + L S L)
    P."""
    random = np.random.default_rng(8)
    A = random.normal(0.0, 1.0, (12, 12))
    S = A @ A.T
    own = [S[:6, :6], S[6:, 6:]]
    L = np.zeros((12, 12))
    L[:6, :6], L[6:, 6:] = (np.linalg.inv(c) for c in own)
    # data that leave much to the priors, as pictures leave the scale
    B = random.normal(0.0, 1.0, (5, 12))
    P = np.linalg.inv(B.T @ B + L)
    priors = {k: PairPrior(np.eye(4), 1.0, 1.0, c) for k, c in zip((1, 2), own)}
    problem = Problem(None, priors, {}, {}, shared={(1, 2): S[:6, 6:]})
    assert np.allclose(_with_shared(P, problem, [1, 2]), P @ (B.T @ B + L @ S @ L) @ P, atol=1e-9)
    assert np.array_equal(_with_shared(P, replace(problem, shared={}), [1, 2]), P)


@pytest.fixture(scope="module")
def flown():
    """A reference and two others, all with covariances: 4 cm, half a degree each."""
    town = boards.town()
    covariance = np.diag([0.04**2] * 3 + [np.radians(0.5) ** 2] * 3)
    shots = [
        ("uav1", 0.0, [0, 0, 0]),
        ("uav2", 1.0, [0.0, -4.0, 0.1]),
        ("uav2", 2.0, [0.1, -8.0, 0.0]),
    ]
    pictures = [boards.shot(f"{n}/{t}", boards.pose(p), town, n, t) for n, t, p in shots]
    return [replace(p, covariance=covariance) for p in pictures]


def scale_sigmas(result, reference):
    """Without what a focal length that may be wrong makes of it: three posters far away do not tell
    it."""
    out = []
    for r in result.others:
        arm = r.picture.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
        out.append(
            float(np.sqrt(arm @ (r.uncertainty.noise + r.uncertainty.shared)[3:, 3:] @ arm))
            / (arm @ arm)
        )
    return out


def test_the_scale_of_one_vehicles_pictures_does_not_average_out(flown):
    """The stated sigma of the scale: of one vehicle's pictures more than of two vehicles' with the
    same covariances."""
    reference, *others = flown
    one = refine(reference, others)
    two = refine(reference, [others[0], replace(others[1], vehicle="uav3")])
    assert all(r.refined for r in (*one.others, *two.others)), one.warnings
    # what is estimated is the same, what is said of it is not
    for a, b in zip(one.others, two.others):
        assert np.array_equal(a.picture.T_home_cam, b.picture.T_home_cam)
    assert min(scale_sigmas(one, reference)) > 1.05 * min(scale_sigmas(two, reference))
    sigma_rad = np.sqrt(max(np.diag(r.uncertainty.covariance)[:3].max() for r in one.others))
    assert sigma_rad < 0.1 * np.radians(0.5)  # the pictures fix the rotation, whatever the prior


def test_a_common_scale_is_in_every_picture_whole_and_moves_none(flown):
    """By the same share in all of them, on top of what was there: it neither averages out nor
    loosens the positions."""
    reference, *others = flown
    exact, scaled = (
        refine(reference, others, RefineOptions(prior=PosePrior(scale_sigma=s)))
        for s in (0.0, 0.05)
    )
    for a, b in zip(exact.others, scaled.others):
        assert a.refined and np.array_equal(a.picture.T_home_cam, b.picture.T_home_cam)
    sigmas = np.array([scale_sigmas(r, reference) for r in (exact, scaled)])
    np.testing.assert_allclose(sigmas[1], np.hypot(sigmas[0], 0.05), rtol=1e-6)


def test_a_better_known_flight_has_a_smaller_sigma_and_a_worse_one_a_larger(flown):
    def sigma(factor):
        pictures = [replace(p, covariance=factor**2 * p.covariance) for p in flown]
        return min(scale_sigmas(refine(pictures[0], pictures[1:]), pictures[0]))

    small, large = sigma(0.5), sigma(1.5)
    assert large == pytest.approx(3.0 * small, rel=0.05)  # the scale comes from the priors alone


def test_of_a_refused_picture_the_prior_is_what_is_known(flown):
    reference, other, _ = flown
    blank = replace(other, image=np.zeros_like(other.image))
    (r,) = refine(reference, [blank]).others
    turn = pose_covariance.to_camera(other, position_too=False)
    assert not r.refined
    assert np.allclose(
        r.uncertainty.covariance, turn @ pose_covariance.relative(reference, other) @ turn.T
    )


@pytest.mark.parametrize(
    "broken, words",
    [
        (np.full((6, 6), np.nan), "NaN"),
        (np.zeros((6, 6)), "not positive definite"),
        (np.diag([1e-4] * 5 + [-1e-6]), "not positive definite"),
        (np.triu(np.full((6, 6), 1e-4)), "not symmetric"),
        (np.eye(4), "not 6x6"),
    ],
)
def test_what_is_no_covariance_is_named(broken, words):
    with pytest.raises(InputError, match=words):
        pose_covariance.checked(broken, "uav2")


def test_known_covariances_are_found_by_stamp_and_not_far_from_it():
    known = pose_covariance.KnownCovariances(most=3)
    assert known.at(1.0) is None
    for k in range(5):
        known.add(float(k), k * np.eye(6))
    assert known.at(3.2)[0, 0] == 3.0 and known.at(3.9)[0, 0] == 4.0 and known.at(4.4)[0, 0] == 4.0
    assert known.at(4.6) is None and known.at(1.0) is None  # too late; forgotten


def test_pictures_without_a_covariance_are_named_with_the_prior_that_serves(flown):
    reference, other, _ = flown
    configuration = Configuration("horizontal", 4.0, 0.0, "horizontal 4 m")

    def said(p):
        return pose_covariance.unknown_warning(
            [ConfigurationInput(configuration, [reference], [p])], FLOWN, ["broken"]
        )

    assert said(other) == []
    (line,) = said(replace(other, covariance=None))
    assert all(w in line for w in ("uav2", "broken", "15 cm", "0.3 deg")) and "uav1" not in line
