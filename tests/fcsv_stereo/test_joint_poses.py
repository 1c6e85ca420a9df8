# SPDX-License-Identifier: Apache-2.0
"""Joint matching's own adjustment of poses, on walls with known poses."""

from dataclasses import replace

import numpy as np
import pytest
from support import scenes

from fcsv_geometry import transforms
from fcsv_stereo.joint import MatchOptions, match_jointly
from fcsv_stereo.model import PoseUncertainty

BASELINES_M = (0.5, 1.0)
YAW_DEG_PER_M = 0.15
SIGMAS = np.repeat([np.radians(0.15), 0.003], 3)  # the bench's prior, at these baselines
KNOWN = [PoseUncertainty(np.diag(SIGMAS**2))] * 2


def turned():
    """The reference and others, each turned by more the farther away it is: a shift of all inverse
    depths, nearly."""
    reference = scenes.picture(
        "reference", "uav1", 0.0, scenes.camera_pose([0, 0, 0], (0.3, -0.2, 0.4))
    )
    true = [
        scenes.picture(f"other {b}", "uav2", 0.0, scenes.camera_pose((0, -b, 0), (-0.4, 0.3, -0.3)))
        for b in BASELINES_M
    ]
    wrong = []
    for picture, b in zip(true, BASELINES_M):
        # about the camera's y
        error = transforms.from_xyz_rpy([0, 0, 0], [0, np.radians(YAW_DEG_PER_M * b), 0])
        wrong.append(replace(picture, T_home_cam=picture.T_home_cam @ error))
    return reference, true, wrong


def rotation_errors_deg(found, true):
    return [
        np.degrees(transforms.rotation_angle(f.T_home_cam, t.T_home_cam))
        for f, t in zip(found, true)
    ]


def test_turns_that_look_like_depth_are_found():
    """A third of what was put in is left at most: less than 0.3 px of 5 m, and with it less than
    that of depth."""
    reference, true, wrong = turned()
    kept = match_jointly(reference, wrong, MatchOptions(), KNOWN)
    found = match_jointly(reference, wrong, MatchOptions(adjust_poses=True), KNOWN)
    before, after = (rotation_errors_deg(f.pictures, true) for f in (kept, found))
    assert before == pytest.approx([YAW_DEG_PER_M * b for b in BASELINES_M], abs=1e-6)
    assert max(after) < max(before) / 3.0
    truth = scenes.true_depth(reference.T_home_cam)
    error = [np.nanmedian(np.abs(f.depth / truth - 1.0)) for f in (kept, found)]
    assert error[1] < error[0]


def test_the_scale_is_kept():
    """Pictures do not tell it: the mean length of the baselines stays to a tenth of a per cent."""
    reference, _, wrong = turned()
    found = match_jointly(reference, wrong, MatchOptions(adjust_poses=True), KNOWN)
    lengths = [
        [np.linalg.norm(p.T_home_cam[:3, 3]) for p in pictures]
        for pictures in (wrong, found.pictures)
    ]
    weighted = [np.dot(length, BASELINES_M) for length in lengths]
    assert weighted[1] / weighted[0] == pytest.approx(1.0, abs=1e-3)


def test_without_texture_poses_stay():
    reference, _, wrong = turned()
    flat = [replace(p, image=np.full_like(p.image, 128)) for p in (reference, *wrong)]
    found = match_jointly(flat[0], flat[1:], MatchOptions(adjust_poses=True), KNOWN)
    for a, b in zip(found.pictures, flat[1:]):
        assert np.allclose(a.T_home_cam, b.T_home_cam, atol=1e-9)
