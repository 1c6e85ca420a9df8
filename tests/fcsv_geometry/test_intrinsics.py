# SPDX-License-Identifier: Apache-2.0
"""Which intrinsics are a camera's, and what the others are told to be."""

import doctest

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

from fcsv_geometry import intrinsics
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.intrinsics import camera_of_matrix, coefficients, doubts, require_plausible
from fcsv_geometry.ros import conversions

K = [600.0, 0.0, 319.5, 0.0, 600.0, 239.5, 0.0, 0.0, 1.0]
D = [0.05, -0.1, 0.001, -0.002, 0.03]
NAN = float("nan")


def matrix(fx=600.0, fy=600.0, cx=319.5, cy=239.5):
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]


def test_what_the_docstrings_say():
    result = doctest.testmod(intrinsics)
    assert result.attempted >= 2 and result.failed == 0


@pytest.mark.parametrize(
    "name, wrong, words",
    [
        ("K of zeros", [0.0] * 9, "not calibrated (K is zero)"),
        ("K is the identity", np.eye(3).ravel().tolist(), "not calibrated"),
        ("K of ones", [1.0] * 9, "not calibrated"),
        ("K of garbage (1e-310)", [1e-310] * 9, "it is no camera matrix"),
        ("focal length 1e-310", matrix(1e-310, 1e-310), "is the camera calibrated?"),
        ("K holds NaN", matrix(fx=NAN), "K holds NaN or infinity"),
        ("K holds infinity", matrix(cx=float("inf")), "K holds NaN or infinity"),
        (
            "K transposed",
            np.reshape(K, (3, 3)).T.ravel().tolist(),
            "K is transposed, with cx and cy in the bottom row",
        ),
        (
            "K with a skew",
            [600.0, 30.0, 319.5, 0.0, 600.0, 239.5, 0.0, 0.0, 1.0],
            "K has a skew of 30",
        ),
        ("K whose last entry is not 1", [*K[:8], 0.0], "it is no camera matrix"),
        (
            "principal point 0, 0",
            matrix(cx=0.0, cy=0.0),
            "was it never set? The middle is 319.5, 239.5",
        ),
        ("principal point with one coordinate 0", matrix(cx=0.0), "on its border"),
        ("principal point far outside", matrix(cx=-3000.0), "far outside of it"),
        ("K of a picture of twice the size", matrix(1200.0, 1200.0, 639.5, 479.5), "on its border"),
        (
            "K of a picture of 1.5 times the size",
            matrix(900.0, 900.0, 479.5, 359.5),
            "is K of a picture of 960x720?",
        ),
        (
            "K of a picture of half the size",
            matrix(300.0, 300.0, 159.5, 119.5),
            "is K of a picture of 320x240?",
        ),
        ("cx and cy exchanged", matrix(cx=239.5, cy=319.5), "are cx and cy exchanged"),
        ("focal length in metres", matrix(0.0043, 0.0043), "is it in metres?"),
        ("focal length in mm", matrix(4.3, 4.3), "is it in mm"),
        ("focal length of a lens for 35 mm film, in mm", matrix(24.0, 24.0), "is it in mm"),
        (
            "focal length as a share of the width",
            matrix(0.94, 0.94),
            "a share of the picture's width?",
        ),
        (
            "focal length 65535",
            matrix(65535.0, 65535.0),
            "stands for a focal length that is not known",
        ),
        ("focal length of 100 widths and more", matrix(1e6, 1e6), "no camera sees so little"),
        ("focal length below zero", matrix(-600.0, -600.0), "not a camera"),
        ("fx ten times fy", matrix(fy=60.1), "is it in mm, or of a smaller picture?"),
        ("fx a third of fy", matrix(fx=200.0), "no camera has such pixels"),
    ],
)
def test_a_matrix_that_is_no_cameras(name, wrong, words, wrong_input):
    with pytest.raises(GeometryError) as error:
        camera_of_matrix(640, 480, wrong, D, "plumb_bob")
    assert words in str(error.value) and "\n" not in str(error.value)
    wrong_input("Cameras", name, "refused", words)


@pytest.mark.parametrize(
    "given, model, words",
    [
        (
            [0.1],
            "plumb_bob",
            "D has 1 coefficients where plumb_bob has 5 (k1, k2, p1, p2, k3); OpenCV takes 4,",
        ),
        ([0.1, 0.2], "plumb_bob", "D has 2 coefficients"),
        ([0.1, 0.2, 0.3], "plumb_bob", "D has 3 coefficients"),
        ([0.1, 0.2, 0.0], "plumb_bob", "D has 3 coefficients"),
        ([0.1, 0.2, 0, 0, 0, 0.3], "plumb_bob", "D has 6 coefficients"),
        ([0.1, 0.2, 0, 0, 0, 0.3, 0.4], "rational_polynomial", "D has 7 coefficients"),
        ([0.1, 0.2], "rational_polynomial", "D has 2 coefficients"),
        (
            [0.1, 0.2, 0, 0, 0, 0, 0, 0.3],
            "plumb_bob",
            "is the distortion model rational_polynomial?",
        ),
        ([0.1, 0.2, NAN, 0, 0], "plumb_bob", "D holds NaN or infinity"),
        ([0.1, 0.2, 0, 0, 0], "", "is it plumb_bob?"),
        ([0.0] * 4, "equidistant", "is of a fisheye; only pinhole cameras are known"),
        ([0.1] * 4, "fisheye", "is of a fisheye; only pinhole cameras are known"),
        ([0.1] * 5, "ftheta", "distortion model 'ftheta' is not known"),
        ([1e5, 0, 0, 0, 0], "plumb_bob", "folds the picture: D is not this camera's"),
    ],
)
def test_coefficients_that_nobody_can_tell(given, model, words, wrong_input):
    with pytest.raises(GeometryError) as error:
        camera_of_matrix(640, 480, K, given, model)
    assert words in str(error.value)
    wrong_input("Cameras", f"D of {len(given)}, model '{model}'", "refused", words)


@pytest.mark.parametrize(
    "given, model, expected",
    [
        ([], "", [0.0] * 5),
        ([], "plumb_bob", [0.0] * 5),
        ([0.0], "plumb_bob", [0.0] * 5),
        ([0.0] * 3, "", [0.0] * 5),
        ([0.0] * 6, "plumb_bob", [0.0] * 5),
        ([0.0] * 8, "rational_polynomial", [0.0] * 5),
        ([0.0] * 14, "none", [0.0] * 5),
        (D[:4], "plumb_bob", [*D[:4], 0.0]),
        (D, "plumb_bob", D),
        ([*D, 0, 0, 0], "plumb_bob", D),
        ([*D, 0, 0, 0], "rational_polynomial", D),
        (D, "rational_polynomial", D),
        (D[:4], "rational_polynomial", [*D[:4], 0.0]),
        ([*D, 0.01, 0.02, 0.03], "rational_polynomial", [*D, 0.01, 0.02, 0.03]),
        ([*D, 0.01, 0.0, 0.0], "rational_polynomial", [*D, 0.01, 0.0, 0.0]),
        ([*D, 0], "plumb_bob", D),
    ],
)
def test_coefficients_that_are_certain(given, model, expected):
    """What stands for nothing is nothing; what remains is to the last bit what OpenCV makes of all
    of it."""
    found = coefficients(given, model)
    assert list(found) == expected
    if len(given) in (4, 5, 8, 12, 14):
        points = np.array([[0.3, -0.2, 1.0], [-0.4, 0.25, 1.0], [0.5, 0.37, 1.0]])
        matrix_ = np.reshape(K, (3, 3))
        both = [
            cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix_, np.array(d))[0]
            for d in (given, found)
        ]
        assert np.allclose(*both, rtol=0.0, atol=1e-9)


def test_rational_polynomial_of_zeros_is_a_pinhole(wrong_input):
    for zeros in (5, 8, 12, 14):
        assert camera_of_matrix(640, 480, K, [0.0] * zeros, "rational_polynomial") == PinholeCamera(
            640, 480, 600.0, 600.0, 319.5, 239.5
        )
    wrong_input("Cameras", "rational_polynomial with zeros, of any length", "read right")


def test_a_rational_polynomial_comes_through_camera_info():
    camera = PinholeCamera(640, 480, 600.0, 601.0, 320.0, 240.0, (*D, 0.01, 0.02, 0.03))
    info = conversions.info_from_camera(camera, 1.0, "c")
    assert (
        info.distortion_model == "rational_polynomial"
        and conversions.camera_from_info(info) == camera
    )
    assert camera.undistorted().distortion == (0.0,) * 5


@pytest.mark.parametrize(
    "width, height, fx, fy, cx, cy, rare",
    [
        (640, 480, 600.0, 600.0, 319.5, 239.5, ""),
        (80, 60, 75.0, 75.0, 39.5, 29.5, ""),
        (3, 2, 2.0, 2.0, 1.0, 0.5, ""),
        (4000, 3000, 3000.0, 3000.0, 2010.0, 1480.0, ""),
        (
            640,
            480,
            12800.0,
            12800.0,
            319.5,
            239.5,
            "20 times the picture's larger side",
        ),  # a telephoto
        # squeezed
        (640, 480, 120.0, 120.0, 319.5, 239.5, "0.188 times"),
        (640, 480, 600.0, 800.0, 319.5, 239.5, "fy 800"),
        (640, 480, 600.0, 1200.0, 319.5, 239.5, "fy 1200"),  # an anamorphic lens
        (640, 480, 600.0, 600.0, 130.0, 239.5, "far from the middle"),
        (640, 480, 600.0, 600.0, 319.5, 700.0, "far from the middle"),
        (640, 600, 600.0, 600.0, 319.5, 299.5, ""),
        (480, 640, 600.0, 600.0, 239.5, 319.5, ""),
    ],
)
def test_plausible_cameras_are_read_and_rare_ones_are_said(width, height, fx, fy, cx, cy, rare):
    camera = require_plausible(PinholeCamera(width, height, fx, fy, cx, cy))
    said = doubts(camera)
    assert (rare in "; ".join(said)) and bool(said) == bool(rare)


def test_a_camera_info_of_opencvs_calibration_without_a_size():
    with pytest.raises(GeometryError, match="size 0x0"):
        conversions.camera_from_info(CameraInfo(K=K, D=D, distortion_model="plumb_bob"))


def test_a_number_of_coefficients_that_opencv_does_not_take():
    with pytest.raises(GeometryError, match="3 distortion coefficients"):
        PinholeCamera(640, 480, 600.0, 600.0, 319.5, 239.5, (0.1, 0.2, 0.3))
