# SPDX-License-Identifier: Apache-2.0
"""Census codes (Zabih and Woodfill 1994): which pixels about one are brighter, in 32 bits."""

import numpy as np
from numba import njit

from fcsv_stereo.joint.bits import or_if

RADIUS = 4
#: (dy, dx) that the centre is compared with: 5x5, and eight further out.
OFFSETS = np.array(
    [(y, x) for y in range(-2, 3) for x in range(-2, 3) if (y, x) != (0, 0)]
    + [(-4, 0), (4, 0), (0, -4), (0, 4), (-3, -3), (-3, 3), (3, -3), (3, 3)],
    np.int64,
)
CUT = 16.0  # bits of 32, after weighing: half of them differ between unrelated places
UNSEEN, _BEYOND_MATCH = 9.0, 0.3  # bits that a pair that sees nothing counts: at least, share from a match to none
_FLIP = 1.5  # grey levels by which a step differs from NOISE that make its bit e times as sure
NOISE = 0.75  # grey levels: smaller steps are no texture


def census(image: np.ndarray) -> np.ndarray:
    """HxW uint32 census codes of a float32 picture; its border is repeated."""
    padded = np.pad(image, RADIUS, mode="edge")
    codes = np.zeros(image.shape, np.uint32)
    for y in range(image.shape[0]):
        census_row(padded, y + RADIUS, 0, OFFSETS, codes[y])
    return codes


def unseen_bits(image: np.ndarray) -> np.ndarray:
    """HxW float32: what a pair counts with that does not see the point, more than a match there and less than none.

    Where steps of grey are no larger than noise, even what is right differs in many bits; a smaller price would draw
    such pixels to depths that few pairs see.
    """
    height, width = image.shape
    padded = np.pad(image, RADIUS, mode="edge")
    match = np.zeros_like(image)
    for dy, dx in OFFSETS + RADIUS:
        step = padded[dy : dy + height, dx : dx + width] - image
        match += 0.5 * np.exp(np.abs(step - np.float32(NOISE)) / np.float32(-_FLIP))
    return np.maximum(np.float32(UNSEEN), match + np.float32(_BEYOND_MATCH) * (np.float32(CUT) - match))


@njit(cache=True, nogil=True, fastmath=True)
def census_row(padded, row, first, offsets, codes):
    """Of the row's pixels from ``first`` on, as many as there are ``codes``; four bits at a time."""
    first, width = first + RADIUS, codes.shape[0]
    centre = padded[row, first : first + width]
    codes[:] = np.uint32(0)
    bit = np.uint32(1)
    for k in range(0, offsets.shape[0], 4):
        a, b, c, d = (
            _beside(padded, row, first, offsets[k], width), _beside(padded, row, first, offsets[k + 1], width),
            _beside(padded, row, first, offsets[k + 2], width), _beside(padded, row, first, offsets[k + 3], width),
        )  # fmt: skip
        bit_b, bit_c, bit_d = np.uint32(bit << 1), np.uint32(bit << 2), np.uint32(bit << 3)
        for x in range(width):
            least = centre[x] + np.float32(NOISE)
            two = or_if(or_if(codes[x], a[x] > least, bit), b[x] > least, bit_b)
            codes[x] = or_if(or_if(two, c[x] > least, bit_c), d[x] > least, bit_d)
        bit = np.uint32(bit << 4)


@njit(cache=True, nogil=True)
def _beside(padded, row, first, offset, width):
    return padded[row + offset[0], first + offset[1] : first + offset[1] + width]
