# SPDX-License-Identifier: Apache-2.0
"""The autopilot's estimate held against the feed: jumps adopted at once or late; the link's core in
a closed loop."""

import os

os.environ.setdefault("MAVLINK20", "1")

import doctest

import numpy as np
import pytest
from support.flown import SimulatedLoop

from fcsv_control.errors import CommandRefused
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.mavlink.keeper import ConnectionKeeper
from fcsv_control.flight.pose_feed import estimate
from fcsv_control.flight.pose_feed.estimate import MOVED_M, EstimateWatch
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer


def test_doctests():
    result = doctest.testmod(estimate)
    assert result.attempted and not result.failed


def told(watch, seconds, flown, jumped, moved, armed=True, hz=30.0, lag_s=0.05):
    """Feed and estimates at 30 Hz of a vehicle at ``flown(t)``; what the estimate was said to have
    moved in all."""
    total, at_s = np.zeros(3), []
    for k in range(int(seconds * hz)):
        t = k / hz
        watch.pose_sent(t, t, flown(t) + jumped(t), False)
        step = watch.estimate(t, flown(max(0.0, t - lag_s)) + moved(t), armed)
        if step is not None:
            total, at_s = total + step, [*at_s, t]
    return total, at_s


def nothing(_t):
    return np.zeros(3)


def ramp(start_s, seconds, step_m):
    return lambda t: np.array([step_m * np.clip((t - start_s) / seconds, 0.0, 1.0), 0.0, 0.0])


def test_brisk_flight_is_no_move_of_the_estimate():
    """5 m/s and turns of 3 m/s2, the estimate 0.05 s behind."""
    flown = lambda t: np.array([8 * np.sin(0.6 * t), 8 * np.cos(0.6 * t), 0])  # noqa: E731
    assert told(EstimateWatch(), 20.0, flown, nothing, nothing)[1] == []


@pytest.mark.parametrize("step_m", [0.5, 5.0, 30.0])
def test_a_jump_that_is_first_rejected_then_adopted_over_seconds_is_told_on_the_way(step_m):
    """No step of the estimate is larger than a flying vehicle's, and feed and estimate end
    together."""
    total, at_s = told(
        EstimateWatch(),
        15.0,
        lambda t: np.array([0.3 * t, 0, 2.0]),
        ramp(3.0, 1e-9, step_m),
        ramp(8.0, 4.3, step_m),
    )
    assert total[0] == pytest.approx(step_m, abs=MOVED_M)
    assert 8.0 < at_s[0] and at_s[-1] < 12.5


def test_a_jump_that_comes_back_before_it_was_adopted_is_none():
    jumped = lambda t: np.array([5.0 if 3.0 < t < 6.0 else 0.0, 0, 0])  # noqa: E731
    assert told(EstimateWatch(), 10.0, nothing, jumped, nothing)[1] == []


def test_disarmed_the_estimate_may_move_and_nobody_is_told():
    watch = EstimateWatch()
    assert told(watch, 10.0, nothing, nothing, ramp(1.0, 8.0, 2.0), armed=False)[1] == []
    assert watch.apart_m(9.99) == pytest.approx(2.0, abs=0.1)  # but it is known


def test_after_a_gap_of_the_feed_the_estimate_is_the_better_witness():
    watch = EstimateWatch()
    for k in range(60):
        watch.pose_sent(k / 30, k / 30, np.zeros(3), False)
        watch.estimate(k / 30, np.zeros(3), True)
    assert np.isnan(watch.apart_m(5.0))
    for k in range(150, 200):
        watch.estimate(k / 30, np.array([3.0, 0, 0]), True)
        watch.pose_sent(k / 30, k / 30, np.array([3.0, 0, 0]), False)
        assert watch.estimate(k / 30, np.array([3.0, 0, 0]), True) is None


def test_no_height_runs_away_with_the_links_origin_and_an_autopilots_restart_gets_a_new_one():
    """Before, the link's origin at altitude 0 made the height climb, and after a restart it never
    armed again."""
    loop = SimulatedLoop().run(30.0)
    assert loop.core.origin_set(loop.t) and loop.core.estimate_apart_m(loop.t) < 0.1
    loop.pilot.reboot()
    assert loop.until(lambda: not loop.core.origin_set(loop.t), 2.5)  # its streams have stopped
    assert loop.pilot.origin is None
    loop.run(8.0)
    assert loop.core.origin_set(loop.t) and loop.pilot.origin is not None
    loop.pilot._origin.value = None  # lost without a restart
    loop.run(10.0)
    assert loop.pilot.origin is not None and loop.core.origin_set(loop.t)


def test_an_origin_at_altitude_zero_does_not_count():
    loop = SimulatedLoop()
    loop.run(2.5)
    loop.pilot._origin.set((1, 1, 0), True)
    loop.run(5.0)
    assert not loop.core.origin_set(loop.t) and loop.core.listener.origin_at_zero
    with pytest.raises(ValueError, match="origin_alt_m"):
        LinkParameters(origin_alt_m=0.0)


def test_rate_and_age_of_the_feed():
    loop = SimulatedLoop().run(4.0)
    assert loop.core.pose_rate_hz(loop.t) == pytest.approx(30.0, abs=2.0)
    loop.feed_hz = 0.0
    loop.run(1.0)
    assert loop.core.pose_age_s(loop.t) > 0.9
    loop.feed_hz = 30.0
    loop.run(0.1)
    assert loop.core.pose_age_s(loop.t) < 0.1


def test_stamps_to_the_autopilot_only_rise():
    core = LinkCore(LinkParameters())
    for stamp_s in (10.0, 10.03, 9.0, 10.06):
        core.send_pose(stamp_s, np.eye(4), now_s=20.0)
    stamps = [m.usec for m in core.outgoing()]
    assert stamps == sorted(set(stamps)) and stamps[-1] == 10060000


def test_nobody_sees_a_connection_without_a_mode(monkeypatch):
    """Before, another thread could see "connected" of a vehicle in flight before its mode was
    noted."""
    loop, seen = SimulatedLoop(), []
    heartbeat = ConnectionKeeper.heartbeat
    monkeypatch.setattr(
        ConnectionKeeper,
        "heartbeat",
        lambda k, now_s, booting: (heartbeat(k, now_s, booting), seen.append(loop.core.state.mode))[
            0
        ],
    )
    loop.run(0.1)
    assert set(seen) == {Mode.STABILIZE}


def test_whose_mode_it_is():
    loop = SimulatedLoop().hover()
    assert loop.core.mode_is_ours
    loop.pilot.set_mode(loop.t, modes.BRAKE)
    loop.run(0.1)
    assert loop.core.state.mode == Mode.BRAKE and not loop.core.mode_is_ours
    loop.core.set_mode(loop.t, Mode.LAND)
    loop.run(0.2)
    assert loop.core.state.mode == Mode.LAND and loop.core.mode_is_ours


def test_two_autopilots_on_a_line_without_a_target_are_refused():
    loop = SimulatedLoop().run(3.0)
    stranger = MavlinkServer(Autopilot(0.4, 5, 2.0), 7)
    stranger.step(loop.t, (0.0, 0.0, 0.0))
    for message in stranger.outgoing():
        loop.core.receive(loop.t, message)
    with pytest.raises(CommandRefused, match="autopilots 1, 7 are on one line; set target_system"):
        loop.core.set_mode(loop.t, Mode.GUIDED)
    with pytest.raises(CommandRefused, match="set target_system"):
        loop.core.arm(loop.t, True)
    loop.core.set_mode(loop.t, Mode.LAND)  # stopping is never refused
