# SPDX-License-Identifier: Apache-2.0
"""Gimbal geometry, its angles over time, equation 4.1, and the ground robot's file."""

import doctest

import numpy as np
import pytest
from support.gimbal_scene import GIMBAL

from fcsv_geometry import config
from fcsv_geometry import transforms as tf
from fcsv_geometry.errors import ConfigError, PoseUnavailable
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal import equations, follow, geometry, mx12w
from fcsv_tracking.gimbal.angles import AngleTrack
from fcsv_tracking.gimbal.config import GroundRobot, load_ground_robot
from fcsv_tracking.gimbal.equations import relative_pose
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry


@pytest.mark.parametrize("module", [equations, follow, geometry, mx12w])
def test_identities_in_the_docstrings(module):
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0


def test_aim_puts_every_reachable_point_on_the_axis():
    random = np.random.default_rng(1)
    for _ in range(200):
        angles = Angles(random.uniform(-2.4, 2.4), random.uniform(-0.4, 1.3))
        T = GIMBAL.T_ground_cam(angles)
        p = tf.apply(T, np.array([0.0, 0.0, random.uniform(0.5, 6.0)]))
        found = GIMBAL.aim(p)
        x, y, _ = tf.apply(tf.invert(GIMBAL.T_ground_cam(found)), p)
        assert np.hypot(x, y) < 1e-6, (angles, found)


def test_aim_stays_inside_the_limits():
    behind_and_down = np.array([-3.0, 0.0, -4.0])
    found = np.degrees(GIMBAL.aim(behind_and_down))
    assert -150.0 <= found[0] <= 150.0 and found[1] == pytest.approx(-30.0)


def test_what_an_angle_read_wrong_does_is_the_derivative():
    """motions() against central differences; 1e-6 of a step of 1e-5 rad."""
    angles, T_cam_body = Angles(0.4, 0.3), tf.from_xyz_rpy([0.1, -0.05, 3.0], [1.4, 0.2, -1.5])
    p = (GIMBAL.T_ground_cam(angles) @ T_cam_body)[:3, 3]
    M, h = GIMBAL.motions(angles, p), 1e-5
    for k, step in enumerate((Angles(h, 0.0), Angles(0.0, h))):
        ends = [
            GIMBAL.T_ground_cam(Angles(*np.add(angles, s * np.array(step)))) @ T_cam_body
            for s in (-1, 1)
        ]
        moved = (ends[1][:3, 3] - ends[0][:3, 3]) / (2 * h)
        turned = tf.Rotation.from_matrix(ends[1][:3, :3] @ ends[0][:3, :3].T).as_rotvec() / (2 * h)
        assert np.allclose(M[:, k], np.concatenate([moved, turned]), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_4_1_relative_pose_and_where_the_printed_one_fails(seed):
    random = np.random.default_rng(seed)
    T_G_C, T_G_D = (
        [tf.from_xyz_rpy(random.normal(0, 1, 3), random.normal(0, 0.6, 3)) for _ in range(2)]
        for _ in "CD"
    )
    T_C_D = [tf.invert(c) @ d for c, d in zip(T_G_C, T_G_D)]
    assert np.allclose(
        relative_pose(T_G_C[0], T_C_D[0], T_G_C[1], T_C_D[1]), tf.invert(T_G_D[0]) @ T_G_D[1]
    )
    true = (tf.invert(T_G_D[0]) @ T_G_D[1])[:3, 3]
    between = T_G_C[1][:3, 3] - T_G_C[0][:3, 3]
    between = between + T_G_C[1][:3, :3] @ T_C_D[1][:3, 3] - T_G_C[0][:3, :3] @ T_C_D[0][:3, 3]
    assert np.allclose((T_G_C[0][:3, :3] @ T_C_D[0][:3, :3]).T @ between, true)
    assert not np.allclose(T_C_D[0][:3, :3] @ between, true, atol=0.05)  # as printed
    assert np.linalg.norm(between) == pytest.approx(np.linalg.norm(true))  # 4.2 is right either way


class TestAngles:
    def track(self):
        track = AngleTrack()
        for k in range(20):
            track.add(10.0 + 0.01 * k, Angles(0.2 * k * 0.01, 0.5))
        return track

    def test_between_readings_with_their_rate(self):
        angles, rates = self.track().at(10.055)
        assert angles == pytest.approx((0.2 * 0.055, 0.5)) and rates == pytest.approx([0.2, 0.0])

    def test_never_beyond_the_newest_and_not_through_a_silence(self):
        track = self.track()
        with pytest.raises(PoseUnavailable):
            track.at(10.2)
        track.add(15.2, Angles(1.0, 0.5))  # five seconds of silence
        with pytest.raises(PoseUnavailable, match="silent"):
            track.at(12.0)

    def test_bad_readings_are_rejected_and_a_clock_set_back_begins_anew(self):
        track = self.track()
        for stamp_s, angles in (
            (10.3, Angles(np.nan, 0.0)),
            (np.inf, Angles(0.0, 0.0)),
            (10.19, Angles(0.0, 0.0)),
        ):
            with pytest.raises(SampleRejected):
                track.add(stamp_s, angles)
        track.add(3.0, Angles(0.1, 0.1))
        track.add(3.01, Angles(0.1, 0.1))
        assert track.at(3.005)[0] == pytest.approx((0.1, 0.1))


class TestFile:
    def test_the_one_in_the_repository(self, root):
        robot = load_ground_robot(root / "config" / "gimbal" / "ground_robot.yaml")
        assert list(robot.by_vehicle) == ["tello1", "tello2"]
        assert all(len(g.tags) == 4 and g.tags[0].size_m == 0.08 for g in robot.gimbals)

    @pytest.mark.parametrize(
        "change, message",
        [
            ({"tags": []}, "tags: tello1 wears none"),
            (
                {"tags": [{"id": 600, "size_m": 0.08, "mount": {"xyz_m": [0, 0, 0]}}]},
                "id: 600 is not in family",
            ),
            (
                {"tags": [{"id": 5, "size_m": 80, "mount": {"xyz_m": [0, 0, 0]}}]},
                "size_m: 80.0 is not in",
            ),
            ({"servo": {"pan_id": 3, "tilt_id": 3}}, "tilt_id: 3 is also pan's"),
            (
                {"geometry": {"base": {"xyz_m": [0, 0, 0]}, "tilt_limits_deg": [50, 20]}},
                "tilt_limits_deg",
            ),
            ({"geometry": {"base": {"xyz_m": [0, 0, float("nan")]}}}, "must be finite"),
            ({"colour": "red"}, "unknown key 'gimbals\\[0\\].colour'"),
        ],
    )
    def test_what_is_wrong_is_named(self, change, message):
        gimbal = {
            "vehicle": "tello1",
            "geometry": {"base": {"xyz_m": [0, 0, 0]}},
            "tags": [{"id": 5, "size_m": 0.08, "mount": {"xyz_m": [0, 0, 0]}}],
        }
        with pytest.raises(ConfigError, match=message):
            config.from_mapping({"gimbals": [{**gimbal, **change}]}, GroundRobot, "robot.yaml")

    def test_two_gimbals_share_nothing(self):
        tag = {"id": 5, "size_m": 0.08, "mount": {"xyz_m": [0, 0, 0]}}
        one = {"vehicle": "a", "geometry": {"base": {"xyz_m": [0, 0, 0]}}, "tags": [tag]}
        two = {**one, "vehicle": "b", "servo": {"pan_id": 3, "tilt_id": 4}}
        with pytest.raises(ConfigError, match="tag id 5 is there twice"):
            config.from_mapping({"gimbals": [one, two]}, GroundRobot, "robot.yaml")
        with pytest.raises(ConfigError, match="servo id 1 is there twice"):
            config.from_mapping(
                {"gimbals": [one, {**two, "servo": {}, "tags": [{**tag, "id": 6}]}]},
                GroundRobot,
                "robot.yaml",
            )


def test_limits_that_are_none_are_refused():
    with pytest.raises(ValueError, match="pan_limits_deg"):
        GimbalGeometry(Mount((0.0, 0.0, 0.0)), pan_limits_deg=(-200.0, 10.0))
