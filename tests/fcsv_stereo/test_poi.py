# SPDX-License-Identifier: Apache-2.0
"""Points of interest (6.7): what a box holds, what the report says of it, and what a bad file is
told."""

import json

import cv2
import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, given, photograph, true_depth

from fcsv_geometry import transforms
from fcsv_geometry.errors import ConfigError
from fcsv_stereo import cli
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluating.poi import PointOfInterest, load_points, sample
from fcsv_stereo.thesis import ThesisOptions, map_thesis
from fcsv_stereo.thesis.matchers import DisparityWindow


def quiet(*_):
    pass


def test_a_box_has_the_pixels_it_says():
    image = np.arange(240 * 320).reshape(240, 320)
    box = PointOfInterest("a", 159.5, 119.5).box(image)
    assert box.shape == (30, 160) and box[0, 0] == image[105, 80] and box[-1, -1] == image[134, 239]
    assert PointOfInterest("corner", 79.5, 14.5).box(image)[0, 0] == 0
    for u, v in ((79, 14.5), (240.5, 119.5), (159.5, 225.5), (159.5, 13.0)):
        with pytest.raises(InputError, match="'out'"):
            PointOfInterest("out", u, v).box(image)


def test_depth_and_match_rate_of_each_configuration():
    """On the near wall (12 m) and the far one (20 m); 2.12 for one pixel bounds the median."""
    result = map_thesis(
        given(((0, -0.8, 0), "horizontal"), ((0, 0, 1.2), "vertical")),
        ThesisOptions(window=DisparityWindow(4, 200)),
        quiet,
    )
    truth = true_depth(result.reference.T_home_cam)
    points = [
        PointOfInterest("near", 159.5, 119.5, 60, 30),
        PointOfInterest("far", 250, 40, 60, 30, truth_m=20.0),
    ]
    near, far = sample(result, points, truth)
    assert near.truth_m == pytest.approx(12.0, rel=0.02) and far.truth_m == 20.0
    for found, baselines in ((near, (0.8, 1.2)), (far, (0.8, 1.2))):
        for s, b in zip(found.samples, baselines):
            assert s.match_rate > 0.8 and len(s.depths_m) == round(s.match_rate * 1800)
            # walls slant
            assert (
                abs(s.percentiles_m[2] - found.truth_m) < found.truth_m**2 / (b * CAMERA.fx) + 0.3
            )
    json.dumps(near.to_dict(), allow_nan=False)


def model(folder):
    """The synthetic pair as posed photographs."""
    (folder / "images").mkdir(parents=True)
    lines = []
    for i, xyz in enumerate(([0, 0, 0], [0, -0.8, 0]), 1):
        T = camera_pose(xyz)
        cv2.imwrite(str(folder / f"images/{i}.png"), photograph(T)[..., ::-1])
        T_cam_home = transforms.invert(T)
        x, y, z, w = transforms.quaternion_xyzw(T_cam_home)
        lines.append(f"{i} {w} {x} {y} {z} {' '.join(map(str, T_cam_home[:3, 3]))} 1 {i}.png\n\n")
    (folder / "images.txt").write_text("".join(lines))
    c = CAMERA
    (folder / "cameras.txt").write_text(
        f"1 PINHOLE {c.width} {c.height} {c.fx} {c.fy} {c.cx + 0.5} {c.cy + 0.5}\n"
    )
    return folder


def test_the_report_shows_them(tmp_path, capsys):
    """From a file on the command line, and from poi.yaml beside the pictures."""
    folder = model(tmp_path / "model")
    text = (
        "points_of_interest:\n  - {name: A, u_px: 160, v_px: 120}\n"
        "  - {name: B, u_px: 240, v_px: 30, truth_m: 20.0}\n"
    )
    (folder / "poi.yaml").write_text(text)
    (tmp_path / "other.yaml").write_text(text.replace("name: A", "name: C"))
    for more, names in (([], ["A", "B"]), (["--poi", str(tmp_path / "other.yaml")], ["C", "B"])):
        command = [
            str(folder),
            "-o",
            str(tmp_path / "map"),
            "--method",
            "thesis",
            "--error",
            "10m",
            *more,
        ]
        assert cli.main(command) == 0, capsys.readouterr().err
        found = json.loads((tmp_path / "map/report.json").read_text())["points_of_interest"]
        assert [p["name"] for p in found] == names and found[1]["truth_m"] == 20.0
        assert found[0]["configurations"][0]["match_rate"] > 0.5
        assert "Points of interest" in (tmp_path / "map/report.html").read_text()


@pytest.mark.parametrize(
    "text, words",
    [
        ("points_of_interest: []", "empty"),
        ("points: []", "unknown key 'points'"),
        ("points_of_interest", "mapping"),
        (
            "points_of_interest:\n - {name: A, u_px: 1, v_px: 1, depth: 3}",
            "unknown key 'points_of_interest[0].depth'",
        ),
        ("points_of_interest:\n - {name: A, u_px: 1}", "'points_of_interest[0].v_px' is missing"),
        ("points_of_interest:\n - {name: A, u_px: .nan, v_px: 1}", "finite"),
        ("points_of_interest:\n - {name: A, u_px: 1, v_px: 1, truth_m: -4.0}", "truth_m"),
        ("points_of_interest:\n - {name: A, u_px: 1, v_px: 1, width_px: 0}", "no pixel"),
        (
            "points_of_interest:\n - {name: A, u_px: 1, v_px: 1}\n - {name: A, u_px: 2, v_px: 2}",
            "two are named 'A'",
        ),
    ],
)
def test_bad_files_are_named(text, words, tmp_path):
    (tmp_path / "poi.yaml").write_text(text)
    with pytest.raises(ConfigError) as error:
        load_points(tmp_path / "poi.yaml")
    assert words in str(error.value) and "poi.yaml" in str(error.value)


def test_a_box_outside_the_picture_leaves_no_map(tmp_path, capsys):
    folder = model(tmp_path / "model")
    (tmp_path / "p.yaml").write_text("points_of_interest:\n - {name: A, u_px: 10, v_px: 10}\n")
    command = [str(folder), "-o", str(tmp_path / "map"), "--method", "thesis", "--error", "10m"]
    assert cli.main([*command, "--poi", str(tmp_path / "p.yaml")]) == 2
    assert "'A'" in capsys.readouterr().err and not (tmp_path / "map").exists()
    assert cli.main([*command, "--poi", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err
