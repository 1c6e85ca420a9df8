# SPDX-License-Identifier: Apache-2.0
"""A calibrated rig that a folder of photographs states: one frame of rigs.txt, or Middlebury's
calib.txt."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.scenes import given

from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import RIG, PosePrior
from fcsv_stereo.posed import colmap
from fcsv_stereo.refinement import RefineOptions

CAMERAS = "1 PINHOLE 64 48 60 60 32 24\n2 PINHOLE 64 48 60 60 32 24\n"
#: One K, not turned, abreast: what rectified pairs look like.
PAIR = "1 1 0 0 0 0 0 0 1 left.png\n\n2 1 0 0 0 -0.2 0 0 2 right.png\n\n"
RIGS = "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.2 0 0\n"
ONE_FRAME = "1 1 1 0 0 0 0 0 0 2 CAMERA 1 1 CAMERA 2 2\n"
#: Both cameras are of the rig, but each picture was taken at an instant of its own.
TWO_FRAMES = "1 1 1 0 0 0 0 0 0 1 CAMERA 1 1\n2 1 1 0 0 0 0 0 0 1 CAMERA 2 2\n"
MIDDLEBURY = "cam0=[60 0 31.5; 0 60 23.5; 0 0 1]\ncam1=[60 0 31.5; 0 60 23.5; 0 0 1]\ndoffs=0\nbaseline=200\n"


@pytest.fixture
def folder(tmp_path):
    """Posed photographs of a pair, without a word of a rig."""
    (tmp_path / "images").mkdir()
    random = np.random.default_rng(1)
    for name in ("left.png", "right.png"):
        cv2.imwrite(str(tmp_path / "images" / name), random.integers(0, 255, (48, 64, 3), np.uint8))
    (tmp_path / "cameras.txt").write_text(CAMERAS)
    (tmp_path / "images.txt").write_text(PAIR)
    return tmp_path


def test_nothing_states_a_rig(folder):
    assert colmap.read_photographs(folder).rig == ""
    (folder / "calib.txt").write_text("of another program: fx fy\n")
    assert colmap.read_photographs(folder).rig == ""


@pytest.mark.parametrize("frames, is_rig", [(ONE_FRAME, True), (TWO_FRAMES, False)])
def test_pictures_of_one_frame_are_a_rigs(folder, frames, is_rig):
    (folder / "rigs.txt").write_text(RIGS)
    (folder / "frames.txt").write_text(frames)
    assert ("rigs.txt" in colmap.read_photographs(folder).rig) == is_rig


@pytest.mark.parametrize("turned", [False, True])
def test_middleburys_calibration_counts_for_rectified_poses_alone(folder, turned):
    (folder / "calib.txt").write_text(MIDDLEBURY)
    if turned:
        half = np.radians(0.5) / 2.0
        words = f"{np.cos(half):.9f} 0 {np.sin(half):.9f} 0"
        (folder / "images.txt").write_text(PAIR.replace("2 1 0 0 0 -0.2", f"2 {words} -0.2"))
    assert ("calib.txt" in colmap.read_photographs(folder).rig) != turned


def test_a_stated_rig_is_mapped_as_one_and_said_unless_the_user_says_otherwise():
    seen = replace(given(((0, -1.0, 0), "horizontal"), kind="photographs"), rig="rigs.txt says so")
    stated, asked = (
        Joint().map(seen),
        Joint().map(
            replace(seen, rig=""),
            JointOptions(prior=RIG, refinement=RefineOptions(calibrated=True)),
        ),
    )
    np.testing.assert_array_equal(stated.depth, asked.depth)
    np.testing.assert_array_equal(stated.sigma, asked.sigma)
    (said,) = [w for w in stated.unseen if "rigs.txt says so" in w]
    assert "0.01 degrees" in said and "--prior-rotation-deg" in said
    other = Joint().map(seen, JointOptions(prior=PosePrior()))
    assert np.nanmedian(other.sigma / other.depth) > np.nanmedian(stated.sigma / stated.depth)
    assert not any("calibrated rig" in w for w in other.unseen)
