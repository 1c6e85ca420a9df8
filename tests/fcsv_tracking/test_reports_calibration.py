# SPDX-License-Identifier: Apache-2.0
"""Calibration from pictures as cameras and phones leave them: pixels as stored, broken files
named."""

import cv2
import numpy as np
import pytest
from support.spoilt_pictures import HEIC, spoil, with_orientation

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera
from fcsv_tracking.commands import calibrate_camera

CAMERA = PinholeCamera(640, 480, 600.0, 600.0, 345.0, 222.0)
_SQUARE = 40  # px of the drawn board


def board_picture(T_cam_board, shift=(0.0, 0.0)):
    """A board of 9x6 inner corners, squares of 25 mm, as CAMERA sees it."""
    squares = np.indices((7, 10)).sum(axis=0) % 2
    drawn = np.kron(squares, np.ones((_SQUARE, _SQUARE))) * 255
    drawn = cv2.copyMakeBorder(
        drawn.astype(np.uint8), 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255
    )
    scale, off = 0.025 / _SQUARE, 30 + _SQUARE - 0.5
    H_board = np.array([[scale, 0, -off * scale], [0, scale, -off * scale], [0, 0, 1.0]])
    H = (
        CAMERA.K
        @ np.column_stack([T_cam_board[:3, 0], T_cam_board[:3, 1], T_cam_board[:3, 3]])
        @ H_board
    )
    big = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]]) @ H
    image = cv2.warpPerspective(drawn, big, (2560, 1920), flags=cv2.INTER_AREA, borderValue=160)
    return cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)


def pictures(folder, count=12, orientation=lambda i: 1):
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(4)
    for i in range(count):
        x, y = 0.11 * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]][i % 4])
        T = transforms.from_xyz_rpy(
            [0, 0, 0], np.radians([*(25 * rng.uniform(-1, 1, 2)), 10 * rng.uniform(-1, 1)])
        )
        T[:3, 3] = np.array([x, 0.7 * y, 0.5]) - T[:3, :3] @ [0.1, 0.0625, 0.0]
        data = cv2.imencode(".jpg", board_picture(T), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        (folder / f"b{i:02d}.jpg").write_bytes(with_orientation(data, orientation(i)))
    return folder


def calibrated(folder, out, capsys):
    status = calibrate_camera.main([str(folder), "-o", str(out), "--board", "9x6"])
    printed = capsys.readouterr()
    return (
        status,
        printed.out + printed.err,
        read_camera(out / "camera.yaml")[1] if status == 0 else None,
    )


def assert_is_camera(camera):
    """To 1 %: JPEG's noise on a dozen boards."""
    assert camera.fx == pytest.approx(600.0, rel=0.01) and camera.fy == pytest.approx(
        600.0, rel=0.01
    )
    assert (camera.cx, camera.cy) == (pytest.approx(345.0, abs=6.0), pytest.approx(222.0, abs=6.0))


def test_reported_orientations(shared_data, tmp_path, capsys):
    status, said, camera = calibrated(
        shared_data / "reports" / "calibration_orientation", tmp_path / "out", capsys
    )
    assert status == 0, said
    assert_is_camera(camera)


def test_orientation_does_not_turn_what_is_calibrated(tmp_path, capsys, wrong_input):
    folder = pictures(tmp_path / "in", orientation=lambda i: (1, 3, 6, 8)[i % 4])
    status, said, camera = calibrated(folder, tmp_path / "out", capsys)
    assert status == 0 and (camera.width, camera.height) == (640, 480), said
    assert_is_camera(camera)
    wrong_input("Calibration", "board pictures with EXIF orientations", "read right")


def test_broken_board_pictures_are_named(tmp_path, capsys, wrong_input):
    folder = pictures(tmp_path / "in")
    whole = (folder / "b00.jpg").read_bytes()
    broken = {
        "x1": HEIC,
        "x2": spoil(whole, "cut at 50 %"),
        "x3": spoil(whole, "garbage in the middle"),
        "x4": b"",
    }
    (folder / "._b00.jpg").write_bytes(bytes(99))
    for name, data in broken.items():
        (folder / f"{name}.jpg").write_bytes(data)
    status, said, camera = calibrated(folder, tmp_path / "out", capsys)
    assert status == 0, said
    assert_is_camera(camera)
    assert "._b00" not in said
    for name, words in zip(broken, ("is HEIC", "ends in the middle", "is damaged", "is empty")):
        (line,) = [s for s in said.splitlines() if s.strip().startswith(f"left out: {name}:")]
        assert words in line
    words = "x2.jpg: ends in the middle of the picture"
    wrong_input("Calibration", "a board picture that is cut", "left out and named", words)
    (folder / "b00.jpg").write_bytes(b"")
    for i in range(1, 12):
        (folder / f"b{i:02d}.jpg").unlink()
    status, said, _ = calibrated(folder, tmp_path / "none", capsys)
    assert status == 2 and "is HEIC" in said
