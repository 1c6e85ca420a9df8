# SPDX-License-Identifier: Apache-2.0
"""The robot's place by the tags on it: ordinary pictures, ambiguous ones, several tags, and what is
refused."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_geometry import rotations, transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.vehicles.telemetry import SeenTag
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.place.tag_fix import RobotSight, RobotTagReader, tag_fix
from fcsv_guidance.robot import load_robot
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.robot_tags import load_robot_tags, readable_m
from fcsv_tracking.tags import corner_points

FOCAL_PX, CORNER_PX, SLOPE_RAD = 602.0, 0.12, np.radians(25.0)
POSE = np.diag(np.square([0.05, 0.05, 0.05, 0.005, 0.005, 0.009]))


@pytest.fixture
def tags(root):
    return load_robot_tags(root / "config/robots/rescue.yaml", {})


def T_home_cam(z_m=3.0):
    """A camera above home's origin that looks along x, level."""
    return transforms.transform(transforms.R_FLU_OPTICAL, [0.0, 0.0, z_m])


def sight(tags, T_home_robot, seed=0, noise=1.0, vehicle="uav1", stamp_s=5.0, ids=None, **more):
    """What a camera sees of the tags that face it, with noise of corners and of its own pose."""
    random, seen = np.random.default_rng(seed), []
    T_cam_robot = transforms.invert(T_home_cam()) @ T_home_robot
    for tag in tags.values():
        T = T_cam_robot @ tag.T_body_tag
        if T[:3, 2] @ T[:3, 3] < 0.45 * np.linalg.norm(T[:3, 3]):
            continue  # its back, or too flat
        p = transforms.apply(T, corner_points(tag.size_m))
        corners = p[:, :2] / p[:, 2:]
        corners = corners + noise * CORNER_PX / FOCAL_PX * random.standard_normal((4, 2))
        seen.append(SeenTag(tag.id, tag.size_m, corners, T[:3, 3]))
    error = noise * np.sqrt(np.diag(POSE)) * random.standard_normal(6)
    T = T_home_cam()
    believed = transforms.transform(rotations.exp(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
    seen = [t for t in seen if ids is None or t.id in ids]
    return replace(RobotSight(vehicle, stamp_s, believed, POSE, FOCAL_PX, seen), **more)


def at(x_m, y_m, yaw_deg):
    return transforms.from_xyz_yaw([x_m, y_m, -0.2], np.radians(yaw_deg))


@pytest.mark.parametrize("yaw_deg", [-170.0, -45.0, 0.0, 20.0, 100.0])
def test_without_noise_the_fix_is_the_truth(tags, yaw_deg):
    fix = tag_fix(sight(tags, at(9.0, 1.0, yaw_deg), noise=0.0), tags, SLOPE_RAD)
    assert (fix.x_m, fix.y_m) == pytest.approx((9.0, 1.0), abs=1e-3)
    assert rotations.wrap(fix.yaw_rad - np.radians(yaw_deg)) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("distance_m", [6.0, 12.0])
def test_errors_are_as_large_as_it_says(tags, distance_m):
    """200 fixes at any bearing, noise of the size that the rules believe: the mean of e'C^-1 e of x
    and y is 2, with a standard deviation of 0.14; where the yaw is not measured the covariance is
    wider."""
    d2, turns = [], []
    for k in range(200):
        yaw_deg = float(np.random.default_rng(k).uniform(-180, 180))
        fix = tag_fix(sight(tags, at(distance_m, 0.5, yaw_deg), k), tags, SLOPE_RAD)
        off = np.array([fix.x_m - distance_m, fix.y_m - 0.5])
        d2.append(off @ np.linalg.solve(fix.covariance[:2, :2], off))
        if np.isfinite(fix.covariance[2, 2]):
            turned = rotations.wrap(fix.yaw_rad - np.radians(yaw_deg))
            turns.append(abs(turned) / np.sqrt(fix.covariance[2, 2]))
    assert 1.2 < np.mean(d2) < 2.42
    assert len(turns) > 100
    assert np.mean(np.array(turns) < 2.0) > 0.9


def test_where_a_tag_and_its_mirror_image_fit_alike_the_yaw_is_not_measured(tags):
    """14 m away the corners do not tell 12 degrees to the left from 12 to the right."""
    sights = [sight(tags, at(14.0, 0.0, 168.0), k, ids=[40]) for k in range(20)]
    fixes = [tag_fix(s, tags, SLOPE_RAD) for s in sights]
    unknown = [f for f in fixes if np.isinf(f.covariance[2, 2])]
    assert len(unknown) > 10
    for fix in unknown:
        off = np.array([fix.x_m - 14.0, fix.y_m])
        assert off @ np.linalg.solve(fix.covariance[:2, :2], off) < 13.8  # chi2, 0.999


def test_two_tags_in_one_picture_tell_more_than_one(tags):
    corner = at(12.0, 0.0, 140.0)
    sure = 1e-10 * np.eye(6)  # the vehicle's own pose
    both, one = (
        tag_fix(sight(tags, corner, 3, ids=i, covariance=sure), tags, SLOPE_RAD)
        for i in (None, [40])
    )
    assert len(sight(tags, corner).tags) == 2
    assert both.covariance[2, 2] < 0.5 * one.covariance[2, 2]


def test_the_vehicles_turn_counts_with_its_distance(tags):
    there = at(12.0, 0.0, 140.0)
    turned = POSE + np.diag([0, 0, 0, 0, 0, np.radians(2.0) ** 2])
    sure, unsure = (
        tag_fix(sight(tags, there, 3, covariance=C), tags, SLOPE_RAD) for C in (POSE, turned)
    )
    gained = unsure.covariance[1, 1] - sure.covariance[1, 1]
    assert gained == pytest.approx((12.0 * np.radians(2.0)) ** 2, rel=0.1)


def nan_pose(s):
    return replace(s, T_home_cam=s.T_home_cam * np.nan)


def nan_corner(s):
    return replace(s, tags=[replace(t, corners_normalized=np.full((4, 2), np.nan)) for t in s.tags])


def nan_covariance(s):
    return replace(s, covariance=s.covariance * np.nan)


def other_size(s):
    return replace(s, tags=[replace(t, size_m=0.16) for t in s.tags])


def twice(s):
    return replace(s, tags=[*s.tags, *s.tags])


def torn(s):
    moved = [
        replace(t, corners_normalized=t.corners_normalized + 0.05 * k) for k, t in enumerate(s.tags)
    ]
    return replace(s, tags=moved)


@pytest.mark.parametrize(
    "spoil, reason",
    [
        (nan_pose, "not finite"),
        (nan_corner, "not finite"),
        (nan_covariance, "not finite"),
        (other_size, "other size"),
        (twice, "implausible"),
        (torn, "tags contradict each other"),
    ],
)
def test_what_cannot_be_is_refused_and_counted(tags, spoil, reason):
    spoiled = spoil(sight(tags, at(9.0, 0.0, 140.0)))
    with pytest.raises(SampleRejected) as caught:
        tag_fix(spoiled, tags, SLOPE_RAD)
    assert caught.value.reason == reason
    fix, dropped = RobotTagReader(tags, SLOPE_RAD).receive(1.0, spoiled)
    assert fix is None and [d.what for d in dropped] == [reason]


def test_a_tag_that_is_too_small_gives_no_fix(tags):
    with pytest.raises(SampleRejected, match="13 px large: go nearer"):
        tag_fix(sight(tags, at(22.0, 0.0, 180.0)), tags, SLOPE_RAD)


def test_a_picture_of_other_tags_is_none_of_the_robot(tags):
    reader = RobotTagReader(tags, SLOPE_RAD)
    other = {7: replace(tags[40], id=7)}
    assert reader.receive(1.0, sight(other, at(9.0, 0.0, 180.0))) == (None, [])


def test_a_robot_that_nobody_sees_is_told(tags):
    reader = RobotTagReader(tags, SLOPE_RAD)
    assert reader.step(0.0) == ""
    assert "no vehicle has read a tag of the robot for 6 s" in reader.step(6.0)
    reader.receive(7.0, sight(tags, at(9.0, 0.0, 140.0)))
    assert reader.step(7.5) == ""


def test_two_robots_with_one_tag_are_told_and_give_no_fix(tags):
    reader = RobotTagReader(tags, SLOPE_RAD)
    here, there = at(9.0, 0.0, 140.0), at(9.0, 4.0, 140.0)
    assert reader.receive(1.0, sight(tags, here))[0] is not None
    fix, dropped = reader.receive(1.2, sight(tags, there, vehicle="uav2", stamp_s=5.2))
    assert fix is None and [d.what for d in dropped] == ["seen at two places"]
    assert "uav1 and uav2 see the robot 3.8 m apart" in reader.step(1.5)
    assert reader.receive(1.4, sight(tags, here, stamp_s=5.4))[0] is None
    assert reader.step(9.0).startswith("no vehicle has read")


def test_two_vehicles_that_see_one_robot_both_give_fixes(tags):
    reader, here = RobotTagReader(tags, SLOPE_RAD), at(9.0, 0.0, 140.0)
    names = ["uav1", "uav2", "uav1", "uav2"]
    sights = [sight(tags, here, k, vehicle=n, stamp_s=5.0 + 0.2 * k) for k, n in enumerate(names)]
    assert all(reader.receive(1.0 + 0.2 * k, s)[0] is not None for k, s in enumerate(sights))


@pytest.mark.parametrize(
    "line, words",
    [
        ("{id: 40, size_m: 0.45, mount: {xyz_m: [0, 0, 0.4]}}", "tags: id 40 is there twice"),
        ("{id: 2, size_m: 0.45, mount: {xyz_m: [0, 0, 0.4]}}", "id 2 is also uav2's"),
        (
            "{id: 587, size_m: 0.45, mount: {xyz_m: [0, 0, 0.4]}}",
            "tags[4].id: 587 is not in family",
        ),
        ("{id: 50, size_m: 45, mount: {xyz_m: [0, 0, 0.4]}}", "tags[4].size_m: 45.0 is not in"),
        (
            "{id: 50, size_m: 0.45, mount: {xyz_m: [0, .nan, 0]}}",
            "'tags[4].mount.xyz_m[1]' must be",
        ),
        ("{id: 50, size_m: 0.45}", "'tags[4].mount' is missing"),
    ],
)
def test_a_wrong_tag_is_named_with_its_file(root, tmp_path, line, words):
    path = tmp_path / "mine.yaml"
    path.write_text((root / "config/robots/rescue.yaml").read_text() + f"  - {line}\n")
    with pytest.raises(ConfigError, match="mine.yaml") as caught:
        load_robot_tags(path, load_vehicles(root / "config/vehicles", ["uav1", "uav2"]))
    assert words in str(caught.value)
    if "uav2" not in words:
        with pytest.raises(ConfigError, match="mine.yaml"):
            load_robot(path)


def test_a_robot_without_tags_has_none(root):
    assert load_robot_tags(root / "config/robots/small.yaml", {}) == {}


def test_how_far_its_tags_are_read(tags):
    assert readable_m(list(tags.values()), FOCAL_PX) == pytest.approx(15.05)
