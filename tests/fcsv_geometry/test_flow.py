# SPDX-License-Identifier: Apache-2.0
"""Drops counted by reason, and the gate that lets at most N messages a second pass."""

import doctest
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcsv_geometry.streams import flow
from fcsv_geometry.streams.flow import DropCounter, RateGate


def test_identities_in_the_docstrings():
    result = doctest.testmod(flow)
    assert result.attempted > 0 and result.failed == 0


def test_drops_are_counted_by_reason():
    drops = DropCounter()
    assert not drops and drops["late"] == 0 and "late" not in drops and drops == {}
    drops.count("late")
    drops.count("of no frame", 3)
    drops.count("never", 0)
    assert drops == {"late": 1, "of no frame": 3} and drops.total == 4 and len(drops) == 2
    assert sorted(drops.items()) == [("late", 1), ("of no frame", 3)]


def test_each_reason_is_told_at_its_own_time():
    drops = DropCounter(quiet_s=5.0)
    assert drops.tells("late", 0.0) and drops.tells("of no frame", 1.0)
    assert (
        not drops.tells("late", 4.9)
        and drops.tells("late", 5.0)
        and not drops.tells("of no frame", 5.9)
    )
    assert (
        not drops.tells("late", 9.9) and drops.tells("late", 25.0) and not drops.tells("late", 29.9)
    )


def test_no_drop_is_lost_between_threads():
    drops = DropCounter()
    threads = [
        threading.Thread(target=lambda: [drops.count("late") for _ in range(2000)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for _ in range(200):
        dict(drops)  # read while others write
    for thread in threads:
        thread.join()
    assert drops["late"] == 8000


@pytest.mark.parametrize(
    "gate", [RateGate(10.0), RateGate(10.0, early=0.3), RateGate.bursting(10.0)]
)
def test_at_most_so_many_on_average(gate):
    assert sum(gate.passes(t) for t in np.arange(0.0, 10.0, 1 / 200)) == pytest.approx(100, abs=2)


@settings(max_examples=60)
@given(st.floats(0.5, 50), st.floats(1, 400), st.floats(0, 0.45), st.integers(0, 9), st.booleans())
def test_the_rate_and_the_gap_hold_for_any_flow(rate_hz, flow_hz, early, seed, bursting):
    random = np.random.default_rng(seed)
    times = np.cumsum(random.exponential(1.0 / flow_hz, 400))
    gate = RateGate.bursting(rate_hz) if bursting else RateGate(rate_hz, early)
    passed = [t for t in times if gate.passes(t)]
    assert len(passed) <= (times[-1] - times[0]) * rate_hz + 2 and passed[0] == times[0]
    if not bursting:
        assert np.diff(passed).min(initial=np.inf) >= (1 - 2 * early) / rate_hz - 1e-9


@pytest.mark.parametrize("jitter", [0.0, 0.04, 0.09])
def test_a_regular_flow_that_jitters_is_not_halved(jitter):
    random = np.random.default_rng(1)
    times = np.arange(600) / 30.0 + random.uniform(-jitter, jitter, 600) / 15.0
    gate = RateGate(15.0)
    assert sum(gate.passes(t) for t in times) == pytest.approx(300, abs=3)


def test_a_clock_that_is_set_back_does_not_silence_the_flow():
    for gate in (RateGate(1.0), RateGate.bursting(1.0)):
        assert gate.passes(1000.0) and gate.passes(1001.0)
        assert not gate.passes(1000.5)  # late, not another clock
        assert gate.passes(10.0)
        assert sum(gate.passes(10.0 + t) for t in np.arange(0.01, 10.0, 0.01)) == pytest.approx(
            10, abs=1
        )


def test_a_slow_rate_is_no_clock_that_was_set():
    gate = RateGate(0.1)
    assert (
        gate.passes(100.0)
        and not any(gate.passes(100.0 + t) for t in range(1, 8))
        and gate.passes(110.0)
    )


def test_a_rate_that_changes_counts_from_the_next():
    gate = RateGate(2.0, early=0.0)
    assert gate.due(0.0) and gate.due(0.0)  # to ask takes nothing
    gate.admit(0.0)
    assert not gate.due(0.4) and gate.due(0.5)
    gate.admit(0.5, 10.0)
    assert gate.due(0.6) and not gate.due(0.59)


@pytest.mark.parametrize("rate_hz, early", [(0.0, 0.1), (-1.0, 0.1), (10.0, 0.5), (10.0, -0.1)])
def test_what_is_no_gate_is_refused(rate_hz, early):
    with pytest.raises(ValueError):
        RateGate(rate_hz, early)
