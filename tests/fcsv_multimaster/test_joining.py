# SPDX-License-Identifier: Apache-2.0
"""When a relay joins anew, and when it gives itself up."""

from fcsv_multimaster.joining import Joining


def test_nothing_is_done_without_a_reason():
    joining = Joining()
    assert not joining.due(slept=False, moved=False) and not joining.hopeless


def test_who_slept_joins_once_if_it_can():
    joining = Joining()
    assert joining.due(slept=True, moved=False)
    joining.ended(could=True)
    assert not joining.due(slept=False, moved=False) and not joining.hopeless


def test_who_slept_and_finds_its_port_taken_twice_is_started_again():
    """As a session that never closed held it for a minute: nobody heard uav2 until the flight was over."""
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
