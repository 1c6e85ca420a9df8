# SPDX-License-Identifier: Apache-2.0
"""Which kind each pixel is of (``model.kinds``), and the map of what some pair's texture
supports."""

from dataclasses import replace

import cv2
import numpy as np

from fcsv_stereo.joint.checks.sky import joined_to_top, sky
from fcsv_stereo.joint.refine.residuals import Residuals
from fcsv_stereo.joint.tuning import EVIDENCE, RESIDUALS, SHARED
from fcsv_stereo.model import MapResult
from fcsv_stereo.model.kinds import MOST_PAIRS, DepthKind, supported

_WINDOW = np.ones((SHARED.window_px,) * 2, np.uint8)  # what a pixel is compared by
_STEPS = 600  # up to ``EVIDENCE.sure_doubt``, in which the share is summed


def kinds(
    doubt: np.ndarray,
    out: np.ndarray,
    r: Residuals,
    contrast: np.ndarray,
    infinite: np.ndarray,
    bright: np.ndarray,
) -> np.ndarray:
    """HxW uint8 from the ``doubt`` about each depth (HxW), by how much pairs stand out (NxHxW), the
    pairs' residuals, the reference's contrast (HxW, grey levels), and where (HxW bool) the sky is
    by its movement, and the picture is ``bright``: what is bright, plain and reaches the picture's
    top is sky too."""
    agrees, told = r.trust >= RESIDUALS.least_trust, doubt < EVIDENCE.most_doubt
    # what no other picture sees goes on as the surface beside it: little doubt, and no evidence
    in_view = cv2.erode((r.seen > 0).any(axis=0).astype(np.uint8), _WINDOW) > 0
    pairs = np.clip(agrees.sum(axis=0), 1, MOST_PAIRS)
    pairs = np.where(doubt < sure_limit(doubt[pairs > 1]), pairs, 1)
    plain = contrast < EVIDENCE.plain_grey
    ambiguous = plain | (
        agrees.any(axis=0) & ~(np.where(agrees, out, 0.0).max(axis=0) > EVIDENCE.stands_out)
    )
    is_sky = ~told & (infinite | joined_to_top(plain & bright & ~told))
    conditions = [is_sky, told & in_view, ~in_view, ambiguous]
    return np.select(
        conditions, [DepthKind.SKY, pairs, DepthKind.OUTSIDE, DepthKind.BLANK], DepthKind.HIDDEN
    ).astype(np.uint8)


def sure_limit(doubts: np.ndarray) -> float:
    """The doubt below which two pairs and more are said to agree, of a map's ``doubts`` (N,) where
    they do: at most ``EVIDENCE.sure_doubt``, and so low that no more than ``EVIDENCE.sure_share``
    of what is below it is expected wrong.

    A doubt is a probability, so the mean of those below a limit is the share that is wrong there
    (the false discovery rate of Efron et al. 2001). Where most of a picture is plain, one limit for
    all maps calls too much agreed.

    >>> [round(sure_limit(np.array(doubts)), 3) for doubts in ([0.001, 0.001, 0.03], [0.001, 0.03, 0.03])]
    [0.06, 0.03]
    """
    counts, edges = np.histogram(doubts, _STEPS, (0.0, EVIDENCE.sure_doubt))
    wrong = np.cumsum(counts * 0.5 * (edges[:-1] + edges[1:]))
    few = wrong <= EVIDENCE.sure_share * np.cumsum(counts)
    return float(edges[1:][few].max(initial=0.0))


def infinite(
    w: np.ndarray, r: Residuals, colour: np.ndarray, blind: np.ndarray, shape
) -> np.ndarray:
    """HxW bool of ``shape``: the sky by movement and colour, found at the size of ``w`` (1/m)."""
    return (
        cv2.resize(
            sky(w, r, colour, blind).astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST
        )
        > 0
    )


def supported_only(result: MapResult) -> MapResult:
    """The result without the depths that no pair supports."""
    stays = supported(result.kind)
    return replace(result.keep(stays), pairs=[p.only(stays) for p in result.pairs])
