# SPDX-License-Identifier: Apache-2.0
"""Census codes (Zabih and Woodfill 1994): which pixels about one are brighter, in 32 bits."""

import numpy as np
from numba import njit

from fcsv_stereo.joint.tuning import CENSUS, SHARED
from fcsv_stereo.joint.volume.intrinsics import or_if_above

#: (dy, dx) that the centre is compared with: 5x5, and eight further out.
OFFSETS = np.array(
    [(y, x) for y in range(-2, 3) for x in range(-2, 3) if (y, x) != (0, 0)]
    + [(-4, 0), (4, 0), (0, -4), (0, 4), (-3, -3), (-3, 3), (3, -3), (3, 3)],
    np.int64,
)
RADIUS = int(np.abs(OFFSETS).max())
#: Parts of a grey level: 16 bits hold a picture whose exposure is doubled.
STEPS = 32
MOST_GAIN = 2.0
#: The most that a depth costs: half of the bits differ between unrelated places.
CUT = len(OFFSETS) / 2
_LEAST_STEP = np.int16(SHARED.noise_grey * STEPS)
_FLIP_GREY = 2.0 * SHARED.noise_grey  # both pixels of a step have noise


def census(image: np.ndarray) -> np.ndarray:
    """HxW uint32 census codes of a float32 picture; its border is repeated."""
    codes = np.empty(image.shape, np.uint32)
    _census(np.pad(np.round(STEPS * image).astype(np.int16), RADIUS, mode="edge"), OFFSETS, codes)
    return codes


def unseen_bits(image: np.ndarray) -> np.ndarray:
    """HxW float32: what a pair counts with that does not see the point, more than a match there and
    less than none.

    Where steps of grey are no larger than noise, even what is right differs in many bits; a smaller
    price would draw such pixels to depths that few pairs see.
    """
    height, width = image.shape
    padded = np.pad(image, RADIUS, mode="edge")
    match = np.zeros_like(image)
    for dy, dx in OFFSETS + RADIUS:
        step = padded[dy : dy + height, dx : dx + width] - image
        match += 0.5 * np.exp(
            np.abs(step - np.float32(SHARED.noise_grey)) / np.float32(-_FLIP_GREY)
        )
    beyond = np.float32(CENSUS.beyond_match) * (np.float32(CUT) - match)
    return np.maximum(np.float32(CENSUS.unseen_bits), match + beyond)


@njit(cache=True, nogil=True)
def _census(padded, offsets, codes):
    width = codes.shape[1]
    lower, upper, least = (
        np.empty(width, np.uint16),
        np.empty(width, np.uint16),
        np.empty(width, np.int16),
    )
    for y in range(codes.shape[0]):
        census_row(padded, y + RADIUS, 0, offsets, least, lower, upper)
        for x in range(width):
            codes[y, x] = whole_code(lower[x], upper[x])


@njit(cache=True, nogil=True)
def whole_code(lower, upper):
    """Its 32 bits."""
    return np.uint32(np.uint32(lower) | np.uint32(np.uint32(upper) << np.uint32(16)))


@njit(cache=True, nogil=True, fastmath=True)
def census_row(padded, row, first, offsets, least, lower, upper):
    """Writes the codes of the row's pixels from ``first`` on, as many as there is room for: the
    codes' ``lower`` and ``upper`` 16 bits.

    ``padded`` is int16, in STEPS of a grey level: an instruction compares sixteen. ``least`` (W) is
    written on the way.
    """
    flat, stride = padded.reshape(-1), padded.shape[1]
    middle, width = row * stride + first + RADIUS, np.uintp(lower.shape[0])
    centre = np.uintp(middle)
    for x in range(width):
        least[x] = np.int16(flat[centre + x] + _LEAST_STEP)
    for k in range(0, offsets.shape[0], 4):
        codes, bit = (lower if k < 16 else upper), np.uint16(1 << (k % 16))
        a, b = _place(middle, stride, offsets, k), _place(middle, stride, offsets, k + 1)
        c, d = _place(middle, stride, offsets, k + 2), _place(middle, stride, offsets, k + 3)
        bit_b, bit_c, bit_d = np.uint16(bit << 1), np.uint16(bit << 2), np.uint16(bit << 3)
        if k % 16 == 0:
            codes[:] = np.uint16(0)
        for x in range(width):
            two = or_if_above(
                or_if_above(codes[x], flat[a + x], least[x], bit), flat[b + x], least[x], bit_b
            )
            codes[x] = or_if_above(
                or_if_above(two, flat[c + x], least[x], bit_c), flat[d + x], least[x], bit_d
            )


@njit(cache=True, nogil=True)
def _place(middle, stride, offsets, k):
    return np.uintp(middle + offsets[k, 0] * stride + offsets[k, 1])
