# SPDX-License-Identifier: Apache-2.0
"""Why a pixel has its depth, or none: the codes of kind.npy."""

from enum import IntEnum
from typing import Dict

import numpy as np

#: A kind from 2 to here is the number of pairs that agree; 1 is one pair, or more whose match
#: hardly stands out.
MOST_PAIRS = 199


class DepthKind(IntEnum):
    """Kinds that are no number of pairs."""

    NOTHING = 0  # not looked at: the camera saw nothing there, or the method does not say why
    # other pictures see the place, and none agrees: something is before it, or the match is wrong
    HIDDEN = 201
    OUTSIDE = 202  # outside of every other picture
    BLANK = 203  # too little texture: every depth fits as well
    SKY = 204
    MOVED = 205  # something moved there between the recordings
    NEAR = 206  # of a depth camera, not of pairs (fcsv_stereo.near)


#: By code, of kinds that are one code.
NAMES: Dict[int, str] = {1: "one pair", **{kind.value: kind.name.lower() for kind in DepthKind}}
#: In words, for reports: the name as in docs/user/concepts.md, and what it says.
WORDS: Dict[str, str] = {
    "agreed": "agreed: two pairs or more",
    "one pair": "one pair: one agrees, or more that hardly stand out",
    "hidden": "hidden: in view of others, and none agrees",
    "outside": "outside: in no other picture's view",
    "blank": "blank: too little texture",
    "sky": "sky: no depth",
    "moved": "moved: somewhere else in the other recordings",
    "near": "near: a depth camera's",
    "nothing": "nothing: the camera saw nothing there, or the method does not say",
}


def supported(kind: np.ndarray) -> np.ndarray:
    """HxW bool: where some pair's texture supports the depth (HxW uint8 codes)."""
    return (kind >= 1) & (kind <= MOST_PAIRS)


def masks(kind: np.ndarray) -> Dict[str, np.ndarray]:
    """HxW bool by the names of ``WORDS``; "near" only where there is a near field."""
    found = {"agreed": (kind >= 2) & (kind <= MOST_PAIRS)}
    for one in (
        1,
        DepthKind.HIDDEN,
        DepthKind.OUTSIDE,
        DepthKind.BLANK,
        DepthKind.SKY,
        DepthKind.MOVED,
        DepthKind.NOTHING,
    ):
        found[NAMES[one]] = kind == one
    if (kind == DepthKind.NEAR).any():
        found["near"] = kind == DepthKind.NEAR
    return found
