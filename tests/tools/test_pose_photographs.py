# SPDX-License-Identifier: Apache-2.0
"""tools/pose_photographs.py with a program in COLMAP's place that writes down what it is asked, and answers."""

import json
import os
import stat
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from fcsv_stereo.colmap import read_photographs

ROOT = Path(__file__).resolve().parents[2]
DOUBLE = """#!{python}
import json, os, sys
from pathlib import Path
step, words = sys.argv[1], sys.argv[2:]
given = dict(zip(words[::2], words[1::2]))
with open(os.environ["ASKED"], "a") as log:
    log.write(json.dumps([step, given]) + "\\n")
if step == os.environ.get("FAILS"):
    print("E1125 the alignment\\nfailed")
    sys.exit(1)
if step == "mapper" and os.environ.get("FAILS") != "nothing":
    for name, size in (("0", 10), ("1", 500)):
        (Path(given["--output_path"]) / name).mkdir()
        (Path(given["--output_path"]) / name / "images.bin").write_bytes(b"x" * size)
if step == "model_aligner":
    (Path(given["--output_path"]) / "images.bin").write_bytes(b"x")
if step == "model_converter":
    out = Path(given["--output_path"])
    (out / "cameras.txt").write_text("1 OPENCV 64 48 60 60 32 24 0 0 0 0\\n")
    (out / "images.txt").write_text("# a\\n1 1 0 0 0 0 0 0 1 a.png\\n1 2 -1\\n2 1 0 0 0 -1 0 0 1 b c.png\\n\\n")
"""


@pytest.fixture
def photos(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    (tmp_path / "bin").mkdir()
    colmap = tmp_path / "bin" / "colmap"
    colmap.write_text(DOUBLE.format(python=sys.executable))
    colmap.chmod(colmap.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("ASKED", str(tmp_path / "asked"))
    folder = tmp_path / "photos"
    (folder / "images").mkdir(parents=True)
    for name in ("a.png", "b c.png", "d.png"):
        cv2.imwrite(str(folder / "images" / name), np.zeros((48, 64, 3), np.uint8))
    return folder


def asked(photos):
    return [json.loads(line) for line in (photos.parent / "asked").read_text().splitlines()]


def run(*words):
    import pose_photographs

    return pose_photographs.main([str(w) for w in words])


def test_photographs_with_gps_become_an_input_of_map(photos, capsys):
    assert run(photos, "--gps", "--error-m", 2) == 0
    said = capsys.readouterr().out
    assert "2 of 3 pictures have a pose" in said and "no pose: d.png" in said and "rosrun fcsv_stereo map" in said
    steps = asked(photos)
    assert [s for s, _ in steps] == [
        "feature_extractor",
        "exhaustive_matcher",
        "mapper",
        "model_aligner",
        "model_converter",
    ]
    aligner = steps[3][1]
    assert aligner["--input_path"].endswith("/1"), "the largest model is taken"
    assert (aligner["--ref_is_gps"], aligner["--alignment_type"]) == ("1", "enu")
    assert float(aligner["--robust_alignment_max_error"]) == 2
    (photos / "images" / "d.png").unlink()  # as it says
    read = read_photographs(photos)
    assert [c.others[0].name for c in read.configurations] == ["b c.png"]


def test_known_places_take_the_place_of_gps(photos, tmp_path):
    places = tmp_path / "places.txt"
    places.write_text("a.png 0 0 0\nb c.png 1 0 0\nd.png 2 0 0\n")
    assert run(photos, "--places", places) == 0
    aligner = asked(photos)[3][1]
    assert (aligner["--ref_images_path"], aligner["--ref_is_gps"]) == (str(places), "0")


@pytest.mark.parametrize("fails, said", [
    ("model_aligner", "status 1: failed; is there GPS in at least three pictures"),
    ("mapper", "colmap mapper ended with status 1"),
    ("nothing", "COLMAP found no poses"),
])  # fmt: skip
def test_what_fails_is_told_and_leaves_the_folder_as_it_was(photos, monkeypatch, capsys, fails, said):
    (photos / "images.txt").write_text("from before")
    monkeypatch.setenv("FAILS", fails)
    assert run(photos, "--gps") == 2
    assert said in capsys.readouterr().err
    assert (photos / "images.txt").read_text() == "from before" and not (photos / "cameras.txt").exists()


def test_without_pictures_places_or_colmap_nothing_is_begun(photos, monkeypatch, tmp_path, capsys):
    assert run(photos, "--places", tmp_path / "absent.txt") == 2
    assert "absent.txt is not there" in capsys.readouterr().err
    assert run(tmp_path, "--gps") == 2
    assert "put the pictures into it" in capsys.readouterr().err
    (photos / "images" / "d.png").unlink()
    assert run(photos, "--gps") == 2
    assert "holds 2 pictures" in capsys.readouterr().err
    cv2.imwrite(str(photos / "images" / "e.png"), np.zeros((48, 64, 3), np.uint8))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run(photos, "--gps") == 2
    assert "apt install colmap" in capsys.readouterr().err
    assert not (tmp_path / "asked").exists()
