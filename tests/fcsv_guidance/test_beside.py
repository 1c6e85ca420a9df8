# SPDX-License-Identifier: Apache-2.0
"""Who walks up to a robot and is no longer told from it may stand beside it."""

import numpy as np
import pytest

from fcsv_guidance.ground.beside import BesideWatch

NOTHING = np.empty((0, 2)), np.empty(0)
ROBOT_M = np.array([8.8, 5.0])


def thing(off_m, size_m=1.2):
    """The cells of a thing, and how far from the robot's they are."""
    off = np.arange(off_m, off_m + size_m, 0.1)
    return np.column_stack([10.0 + off, np.full(len(off), 5.0)]), off


def after(*views):
    """What is thought after views, one a second, that show one thing, or none, so far (m) from where
    the robot may be seen."""
    watch = BesideWatch()
    for second, off_m in enumerate(views):
        watch.observe(float(second), *(NOTHING if off_m is None else thing(off_m)), ROBOT_M)
    return watch


@pytest.mark.parametrize(
    "views, may_stand",
    [
        ((3.8, 2.4, 1.0), True),
        ((3.8, 2.4, 1.0, None, None, None), True),
        ((3.8, None, 1.0, None), True),  # a view missed him
        ((3.8, 2.4, 1.0, 0.3, 1.0, None), True),  # his near side is taken for the robot
        ((3.8, 2.4, 1.0, None, 0.8, 2.0), False),  # he is seen to leave
        ((3.8, 2.4, 1.0, None, None, 2.0), True),  # one sighting is no walk
        ((3.8, 2.4, 1.0, 2.3, None), False),
        ((1.0, None), False),  # a wrong depth comes from nowhere
        ((9.0, 1.0, None), False),  # nobody is so fast
        ((1.3, 1.0, 1.2, 0.9, None), False),  # noise of a thing that stood and is taken away
        ((2.1, 1.3, 2.0, 0.9, 1.9, None), False),  # and of one whose depth is matched worse
        ((2.4, 1.9, 1.4, 0.9, None), True),  # slowly: he is seen where he was, too
        ((1.4, 0.9, None), True),  # seen twice, slow, and gone
        ((1.4, None, 0.4, None), True),
        ((1.4, 0.9, 0.9, None), False),  # it stopped where it is seen
        ((0.9, 1.4, None), False),  # he left
        ((1.1, 0.9, None), False),  # noise
        ((3.8, 2.4, None), False),  # he turned off before
        ((3.8, None, None, None, 1.0, None), False),  # too long ago to be one and the same
        ((None, None), False),
    ],
)
def test_he_may_stand_beside_it_once_he_came_up_and_until_he_is_seen(views, may_stand):
    assert after(*views).may_stand == may_stand


def test_a_thing_that_stands_while_the_robot_passes_it_did_not_come():
    watch = BesideWatch()
    for second, off_m in enumerate((3.0, 2.2, 1.4, 0.6)):
        watch.observe(float(second), thing(2.0)[0], thing(off_m)[1], ROBOT_M)
    watch.observe(4.0, *NOTHING, ROBOT_M)
    assert not watch.may_stand


def test_who_looked_ends_it():
    watch = after(3.8, 2.4, 1.0, None)
    watch.forget(6.5)
    watch.observe(7.0, *NOTHING, ROBOT_M)
    assert not watch.may_stand


def test_who_looked_while_somebody_is_on_his_way_looks_again():
    watch = after(3.8, 2.4, 1.0, None)  # a view misses him; he walks on
    watch.forget(3.5)
    assert watch.may_stand
    watch.forget(6.5)
    assert not watch.may_stand
