# SPDX-License-Identifier: Apache-2.0
"""How long nothing of a flow came."""

import doctest

import pytest

from fcsv_geometry.streams import silence
from fcsv_geometry.streams.silence import Silence, in_steps


def test_doctests():
    result = doctest.testmod(silence)
    assert result.attempted and not result.failed


def test_a_silence_that_is_given_up_counts_and_one_that_is_not_wanted_does_not():
    pictures = Silence(1.0)
    pictures.came(5.0)
    assert pictures.lasts_s(9.0) == 0.0 and pictures.times == 0
    pictures.want(10.0)
    pictures.want(12.0)
    assert pictures.lasts_s(13.0) == 3.0, "it counts from when it was wanted first"
    pictures.want(14.0, wanted=False)
    assert (pictures.lasts_s(20.0), pictures.times, pictures.worst_s) == (0.0, 1, 4.0)
    pictures.want(30.0)
    assert pictures.lasts_s(31.0) == 0.0


def test_what_is_said_changes_seldom():
    said = [in_steps(second) for second in range(1000)]
    assert said == sorted(said) and sorted(set(said)) == [0, 1, 2, 5, 10, 20, 50, 100, 200, 500]


@pytest.mark.parametrize("longest_s", [0.0, -1.0, float("nan")])
def test_no_length_that_is_none(longest_s):
    with pytest.raises(ValueError, match="longest_s"):
        Silence(longest_s)
