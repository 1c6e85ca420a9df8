# SPDX-License-Identifier: Apache-2.0
"""Points on the ground before a camera 6 m above it: which of their motions say that the vehicle
flies one way."""

import numpy as np
import pytest

from fcsv_geometry import rotations, transforms
from fcsv_geometry.transforms import R_FLU_OPTICAL
from fcsv_tracking.scene.one_way import one_way_ratio

HEIGHT_M, COUNT, BOUND = 6.0, 60, 3.8  # the last of SceneCheckRules
T_ODOM_THEN = transforms.transform(R_FLU_OPTICAL, [0.0, 0.0, HEIGHT_M])  # looks along x
NOISE_RAD = 0.001


def scene(seed=3, count=COUNT):
    """(N, 3) in the odometry frame: on the ground, 10 to 80 m ahead."""
    random = np.random.default_rng(seed)
    ahead = np.exp(random.uniform(np.log(10.0), np.log(80.0), count))
    return np.column_stack([ahead, 0.5 * ahead * random.uniform(-1.0, 1.0, count), np.zeros(count)])


def ratio(points, flown_m, told_m, moved_m=0.0, turned_rad=(0.0, 0.0, 0.0), seed=4):
    """What is said of a camera that flew, and of one whose tracker told, so much (3,; odometry
    frame)."""
    random = np.random.default_rng(seed)

    def seen(p_m, T_odom_cam, turn_rad):
        p_cam = (
            transforms.apply(transforms.invert(T_odom_cam), p_m)
            @ rotations.exp(np.array(turn_rad)).T
        )
        return p_cam[:, :2] / p_cam[:, 2:] + random.normal(0.0, NOISE_RAD, (len(p_m), 2))

    true, told = (
        transforms.transform(T_ODOM_THEN[:3, :3], T_ODOM_THEN[:3, 3] + m) for m in (flown_m, told_m)
    )
    xy = seen(points, T_ODOM_THEN, np.zeros(3)), seen(points + moved_m, true, turned_rad)
    return one_way_ratio(*xy, transforms.invert(told) @ T_ODOM_THEN, told[:3, :3], 0.0)


STILL = np.zeros(3)


@pytest.mark.parametrize(
    "flown_m", [[0.0, 0.4, 0.0], [0.0, -0.8, 0.0], [3.2, 0.0, 0.0], [-1.2, 0.6, 0.0], [0, 0, 0.6]]
)
def test_who_holds_a_place_and_flies_is_seen(flown_m):
    assert ratio(scene(), np.array(flown_m), STILL) > BOUND


def test_and_whose_tracker_tells_another_way():
    assert ratio(scene(), np.array([0.0, 0.8, 0.4]), np.array([0.0, 0.0, 0.4])) > BOUND


@pytest.mark.parametrize(
    "flown_m", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.4, 0.0], [0.5, -0.5, 0.8]]
)
def test_a_tracker_that_tells_the_truth_is_believed(flown_m):
    assert ratio(scene(), np.array(flown_m), np.array(flown_m)) < 0.3 * BOUND


@pytest.mark.parametrize("turned_rad", [[0.012, 0.0, 0.0], [0.0, -0.012, 0.0], [0.0, 0.0, 0.012]])
def test_a_turn_of_the_whole_picture_is_none(turned_rad):
    """Three times what vibration and late stamps turn."""
    assert ratio(scene(), STILL, STILL, turned_rad=turned_rad) < 0.3 * BOUND


@pytest.mark.parametrize("seed", range(5))
def test_what_moves_each_its_own_way_is_none(seed):
    moved_m = (
        np.random.default_rng(seed).normal(0.0, 1.5, (COUNT, 3))
        * (np.arange(COUNT) % 6 == 0)[:, None]
    )
    assert ratio(scene(), STILL, STILL, moved_m) < BOUND


def test_what_moves_one_way_and_fills_the_ground_is_taken_for_a_drift():
    """Water: said in docs/user/safety.md."""
    assert ratio(scene(), STILL, STILL, np.array([0.0, 1.0, 0.0])) > BOUND


def test_clouds_do_not_count():
    clouds = scene() + [0.0, 0.0, 2.0 * HEIGHT_M]
    assert ratio(clouds, np.array([0.0, 0.8, 0.0]), STILL) == 0.0


def test_too_few_points_say_nothing():
    assert ratio(scene(count=9), np.array([0.0, 0.8, 0.0]), STILL) == 0.0
