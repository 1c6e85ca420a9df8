# SPDX-License-Identifier: Apache-2.0
"""The calibrated probability: more of what speaks against a place never raises it; several maps are
weighed."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import standing
from fcsv_guidance.ground.model import ground_from, stand_probability
from fcsv_guidance.ground.tuning import CONTRADICTED_P, FREE_P, OBSTACLE_P, STAND_WEIGHTS
from fcsv_guidance.robot import load_robot

GRID = Grid.around((8, -6), (26, 6), 0.1)
BLOCK = (15.0, 16.0, -1.0, 1.0, 0.0, 0.6)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


def raised(view, up_m):
    """The same view with its camera, and so all that it shows, higher."""
    T_home_cam = view.T_home_cam.copy()
    T_home_cam[2, 3] += up_m
    return replace(view, T_home_cam=T_home_cam)


def test_more_of_what_is_against_a_place_never_raises_its_probability():
    assert len(STAND_WEIGHTS) == standing.FEATURES
    assert all(weight <= 0 for weight in STAND_WEIGHTS[standing.FREE_SIGN :])


@pytest.mark.parametrize(
    "slope_deg, limit_deg, free", [(6, 25, True), (9, 2, False), (10, 4, False), (35, 25, False)]
)
def test_ground_steeper_than_the_robot_climbs_is_not_free(
    scene, rescue, slope_deg, limit_deg, free
):
    """Also for a robot whose step is higher than what the slope rises below it."""
    level = ground_from([scene().view()], grid=GRID)
    up_m = (
        np.float32(np.tan(np.radians(slope_deg))) * GRID.middle_of(*np.indices(GRID.shape))[..., 0]
    )
    sloped = replace(
        level, **{n: getattr(level, n) + up_m for n in ("height_m", "low_m", "high_m")}
    )
    robot = replace(rescue, largest_slope_deg=limit_deg, largest_step_m=0.8)
    p = stand_probability(sloped, robot)[GRID.cell_of(12, 0)]
    assert (p >= FREE_P) == free and (p <= OBSTACLE_P) == (not free)


def test_a_second_map_that_lies_higher_takes_no_freedom(scene, rescue):
    """Heights of two maps differ by errors of pose: 0.12 m is no step, as each map alone shows
    level ground."""
    one = scene([BLOCK]).view(noise=0.3)
    alone = stand_probability(ground_from([one], grid=GRID), rescue) >= FREE_P
    both = stand_probability(ground_from([one, raised(one, 0.12)], grid=GRID), rescue) >= FREE_P
    assert alone.sum() > 3000 and (both & alone).sum() > 0.99 * alone.sum()


def test_what_one_map_contradicts_is_not_free(scene, rescue):
    clear, blocked = scene().view(noise=0.3), scene([BLOCK]).view(noise=0.3, seed=2)
    p = stand_probability(ground_from([clear, blocked], grid=GRID), rescue)
    assert (
        stand_probability(ground_from([clear], grid=GRID), rescue)[GRID.cell_of(14.8, 0)] >= FREE_P
    )
    assert p[GRID.cell_of(14.8, 0)] < FREE_P and p[GRID.cell_of(11, 3)] >= FREE_P


def test_what_several_maps_say_together():
    nan, around = np.nan, np.ones((1, 1), np.uint8)
    each = [[nan, 0.99, 0.99, 0.99, 0.90, nan, 0.99], [nan, nan, 0.90, 0.30, 0.20, 0.97, 0.30]]
    whole = np.ones((2, 1, 7), bool)
    whole[1, 0, 6] = False  # it knows a part of the footprint
    p = standing.weighed(np.array(each)[:, None], whole, around)[0]
    assert np.isnan(p[0]) and p[1] >= FREE_P and p[2] >= FREE_P
    assert OBSTACLE_P < p[3] == np.float32(CONTRADICTED_P)
    assert p[4] <= OBSTACLE_P and p[5] == np.float32(0.97) and p[6] >= FREE_P


def test_two_maps_outvote_a_third():
    around, whole = np.ones((1, 1), np.uint8), np.ones((3, 1, 1), bool)
    votes = np.array([0.99, 0.99, 0.30])[:, None, None]
    assert standing.weighed(votes, whole, around)[0, 0] >= FREE_P


def test_a_gap_between_two_maps_closes_and_a_step_does_not():
    """Each map calls its side free; what lies between is narrower than the footprint."""
    around, whole = np.ones((1, 3), np.uint8), np.ones((2, 1, 7), bool)
    gap = np.array([[0.99, 0.99, 0.99, 0.9, 0.9, 0.9, 0.9], [0.9, 0.9, 0.9, 0.9, 0.99, 0.99, 0.99]])
    assert standing.weighed(gap[:, None], whole, around)[0, 3] >= FREE_P
    step = np.array([[0.99, 0.99, 0.99, 0.1, 0.99, 0.99, 0.99]] * 2)
    assert standing.weighed(step[:, None], whole, around)[0, 3] <= OBSTACLE_P
