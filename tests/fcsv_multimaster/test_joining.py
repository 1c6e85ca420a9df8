# SPDX-License-Identifier: Apache-2.0
"""When a relay joins anew or opens a link anew, and when it gives itself up."""

from fcsv_multimaster.network.joining import HalfOpen, Joining


def test_nothing_is_done_without_a_reason():
    joining = Joining()
    assert not joining.due(slept=False, moved=False) and not joining.hopeless


def test_who_slept_joins_once_if_it_can():
    joining = Joining()
    assert joining.due(slept=True, moved=False)
    joining.ended(could=True)
    assert not joining.due(slept=False, moved=False) and not joining.hopeless


def test_who_slept_and_finds_its_port_taken_twice_is_started_again():
    """As a session that never closed held it for a minute: nobody heard uav2 until the flight was
    over."""
    joining = Joining()
    joining.due(slept=True, moved=False)
    joining.ended(could=False)
    assert not joining.hopeless and joining.due(slept=False, moved=False)
    joining.ended(could=False)
    assert joining.hopeless


def test_an_address_that_went_away_is_waited_for():
    joining = Joining()
    joining.due(slept=False, moved=True)
    for _ in range(100):
        joining.ended(could=False)
        assert joining.due(slept=False, moved=False) and not joining.hopeless
    joining.ended(could=True)
    assert not joining.due(slept=False, moved=False)


def due(half_open, counts, from_s=0.0, every_s=0.5):
    """When it is to be opened anew, of (listening, there) at looks that follow each other."""
    return [
        from_s + i * every_s
        for i, c in enumerate(counts)
        if half_open.due(*c, from_s + i * every_s)
    ]


def test_a_link_whose_peers_are_all_there_or_all_away_is_left_alone():
    """More are there than listen: one that is being found, or a machine that is not let in."""
    for counts in (
        [(1, 1)] * 20,
        [(0, 0)] * 20,
        [(0, 1)] * 20,
        [(2, 3)] * 20,
        [(1, 0), (1, 1)] * 20,
        [(1, 0), (0, 0)] * 20,
    ):
        assert due(HalfOpen(), counts) == []


def test_a_link_with_a_peer_that_listens_and_is_not_there_is_opened_anew_and_again_if_that_did_not_help():
    half_open = HalfOpen()
    assert due(half_open, [(2, 2)] * 4 + [(2, 1)] * 8) == [3.5, 5.5]
    assert due(half_open, [(2, 2), (2, 1), (2, 1), (2, 1)], from_s=10.0) == []


def test_a_link_that_could_not_be_opened_is_tried_until_it_can():
    half_open = HalfOpen()
    assert due(half_open, [(1, 0)] * 4) == [1.5]
    half_open.failed()
    assert due(half_open, [(0, 0)] * 4, from_s=2.0) == [3.5]
    half_open.failed()
    assert due(half_open, [(0, 0)] * 4, from_s=4.0) == [5.5]
    assert due(half_open, [(0, 0), (1, 1)] * 10, from_s=6.0) == []
