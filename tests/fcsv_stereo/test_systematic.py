# SPDX-License-Identifier: Apache-2.0
"""What errors that all points of a picture share make of the poses: on points alone, with fields
that are drawn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.boards import CAMERA

from fcsv_geometry import transforms
from fcsv_stereo.refinement import fields, systematic
from fcsv_stereo.refinement.adjust import Problem, adjust
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_stereo.refinement.rolling_shutter import readout_turns
from fcsv_stereo.refinement.structure import Observations

# a narrow pair: 1 m, points from 8 to 200 m
TRUE = transforms.transform(np.eye(3), np.array([1.0, 0.0, 0.0]))
POINTS, NOISE_PX = 400, 0.1
CAMERAS = {0: CAMERA, 1: CAMERA}


def adjusted(random, field_px, rotation_rad=0.01, turn_rad=0.0):
    """A pair of pictures whose points are off by a smooth field each, rms ``field_px``, by noise,
    and by a turn between first and last row of ``turn_rad`` about each axis."""
    uv = random.uniform([0, 0], [CAMERA.width, CAMERA.height], (POINTS, 2))
    rays = np.column_stack([(uv - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(POINTS)])
    rho = 1.0 / np.exp(random.uniform(np.log(8.0), np.log(200.0), POINTS))
    there = rays - rho[:, None] * TRUE[:3, 3]
    measured = []
    for true in (rays, there / there[:, 2:]):
        shifts = fields.of_picture(CAMERA, true)
        terms = random.normal(0.0, field_px / np.sqrt(fields.TERMS), 2 * fields.TERMS)
        off_px = shifts @ terms + random.normal(0.0, NOISE_PX, (POINTS, 2))
        time = (true[:, 1] / true[:, 2] * CAMERA.fy + CAMERA.cy + 0.5) / CAMERA.height - 0.5
        seen_from = true - np.cross(time[:, None] * random.normal(0.0, turn_rad, 3), true)
        seen_from = seen_from / seen_from[:, 2:]
        measured.append(seen_from + np.column_stack([off_px / CAMERA.fx, np.zeros(POINTS)]))
    point = np.arange(POINTS)
    seen = Observations(
        np.zeros(POINTS, int), measured[0], point, np.ones(POINTS, int), measured[1]
    )
    noise_px = 2.5 * np.sqrt(2.0) * NOISE_PX  # of both pictures, and stated as consensus does
    priors = {1: PairPrior(TRUE, rotation_rad, 0.01)}
    problem = Problem(seen, priors, {0: CAMERA.fx, 1: CAMERA.fx}, {0: noise_px, 1: noise_px})
    found = adjust(problem, {1: TRUE}, rho)
    return Consensus(found, seen, problem=problem)


def rotation(consensus):
    return Rotation.from_matrix(consensus.adjusted.poses[1][:3, :3]).as_rotvec()


def test_a_field_makes_of_poses_what_is_said(monkeypatch):
    """60 draws with 0.3 px: squared errors over what is stated average one (0.18 is the mean's
    standard deviation), for each axis. Without the fields they are far larger."""
    monkeypatch.setattr(systematic, "_field_px", lambda *_: 0.3)
    random, scores, noise_only = np.random.default_rng(3), [], []
    for _ in range(60):
        consensus = adjusted(random, 0.3)
        noise = np.diag(consensus.adjusted.covariance)[:3]
        stated = noise + np.diag(systematic.systematic(consensus, CAMERAS).covariance)[:3]
        scores.append(rotation(consensus) ** 2 / stated)
        noise_only.append(rotation(consensus) ** 2 / noise)
    assert ((0.5 < np.mean(scores, axis=0)) & (np.mean(scores, axis=0) < 1.6)).all(), np.mean(
        scores, axis=0
    )
    assert np.mean(noise_only, axis=0).min() > 3.0


def test_yaw_against_depth_is_what_a_narrow_pair_knows_worst():
    consensus = adjusted(np.random.default_rng(4), 0.1)
    pitch, yaw, roll = np.sqrt(np.diag(systematic.systematic(consensus, CAMERAS).covariance)[:3])
    assert yaw > 5.0 * pitch and yaw > 2.0 * roll


def test_poses_that_are_exact_are_moved_by_no_field():
    consensus = adjusted(np.random.default_rng(5), 0.1, rotation_rad=1e-6)
    assert np.sqrt(np.diag(systematic.systematic(consensus, CAMERAS).covariance)[:3]).max() < 1e-6


@pytest.mark.parametrize("field_px", [0.0, 0.1, 0.3])
def test_residuals_tell_how_large_the_fields_are(field_px):
    """To a factor of two in the mean of 8 draws; of none there is hardly anything left."""
    random, sizes = np.random.default_rng(6), []
    for _ in range(8):
        sizes.append(systematic.systematic(adjusted(random, field_px), CAMERAS).field_px)
    mean = float(np.sqrt(np.mean(np.square(sizes))))
    assert mean < 0.05 if field_px == 0.0 else 0.5 * field_px < mean < 2.0 * field_px, mean


def test_rows_read_late_are_told_from_any_other_field():
    """Of 12 draws each: turns of 0.2 degrees, smooth fields of 0.15 px, noise alone."""

    def sure(field_px, turn_rad):
        random = np.random.default_rng(7)
        drawn = (adjusted(random, field_px, 0.0026, turn_rad) for _ in range(12))
        return sum(readout_turns(consensus, CAMERAS, {}).sure for consensus in drawn)

    assert sure(0.0, np.radians(0.2)) >= 10 and sure(0.15, 0.0) <= 1 and sure(0.0, 0.0) == 0


def test_turns_that_are_found_take_the_pose_along_and_say_how_well():
    """40 draws: yaw after the step, squared, over what is stated for it averages about one (0.22 is
    the mean's standard deviation); what is stated for pictures that are left as they are is not
    less than what the step takes away."""
    random, scores, before = np.random.default_rng(8), [], []
    for _ in range(40):
        consensus = adjusted(random, 0.0, np.radians(0.15), np.radians(0.1))
        turns = readout_turns(consensus, CAMERAS, {})
        stated = consensus.adjusted.covariance[1, 1] + turns.covariance[1, 1]
        scores.append((rotation(consensus)[1] + turns.step[1]) ** 2 / stated)
        before.append(rotation(consensus)[1] ** 2 / consensus.adjusted.covariance[1, 1])
        assert turns.if_left[1, 1] >= turns.probability * turns.step[1] ** 2
    assert 0.5 < np.mean(scores) < 1.7 and np.mean(before) > 10.0
