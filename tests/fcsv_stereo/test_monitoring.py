# SPDX-License-Identifier: Apache-2.0
"""The picture of monitoring, for people."""

import numpy as np
import pytest

from fcsv_stereo import monitoring


def test_depth_is_red_near_and_blue_far_and_black_where_there_is_none():
    near, middle, far, none = monitoring.colours(np.array([[5.0, 45.0, 400.0, np.nan]]))[0].astype(int)
    assert near[0] > near[2] and far[2] > far[0] and middle[1] == max(middle) and not none.any()
    beyond = monitoring.colours(np.array([[0.0, 1e4]]))[0]
    assert (beyond == [near, far]).all()


@pytest.mark.parametrize("line", ["4.1 Hz", "of one instant, " * 20])
def test_the_picture_holds_both_and_a_line_that_fits(line):
    rgb, depth = np.full((120, 160, 3), 90, np.uint8), np.full((120, 160), np.nan)
    shown = monitoring.picture(rgb, depth, line)
    assert shown.shape == (120 + 44, 320, 3)
    assert (shown[22:142, :160] == 90).all() and not shown[22:142, 160:].any()
    assert shown[:22].any() and not shown[:22, -4:].any() and shown[-22:-16].any(axis=2).all()


def test_a_rate_is_of_the_last_seconds():
    rate = monitoring.Rate()
    assert rate.hz(0.0) == 0.0
    for t in (0.0, 10.0, 10.5, 11.0):
        rate.tick(t)
    assert rate.hz(11.0) == 2.0 and rate.hz(20.0) == 0.0
