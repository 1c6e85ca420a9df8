# SPDX-License-Identifier: Apache-2.0
"""What vehicles occupy, and who is in whose way."""

import doctest

import numpy as np
import pytest

from fcsv_geometry.missions import airspace
from fcsv_geometry.missions.airspace import HorizontalClearance, Occupant


def at(x, y, z, **more):
    return Occupant([np.array([x, y, z])], **more)


def test_examples_hold():
    done = doctest.testmod(airspace)
    assert done.attempted and not done.failed


@pytest.mark.parametrize("height_m, meets", [(7.0, True), (7.8, False), (8.2, False)])
def test_beside_counts_less_than_below(height_m, meets):
    """2 m away: less than what is kept of one below, more than of one at the same height."""
    assert airspace.comes_down_on(at(0, 0, 8), at(2, 0, height_m), 2.5, 0.5, 1.8) == meets


def test_the_way_to_a_stand_counts():
    lower, moving = at(4, 0, 3), at(0, 0, 8, stop_m=np.array([3.0, 0.0, 8.0]))
    assert airspace.comes_down_on(moving, lower, 2.5)
    assert not airspace.comes_down_on(at(0, 0, 8), lower, 2.5)


def test_one_that_lies_somewhere_has_no_height():
    here, lost = at(8, 0, 4), {"astray": True, "reach_m": 9.0}
    assert airspace.may_lie_beneath(here, at(0, 0, 20, lies=True, **lost))
    assert not airspace.may_lie_beneath(here, at(0, 0, 20, **lost)), "it still flies"
    assert not airspace.may_lie_beneath(here, at(0, 0, 3)), "it is where it is"


def test_who_lands_keeps_out_of_the_reach_of_a_lost_one():
    own, others = at(2, 0, 8), {"lost": at(0, 0, 0, astray=True, reach_m=12.0, lies=True)}
    flies, lands = (
        airspace.aside(own, others, "lost", HorizontalClearance(2.5), lands)
        for lands in (False, True)
    )
    assert 6.0 <= np.hypot(*flies[:2]) and 12.0 <= np.hypot(*lands[:2])


def test_two_that_do_not_hear_each_other_part():
    left, right = (
        airspace.aside(
            at(0, 0, 8), {"b": at(1, 0, 3)}, "b", HorizontalClearance(2.5), side=side, agreed=True
        )
        for side in (np.array([0.0, 1.0]), np.array([0.0, -1.0]))
    )
    assert left[1] > 0.0 > right[1]
