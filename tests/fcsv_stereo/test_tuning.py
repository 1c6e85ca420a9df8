# SPDX-License-Identifier: Apache-2.0
"""Tuned numbers: what grows with the focal length does so only beyond the pictures that it was
chosen on."""

import pytest

from fcsv_stereo.joint.tuning import (
    FAR_REMATCH,
    PAIRS,
    REFERENCE_FOCAL_PX,
    STAGES,
    beyond_reference,
    table,
)


@pytest.mark.parametrize(
    "focal_px, times", [(300.0, 1.0), (601.8, 1.0), (2.0 * REFERENCE_FOCAL_PX, 2.0)]
)
def test_a_pose_that_is_off_by_one_angle_is_off_by_more_pixels_of_a_finer_picture(focal_px, times):
    assert beyond_reference(focal_px) == times
    assert PAIRS.most_pose_off_px(focal_px) == times * PAIRS.most_pose_px


def test_what_is_far_has_the_levels_of_its_steps():
    assert (FAR_REMATCH.levels - 1) * FAR_REMATCH.step_px == FAR_REMATCH.far_px


def test_the_table_has_a_line_for_every_number():
    lines = [line for stage in STAGES for line in table(stage)]
    assert len({line.split("|")[1] for line in table(STAGES[0])}) > 3
    assert all(line.count("|") == 7 for line in lines if line.startswith("| "))
