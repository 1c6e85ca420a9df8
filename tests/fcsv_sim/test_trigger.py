# SPDX-License-Identifier: Apache-2.0
"""Simulated cameras take their pictures in phase."""

import numpy as np
import pytest

from fcsv_sim.sensors import trigger

WALL_S = 1795627487.0  # as large as clocks are: a double holds 0.2 us there


@pytest.mark.parametrize("rate_hz", [2.0, 6.0, 7.3, 30.0])
def test_cameras_that_look_at_any_time_of_a_period_take_the_same_moment(rate_hz):
    at = trigger.newest(WALL_S, rate_hz)
    looked = at + np.linspace(1e-6, 1.0 / rate_hz - 1e-6, 50)
    assert {trigger.newest(t, rate_hz) for t in looked} == {at}


@pytest.mark.parametrize("rate_hz", [2.0, 6.0, 7.3, 30.0])
def test_moments_follow_one_another_without_a_gap_or_a_repeat(rate_hz):
    stamps = [trigger.newest(WALL_S, rate_hz)]
    for _ in range(200):
        stamps.append(trigger.after(stamps[-1], rate_hz))
        assert trigger.newest(stamps[-1], rate_hz) == stamps[-1]
    assert np.diff(stamps) == pytest.approx(1.0 / rate_hz, abs=1e-6)
