# SPDX-License-Identifier: Apache-2.0
"""The cost volume's parts: what is in view of a pair, and what counts where nothing is."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fcsv_stereo.joint.tuning import CENSUS
from fcsv_stereo.joint.volume.census import CUT, OFFSETS, RADIUS, STEPS, census, unseen_bits
from fcsv_stereo.joint.volume.pair_costs import in_view, rank, scratch, warp_row

WIDTH = 64
IMAGE = np.random.default_rng(0).uniform(0, 255, (48, WIDTH)).astype(np.float32)
SIZE = np.array(IMAGE.shape, np.int64)


def warped_row(image, p, w, v, first, width):
    """Grey levels and what is seen, both float."""
    out, seen = np.empty(width, np.int16), np.empty(width, np.float32)
    at = scratch(1, width)[2]
    warp_row(
        image,
        np.array(image.shape, np.int64),
        p,
        np.float32(w),
        np.float32(v),
        first,
        at,
        out,
        seen,
    )
    return out.astype(np.float32) / STEPS, seen


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
    st.floats(0.0, 1.0),
    st.integers(0, 47),
)
def test_nothing_that_is_seen_is_left_out_of_view(numbers, w, v):
    turn = np.array([0.2, 0.2, 30.0, 0.2, 0.2, 30.0, 3e-3, 3e-3, 0.3, 60.0, 60.0, 0.5])
    p = (np.r_[np.eye(3).ravel(), 0.0, 0.0, 0.0] + turn * numbers).astype(np.float32)
    _, seen = warped_row(IMAGE, p, w, v, 0, WIDTH)
    low, high = in_view(p, SIZE, np.float32(w), np.float32(v), WIDTH)
    columns = np.flatnonzero(seen)
    assert len(columns) == 0 or (low <= columns[0] and columns[-1] < high)
    assert high - low <= np.ptp(columns) + 6 if len(columns) else high - low <= 6


def test_a_row_is_sampled_between_pixels_up_to_the_last():
    p = np.r_[np.eye(3).ravel(), 1.0, 0.5, 0.0].astype(np.float32)
    out, seen = warped_row(IMAGE, p, 0.5, 46.75, 0, WIDTH)
    between = 0.5 * (IMAGE[:, :-1] + IMAGE[:, 1:])
    assert np.allclose(out[:-1], between[47], atol=1.0 / STEPS) and np.all(seen[:-1] == 1.0)
    assert seen[-1] == 0.0, "half a pixel beyond the last column"


def test_a_picture_of_one_row_is_sampled_without_a_second():
    p = np.r_[np.eye(3).ravel(), 0.0, 0.0, 0.0].astype(np.float32)
    image = np.ascontiguousarray(IMAGE[:1])
    assert np.allclose(warped_row(image, p, 0.0, 0, 0, WIDTH)[0], image[0], atol=1.0 / STEPS)


def test_a_pair_that_sees_nothing_counts_more_where_noise_alone_differs():
    strong = (100.0 * (np.indices((20, 20)).sum(axis=0) % 2)).astype(np.float32)
    flat = np.full((20, 20), 90.0, np.float32)
    assert np.all(census(flat) == 0)
    # every other place of a chequer is of the same grey: half of its bits are as unsure as those of
    # the flat one
    assert CENSUS.unseen_bits <= unseen_bits(strong).max() < unseen_bits(flat).min() < CUT
    wide = np.random.default_rng(1).uniform(0, 255, (20, 20)).astype(np.float32)
    assert np.median(unseen_bits(wide)) == CENSUS.unseen_bits


def bilinear(image, x, y):
    c, r = np.clip(int(x), 0, image.shape[1] - 2), np.clip(int(y), 0, image.shape[0] - 2)
    a, b = x - c, y - r
    top, low = ((1 - a) * row[c] + a * row[c + 1] for row in (image[r], image[r + 1]))
    return (1 - b) * top + b * low


SMOOTH = (
    120 + 60 * np.sin(np.arange(96) / 9.0) + 50 * np.cos(np.arange(64) / 7.0)[:, None]
).astype(np.float32)


@settings(max_examples=100, deadline=None)
@given(
    st.floats(-0.2, 0.2),
    st.floats(0.9, 1.1),
    st.floats(-2e-4, 2e-4),
    st.floats(-30.0, 30.0),
    st.integers(0, 63),
)
def test_blocks_that_move_as_one_are_sampled_as_each_place_is(roll, scale, tilt, shift, v):
    """Turned by little, blocks drift within their two pixels; by more, every place is looked for:
    no seam between."""
    c, s = scale * np.cos(roll), scale * np.sin(roll)
    p = np.float32([c, -s, shift, s, c, -0.5 * shift, tilt, 0.0, 1.0, 0.0, 0.0, 0.0])
    out, seen = warped_row(SMOOTH, p, 0.0, v, 0, 96)
    for u in np.flatnonzero(seen):
        q = p[:9].reshape(3, 3).astype(float) @ [u, v, 1.0]
        # what a drift reaches beyond its two pixels is drawn on from them: their slope changes by
        # little
        assert abs(out[u] - bilinear(SMOOTH, q[0] / q[2], q[1] / q[2])) < 0.5


def test_costs_are_the_bits_that_differ_sorted_pair_by_pair():
    random = np.random.default_rng(2)
    images = random.integers(0, 256, (3, 48, 64)).astype(np.float32)
    shifts = [0, 3, -5]  # columns by which each pair sees the reference's pixels
    p = np.array([[1, 0, s, 0, 1, 0, 0, 0, 1, 0, 0, 0] for s in shifts], np.float32)
    reference = census(random.uniform(0, 255, (48, 64)).astype(np.float32))
    unseen = np.full((48, 64), 40, np.uint8)
    ranked = np.empty((8, 3, 64), np.uint8)
    sizes = np.array([[48, 64]] * 3, np.int64)
    rank(reference, images, sizes, p, np.float32(0.0), OFFSETS, unseen, 20, scratch(8, 64), ranked)
    costs = np.full((3, 8, 64), 40)
    for cost, image, shift in zip(costs, images, shifts):
        codes = census(image)
        for r, x in np.ndindex(8, 64):
            if 0 <= x + shift < 64:
                cost[r, x] = 4 * bin(int(codes[20 + r, x + shift] ^ reference[20 + r, x])).count(
                    "1"
                )
    # windows are cut off otherwise where a pair's picture ends
    inner = slice(RADIUS + 5, 64 - RADIUS - 5)
    assert np.array_equal(
        np.sort(costs, axis=0)[:, :, inner], ranked.transpose(1, 0, 2)[:, :, inner]
    )


def test_codes_have_room_for_an_exposure_that_was_doubled():
    image = np.random.default_rng(3).integers(0, 256, (20, 20)).astype(np.float32)
    assert np.array_equal(census(2.0 * image), census(2.0 * image - 510.0))
    assert np.array_equal(census(image + 500.0), census(image))
