# SPDX-License-Identifier: Apache-2.0
"""Semi-global aggregation against its formula, written down level by level."""

import numpy as np
import pytest

from fcsv_stereo.joint.volume.sgm import MOST_PRICE, aggregate

P1, P2, LEVEL = 40.0, 330.0, 5.0
SHAPE = 7, 9, 12
PATHS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0)]


def by_formula(volume, counts, grey, drift):
    """Hirschmueller's equation 13 and a level surface's way, in floats."""
    total = np.zeros(volume.shape)
    for dy, dx in PATHS:
        rows = range(volume.shape[0]) if dy >= 0 else range(volume.shape[0] - 1, -1, -1)
        columns = range(volume.shape[1]) if dx >= 0 else range(volume.shape[1] - 1, -1, -1)
        paths = {}
        for y in rows:
            for x in columns:
                cost = volume[y, x, : counts[y]].astype(float)
                before = paths.get((y - dy, x - dx))
                if before is not None:
                    cost = cost + ways(
                        before,
                        grey[y, x] - grey[y - dy, x - dx],
                        len(cost),
                        drift[int(dy < 0), y],
                        dy,
                    )
                paths[y, x] = cost
                total[y, x, : counts[y]] += cost
    return total


def ways(before, step, count, drift, dy):
    jump = before.min() + max(P2 / (1.0 + 0.1 * abs(step)), P1)

    def at(d):
        return before[d] if 0 <= d < len(before) else np.inf

    out = np.empty(count)
    for d in range(count):
        out[d] = min(at(d), at(d - 1) + P1, at(d + 1) + P1, jump)
        there = int(np.floor(d + drift[d]))
        if dy != 0 and drift.any() and 0 <= there < len(before):
            share = d + drift[d] - there
            out[d] = min(
                out[d], (1 - share) * at(there) + share * min(at(there + 1), at(there) + P1) + LEVEL
            )
    return out - before.min()


@pytest.mark.parametrize("drifts", [False, True])
@pytest.mark.parametrize("same", [True, False])
def test_the_sums_are_those_of_the_formula(drifts, same, pool):
    random = np.random.default_rng(3)
    volume = random.integers(0, 180, SHAPE, dtype=np.uint8)
    counts = np.full(SHAPE[0], SHAPE[2]) if same else np.array([2, 5, 12, 7, 7, 12, 1])
    grey = random.uniform(0.0, 80.0, SHAPE[:2]).astype(np.float32)
    drift = np.zeros((2, SHAPE[0], SHAPE[2]), np.float32)
    if drifts:  # as level ground's, in quarters, which are not rounded
        drift[0], drift[1] = -np.arange(SHAPE[2]) / 4.0, np.arange(SHAPE[2]) / 4.0
        drift[:, 0] = 0.0
    found = aggregate(volume, counts, grey, (P1, P2), drift, pool)
    wanted = by_formula(volume, counts, grey, drift)
    for y, count in enumerate(counts):
        # prices and parts of levels are rounded, half a unit each, along paths as long as the
        # picture
        assert np.abs(found[y, :, :count] - wanted[y, :, :count]).max() <= 0.5 * len(PATHS) * max(
            SHAPE[:2]
        )
        assert np.array_equal(*(v[y, :, :count].argmin(axis=1) for v in (found, wanted)))


def test_a_price_beyond_what_sixteen_bits_hold_is_refused(pool):
    volume, drift = np.zeros(SHAPE, np.uint8), np.zeros((2, SHAPE[0], SHAPE[2]), np.float32)
    with pytest.raises(ValueError, match="price"):
        prices = P1, MOST_PRICE + 1.0
        aggregate(
            volume, np.full(SHAPE[0], 3), np.zeros(SHAPE[:2], np.float32), prices, drift, pool
        )
