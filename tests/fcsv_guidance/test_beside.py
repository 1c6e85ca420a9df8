# SPDX-License-Identifier: Apache-2.0
"""Who walks up to a robot and is no longer told from it may stand beside it."""

import numpy as np
import pytest

from fcsv_guidance.beside import BesideWatch

HIDDEN_M = 1.2


def after(*views):
    """What is thought after views that show one thing, or none, so far (m) from the robot."""
    watch = BesideWatch()
    for away_m in views:
        things = np.empty((0, 2)) if away_m is None else np.array([[10.0 + away_m, 5.0]])
        watch.observe(things, np.array([10.0, 5.0]), HIDDEN_M)
    return watch


@pytest.mark.parametrize(
    "views, may_stand",
    [
        ((5.0, 3.6, 2.2, None), True),
        ((5.0, 3.6, 2.2, None, None, None), True),
        ((5.0, 3.6, 2.2, None, 2.0, 3.2), False),  # he is seen to leave
        ((5.0, 3.6, 2.2, 3.5, None), False),
        ((2.2, None), False),  # a wrong depth comes from nowhere
        ((2.3, 2.2, 2.3, None), False),  # a thing that stood is taken away
        ((5.0, 3.6, None), False),  # he turned off before
        ((None, None), False),
    ],
)
def test_he_may_stand_beside_it_once_he_came_up_and_until_he_is_seen(views, may_stand):
    assert after(*views).may_stand == may_stand


def test_who_looked_ends_it():
    watch = after(5.0, 3.6, 2.2, None)
    watch.forget()
    watch.observe(np.empty((0, 2)), np.array([10.0, 5.0]), HIDDEN_M)
    assert not watch.may_stand
