# SPDX-License-Identifier: Apache-2.0
"""The cost volume's parts: what is in view of a pair, and what counts where nothing is."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fcsv_stereo.joint.census import CUT, UNSEEN, census, unseen_bits
from fcsv_stereo.joint.volume import _in_view, _warp_row

WIDTH = 64
IMAGE = np.random.default_rng(0).uniform(0, 255, (48, WIDTH)).astype(np.float32)
SIZE = np.array(IMAGE.shape, np.int64)


def warped_row(image, p, w, v, first, width):
    at = np.empty(width, np.int32), np.empty(width, np.float32), np.empty(width, np.float32)
    out, seen = np.empty(width, np.float32), np.empty(width, np.float32)
    _warp_row(image, np.array(image.shape, np.int64), p, np.float32(w), np.float32(v), first, at, out, seen)
    return out, seen


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12), st.floats(0.0, 1.0), st.integers(0, 47)
)  # fmt: skip
def test_nothing_that_is_seen_is_left_out_of_view(numbers, w, v):
    turn = np.array([0.2, 0.2, 30.0, 0.2, 0.2, 30.0, 3e-3, 3e-3, 0.3, 60.0, 60.0, 0.5])
    p = (np.r_[np.eye(3).ravel(), 0.0, 0.0, 0.0] + turn * numbers).astype(np.float32)
    _, seen = warped_row(IMAGE, p, w, v, 0, WIDTH)
    low, high = _in_view(p, SIZE, np.float32(w), np.float32(v), WIDTH)
    columns = np.flatnonzero(seen)
    assert len(columns) == 0 or (low <= columns[0] and columns[-1] < high)
    assert high - low <= np.ptp(columns) + 6 if len(columns) else high - low <= 6


def test_a_row_is_sampled_between_pixels_up_to_the_last():
    p = np.r_[np.eye(3).ravel(), 1.0, 0.5, 0.0].astype(np.float32)
    out, seen = warped_row(IMAGE, p, 0.5, 46.75, 0, WIDTH)
    between = 0.5 * (IMAGE[:, :-1] + IMAGE[:, 1:])
    assert np.allclose(out[:-1], between[47], atol=1e-3) and np.all(seen[:-1] == 1.0)
    assert seen[-1] == 0.0, "half a pixel beyond the last column"


def test_a_picture_of_one_row_is_sampled_without_a_second():
    p = np.r_[np.eye(3).ravel(), 0.0, 0.0, 0.0].astype(np.float32)
    image = np.ascontiguousarray(IMAGE[:1])
    assert np.allclose(warped_row(image, p, 0.0, 0, 0, WIDTH)[0], image[0], atol=0.01)


def test_a_pair_that_sees_nothing_counts_more_where_noise_alone_differs():
    strong = (100.0 * (np.indices((20, 20)).sum(axis=0) % 2)).astype(np.float32)
    flat = np.full((20, 20), 90.0, np.float32)
    assert np.all(census(flat) == 0)
    # every other place of a chequer is of the same grey: half of its bits are as unsure as those of the flat one
    assert UNSEEN <= unseen_bits(strong).max() < unseen_bits(flat).min() < CUT
    wide = np.random.default_rng(1).uniform(0, 255, (20, 20)).astype(np.float32)
    assert np.median(unseen_bits(wide)) == UNSEEN
