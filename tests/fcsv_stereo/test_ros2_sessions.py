# SPDX-License-Identifier: Apache-2.0
"""Sessions recorded by ROS 2 give the same pictures and poses as those of ROS 1; what cannot be
read is named."""

import shutil

import numpy as np
import pytest
from support.ros2_bags import PLUGINS, session_to_ros2, to_ros2, without_definitions
from support.sessions import write_session

from fcsv_stereo.errors import InputError
from fcsv_stereo.sessions import is_session, read_session

COVARIANCE = np.diag([0.01**2] * 3 + [0.003**2] * 3)


@pytest.fixture(scope="module")
def ros1(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("ros1") / "session", covariance=COVARIANCE)


@pytest.fixture(scope="module", params=sorted(PLUGINS))
def ros2(request, ros1, tmp_path_factory):
    return session_to_ros2(ros1, tmp_path_factory.mktemp(request.param) / "session", request.param)


def pictures(given):
    return [p for c in given.configurations for p in (*c.references, *c.others)]


def same(given, other):
    found, expected = pictures(given), pictures(other)
    assert [p.name for p in found] == [p.name for p in expected] and len(found) == 8
    for a, b in zip(found, expected):
        assert (
            np.array_equal(a.image, b.image)
            and np.array_equal(a.T_home_cam, b.T_home_cam)
            and a.camera == b.camera
        )
        assert np.array_equal(a.covariance, b.covariance)
    assert given.warnings == other.warnings == []


def test_a_session_of_ros2_is_that_of_ros1(ros1, ros2):
    same(read_session(ros2), read_session(ros1))


def test_without_a_description_its_bags_are_found(ros1, ros2, tmp_path):
    shutil.copytree(ros2, tmp_path / "session")
    (tmp_path / "session" / "session.yaml").unlink()
    assert is_session(tmp_path / "session")
    same(read_session(tmp_path / "session"), read_session(ros1))


@pytest.mark.parametrize("storage", PLUGINS)
def test_one_bag_with_everything_as_folder_and_as_file(ros1, tmp_path, storage):
    bag = to_ros2(sorted(ros1.glob("*.bag")), tmp_path / "all", storage)
    (file,) = bag.glob(f"*{PLUGINS[storage]}")
    for path in (bag, file):
        assert is_session(path)
        same(read_session(path), read_session(ros1))


def test_definitions_that_the_bag_lacks_are_ours(ros1, tmp_path):
    session = session_to_ros2(ros1, tmp_path / "session", "sqlite3")
    for name in ("uav1", "uav2", "control"):
        without_definitions(session / name)
    same(read_session(session), read_session(ros1))


def data_of(bag):
    return next(p for suffix in PLUGINS.values() for p in bag.glob(f"*{suffix}"))


def cut(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def no_bag(file):
    file.write_bytes(b"no bag " * 100)


def test_a_damaged_bag_is_named_and_its_vehicle_missed(ros2, tmp_path):
    for number, damage in enumerate((cut, no_bag)):
        session = tmp_path / str(number)
        shutil.copytree(ros2, session)
        damage(data_of(session / "uav2"))
        with pytest.raises(InputError) as error:
            read_session(session)
        said = str(error.value)
        assert "\n" not in said and "uav2 is missing" in said.replace(
            "/uav2/odometry/body", "uav2"
        ), said
        assert "/uav2: cannot be read as a bag (" in said and "left out" in said, said


@pytest.mark.parametrize(
    "change, words",
    [
        (("version: 8", "version: 99"), "version 99"),
        (("storage_identifier: ", "storage_identifier: tape # "), "'tape'"),
        (("relative_file_paths", "relative_paths"), "relative_file_paths"),
    ],
)
def test_metadata_that_is_not_known_is_named(ros2, tmp_path, change, words):
    shutil.copytree(ros2, tmp_path / "session")
    metadata = tmp_path / "session" / "uav2" / "metadata.yaml"
    text = metadata.read_text()
    assert change[0] in text
    metadata.write_text(text.replace(*change, 1))
    with pytest.raises(InputError) as error:
        read_session(tmp_path / "session")
    assert "/uav2: cannot be read as a bag (" in str(error.value) and words in str(error.value)


def test_a_bag_of_ros2_that_is_missing_is_named(ros2, tmp_path):
    shutil.copytree(ros2, tmp_path / "session")
    shutil.rmtree(tmp_path / "session" / "uav2")
    with pytest.raises(
        InputError, match=r"/uav2/odometry/body is missing.*uav2 is missing: copy it"
    ):
        read_session(tmp_path / "session")
