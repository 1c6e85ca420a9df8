# SPDX-License-Identifier: Apache-2.0
"""What two vehicles must keep of each other, by what is known of their places."""

import doctest

import numpy as np
import pytest

from fcsv_geometry.missions import separation
from fcsv_geometry.missions.separation import SeparationRules, doubt_m, share

AIR = SeparationRules(0.6, 3.0)


def test_examples_hold():
    done = doctest.testmod(separation)
    assert done.attempted and not done.failed


@pytest.mark.parametrize(
    "offset_m, kept", [((0.6, 0.0, 0.0), 1.0), ((0.0, 0.0, 1.8), 1.0), ((0.3, 0.0, 0.0), 0.5)]
)
def test_height_counts_for_a_third(offset_m, kept):
    assert share(np.array(offset_m), AIR) == pytest.approx(kept)
    assert share(np.array([offset_m, offset_m]), AIR) == pytest.approx([kept, kept])


def test_what_is_known_less_well_needs_more_room():
    """Never less than what both trackers drift; age counts from a quarter of a second on, for a
    second at most."""
    usual = doubt_m(age_s=0.2, speed_mps=2.0)
    assert usual == doubt_m() == pytest.approx(0.15)
    assert doubt_m([0.1, 0.1]) == pytest.approx(3.0 * np.hypot(0.05, np.hypot(0.1, 0.1)))
    assert doubt_m(age_s=0.75, speed_mps=1.0) == pytest.approx(usual + 0.5)
    assert doubt_m(age_s=9.0, speed_mps=9.0) == doubt_m(age_s=1.25, speed_mps=2.0)
    assert (
        share(np.array([0.7, 0.0, 0.0]), AIR) > 1.0 > share(np.array([0.7, 0.0, 0.0]), AIR, usual)
    )


def test_of_each_vehicle_another_distance_is_kept():
    """One that may lie anywhere within 18 m, and one that is known: it goes as far as it must, no
    further."""
    here, lost, known = np.array([5.0, 0.0, 8.0]), np.zeros(3), np.array([8.5, 0.0, 8.0])
    place = separation.aside(here, [lost, known], [18.0, 2.5], lost)
    assert np.hypot(*(place - lost)[:2]) > 18.0 and np.hypot(*(place - known)[:2]) > 2.5
    assert np.hypot(*(place - here)[:2]) < 18.0


def test_a_way_aside_stays_in_the_fence_where_one_of_them_is_clear():
    here, other = np.array([2.0, 0.0, 8.0]), np.zeros(3)
    free = separation.aside(here, [other], 6.0, other)
    fenced = separation.aside(here, [other], 6.0, other, within=lambda p: p[0] < 9.0)
    assert free[0] > 9.0 > fenced[0] and np.hypot(*fenced[:2]) > 6.0
    nowhere = separation.aside(here, [other], 6.0, other, within=lambda p: False)
    assert nowhere.tolist() == free.tolist(), "then better out of the fence than into another"
