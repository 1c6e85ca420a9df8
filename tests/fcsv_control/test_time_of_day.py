# SPDX-License-Identifier: Apache-2.0
"""The time of day against the monotonic clock: a step is seen, and nothing else is taken for
one."""

import doctest

import pytest

from fcsv_control.mission import time_of_day
from fcsv_control.mission.time_of_day import TimeOfDay


def read(day, at_s, offset_s, delay_s=0.0):
    """The time of day is read at ``at_s``; the process then does not run for ``delay_s``."""
    day.update(at_s, at_s + offset_s, at_s + delay_s)


def test_examples_hold():
    assert not doctest.testmod(time_of_day).failed


@pytest.mark.parametrize("step_s", [-60.0, -0.4, 0.1, 2.0])
def test_a_step_is_seen_and_told_from_then_on(step_s):
    day = TimeOfDay()
    for k in range(100):
        read(day, 0.1 * k, 1.7e9 + (step_s if k >= 50 else 0.0))
    assert day.times_set == 1 and day.offset_s == pytest.approx(1.7e9 + step_s, abs=1e-6)


def test_a_busy_machine_is_no_step():
    """Between two looks at clocks it may not run for seconds."""
    day = TimeOfDay()
    for k in range(100):
        read(day, 10.0 * k, 1.7e9, delay_s=(k % 7) * 0.5)
    assert day.times_set == 0 and day.offset_s == pytest.approx(1.7e9, abs=1e-6)


def test_a_step_that_hides_in_such_a_pause_is_seen_at_the_next_reading():
    day = TimeOfDay()
    read(day, 0.0, 5.0)
    read(day, 1.0, 5.4, delay_s=1.0)
    assert day.times_set == 0
    read(day, 2.1, 5.4)
    assert day.times_set == 1 and day.offset_s == pytest.approx(5.4)


def test_a_clock_that_is_kept_right_slowly_is_not_set():
    """NTP slews by 0.5 ms a second at most."""
    day = TimeOfDay()
    for k in range(6000):
        read(day, 0.1 * k, 5.0 + 0.0005 * 0.1 * k)
    assert day.times_set == 0 and day.offset_s == pytest.approx(5.0 + 0.0005 * 599.9, abs=1e-3)
