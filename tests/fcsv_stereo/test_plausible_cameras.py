# SPDX-License-Identifier: Apache-2.0
"""COLMAP's cameras.txt and calibration files are judged by the same rule as camera_info."""

import numpy as np
import pytest

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera, write_camera
from fcsv_geometry.config import ConfigError
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.colmap import read_cameras

CAMERA = PinholeCamera(640, 480, 600.0, 601.0, 320.0, 238.0, (0.05, -0.1, 0.001, -0.002, 0.03))


@pytest.mark.parametrize(
    "values, words",
    [
        ("600 600 0 0", "was it never set? The middle is 319.5, 239.5"),
        ("0.004 0.004 320 240", "is it in metres?"),
        ("65535 65535 320 240", "stands for a focal length that is not known"),
        ("600 600 240 320", "exchanged"),
        ("600 nan 320 240", "not finite"),
        ("600 100 320 240", "no camera has such pixels"),
        ("1 1 0.5 0.5", "share of the"),
    ],
)
def test_a_camera_of_colmap_that_is_none(tmp_path, values, words):
    (tmp_path / "cameras.txt").write_text(f"# comment\n1 PINHOLE 640 480 {values}\n")
    with pytest.raises(InputError) as error:
        read_cameras(tmp_path / "cameras.txt")
    assert words in str(error.value) and "cameras.txt, line 2: " in str(error.value)


def test_a_telephoto_of_colmap_is_read(tmp_path):
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 640 480 12800 320 240\n")
    assert read_cameras(tmp_path / "cameras.txt")[1].fx == 12800.0


@pytest.mark.parametrize(
    "before, after, words",
    [
        (
            "data: [600.0, 0.0, 320.0, 0.0, 601.0, 238.0, 0.0, 0.0, 1.0]",
            "data: [600, 0, 0, 0, 601, 0, 320, 238, 1]",
            "K is transposed",
        ),
        (
            "data: [600.0, 0.0, 320.0, 0.0, 601.0, 238.0, 0.0, 0.0, 1.0]",
            "data: [1, 0, 0, 0, 1, 0, 0, 0, 1]",
            "calibrated",
        ),
        (
            "data: [0.05, -0.1, 0.001, -0.002, 0.03]",
            "data: [0.05, -0.1, 0.001]",
            "D has 3 coefficients",
        ),
        (
            "data: [0.05, -0.1, 0.001, -0.002, 0.03]",
            "data: [0.05, x]",
            "'distortion_coefficients' is no row of numbers",
        ),
        ("distortion_model: plumb_bob", "distortion_model: equidistant", "is of a fisheye"),
        ("image_width: 640", "image_width: wide", "image_width and image_height are no numbers"),
    ],
)
def test_a_calibration_file_that_is_none(tmp_path, before, after, words):
    path = tmp_path / "camera.yaml"
    write_camera(path, "front", CAMERA)
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(ConfigError) as error:
        read_camera(path)
    assert words in str(error.value) and "camera.yaml: " in str(error.value)


@pytest.mark.parametrize("distortion", [CAMERA.distortion, (*CAMERA.distortion, 0.01, 0.02, 0.03)])
def test_a_calibration_file_round_trip(tmp_path, distortion):
    camera = PinholeCamera(640, 480, 600.0, 601.0, 320.0, 238.0, distortion)
    write_camera(tmp_path / "camera.yaml", "front", camera)
    name, found = read_camera(tmp_path / "camera.yaml")
    assert name == "front" and found == camera and np.array_equal(found.K, camera.K)
