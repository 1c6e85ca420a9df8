# SPDX-License-Identifier: Apache-2.0
"""The floor: transforms, camera, trajectory, strict configuration, vehicles."""

import doctest
from dataclasses import dataclass, field
from typing import List, Optional, Tuple

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcsv_geometry import camera, chi_squared, config, rotations, strict_yaml, transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import ConfigError, GeometryError, PoseUnavailable
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.trajectory import Trajectory
from fcsv_geometry.vehicles import vehicle

ROUNDING = 1e-9  # float64, a few products of numbers of order 100

angle = st.floats(-3.0, 3.0)
length = st.floats(-100.0, 100.0)
poses = st.builds(
    lambda p, r: transforms.from_xyz_rpy(p, r),
    st.tuples(length, length, length),
    st.tuples(angle, st.floats(-1.5, 1.5), angle),
)


@pytest.mark.parametrize(
    "module", [transforms, rotations, camera, chi_squared, config, strict_yaml]
)
def test_identities_in_the_docstrings(module):
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0


@given(poses, poses)
def test_labels_cancel(T_a_b, T_b_c):
    T_a_c = T_a_b @ T_b_c
    p_c = np.array([1.0, -2.0, 3.0])
    assert np.allclose(
        transforms.apply(T_a_c, p_c),
        transforms.apply(T_a_b, transforms.apply(T_b_c, p_c)),
        atol=1e-9,
    )
    assert np.allclose(
        transforms.invert(T_a_c), transforms.invert(T_b_c) @ transforms.invert(T_a_b), atol=1e-9
    )


@given(poses)
def test_quaternion_and_angles_round_trip(T):
    again = transforms.from_xyz_quaternion(T[:3, 3], transforms.quaternion_xyzw(T))
    assert np.allclose(again, T, atol=1e-9)
    assert np.allclose(transforms.from_xyz_rpy(T[:3, 3], transforms.rpy(T)), T, atol=1e-9)


@given(poses)
def test_level_keeps_position_and_heading(T):
    level = transforms.level(T)
    assert np.allclose(level[:3, 3], T[:3, 3]) and np.allclose(level[2, :3], [0, 0, 1])
    assert abs(np.sin(transforms.yaw(level) - transforms.yaw(T))) < ROUNDING


@pytest.mark.parametrize("q", [[0, 0, 0, 0], [0, 0, 0, 0.5], [np.nan, 0, 0, 1]])
def test_a_quaternion_that_is_none_is_refused(q):
    with pytest.raises(GeometryError):
        transforms.from_xyz_quaternion([0, 0, 0], q)


@pytest.mark.parametrize(
    "T", [np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan), np.eye(3), np.diag([2.0, 1, 1, 1])]
)
def test_not_rigid_is_refused_by_name(T):
    with pytest.raises(GeometryError, match="T_home_cam"):
        transforms.require_rigid(T, "T_home_cam")


def test_optical_frame_looks_forward():
    assert np.allclose(transforms.R_FLU_OPTICAL @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(transforms.R_FLU_OPTICAL @ [1, 0, 0], [0, -1, 0])


CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0), (-0.05, 0.02, 0.001, -0.001, 0.0))


@given(st.floats(-0.45, 0.45), st.floats(-0.35, 0.35), st.floats(1.0, 400.0))
def test_project_and_normalize_are_inverse(x, y, z):
    uv = CAMERA.project(np.array([[x * z, y * z, z]]))
    assert CAMERA.project(np.empty((0, 3))).shape == (0, 2)
    # OpenCV iterates five times towards the undistorted point: a thousandth of a pixel is left
    assert np.allclose(CAMERA.normalize(uv), [[x, y]], atol=1e-3 / CAMERA.fx * 5)


def test_rays_hit_their_pixels():
    rays = CAMERA.rays()
    uv = CAMERA.project(rays[100:110, 200:210].reshape(-1, 3))
    expected = np.stack(np.meshgrid(np.arange(200, 210), np.arange(100, 110)), -1).reshape(-1, 2)
    assert np.abs(uv - expected).max() < 0.01


def test_undistort_puts_a_point_where_the_pinhole_sees_it():
    point = np.array([[3.0, 2.0, 10.0]])
    picture = np.zeros((480, 640), np.uint8)
    u, v = CAMERA.project(point)[0]
    cv2.circle(picture, (round(u), round(v)), 4, 255, -1)
    rows, columns = np.nonzero(CAMERA.undistort(picture) > 127)
    assert np.allclose(
        [columns.mean(), rows.mean()], CAMERA.undistorted().project(point)[0], atol=0.7
    )  # whole-pixel disc


def test_blank_is_what_a_pincushion_camera_did_not_take():
    camera = PinholeCamera(
        640, 480, 602.0, 602.0, 319.5, 239.5, [0.05, 0.0, 0.0, 0.0, 0.0]
    )  # pincushion: black borders
    picture = camera.undistort(np.full((480, 640), 200, np.uint8))
    blank = camera.blank()
    assert 0.005 < blank.mean() < 0.05 and not blank[10:-10, 10:-10].any()
    assert (picture[~blank] == 200).all() and (picture[blank] < 200).mean() > 0.9
    assert camera.undistorted().blank() is None


@pytest.mark.parametrize(
    "values", [(0, 480, 600, 600), (640, 480, -1, 600), (640, 480, float("nan"), 600)]
)
def test_no_camera(values):
    with pytest.raises(GeometryError):
        PinholeCamera(*values, 319.5, 239.5)


class TestTrajectory:
    def trajectory(self, **bounds):
        track = Trajectory(**bounds)
        for i in range(11):
            track.add(i * 0.05, transforms.from_xyz_yaw([i * 0.05, 0, 0], 0.1 * i))
        return track

    def test_interpolates_position_and_rotation(self):
        T = self.trajectory().at(0.125)
        assert np.allclose(T[:3, 3], [0.125, 0, 0]) and np.isclose(transforms.yaw(T), 0.25)

    @pytest.mark.parametrize("stamp_s", [-0.01, 0.51])
    def test_never_beyond_the_ends(self, stamp_s):
        with pytest.raises(PoseUnavailable):
            self.trajectory().at(stamp_s)

    def test_extrapolates_only_as_far_as_told(self):
        track = self.trajectory(extrapolation_s=0.03)
        T = track.at(0.52)
        assert np.allclose(T[:3, 3], [0.52, 0, 0], atol=1e-6) and np.isclose(
            transforms.yaw(T), 1.04, atol=1e-6
        )
        with pytest.raises(PoseUnavailable):
            track.at(0.54)

    def test_does_not_bridge_silence(self):
        track = self.trajectory()
        track.add(2.0, np.eye(4))
        with pytest.raises(PoseUnavailable, match="silent"):
            track.at(1.0)
        with pytest.raises(PoseUnavailable, match="silent"):
            track.at(2.0 - 1e-6)

    def test_bridges_as_much_as_it_is_told_to(self):
        track = self.trajectory()
        track.add(0.8, np.eye(4))
        assert track.spacing_s == pytest.approx(0.05) and Trajectory().spacing_s == 0.0
        track.bridging(0.4).at(0.6)
        with pytest.raises(PoseUnavailable, match="silent"):
            track.at(0.6)

    def test_a_stamp_that_has_a_pose_of_its_own_is_in_no_silence(self):
        track = self.trajectory()
        T = transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.4)
        track.add(2.0, T)
        track.add(3.0, np.eye(4))
        assert (track.at(2.0) == T).all() and (track.at(3.0) == np.eye(4)).all()

    def test_stamps_that_go_back_are_refused(self):
        track = self.trajectory()
        assert not track.add(0.2, np.eye(4)) and len(track) == 11

    def test_memory_is_bounded(self):
        track = Trajectory(keep_s=1.0)
        for i in range(10000):
            track.add(i * 0.01, np.eye(4))
        assert len(track) <= 202

    def test_empty(self):
        with pytest.raises(PoseUnavailable):
            Trajectory().at(0.0)


@dataclass(frozen=True)
class Inner:
    size_m: float

    def __post_init__(self):
        if self.size_m < 0:
            raise ValueError(f"size_m: {self.size_m} is negative")


@dataclass(frozen=True)
class Outer:
    name: str
    parts: List[Inner] = field(default_factory=list)
    xy: Tuple[float, float] = (0.0, 0.0)
    note: Optional[str] = None
    count: int = 1


@dataclass(frozen=True)
class Bounded:
    fence: Fence = field(default_factory=lambda: Fence(0.3, 45.0, 100.0))


class TestConfig:
    def load(self, tmp_path, text):
        path = tmp_path / "some.yaml"
        path.write_text(text)
        return config.load(path, Outer)

    def test_reads(self, tmp_path):
        outer = self.load(
            tmp_path, "name: a\nparts: [{size_m: 1}, {size_m: 2.5}]\nxy: [1, 2]\nnote: null\n"
        )
        assert outer == Outer("a", [Inner(1.0), Inner(2.5)], (1.0, 2.0))

    def test_what_a_nested_mapping_does_not_name_is_as_the_outer_default_has_it(self):
        assert config.from_mapping({"fence": {"radius_m": 9.0}}, Bounded, "test").fence == Fence(
            0.3, 45.0, 9.0
        )

    @pytest.mark.parametrize(
        "text, words",
        [
            ("name: a\nnmae: b", ["unknown key 'nmae'", "name, parts"]),
            ("parts: []", ["'name' is missing"]),
            ("name: a\nparts: [{size_m: -1}]", ["parts[0].size_m", "negative"]),
            ("name: a\nparts: [{size_m: .nan}]", ["parts[0].size_m", "finite"]),
            ("name: a\nparts: {}", ["'parts' must be a list"]),
            ("name: 3", ["'name' must be str", "put it in quotes, '3'"]),
            ("name: {/a/b: c}", ["'name' must be str", "put it in quotes, '/a/b: c' (for ros"]),
            ("name: 2024-13-45", ["not valid YAML", "month must be in 1..12"]),
            ("name: a\nxy: [1, 2]\nname: b", ["line 3", "'name' stands twice, first in line 1"]),
            ("name: a\nparts: [{size_m: 1, size_m: 2}]", ["line 2", "'size_m' stands twice"]),
            ("name: a\nparts: [{size_m: " + "9" * 400 + "}]", ["'parts[0].size_m' is too large"]),
            ("name: a\ncount: " + "9" * 400, ["'count' is too large"]),
            ("name: a\nxy: [" + "9" * 5000 + "]", []),
            ("{a: " * 2000 + "1" + "}" * 2000, ["not valid YAML", "nested too deep"]),
            ("name: a\ncount: true", ["'count' must be int"]),
            ("name: a\nxy: [1]", ["'xy' must have 2 values"]),
            ("name: [", ["not valid YAML", "line"]),
            ("", ["must be a mapping"]),
        ],
    )
    def test_errors_name_file_and_field_in_one_line(self, tmp_path, text, words):
        with pytest.raises(ConfigError) as error:
            self.load(tmp_path, text)
        message = str(error.value)
        assert "some.yaml" in message and "\n" not in message
        assert all(word in message for word in words), message

    def test_a_merged_key_may_be_said_anew(self, tmp_path):
        document = "parts: [&a {size_m: 1}, {<<: *a, size_m: 2}, {<<: *a}]\nname: a\n"
        assert [part.size_m for part in self.load(tmp_path, document).parts] == [1.0, 2.0, 1.0]

    def test_missing_file(self, tmp_path):
        with pytest.raises(ConfigError, match="cannot be read"):
            config.load(tmp_path / "none.yaml", Outer)


class TestVehicles:
    def test_shipped_vehicles(self, root):
        vehicles = vehicle.load_vehicles(root / "config/vehicles", ["uav1", "uav2"])
        T_body_cam = vehicles["uav1"].T_body_cam
        assert np.allclose(T_body_cam[:3, :3] @ [0, 0, 1], [1, 0, 0])  # looks forward
        T_body_tag = vehicles["uav1"].T_body_tag
        # into the tag, seen from behind
        assert np.allclose(T_body_tag[:3, :3] @ [0, 0, 1], [1, 0, 0])
        # its x is the viewer's right
        assert np.allclose(T_body_tag[:3, :3] @ [1, 0, 0], [0, -1, 0])
        # looks down
        assert np.allclose(vehicles["uav1"].T_body_t265[:3, :3] @ [1, 0, 0], [0, 0, -1])

    def test_two_tags_with_one_id(self, tmp_path, root):
        for name in ("uav1", "uav2"):
            text = (
                (root / f"config/vehicles/{name}.yaml")
                .read_text()
                .replace("tag_id: 2", "tag_id: 1")
            )
            (tmp_path / f"{name}.yaml").write_text(text)
        with pytest.raises(ConfigError, match="tag_id 1 is also uav1's"):
            vehicle.load_vehicles(tmp_path, ["uav1", "uav2"])


settings.register_profile("fcsv")
settings.load_profile("fcsv")
