# SPDX-License-Identifier: Apache-2.0
"""Axes and mounts of a tilting rig from simulated views of a board of tags, with noise of corners
and readings."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_sim.render.tag import tag_bitmap
from fcsv_tracking.commands import calibrate_tilting
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tilting.board import SideBoardView, TagBoard, read_views
from fcsv_tracking.tilting.calibrate import calibrate
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltAxis, load_rig
from fcsv_tracking.tilting.rig_file import write_rig

BOARD = TagBoard()
TICK_RAD = 2.0 * np.pi / 4096.0
STATIONS = [
    ([0.9, 0.1, 0.05], [5.0, 20.0, 0.0]),
    ([1.1, 0.05, 0.1], [-10.0, -25.0, 15.0]),
    ([0.8, 0.15, 0.2], [0.0, 5.0, -20.0]),
]
ANGLES_DEG = np.linspace(0.0, 30.0, 4)


@pytest.fixture(scope="module")
def told(root):
    return load_rig(root / "config/tilting/rig.yaml")


def built(rig, seed=0):
    """As nobody built it on purpose: millimetres and a degree off in axes and the right camera."""
    random = np.random.default_rng([seed, 7])
    sides = {}
    for side in SIDES:
        camera = getattr(rig, side)
        tilt = transforms.Rotation.from_rotvec(np.radians(random.normal(0.0, 1.0, 3)))
        place = tuple(np.add(camera.axis.xyz_m, random.normal(0.0, 0.002, 3)))
        sides[side] = replace(camera, axis=TiltAxis(place, tuple(tilt.apply(camera.axis.unit))))
    right = sides["right"]
    xyz_m, rpy_deg = (
        tuple(np.add(v, random.normal(0.0, s, 3)))
        for v, s in ((right.mount.xyz_m, 0.002), ((0, 0, 0), 1))
    )
    return replace(rig, left=sides["left"], right=replace(right, mount=Mount(xyz_m, rpy_deg)))


def board_pose(station):
    """T_rig_board, facing the rig."""
    xyz_m, rpy_deg = STATIONS[station]
    T = transforms.from_xyz_rpy(xyz_m, np.radians(rpy_deg))
    return T @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def views_of(true, stations=(0, 1, 2), angles_deg=ANGLES_DEG, noise_px=0.1, sides=SIDES, seed=0):
    """Every tag that is whole in the picture; angles as encoders read them."""
    random, views = np.random.default_rng([seed, 8]), []
    for s in stations:
        for deg in angles_deg:
            for side in sides:
                camera = getattr(true, side)
                angle = np.radians(deg) + random.normal(0.0, np.radians(0.03))
                T_cam_board = transforms.invert(camera.T_rig_cam(angle)) @ board_pose(s)
                points = np.concatenate(
                    [BOARD.corners(i) for i in range(BOARD.columns * BOARD.rows)]
                )
                uv = camera.camera.project(transforms.apply(T_cam_board, points))
                inside = (
                    ((uv > 3) & (uv < [636, 476])).all(axis=1).reshape(-1, 4).all(axis=1).repeat(4)
                )
                if inside.sum() < 16:
                    continue
                uv = uv[inside] + random.normal(0.0, noise_px, (int(inside.sum()), 2))
                read = np.round(angle / TICK_RAD) * TICK_RAD
                views.append(
                    SideBoardView(
                        str(s),
                        side,
                        float(read),
                        camera.camera.normalize(uv),
                        points[inside],
                        601.8,
                    )
                )
    return views


def errors(found, true):
    """Largest rotation (deg) and position error (m) of the right camera against the left one over
    the angles."""
    worst = np.zeros(2)
    for left in (0.0, 0.25, 0.5):
        for right in (0.0, 0.25, 0.5):
            a, b = (r.T_left_right(TiltAngles(left, right)) for r in (found, true))
            worst = np.maximum(
                worst, [np.degrees(transforms.rotation_angle(a, b)), np.abs(a - b)[:3, 3].max()]
            )
    return worst


def test_it_finds_what_was_built_and_says_how_well(told):
    true = built(told)
    before = errors(told, true)
    found = calibrate(told, views_of(true))
    rotation_deg, position_m = errors(found.rig, true)
    assert before[0] > 1.0 and before[1] > 0.002
    known = found.rig.known
    # three axes, nine places
    assert rotation_deg < 4.0 * known.rotation_deg and position_m < 4.0 * known.position_m
    # what config/tilting/rig.yaml takes for granted
    assert known.rotation_deg < 0.05 and known.position_m < 0.0005
    assert found.rms_px == pytest.approx(0.1, rel=0.1) and found.rejected == 0


def test_its_standard_deviations_are_those_of_its_errors(told):
    """Four rigs: squared errors over variances of six numbers at one pair of angles; the mean is 6,
    its sigma 1.7."""
    chi2 = []
    for seed in range(4):
        true = built(told, seed)
        found = calibrate(told, views_of(true, seed=seed))
        at = TiltAngles(0.3, 0.3)
        T, M = (r.T_left_right(at) for r in (found.rig, true))
        turn = transforms.Rotation.from_matrix(M[:3, :3] @ T[:3, :3].T).as_rotvec()
        # ``known`` is the worst of the limits' corners: errors may be smaller, never larger
        sigma = np.repeat([np.radians(found.rig.known.rotation_deg), found.rig.known.position_m], 3)
        chi2.append(float(np.sum(np.square(np.concatenate([turn, M[:3, 3] - T[:3, 3]]) / sigma))))
    assert 0.3 < np.mean(chi2) < 6.0 + 4.0 * np.sqrt(12.0 / 4.0), chi2


def test_one_servo_for_both_and_one_wrong_tag(told):
    geared = replace(told, right=replace(told.right, servo=None))
    true = built(geared, 3)
    views = views_of(true)
    bad = views[4].corners_normalized.copy()
    bad[:4] += 0.05  # 30 px: a tag that was pasted elsewhere
    views[4] = replace(views[4], corners_normalized=bad)
    found = calibrate(geared, views)
    same = [
        np.subtract(r.T_left_right(TiltAngles(a, a)), true.T_left_right(TiltAngles(a, a)))
        for a in (0.0, 0.25, 0.5)
        for r in (found.rig,)
    ]
    assert found.rejected == 4 and np.abs(same).max() < 2e-3


@pytest.mark.parametrize(
    "change, words",
    [
        ({"sides": ("left",)}, "the right camera sees the board in 0 pictures"),
        ({"angles_deg": np.linspace(5.0, 9.0, 4)}, "angles span 4"),
        ({"stations": (0,), "angles_deg": ANGLES_DEG[:3]}, "in 3 pictures, 6 are needed"),
        ({"noise_px": 8.0}, "only known to"),
    ],
)
def test_what_cannot_be_told_is_refused(told, change, words):
    with pytest.raises(CalibrationRefused, match=words):
        calibrate(told, views_of(built(told), **change))


def test_cameras_that_never_see_one_board_are_refused(told):
    true = built(told)
    views = views_of(true, (0, 2), sides=("left",)) + views_of(
        true, (1,), np.arange(0, 36, 5), sides=("right",)
    )
    with pytest.raises(CalibrationRefused, match="no station is seen by both"):
        calibrate(told, views)


def picture(T_cam_board, camera):
    """The board's tags on grey, drawn three times as large and averaged."""
    big = np.full((camera.height * 3, camera.width * 3), 110, np.uint8)
    scale = np.array([[3.0, 0, 1.0], [0, 3.0, 1.0], [0, 0, 1.0]])
    for i in range(BOARD.columns * BOARD.rows):
        bits = cv2.resize(
            (tag_bitmap(BOARD.first_id + i) * 255).astype(np.uint8),
            (200, 200),
            interpolation=cv2.INTER_NEAREST,
        )
        edge_m, at = BOARD.size_m / 160, BOARD.corners(BOARD.first_id + i).mean(axis=0)
        A = np.array(
            [[edge_m, 0, at[0] - 99.5 * edge_m], [0, edge_m, at[1] - 99.5 * edge_m], [0, 0, 1.0]]
        )
        H = scale @ camera.K @ T_cam_board[:3, [0, 1, 3]] @ A
        cv2.warpPerspective(
            bits,
            H,
            big.shape[::-1],
            dst=big,
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
    return cv2.resize(big, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def test_the_command_from_pictures_to_a_file(told, root, tmp_path, capsys):
    true, lines = built(told, 5), ["picture,station,side,angle_deg"]
    for s in (0, 1):
        for deg in (0.0, 12.0, 24.0):
            for side in SIDES:
                camera, name = getattr(true, side), f"{s}_{side}_{deg:g}.png"
                T_cam_board = transforms.invert(camera.T_rig_cam(np.radians(deg))) @ board_pose(s)
                cv2.imwrite(str(tmp_path / name), picture(T_cam_board, camera.camera))
                lines.append(f"{name},{s},{side},{deg}")
    (tmp_path / "views.csv").write_text("\n".join(lines))
    rig_file, out = str(root / "config/tilting/rig.yaml"), tmp_path / "found" / "rig.yaml"
    assert calibrate_tilting.main([rig_file, str(tmp_path), "-o", str(out)]) == 0
    assert "12 views" in capsys.readouterr().out
    rotation_deg, position_m = errors(load_rig(out), true)
    assert rotation_deg < 0.1 and position_m < 0.001  # TiltRules accepts no more
    for text, words in (
        ("picture,side", "line 1"),
        ("\n".join([*lines, "none.png,0,left,3"]), "line 14"),
        ("\n".join([*lines, f"{name},0,middle,3"]), "side 'middle'"),
        ("\n".join([*lines, f"{name},0,left,x"]), "angle 'x'"),
    ):
        (tmp_path / "views.csv").write_text(text)
        assert (
            calibrate_tilting.main([rig_file, str(tmp_path), "-o", str(tmp_path / "none.yaml")])
            == 2
        )
        assert words in capsys.readouterr().err and not (tmp_path / "none.yaml").exists()


def test_a_file_reads_back_as_it_was_written(told, tmp_path):
    for rig in (told, replace(told, right=replace(told.right, servo=None))):
        assert write_rig(tmp_path / "rig.yaml", rig, "test") == rig


def test_no_picture_list_no_calibration(told, tmp_path):
    with pytest.raises(CalibrationRefused, match=r"views.csv: does not exist"):
        read_views(tmp_path, told, BOARD)
