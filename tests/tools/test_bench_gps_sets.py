# SPDX-License-Identifier: Apache-2.0
"""The bench of GPS sets: a small draw of it holds, and what it judges by is what it says."""

from dataclasses import replace

import numpy as np
import pytest

from bench import gps_sets


@pytest.fixture(scope="module")
def judged():
    return [j for of in gps_sets.run(60, 7).values() for j in of]


def test_the_truth_is_within_what_is_stated(judged):
    """Of 500 sets 97 % must be (docs/lab/photographs.md); of 60 one further set may miss by
    chance."""
    assert gps_sets.within(judged, 3.0) >= 0.97 - 1.0 / 60.0
    errors = np.array([j.errors for j in judged if j.errors is not None])
    assert len(errors) >= 54 and 0.5 < np.mean(errors <= 1.0) < 0.9, (
        "nor is too much stated: 68 % of Gauss's errors"
    )


def test_nothing_is_refused_without_need(judged):
    assert not any(j.needless for j in judged)


def test_what_is_enough_is_told_by_the_truth():
    """Of a set whose places are all wrong but five nobody could know enough; the bound falls as GPS
    gets better."""
    drawn = gps_sets.draw(np.random.default_rng([7, 0]))
    known = gps_sets.known_to(drawn)
    better = replace(drawn, sigmas_m=drawn.sigmas_m / 10.0)
    assert gps_sets.known_to(better)[0] == pytest.approx(known[0] / 10.0, rel=1e-3)
    wrong = np.arange(len(drawn.p_model)) >= 5
    assert not gps_sets.is_enough(replace(drawn, wrong_places=wrong))


def test_the_table_counts_every_set(judged):
    text = gps_sets.table({"drawn": judged})
    assert text.splitlines()[-1].startswith("| all | 60 |")
