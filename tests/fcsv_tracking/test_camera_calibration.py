# SPDX-License-Identifier: Apache-2.0
"""calibrate_camera: real pictures of a chessboard, a simulated board with known truth, and what
must be refused."""

import shutil

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera, write_camera
from fcsv_geometry.errors import ConfigError
from fcsv_tracking.cameras.board import BoardView, Chessboard, find_board
from fcsv_tracking.cameras.intrinsics import calibrate_intrinsics
from fcsv_tracking.cameras.pictures import collect_views
from fcsv_tracking.cameras.stereo import calibrate_stereo
from fcsv_tracking.commands.calibrate_camera import main
from fcsv_tracking.errors import CameraCalibrationRefused

BOARD = Chessboard(9, 6, 0.025)
CAMERA = PinholeCamera(640, 480, 601.8, 603.1, 322.4, 237.9, (0.042, -0.085, 0.0006, -0.0004, 0.0))
NOISE_PX = 0.1


def board_pose(random, tilt_deg=35.0, aside_m=0.13):
    """T_cam_board: the board's middle somewhere in view, 0.3 to 0.55 m away, tilted."""
    tilt = np.radians(random.uniform(-tilt_deg, tilt_deg, 3))
    place = [*random.uniform(-aside_m, aside_m, 2), random.uniform(0.3, 0.55)]
    return transforms.from_xyz_rpy(place, tilt) @ transforms.from_xyz_rpy(
        -BOARD.points.mean(axis=0), np.zeros(3)
    )


def simulated_views(random, count, noise_px=NOISE_PX, T_other_cam=None, camera=CAMERA, **kwargs):
    """Views in which the whole board is in the picture; with T_other_cam pairs of such."""
    views = []
    while len(views) < count:
        T = board_pose(random, **kwargs)
        pair = []
        for T_side_cam in [np.eye(4)] + ([T_other_cam] if T_other_cam is not None else []):
            uv = camera.project(transforms.apply(T_side_cam @ T, BOARD.points))
            if np.isfinite(uv).all() and (uv > 3).all() and (uv < [636, 476]).all():
                pair.append(
                    BoardView(f"{len(views):02d}", uv + random.normal(0, noise_px, uv.shape))
                )
        if len(pair) == (2 if T_other_cam is not None else 1):
            views.append(pair)
    return list(zip(*views))


def test_the_simulated_camera_comes_back():
    """Within four of the standard deviations that the calibration itself gives (99.99 % each)."""
    (views,) = simulated_views(np.random.default_rng(1), 25)
    found = calibrate_intrinsics(views, BOARD, (640, 480))
    truth = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    errors = np.array([found.camera.fx, found.camera.fy, found.camera.cx, found.camera.cy]) - truth
    assert (np.abs(errors) < 4 * np.array(found.stds)).all(), (errors, found.stds)
    assert (np.array(found.stds) < 2.0).all() and not found.left_out
    # of a point: two coordinates
    assert found.rms_px == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.1)


def test_bad_views_are_named_and_left_out():
    (views,) = simulated_views(np.random.default_rng(2), 20)
    random = np.random.default_rng(3)
    bad = {"04", "11", "17"}
    views = [
        BoardView(v.name, v.corners_px + random.normal(0, 2.0 * (v.name in bad), (54, 2)))
        for v in views
    ]
    found = calibrate_intrinsics(views, BOARD, (640, 480))
    assert set(found.left_out) == bad and found.camera.fx == pytest.approx(CAMERA.fx, rel=0.005)


@pytest.mark.parametrize(
    "kwargs, count, word",
    [
        ({}, 5, "5 usable views"),
        ({"aside_m": 0.01, "tilt_deg": 10.0}, 20, "covers only .* of the picture"),
        ({"tilt_deg": 0.0}, 20, "tilt the board"),
    ],
)
def test_poor_sets_are_refused_with_the_reason(kwargs, count, word):
    (views,) = simulated_views(np.random.default_rng(4), count, **kwargs)
    if word.startswith("covers"):  # far away and in the middle: small everywhere
        views = [BoardView(v.name, (v.corners_px - [320, 240]) * 0.3 + [320, 240]) for v in views]
    with pytest.raises(CameraCalibrationRefused, match=word):
        calibrate_intrinsics(views, BOARD, (640, 480))


def test_another_boards_corners_are_refused():
    (views,) = simulated_views(np.random.default_rng(5), 12)
    mixed = [
        BoardView(v.name, v.corners_px[np.random.default_rng(i).permutation(54)])
        for i, v in enumerate(views)
    ]
    with pytest.raises(
        CameraCalibrationRefused, match="px off|usable views|no camera explains|focal length"
    ):
        calibrate_intrinsics(mixed, BOARD, (640, 480))


def test_stereo_with_turned_board_orders():
    """The detector may begin at either end of the board; every third right view begins at the
    other."""
    T_right_left = transforms.from_xyz_rpy([-0.0836, 0.001, 0.0005], [0.004, -0.008, 0.006])
    lefts, rights = simulated_views(np.random.default_rng(6), 15, T_other_cam=T_right_left)
    rights = [
        BoardView(v.name, v.corners_px[::-1] if i % 3 == 0 else v.corners_px)
        for i, v in enumerate(rights)
    ]
    stereo = calibrate_stereo(lefts, rights, BOARD, CAMERA, CAMERA)
    # 0.1 px of noise at 0.4 m: 0.07 mm a corner
    assert stereo.baseline_m == pytest.approx(0.0836, rel=0.003)
    assert transforms.rotation_angle(stereo.T_right_left, T_right_left) < np.radians(0.05)
    assert not stereo.left_out


def test_a_pair_of_two_moments_is_named_and_left_out():
    T_right_left = transforms.from_xyz_rpy([-0.0836, 0.0, 0.0], [0.0, 0.0, 0.0])
    lefts, rights = simulated_views(np.random.default_rng(7), 12, T_other_cam=T_right_left)
    rights = [BoardView(v.name, v.corners_px + (8.0 if v.name == "05" else 0.0)) for v in rights]
    assert set(calibrate_stereo(lefts, rights, BOARD, CAMERA, CAMERA).left_out) == {"05"}


def test_pictures_without_a_board_or_of_another_size_are_named():
    board = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((40, 40))) * 255
    picture = cv2.copyMakeBorder(
        board.astype(np.uint8), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255
    )
    pictures = [("a", picture), ("b", picture), ("half", picture[:, :250]), ("none", None)]
    pictures.append(
        ("small", cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    )
    found = collect_views(pictures, BOARD)
    assert [v.name for v in found.views] == ["a", "b"] and set(found.left_out) == {
        "half",
        "none",
        "small",
    }
    assert "no whole board" in found.left_out["half"] and "is 260x200" in found.left_out["small"]
    # drawn at whole squares: the corner lies between two pixels
    assert np.allclose(found.views[0].corners_px.min(axis=0), [99.5, 99.5], atol=0.05)
    with pytest.raises(CameraCalibrationRefused, match="check --board"):
        collect_views([("c", np.full((480, 640), 128, np.uint8))], BOARD)
    assert find_board(picture, Chessboard(7, 5)) is None


def test_file_round_trip(tmp_path):
    write_camera(tmp_path / "camera.yaml", "uav1", CAMERA)
    assert read_camera(tmp_path / "camera.yaml") == ("uav1", CAMERA)
    (tmp_path / "broken.yaml").write_text(
        (tmp_path / "camera.yaml").read_text().replace("camera_matrix", "matrix")
    )
    with pytest.raises(ConfigError, match="'camera_matrix' is missing"):
        read_camera(tmp_path / "broken.yaml")


def test_the_parsers_of_ros_read_the_file(tmp_path):
    parsers = pytest.importorskip(
        "camera_calibration_parsers", reason="python3-camera-calibration-parsers"
    )
    write_camera(tmp_path / "camera.yaml", "uav1", CAMERA)
    name, info = parsers.readCalibration(str(tmp_path / "camera.yaml"))
    assert (name, info.width, info.height, info.distortion_model) == ("uav1", 640, 480, "plumb_bob")
    assert np.allclose(np.reshape(info.K, (3, 3)), CAMERA.K) and np.allclose(
        info.D, CAMERA.distortion
    )
    assert np.allclose(np.reshape(info.P, (3, 4))[:, :3], CAMERA.K)


class TestPhotographs:
    """OpenCV's pairs (see the data's README): left RMS 0.41 px, f about 536 px, baseline 83.6 mm by
    its authors."""

    def test_figures_of_the_authors(self, shared_data, tmp_path, capsys):
        sides = ["--prefix", "left", "--right-prefix", "right"]
        assert main([str(shared_data / "chessboard"), "-o", str(tmp_path), *sides]) == 0
        said = capsys.readouterr().out
        rms_px = float(said.split("rms ")[1].split(" px")[0])
        baseline_mm = float(said.split("baseline ")[1].split(" mm")[0])
        _, left = read_camera(tmp_path / "left.yaml")
        assert rms_px <= 0.45 and baseline_mm == pytest.approx(83.6, rel=0.01)
        assert left.fx == pytest.approx(536.0, rel=0.01) and left.fy == pytest.approx(
            536.0, rel=0.01
        )
        picture = cv2.imread(str(tmp_path / "left_coverage.png"))
        assert picture is not None and picture.std() > 10

    def test_too_few_are_refused_in_one_line(self, shared_data, tmp_path, capsys):
        for number in (1, 2, 3):
            shutil.copy(shared_data / "chessboard" / f"left0{number}.jpg", tmp_path)
        assert main([str(tmp_path), "-o", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err.strip()
        assert (
            "3 usable views" in error and error.count("\n") == 0 and not (tmp_path / "out").exists()
        )

    def test_from_a_bag(self, shared_data, tmp_path, capsys):
        rosbag = pytest.importorskip("rosbag")
        import rospy

        from fcsv_geometry.ros import conversions

        with rosbag.Bag(str(tmp_path / "board.bag"), "w") as bag:
            for i, path in enumerate(sorted((shared_data / "chessboard").glob("left*.jpg"))):
                for k in range(2):  # a video: the second picture says nothing new
                    stamp_s = 100.0 + i + 0.1 * k
                    message = conversions.array_to_image(
                        cv2.imread(str(path)), "bgr8", stamp_s, "camera"
                    )
                    bag.write("/uav1/camera/color/image_raw", message, rospy.Time.from_sec(stamp_s))
        assert (
            main([str(tmp_path / "board.bag"), "-o", str(tmp_path / "out"), "--name", "uav1"]) == 0
        )
        assert "over 13 views" in capsys.readouterr().out
        assert read_camera(tmp_path / "out" / "uav1.yaml")[1].fx == pytest.approx(536.0, rel=0.01)
        assert (
            main([str(tmp_path / "board.bag"), "-o", str(tmp_path / "out"), "--topic", "/else"])
            == 2
        )
        assert "/uav1/camera/color/image_raw" in capsys.readouterr().err


def test_pictures_of_two_cameras_are_not_one_camera(tmp_path, capsys):
    for name in ("left01.png", "right01.png", "left02.png", "right02.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((40, 60), np.uint8))
    assert main([str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert (
        "two cameras" in (said := capsys.readouterr().err)
        and "--prefix left --right-prefix right" in said
    )
    # of one, and without a board
    assert main([str(tmp_path), "-o", str(tmp_path / "out"), "--prefix", "left"]) == 2
    assert "none of 2 pictures shows a board" in capsys.readouterr().err


def test_where_nothing_can_be_written_is_said_before_the_work(tmp_path, capsys):
    (tmp_path / "out").write_text("a file")
    assert main([str(tmp_path / "nowhere"), "-o", str(tmp_path / "out")]) == 2
    assert "out: a file stands there" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, word",
    [
        (["nowhere"], "neither a folder"),
        (["."], "no pictures"),
        ([".", "--board", "9by6"], "COLUMNSxROWS"),
        ([".", "--square-m", "0"], "square_m"),
    ],
)
def test_wrong_arguments_end_in_one_line(arguments, word, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*arguments, "-o", "out"]) == 2
    assert word in capsys.readouterr().err
