# SPDX-License-Identifier: Apache-2.0
"""The sky: what is at infinity for every pair, from the top of the picture down to the skyline."""

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.tuning import SHARED, SKY
from fcsv_stereo.model.kinds import MOST_PAIRS, DepthKind, supported

_BINS = SKY.bins


def sky(w: np.ndarray, r: Residuals, colour: np.ndarray, blind: np.ndarray) -> np.ndarray:
    """HxW bool, from inverse depth (1/m), what pairs make of it, ``colour`` (HxWx3 float32), and
    where the sky would be outside every other picture (``blind``, HxW bool: a tilted pair has wide
    borders of it).

    The windows of the match carry the skyline into the sky, which has little texture; so the sky
    grows again over pixels that look like it, up to the next edge of the picture. Where pairs are
    blind, colour alone decides, but never below what stands: a strip of bright ground at the lower
    edge is no sky.
    """
    steady = np.ones((SHARED.window_px,) * 2, np.uint8)
    still = (
        cv2.medianBlur(w.astype(np.float32), SHARED.window_px) * r.speed.max(axis=0) < SKY.most_px
    ) & ~blind
    still = cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_CLOSE, steady) > 0
    out = _joined(still | blind, _top_rows(still.shape)) & still
    kernel = np.ones((3, 3), np.uint8)
    smooth = np.max(cv2.morphologyEx(colour, cv2.MORPH_GRADIENT, kernel), axis=2) < SKY.skyline_grey
    about = (SKY.about_px,) * 2
    share = cv2.blur(out.astype(np.float32), about)
    mean = cv2.blur(colour * out[..., None], about) / np.maximum(share, 1e-3)[..., None]
    alike = (np.abs(colour - mean).mean(axis=2) < 2.0 * SHARED.surface_grey) & (
        share > SKY.least_share
    )
    for _ in range(SKY.growth_px):
        out = out | (cv2.dilate(out.astype(np.uint8), kernel) > 0) & smooth & alike
    below = np.logical_or.accumulate(~blind & ~out, axis=0)
    return out | _joined(out | blind & ~below & _coloured_like(out, ~blind, colour), out)


def in_the_skyline(
    is_sky: np.ndarray, told: np.ndarray, moves_px: np.ndarray, image: np.ndarray
) -> np.ndarray:
    """HxW bool: what of the answered depths (``told``, HxW bool) is a gap of a far skyline, as
    between treetops.

    It lies beside the sky (``is_sky``, HxW bool), hardly moves (``moves_px``, HxW: px in the
    fastest pair), and its colour in the ``image`` (HxW or HxWx3 uint8) is more like that of the sky
    about it than like that of what is answered about it. A gap of a pixel or two has no match of
    its own: it gets the depth of the trees.
    """
    found = told & _dilated(is_sky, SKY.beside_px) & (moves_px < SKY.far_px)
    if not found.any():
        return found
    margin, window = SKY.about_px // 2, (SKY.about_px,) * 2
    here = tuple(slice(max(x.min() - margin, 0), x.max() + margin + 1) for x in np.nonzero(found))
    colour = np.atleast_3d(image)[here].astype(np.float32)

    def unlike(mask: np.ndarray) -> np.ndarray:
        """Says by how much colours differ from the mean of a mask about them; infinite where there
        is none."""
        share = cv2.blur(mask[here].astype(np.float32), window)
        mean = (
            np.atleast_3d(cv2.blur(colour * mask[here][..., None], window))
            / np.maximum(share, 1e-3)[..., None]
        )
        return np.where(share > SKY.least_share, np.abs(colour - mean).sum(axis=2), np.inf)

    found[here] &= unlike(is_sky) < unlike(told & ~_dilated(is_sky, SKY.beside_px + 1))
    return found


def moved_clouds(kind: np.ndarray, seeing: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """HxW bool: answered depths that are those of clouds, which moved between the pictures.

    Each pair sees such a cloud shifted by its own way, so that a pair may find a depth for it, but
    no two pairs the same. What stands is seen alike by several. So they are what is joined to the
    top of the picture and to known sky over soft edges alone, and of whose answers about them
    hardly any is agreed, although pairs enough see it.

    ``kind`` is HxW uint8; ``seeing`` (hxw, how many pairs see a pixel) and ``colour`` (hxwx3
    float32) may be smaller.
    """
    whole, shape = kind, seeing.shape
    kind = cv2.resize(kind, shape[::-1], interpolation=cv2.INTER_NEAREST)
    told, agreed = supported(kind), (kind > 1) & (kind <= MOST_PAIRS)
    kernel = np.ones((3, 3), np.uint8)
    soft = np.max(cv2.morphologyEx(colour, cv2.MORPH_GRADIENT, kernel), axis=2) < SKY.skyline_grey
    soft = (
        cv2.morphologyEx(
            (soft | (kind == DepthKind.SKY)).astype(np.uint8),
            cv2.MORPH_OPEN,
            np.ones((5, 5), np.uint8),
        )
        > 0
    )
    joined = _mostly(joined_to_top(soft), kind == DepthKind.SKY)
    about = (SKY.about_px,) * 2
    told_about, agreed_about = (
        cv2.blur((m & joined).astype(np.float32), about) for m in (told, agreed)
    )
    found = joined & (agreed_about < SKY.most_agreed * told_about) & (seeing >= 2)
    found = (
        cv2.resize(found.astype(np.uint8), whole.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    )
    return found & supported(whole)


def _mostly(region: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The parts of a region (HxW bool) of which ``SKY.known_share`` is ``known`` (HxW bool) to be
    sky."""
    count, labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)
    sizes, hits = (np.bincount(labels[m], minlength=count) for m in (region, region & known))
    return region & (hits >= SKY.known_share * np.maximum(sizes, 1))[labels]


def _dilated(mask: np.ndarray, px: int) -> np.ndarray:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * px + 1,) * 2, np.uint8)) > 0


def _top_rows(shape) -> np.ndarray:
    rows = np.zeros(shape, np.bool_)
    rows[: SKY.top_rows] = True
    return rows


def joined_to_top(region: np.ndarray) -> np.ndarray:
    """HxW bool: the parts of a region (HxW bool) that reach the top of the picture."""
    return _joined(region, _top_rows(region.shape))


def _joined(region: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The parts of a region (HxW bool) that have a seed in them."""
    labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=4)[1]
    return region & np.isin(labels, np.unique(labels[seeds & region]))


def _coloured_like(some: np.ndarray, all_known: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """HxW bool: whose colour is more often ``some``'s than not, of what is known (both HxW bool;
    histograms' ratio, Swain and Ballard 1991)."""
    codes = np.int64(np.clip(colour, 0.0, 255.0) * (_BINS / 256.0)) @ np.array([_BINS**2, _BINS, 1])

    def histogram(of):
        counts = (
            np.bincount(codes[of], minlength=_BINS**3)
            .reshape(_BINS, _BINS, _BINS)
            .astype(np.float32)
        )
        return gaussian_filter(counts, 1.0)

    share = histogram(some & all_known) / np.maximum(histogram(all_known), 1e-3)
    return cv2.medianBlur((share.ravel()[codes] > 0.5).astype(np.uint8), SHARED.window_px) > 0
