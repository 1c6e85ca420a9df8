# SPDX-License-Identifier: Apache-2.0
"""Which stamps of a recorded topic can be believed."""

import doctest

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcsv_geometry.streams import stamps
from fcsv_geometry.streams.stamps import in_order, stuck
from fcsv_geometry.trajectory import Trajectory

STEADY = (1000.0 + 0.05 * np.arange(200)).tolist()


def test_what_the_docstrings_say():
    result = doctest.testmod(stamps)
    assert result.attempted >= 2 and result.failed == 0


@pytest.mark.parametrize("at", [0, 1, 100, 198, 199])
@pytest.mark.parametrize("wrong", [0.0, 1060.0, 940.0, 1e9, -5.0])
def test_a_single_wrong_stamp_alone_is_left_out(at, wrong):
    found = in_order([*STEADY[:at], wrong, *STEADY[at + 1 :]], alone_s=10.0)
    assert list(found.left_out) == [at] and found.jumps == []
    assert found.kept == [i for i in range(200) if i != at]


@given(st.sets(st.integers(0, 199), max_size=8), st.randoms(use_true_random=False))
def test_scattered_wrong_stamps_lose_no_right_one(wrong, random):
    stamps_s = [random.uniform(0.0, 5000.0) if i in wrong else s for i, s in enumerate(STEADY)]
    found = in_order(stamps_s, alone_s=10.0)
    assert len(found.kept) >= 200 - len(wrong) - 2 and set(found.left_out) | set(found.kept) == set(
        range(200)
    )
    assert all(
        a < b
        for a, b in zip([stamps_s[i] for i in found.kept], [stamps_s[i] for i in found.kept][1:])
    )


@pytest.mark.parametrize("places", [(101, 100), (101, 102, 100), (102, 100, 101), (102, 101, 100)])
@pytest.mark.parametrize("first", [0, 1, 100])
def test_messages_that_changed_places_on_the_way_are_sorted(first, places):
    """Each with its own stamp, recorded before a neighbour: nothing is wrong with them."""
    order = [*range(first), *(first + p - 100 for p in places), *range(first + len(places), 200)]
    found = in_order([STEADY[i] for i in order], alone_s=10.0)
    assert not found.left_out and not found.jumps
    assert [order[i] for i in found.kept] == list(range(200))


def test_two_that_were_late_and_follow_one_another_are_sorted():
    order = [*range(196), 198, 196, 199, 197]
    found = in_order([STEADY[i] for i in order], alone_s=10.0)
    assert not found.left_out and [order[i] for i in found.kept] == list(range(200))


def test_a_wrong_stamp_near_its_neighbours_fills_no_gap():
    """At 20 Hz: 0.08 s early, two seconds back, and a clock that goes back by 0.09 s."""
    for wrong_s in (STEADY[100] - 0.08, STEADY[60] + 0.01):
        found = in_order([*STEADY[:100], wrong_s, *STEADY[101:]])
        assert list(found.left_out) == [100]
    found = in_order([*STEADY[:100], *(s - 0.09 for s in STEADY[100:])])
    assert list(found.left_out.values()) == ["is 40 ms before its neighbours"]


def test_a_clock_that_jumps_back_keeps_what_can_be_told_apart():
    found = in_order([*STEADY, *(s - 4.0 for s in STEADY)])
    assert found.jumps == [(STEADY[-1], STEADY[0] - 4.0)]
    kept = np.array([*STEADY, *(s - 4.0 for s in STEADY)])[found.kept]
    assert (
        kept.min() == STEADY[0] - 4.0
        and kept.max() == STEADY[-1]
        and not np.any((kept > 1000.1) & (kept < 1005.8))
    )
    assert in_order([*STEADY, *(s - 500.0 for s in STEADY)]).left_out == {}, (
        "no time is counted twice"
    )


def test_a_stamp_that_stands_still_for_a_while_costs_the_messages_that_repeat_it():
    found = in_order([*STEADY[:100], *[STEADY[100]] * 30, *STEADY[130:]])
    assert found.kept == [*range(101), *range(130, 200)] and found.jumps == []
    assert set(found.left_out.values()) == {"is that of the message before"}
    found = in_order([*STEADY[:100], *[0.0] * 30, *STEADY[130:]])
    assert len(found.kept) == 170 and set(found.left_out.values()) == {"is 0"}


def test_simulated_time_begins_at_0():
    found = in_order([0.05 * i for i in range(100)], alone_s=10.0)
    assert found.kept == list(range(100)) and not found.left_out


def test_silences_and_forward_steps_are_in_order():
    stamps_s = [*STEADY, *(s + 60.0 for s in STEADY)]
    found = in_order(stamps_s, alone_s=10.0)
    assert found.kept == list(range(400)) and not found.left_out and not found.jumps


@pytest.mark.parametrize(
    "stamps_s, words", [([0.0] * 9, "are 0"), ([0.0], "are 0"), ([7.0] * 9, "stand still at 7.000")]
)
def test_stamps_that_say_nothing(stamps_s, words):
    assert words in stuck(stamps_s) and stuck(STEADY) == stuck([5.0]) == stuck([]) == ""


def test_one_pose_ahead_does_not_cost_a_live_track_those_that_follow():
    track = Trajectory(keep_s=3.0)
    for i, stamp_s in enumerate(STEADY):
        assert track.add(stamp_s + 60.0 * (i == 100), np.eye(4))
    assert len(track) >= 60 and track.span_s[1] == STEADY[-1]
    track.at(STEADY[150] + 0.01)
    assert not track.add(STEADY[190], np.eye(4))


def test_a_live_clock_that_goes_ahead_for_good_is_followed():
    track = Trajectory(keep_s=3.0)
    assert all(track.add(s, np.eye(4)) for s in (*STEADY, *(s + 60.0 for s in STEADY)))
    assert track.span_s[1] == STEADY[-1] + 60.0 and len(track) <= 122
