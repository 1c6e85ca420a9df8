# SPDX-License-Identifier: Apache-2.0
"""Posed photographs: real ones against each other and against truth, and what is wrong with bad
ones."""

import subprocess

import cv2
import numpy as np
import pytest
from support.photographs import fountain, model, motorcycle

from fcsv_stereo.errors import InputError
from fcsv_stereo.posed import colmap
from fcsv_stereo.thesis import ThesisOptions, map_thesis


def quiet(*_):
    pass


@pytest.mark.slow
def test_two_independent_pairs_of_the_fountain_agree(shared_data, tmp_path):
    """Measured 2026-11-24: both see 75 % of the pixels, of which 90.6 % are within 2 %; 1.44
    million points."""
    folder = fountain(shared_data, tmp_path / "model", ["0005.jpg", "0004.jpg", "0006.jpg"])
    result = map_thesis(colmap.read_photographs(folder, "0005.jpg"), ThesisOptions(), quiet)
    a, b = (p.depth for p in result.pairs)
    both = np.isfinite(a) & np.isfinite(b)
    assert both.mean() > 0.72
    assert (np.abs(a[both] / b[both] - 1) < 0.02).mean() > 0.88
    assert result.points > 1_350_000 and 6.0 < np.nanmedian(result.depth) < 12.0


def test_motorcycle_depth(shared_data, tmp_path):
    """Metric depth within 3 % of truth, of the pixels that have truth: measured 2026-11-24, 79.7
    %."""
    disparity, truth, f, baseline_m, doffs = motorcycle(shared_data, tmp_path)
    depth = map_thesis(colmap.read_photographs(tmp_path), ThesisOptions(), quiet).depth
    relative = np.abs(depth[truth] / (f * baseline_m / (disparity[truth] + doffs)) - 1)
    assert (relative < 0.03).mean() >= 0.78


def test_pixel_origin_axis_and_reference(tmp_path):
    given = colmap.read_photographs(model(tmp_path))
    (c,) = given.configurations
    # COLMAP's centres are at 0.5
    assert (c.references[0].camera.cx, c.references[0].camera.cy) == (31.5, 23.5)
    assert c.configuration.axis == "horizontal" and c.configuration.baseline_m == pytest.approx(1.0)
    swapped = colmap.read_photographs(tmp_path, "b.png")
    assert swapped.configurations[0].references[0].name == "b.png"
    images = "# poses\n1 1 0 0 0 0 0 0 1 a.png\n1.0 2.0 -1\n2 1 0 0 0 0.1 0.5 0 1 b.png\n\n"
    assert (
        colmap.read_photographs(model(tmp_path, images=images)).configurations[0].configuration.axis
        == "vertical"
    )


@pytest.mark.parametrize(
    "change, words",
    [
        ({"images": "1 1 0 0 0 0 0 0 1 a.png\n\n"}, ["images.txt", "holds 1 picture"]),
        (
            {"images": "1 1 0 0 0 0 0 0 1 a.png\n\n2 nan 0 0 0 -1 0 0 1 b.png\n\n"},
            ["images.txt, line 3", "finite"],
        ),
        (
            {"images": "1 1 0 0 0 0 0 0 1 a.png\n\n2 0 0 0 0 -1 0 0 1 b.png\n\n"},
            ["line 3", "length 0"],
        ),
        ({"images": "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -1 0 0 9 b.png\n\n"}, ["camera 9"]),
        ({"images": "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0 0 0 1 b.png\n\n"}, ["no baseline"]),
        ({"sizes": ((64, 48), (32, 24))}, ["b.png", "32x24", "64x48"]),
        ({"cameras": "1 FISHEYE 64 48 60\n"}, ["cameras.txt, line 1", "FISHEYE"]),
        ({"cameras": "1 PINHOLE 64 48 60\n"}, ["cameras.txt, line 1", "4 parameters"]),
        ({"cameras": "1 PINHOLE 64 48 -5 60 32 24\n"}, ["cameras.txt, line 1", "not a camera"]),
    ],
)
def test_bad_models_are_named_in_one_line(tmp_path, change, words):
    folder = model(tmp_path, **change)
    if "holds 1" in words[-1]:
        (folder / "images" / "b.png").unlink()
    with pytest.raises(InputError) as error:
        colmap.read_photographs(folder)
    assert "\n" not in str(error.value) and all(w in str(error.value) for w in words), str(
        error.value
    )


def test_photographs_without_poses(tmp_path):
    folder = model(tmp_path)
    (folder / "images.txt").unlink()
    with pytest.raises(InputError, match="without poses"):
        colmap.read_photographs(folder)
    model(tmp_path)
    cv2.imwrite(str(folder / "images" / "c.png"), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(InputError, match=r"c\.png: has no pose"):
        colmap.read_photographs(folder)


def test_the_command_says_one_line_and_writes_nothing(tmp_path):
    folder = model(tmp_path / "model")
    (folder / "images" / "a.png").write_bytes(b"no picture")
    command = ["rosrun", "fcsv_stereo", "map", str(folder), "-o", str(tmp_path / "out" / "map")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "a.png" in done.stderr
    assert not (tmp_path / "out" / "map").exists() and not list(tmp_path.glob("out/.*"))


def test_the_command_leaves_what_is_not_its_own(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.docx").write_text("precious")
    command = [
        "rosrun",
        "fcsv_stereo",
        "map",
        str(model(tmp_path / "model")),
        "-o",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (
        done.returncode == 2
        and "thesis.docx" in done.stderr
        and (tmp_path / "out" / "thesis.docx").exists()
    )


def turned_photograph(path, orientation, shape=(48, 64)):
    """A JPEG, bright above and dark below as stored, whose EXIF says that it is to be shown
    turned."""
    image = np.zeros((*shape, 3), np.uint8)
    image[: shape[0] // 2] = 255
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    tiff = (
        b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"
        + bytes([orientation, 0, 0, 0])
        + b"\0\0\0\0"
    )
    exif = b"Exif\0\0" + tiff
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:])


IMAGES = "1 1 0 0 0 0 0 0 1 a.jpg\n\n2 1 0 0 0 -1 0 0 1 b.png\n\n"


def test_pixels_are_those_that_the_poses_are_of(tmp_path):
    """COLMAP does not turn pictures; an orientation of 180 degrees turned the pixels and left the
    poses."""
    folder = model(tmp_path, images=IMAGES)
    (folder / "images" / "a.png").unlink()
    turned_photograph(folder / "images" / "a.jpg", 3)
    image = colmap.read_photographs(folder).configurations[0].references[0].image
    assert image[:20].mean() > 240 and image[-20:].mean() < 15


def test_a_picture_is_turned_where_the_camera_has_the_turned_size(tmp_path):
    folder = model(tmp_path, images=IMAGES)
    (folder / "images" / "a.png").unlink()
    turned_photograph(folder / "images" / "a.jpg", 6, shape=(64, 48))  # stored upright, shown lying
    image = colmap.read_photographs(folder).configurations[0].references[0].image
    assert image.shape[:2] == (48, 64) and image[:, -20:].mean() > 240 and image[:, :20].mean() < 15


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_picture_that_ends_early_is_named(tmp_path, suffix):
    folder = model(tmp_path, images=IMAGES.replace("a.jpg", f"a{suffix}"))
    noise = np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8)
    path = folder / "images" / f"a{suffix}"
    (folder / "images" / "a.png").unlink()
    whole = cv2.imencode(suffix, noise)[1].tobytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError, match=rf"a\{suffix}: ends in the middle"):
        colmap.read_photographs(folder)
    path.unlink()
    with pytest.raises(InputError, match=rf"a\{suffix} is missing"):
        colmap.read_photographs(folder)
