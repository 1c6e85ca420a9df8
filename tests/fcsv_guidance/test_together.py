# SPDX-License-Identifier: Apache-2.0
"""Several maps judged by their average: noise sinks, an outlier does not count, and the trees call
level ground free and a block not."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground import kernels, together
from fcsv_guidance.ground.known import GroundSeen, KnownGround
from fcsv_guidance.ground.model import LAYERS, ground_from, stand_probability
from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.robot import load_robot

GRID = Grid.around((20, -4), (28, 4), 0.1)
BLOCK = (23.0, 24.0, -1.0, 1.0, 0.0, 0.6)


@pytest.fixture
def rescue(root):
    return load_robot(root / "config/robots/rescue.yaml")


@pytest.fixture
def maps(scene):
    return [ground_from([scene([BLOCK]).view(noise=0.3, seed=n)], grid=GRID) for n in range(5)]


def test_the_average_is_less_noisy_than_each_map_and_needs_no_common_level(maps):
    names = ("height_m", "low_m", "high_m", "overhead_m")
    high = replace(maps[0], **{n: getattr(maps[0], n) + np.float32(0.1) for n in names})
    ground, count, _, _ = together.averaged([high, *maps[1:]])
    apart = np.hypot(*(GRID.middle_of(*np.indices(GRID.shape)) - [23.5, 0.0]).transpose(2, 0, 1))
    level = (apart > 2.5) & (count == 5)
    assert level.sum() > 500
    # of five independent maps 1 / sqrt(5) = 0.45
    assert np.std(ground.height_m[level]) < 0.6 * np.std(maps[1].height_m[level])


def test_one_map_of_five_that_lies_far_off_in_a_cell_does_not_count(maps):
    cell = GRID.cell_of(26.0, 3.0)
    raised = maps[0].height_m.copy()
    raised[cell] += 1.0
    ground, _, spread, out = together.averaged([replace(maps[0], height_m=raised), *maps[1:]])
    assert out[cell] == 1 and spread[cell] > 0.2
    assert abs(ground.height_m[cell] - np.mean([one.height_m[cell] for one in maps[1:]])) < 0.05


def test_trees_go_above_a_threshold_or_to_the_next_node():
    """Tree 1 is one leaf; tree 2 asks feature 1 and then feature 0."""
    feature, first = np.array([-1, 1, -1, 0, -1, -1]), np.array([0, 1])
    threshold = np.array([0.5, 2.0, 1.0, 3.0, 10.0, 100.0], np.float32)
    above = np.array([0, 3, 0, 5, 0, 0])
    x = np.array([[0, 2], [3, 2.5], [4, 2.5]], np.float32)
    found = kernels.log_odds(x, feature, threshold, above, first)
    assert found.tolist() == [1.5, 10.5, 100.5]


@pytest.mark.parametrize("learnt", together.LEARNT, ids=lambda learnt: learnt.name)
def test_the_stored_trees_end_in_leaves_and_ask_for_features_that_there_are(learnt):
    feature, _, above, first = together.trees(learnt.name)
    assert feature.max() < together.FEATURES and len(first) > 1
    inner = np.flatnonzero(feature >= 0)
    assert (above[inner] > inner + 1).all() and (above < len(feature)).all()


@pytest.mark.parametrize("more_m", (-15.0, 45.0))
def test_maps_too_near_or_too_far_are_not_judged_together(maps, rescue, more_m):
    assert np.isfinite(together.probability(maps[:1], rescue)).any()
    away = [replace(one, distance_m=one.distance_m + np.float32(more_m)) for one in maps]
    assert np.isnan(together.probability(away, rescue)).all()


def test_what_tellos_see_is_judged_for_small_robots_alone(root, scene, rescue):
    """Level ground 5 m away, and a thing of 0.1 m, which a small robot does not climb."""
    grid = Grid.around((20, -2), (24, 2), 0.05)
    box = (22.0, 22.4, -0.3, 0.3, 0.0, 0.1)
    maps = [ground_from([scene([box]).view(noise=0.05, seed=n)], grid=grid) for n in range(4)]
    near = [replace(one, distance_m=one.distance_m * np.float32(0.2)) for one in maps]
    p = together.probability(near, load_robot(root / "config/robots/small.yaml"))
    assert (p >= FREE_P).sum() > 500 and not p[grid.cell_of(22.2, 0.0)] >= FREE_P
    assert np.isnan(together.probability(near, rescue)).all()


def test_maps_of_another_place_say_nothing(maps, rescue):
    away = replace(maps[0], **{name: np.full_like(maps[0].height_m, np.nan) for name in LAYERS})
    with_others = together.probability([*maps, away, away], rescue)
    assert np.array_equal(with_others, together.probability(maps, rescue), equal_nan=True)


def test_a_block_is_not_free_together_and_what_changed_is_left_to_the_watch(maps, rescue):
    p = together.probability(maps, rescue)
    assert not (p[GRID.cell_of(23.5, 0.0)] >= FREE_P) and not (p[GRID.cell_of(22.8, 0.0)] >= FREE_P)
    known = KnownGround(rescue)
    seen = [GroundSeen(0.0, f"station {number}", one) for number, one in enumerate(maps)]
    assert known.receive_maps(seen) and known.version == 1
    whole = replace(maps[0], maps=tuple(maps))
    assert np.array_equal(known.stands, stand_probability(whole, rescue), equal_nan=True)
    free = known.stands >= FREE_P
    assert (free & (p >= FREE_P)).sum() == (p >= FREE_P).sum()
    assert not free[GRID.cell_of(23.5, 0.0)]
