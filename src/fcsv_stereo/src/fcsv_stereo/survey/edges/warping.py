# SPDX-License-Identifier: Apache-2.0
"""Places that two views see from directions too different for SIFT: corners of one are tracked in
the other's picture as it looks from there, by depth and the priors of both."""

from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_stereo.model import as_grey
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.edges.features import Features, of_pixels, on_surfaces
from fcsv_stereo.survey.edges.matching import predicted
from fcsv_stereo.survey.views.view import View

_WINDOW_PX, _LEVELS = 15, 2  # of the tracker
#: Side of what must be known about a corner: what is not known is filled with the other picture,
#: which says that corners are where the priors say.
_KNOWN_PX = 21
_CORNERS, _QUALITY, _APART_PX, _BLOCK_PX = 2000, 0.003, 4, 5
_OUTSIDE_PX = -1e4


def tracked(a: View, b: View) -> Optional[Tuple[Features, Features]]:
    """Places as a and as b measure them, without descriptors; None where there are none. Pyramidal
    Lucas-Kanade (Bouguet 2000) finds corners of b in a's warped picture, and back."""
    uv_a = _seen_in(a, b)
    grey_a, grey_b = as_grey(a.image), as_grey(b.image)
    known = ((uv_a >= 0) & (uv_a <= [a.camera.width - 1, a.camera.height - 1])).all(axis=-1)
    warped = cv2.remap(grey_a, uv_a, None, cv2.INTER_LINEAR)
    warped = np.where(known, _as_exposed(warped, grey_b, known), grey_b)
    whole = cv2.erode(known.astype(np.uint8), np.ones((_KNOWN_PX, _KNOWN_PX), np.uint8)) > 0
    where = (whole & on_surfaces(b)).astype(np.uint8)
    corners = cv2.goodFeaturesToTrack(
        grey_b, _CORNERS, _QUALITY, _APART_PX, mask=where, blockSize=_BLOCK_PX
    )
    if corners is None:
        return None
    there = _flow(grey_b, warped, corners)
    came_back_px = np.linalg.norm(_flow(warped, grey_b, there) - corners, axis=-1)[:, 0]
    close = came_back_px < tuning.MOST_TRACK_PX
    uv_b, there = corners[close, 0], there[close]
    if not len(there):
        return None
    uv = cv2.remap(uv_a, there, None, cv2.INTER_LINEAR)[:, 0].astype(float)
    good = _is(whole, there[:, 0]) & _is(on_surfaces(a), uv)
    none = np.zeros((int(good.sum()), 128), np.float32)
    return of_pixels(a, uv[good], none), of_pixels(b, uv_b[good].astype(float), none)


def _as_exposed(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> np.ndarray:
    """A picture (H,W) uint8 with mean and contrast of another ``where`` (H,W) bool."""
    if not where.any():
        return one
    (mean, spread), (to_mean, to_spread) = ((g[where].mean(), g[where].std()) for g in (one, other))
    exposed = (one - mean) * (to_spread / max(spread, 1.0)) + to_mean
    return exposed.round().clip(0, 255).astype(np.uint8)


def _is(mask: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N,) bool: the mask (H,W) at pixels (N,2), False outside."""
    u, v = np.rint(uv).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    return inside & mask[np.where(inside, v, 0), np.where(inside, u, 0)]


def _seen_in(a: View, b: View) -> np.ndarray:
    """(H,W,2) float32 px: where a should see what b sees, by b's depth; far outside where it does
    not."""
    rows, columns = np.nonzero(b.known)
    points = b.camera.rays()[rows, columns] * b.depth[rows, columns].astype(float)[:, None]
    uv = np.full((*b.depth.shape, 2), _OUTSIDE_PX, np.float32)
    found = predicted(points, b.prior, a.prior, a)[0]
    uv[rows, columns] = np.nan_to_num(found, nan=_OUTSIDE_PX).clip(_OUTSIDE_PX, -_OUTSIDE_PX)
    return uv


def _flow(one: np.ndarray, other: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,1,2) float32 px: where points of one picture are in the other; NaN where not found."""
    window = (_WINDOW_PX, _WINDOW_PX)
    start = np.nan_to_num(points, nan=_OUTSIDE_PX)
    found, good, _ = cv2.calcOpticalFlowPyrLK(
        one, other, start, None, winSize=window, maxLevel=_LEVELS
    )
    return np.where(good[..., None] > 0, found, np.nan).astype(np.float32)
