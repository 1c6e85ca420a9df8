# SPDX-License-Identifier: Apache-2.0
"""OpenCV's matchers behind one face: pictures whose disparity runs along +x in, disparity in px out
(NaN none)."""

from dataclasses import dataclass
from typing import Callable, Dict, Optional, Tuple

import cv2
import numpy as np

from fcsv_stereo.model import Axis
from fcsv_stereo.rectify import RectifiedPair

#: OpenCV's Quasi-Dense leaves 15 px unmatched on every side, and reads beyond its pictures when
#: told to leave fewer.
_PAD = 9
_LARGEST_BLOCK_PX = 15  # OpenCV refuses pictures that do not hold a block


@dataclass(frozen=True)
class DisparityWindow:
    """Disparities (px) that count; smaller ones are too far to be measured, larger ones are false
    matches.

    The thesis used 11 to 256 (3.1), 16 to 256 (6.7), and 32 at least where the sky had to stay out
    (3.5).
    """

    least_px: float = 8.0
    most_px: float = 256.0

    def __post_init__(self):
        if not 0 <= self.least_px < self.most_px:
            raise ValueError(f"disparity window {self.least_px}..{self.most_px} px is empty")


@dataclass(frozen=True)
class Search:
    """Disparities (px) to look for in the turned and shifted pictures, and the one that the sky has
    there."""

    low_px: float
    high_px: float
    sky_px: float = 0.0


def quasi_dense(left: np.ndarray, right: np.ndarray, search: Search) -> np.ndarray:
    """Quasi-Dense matching (the thesis's choice); whole pixels, matches in two dimensions.

    OpenCV answers the length of the shift, as the thesis took it; where far things are shifted the
    other way, the shift along x is taken, with its sign.
    """
    left, right = (
        cv2.copyMakeBorder(i, *[_PAD] * 4, cv2.BORDER_REFLECT_101) for i in (left, right)
    )
    matcher = cv2.stereo.QuasiDenseStereo.create(left.shape[::-1])
    settings = matcher.Param
    # seeds on small things too,
    settings.gftMaxNumFeatures, settings.gftMinSeperationDist = 1500, 5
    # and across large disparities: near ground needs both
    settings.lkPyrLvl, settings.lkTemplateSize = 5, 7
    settings.correlationThreshold = 0.4
    matcher.Param = settings
    try:
        matcher.process(left, right)
    # what it says where it finds no corner to start from: no texture, or a few pixels
    except cv2.error:
        return np.full((left.shape[0] - 2 * _PAD, left.shape[1] - 2 * _PAD), np.nan, np.float32)
    disparity = (
        matcher.getDisparity()
        if search.sky_px >= 0
        else _signed(matcher.getDenseMatches(), left.shape)
    )
    return disparity[_PAD:-_PAD, _PAD:-_PAD]


def sgbm(left: np.ndarray, right: np.ndarray, search: Search) -> np.ndarray:
    """Semi-global block matching, sub-pixel."""
    least, levels = _levels(search)
    matcher = cv2.StereoSGBM_create(
        minDisparity=least,
        numDisparities=levels,
        blockSize=5,
        P1=8 * 25,
        P2=32 * 25,
        disp12MaxDiff=1,
        uniquenessRatio=8,
        speckleWindowSize=80,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    return _computed(matcher, left, right, least, levels)


def bm(left: np.ndarray, right: np.ndarray, search: Search) -> np.ndarray:
    """Block matching."""
    least, levels = _levels(search)
    matcher = cv2.StereoBM_create(levels, _LARGEST_BLOCK_PX)
    matcher.setMinDisparity(least)
    return _computed(matcher, left, right, least, levels)


MATCHERS: Dict[str, Callable[[np.ndarray, np.ndarray, Search], np.ndarray]] = {
    "quasi-dense": quasi_dense,
    "sgbm": sgbm,
    "bm": bm,
}


def match(
    pair: RectifiedPair, matcher: str, window: DisparityWindow, offset_px: Optional[float] = 0.0
) -> np.ndarray:
    """Signed disparity (px, float32, NaN where none) along the pair's axis in the reference's
    rectified view.

    Pictures are turned so that the disparity runs along +x, and the other one is shifted by
    ``offset_px`` (added back), which keeps disparities of convergent pairs small and positive; None
    finds it from a few features. What counts as too far is judged against the sky's disparity,
    which is not 0 in a tilted pair (3.5).
    """
    sign = 1.0 if pair.baseline_m > 0 else -1.0
    turn, back = _turns(pair.axis, sign)
    left, right = (turn(cv2.cvtColor(i, cv2.COLOR_RGB2GRAY)) for i in (pair.reference, pair.other))
    if min(*left.shape, *right.shape) <= _LARGEST_BLOCK_PX:
        return np.full(pair.reference.shape[:2], np.nan, np.float32)
    seen, seen_other = turn(pair.mask_reference), turn(pair.mask_other)
    given = offset_px is not None
    if not given:
        offset_px = _offset(left, right, window)
    offset = int(round(offset_px))
    shifted, seen_other = _shift(right, offset), _shift(seen_other.astype(np.uint8), offset) > 0
    # photographs: the offset was found for the window
    sky_px = sign * pair.infinity_px - offset if given else 0.0
    search = Search(window.least_px + sky_px, window.most_px, sky_px)
    disparity = MATCHERS[matcher](left, shifted, search).astype(np.float32)
    valid = (disparity >= search.low_px) & (disparity <= search.high_px) & seen
    valid &= _source_seen(disparity, seen_other)
    disparity = np.where(valid, disparity + offset, np.nan).astype(np.float32)
    return sign * back(disparity)


def match_rate(disparity: np.ndarray) -> float:
    """Share of pixels with a disparity (thesis 5.4)."""
    return float(np.isfinite(disparity).mean())


def _turns(axis: Axis, sign: float) -> Tuple[Callable, Callable]:
    """How to turn pictures so that disparity u_reference - u_other is positive along x, and
    back."""
    if axis is Axis.HORIZONTAL:
        flip = (lambda a: a) if sign > 0 else (lambda a: np.ascontiguousarray(a[:, ::-1]))
        return flip, flip
    # rows become columns: down (other below) or up (other above) becomes right
    k = 1 if sign > 0 else -1
    return (lambda a: np.ascontiguousarray(np.rot90(a, k))), (
        lambda a: np.ascontiguousarray(np.rot90(a, -k))
    )


def _shift(image: np.ndarray, offset: int) -> np.ndarray:
    """The picture moved right by ``offset`` pixels, zeros where nothing comes."""
    if offset == 0:
        return image
    out = np.zeros_like(image)
    if abs(offset) >= image.shape[1]:
        return out
    if offset > 0:
        out[:, offset:] = image[:, :-offset]
    else:
        out[:, :offset] = image[:, -offset:]
    return out


def _offset(left: np.ndarray, right: np.ndarray, window: DisparityWindow) -> float:
    """An offset that brings the smallest of the features' disparities to just above the window's
    lower end."""
    sift = cv2.SIFT_create(2000)
    (k1, d1), (k2, d2) = sift.detectAndCompute(left, None), sift.detectAndCompute(right, None)
    if d1 is None or d2 is None or len(k1) < 8 or len(k2) < 8:
        return 0.0
    pairs = cv2.BFMatcher().knnMatch(d1, d2, 2)
    good = [m for m, n in (p for p in pairs if len(p) == 2) if m.distance < 0.7 * n.distance]
    d = np.array([np.subtract(k1[m.queryIdx].pt, k2[m.trainIdx].pt) for m in good]).reshape(-1, 2)
    d = d[np.abs(d[:, 1]) < 4.0, 0]  # rows correspond
    if len(d) < 20:
        return 0.0
    return float(np.percentile(d, 3) - window.least_px - 8.0)


def _source_seen(disparity: np.ndarray, seen_other: np.ndarray) -> np.ndarray:
    """Whether the pixel that was matched lies inside the other picture."""
    height, width = disparity.shape
    source = np.arange(width)[None, :] - np.nan_to_num(disparity, nan=0.0)
    column = np.clip(np.rint(source), 0, width - 1).astype(int)
    inside = (source >= 0) & (source <= width - 1)
    return inside & np.take_along_axis(seen_other, column, axis=1)


def _levels(search: Search) -> Tuple[int, int]:
    """OpenCV's smallest disparity and number of disparities (a multiple of 16)."""
    least = int(np.floor(search.low_px))
    return least, max(1, int(np.ceil((search.high_px - least) / 16.0))) * 16


def _computed(matcher, left: np.ndarray, right: np.ndarray, least: int, levels: int) -> np.ndarray:
    """Disparity (px, NaN where none). OpenCV leaves a border as wide as the largest disparity
    unmatched, which is half of a vertical pair: pictures are padded by it."""
    before, after = max(least + levels, 0), max(-least, 0)
    wide = [cv2.copyMakeBorder(i, 0, 0, before, after, cv2.BORDER_REPLICATE) for i in (left, right)]
    raw = matcher.compute(*wide)[:, before : before + left.shape[1]]
    disparity = raw.astype(np.float32) / 16.0
    disparity[raw < least * 16] = np.nan
    return disparity


def _signed(matches, shape: Tuple[int, int]) -> np.ndarray:
    """Disparity along x (px, NaN where none) of OpenCV's list of matches."""
    disparity = np.full(shape, np.nan, np.float32)
    if matches:
        both = np.array([(*m.p0, *m.p1) for m in matches], int)
        disparity[both[:, 1], both[:, 0]] = both[:, 0] - both[:, 2]
    return disparity
