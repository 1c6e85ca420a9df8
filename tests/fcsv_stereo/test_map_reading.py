# SPDX-License-Identifier: Apache-2.0
"""A map's folder that programs go on from: what cannot be a map is refused by file and field."""

import json

import numpy as np
import pytest

from fcsv_stereo.errors import InputError
from fcsv_stereo.map_files.reading import read_map_folder

SHAPE = (48, 64)
CAMERA = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}


@pytest.fixture
def folder(tmp_path):
    for name in ("depth", "sigma"):
        np.save(tmp_path / f"{name}.npy", np.ones(SHAPE, np.float32))
    np.save(tmp_path / "kind.npy", np.ones(SHAPE, np.uint8))
    write(tmp_path, {})
    return tmp_path


def write(folder, changed):
    reference = {**CAMERA, "T_home_cam": np.eye(4).tolist(), **changed}
    (folder / "report.json").write_text(json.dumps({"reference": reference}))


def test_a_map_is_read(folder):
    read = read_map_folder(folder)
    assert read.K[0, 0] == 60.0 and read.depth.shape == SHAPE and np.isnan(read.stamp_s)


@pytest.mark.parametrize(
    "field, value",
    [
        ("fx", 0.0),
        ("fx", -600.0),
        ("fy", 1e300),
        ("fy", 1e-300),
        ("fx", float("nan")),
        ("fx", None),
        ("stamp_s", "now"),
        ("cx", 1e9),
        ("cy", float("inf")),
        ("width", 640),
        ("height", 64),
    ],
)
def test_a_camera_that_is_none_is_refused_by_its_field(folder, field, value):
    """A focal length of 0 was divided by, one below 0 mirrored the map."""
    write(folder, {field: value})
    with pytest.raises(InputError, match=rf"report.json: reference.{field}: "):
        read_map_folder(folder)


@pytest.mark.parametrize(
    "name, values",
    [
        ("depth", np.ones(SHAPE, complex)),
        ("sigma", np.full(SHAPE, "1.0")),
        ("kind", np.ones(SHAPE[::-1], np.uint8)),
        ("depth", np.ones(SHAPE[0])),
        ("depth", np.ones((0, 64))),
    ],
)
def test_an_array_that_is_no_picture_is_refused_by_its_file(folder, name, values):
    np.save(folder / f"{name}.npy", values)
    with pytest.raises(InputError, match=r"is not a map of this program \(\w+.npy: "):
        read_map_folder(folder)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"reference": {"fx": ' + "9" * 400 + "}}", "[]", '{"reference": null}']
)
def test_a_report_that_is_none_is_one_line(folder, text):
    (folder / "report.json").write_text(text)
    with pytest.raises(InputError, match="is not a map of this program") as caught:
        read_map_folder(folder)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
