# SPDX-License-Identifier: Apache-2.0
"""Trackers that freeze or run off, held against the velocity of an autopilot that flies: see
support/flown.py. What is withheld never reaches its filter, so that it comes down where it was."""

import numpy as np
import pytest
from support.flown import flown_link

from fcsv_control.flight.pose_feed.feed_check import PoseCheck
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode


@pytest.fixture
def loop():
    loop = flown_link()
    loop.check, loop.tracker = PoseCheck(), lambda T, _s: loop.noisy(T)
    yield loop
    loop.target, loop.line_up, loop.check = None, True, None
    loop.tracker = lambda T, _s: loop.noisy(T)
    if loop.core.state.armed:  # the next test begins on the ground
        loop.core.set_mode(loop.t, Mode.LAND)
        loop.until(lambda: not loop.core.state.armed, 60.0)
    loop.close()


def test_hovering_and_a_square_raise_no_doubt(loop):
    loop.hover()
    withheld, judge = [], loop.check.passes_in_flight

    def judged(*arguments):
        believed = judge(*arguments)
        withheld.append(not believed)
        return believed

    loop.check.passes_in_flight = judged
    home = loop.target.copy()
    for x, y, z, yaw in (
        (6.0, 0.0, 0.0, 0.3),
        (6.0, 6.0, 3.0, 1.8),
        (0.0, 6.0, 0.0, -2.5),
        (0.0, 0.0, 2.0, 0.3),
    ):
        loop.target = transforms.from_xyz_yaw(home[:3, 3] + [x, y, z], yaw)
        loop.run(6.0)
        assert loop.check.doubt == ""
    assert np.mean(withheld) < 0.01


def test_a_take_off_raises_no_doubt(loop):
    loop.hover()
    assert loop.check.doubt == ""


@pytest.mark.parametrize("speed_mps", [0.0, 1.5])
def test_a_frozen_tracker_is_doubted_and_it_comes_down_where_it_was(loop, speed_mps):
    loop.hover()
    if speed_mps:
        loop.target = transforms.from_xyz_yaw(
            loop.target[:3, 3] + [12.0, 0.0, 0.0], transforms.yaw(loop.target)
        )
        loop.run(2.5)
    kept = loop.noisy(loop.T_true)
    kept[2, 3] += 0.05
    loop.tracker = lambda _T, _s: transforms.transform(
        kept[:3, :3], kept[:3, 3] + loop.noisy(np.eye(4))[:3, 3] * 0.05
    )
    comes_down(loop, 1.0)


@pytest.mark.parametrize("speed_mps", [0.8, 3.0, 9.0])
def test_a_tracker_that_runs_off_is_doubted_and_it_comes_down_where_it_was(loop, speed_mps):
    loop.hover()
    begun_s = loop.t

    def runs_off(T, now_s):
        return transforms.transform(
            T[:3, :3], loop.noisy(T)[:3, 3] + [speed_mps * (now_s - begun_s), 0.0, 0.0]
        )

    loop.tracker = runs_off
    comes_down(loop, 1.5)


def comes_down(loop, drift_m):
    """Doubt within a second; LAND then ends near where it was, but for the way that it takes to
    stop."""
    begun_s, start = loop.t, loop.p_true_m.copy()
    assert loop.until(lambda: loop.check.doubt, 1.0), "within a second"
    took_s = loop.t - begun_s
    assert took_s < 0.8
    v_mps = float(np.linalg.norm(loop.p_true_m - start)) / took_s
    there = loop.p_true_m.copy()
    loop.core.set_mode(loop.t, Mode.LAND)
    loop.target = None
    assert loop.until(lambda: not loop.core.state.armed, 40.0)
    came_m = float(np.linalg.norm((loop.p_true_m - there)[:2]))
    print(f"doubt after {took_s:.2f} s at {v_mps:.1f} m/s, came down {came_m:.2f} m off")
    assert came_m < drift_m + v_mps**2 / 4.0 + 0.5 * v_mps
