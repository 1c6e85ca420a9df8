# SPDX-License-Identifier: Apache-2.0
"""Sessions after public bug reports (../shared/data/reports): they are one session, each spoilt in
its own way."""

import shutil

import numpy as np
import pytest

from fcsv_stereo.errors import InputError
from fcsv_stereo.sessions import read_session

NONE = "topic /uav1/camera/color/camera_info: none of its 42 messages can be used: uav1.bag: "


@pytest.fixture
def report(shared_data, tmp_path):
    def copied(name):
        target = tmp_path / str(len(list(tmp_path.iterdir())))
        target.mkdir()
        for path in (shared_data / "reports" / f"session_{name}").iterdir():
            shutil.copyfile(path, target / path.name)  # without its mode: the reports are read-only
        return target

    return copied


def pictures(given):
    return {p.name: p for c in given.configurations for p in (*c.references, *c.others)}


@pytest.fixture
def right(report):
    """The report whose pictures and odometry are whole; its camera is that of all others'
    camera_info."""
    given = read_session(report("i_first_other_f"))
    found = pictures(given)
    assert len(found) == 8 and {round(p.camera.fx, 3) for p in found.values()} == {75.229}
    return found


def same_but(given, right, lost=0):
    found = pictures(given)
    assert len(found) == len(right) - lost and set(found) <= set(right)
    for name, p in found.items():
        assert np.array_equal(p.image, right[name].image) and p.camera == right[name].camera
        assert np.allclose(p.T_home_cam, right[name].T_home_cam, atol=1e-3)


@pytest.mark.parametrize(
    "name, words",
    [
        ("b02a_K_garbage", f"{NONE}focal length is 1e-310 px"),
        ("b03b_D3", f"{NONE}distortion D has 3 coefficients"),
    ],
)
def test_cameras_that_nobody_can_tell_are_refused_by_name(report, name, words):
    with pytest.raises(InputError) as error:
        read_session(report(name))
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "name, lost, words",
    [
        (
            "c01_odo_nan1",
            0,
            "topic /uav1/odometry/body: 1 message is left out: uav1.bag: pose is not finite",
        ),
        (
            "c05_odo_future60_1",
            0,
            "topic /uav1/odometry/body: 1 message is left out: its stamp is 60.0 s after",
        ),
        (
            "e_badone",
            1,
            "topic /uav1/camera/color/image_raw: 1 message is left out: uav1.bag: image has 13400 bytes",
        ),
        (
            "i_first_other_f",
            0,
            "topic /uav1/camera/color/camera_info: 1 message is left out: intrinsics of",
        ),
    ],
)
def test_a_single_bad_message_is_left_out_and_named(report, right, name, lost, words):
    given = read_session(report(name))
    assert len([w for w in given.warnings if words in w]) == 1, given.warnings
    same_but(given, right, lost)


def test_compressed_pictures_alone_are_read(report, right):
    found = pictures(read_session(report("e_compressed")))
    assert set(found) == set(right)
    for name, p in found.items():
        assert np.abs(p.image.astype(int) - right[name].image).mean() < 6.0
        assert np.allclose(p.T_home_cam, right[name].T_home_cam)
