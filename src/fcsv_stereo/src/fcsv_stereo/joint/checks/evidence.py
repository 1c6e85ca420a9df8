# SPDX-License-Identifier: Apache-2.0
"""What speaks for each pixel's depth: how far its match stands out against other depths, there and
about it.

A match that is as good at every other depth says nothing: a sky of one grey agrees with everything
(ambiguity; Hu and Mordohai 2012 compare such measures). What speaks for a depth is put together by
a logistic regression, whose weights ``tools/train_evidence.py`` finds on seeded scenes.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Iterable, Iterator, Tuple

import cv2
import numpy as np
from scipy.special import erfc

from fcsv_stereo.joint.refine.residuals import Residuals, mean_unlike, unlike
from fcsv_stereo.joint.refine.subpixel import Fine
from fcsv_stereo.joint.tuning import EVIDENCE, PLANE_FIT, RESIDUALS, SHARED, SIGMA, WRONG
from fcsv_stereo.joint.views import Views

_BAND = 64  # rows at a time: large pictures
_NEAR_PX = 2 * PLANE_FIT.radius_px + 1  # as a depth's plane
#: What is looked at, in the order of the weights.
FEATURES = (
    "log relative sigma",
    "log of the best pair's standing out",
    "best pair's trust",
    "share of pairs that agree",
    "volume's match was trusted",
    "standing out about it",
    "standing out further about it",
    "trust about it",
    "volume's match about it",
    "volume's match further about it",
    "log step about it",
    "log step further about it",
    "log contrast",
    "share of pairs that see it",
)


def standing_out(
    small: Views, w: np.ndarray, here: Residuals, shape: Tuple[int, int], pool: ThreadPoolExecutor
) -> np.ndarray:
    """NxHxW float32 of ``shape``: by how much each pair matches worse at the best of other depths
    than at ``w`` (1/m), as a ratio; 0 where the pair does not agree or nothing can be said.

    ``small`` are pictures at a reduced size: other depths are pixels away. ``w`` is at its size,
    and ``here`` are the residuals at it.
    """
    speed = np.maximum(here.speed, 1e-6)
    at_w = np.stack([mean_unlike(d) for d in here.difference])
    others = np.full(at_w.shape, np.inf, np.float32)

    def probe(i: int) -> None:
        for moved_px in (*EVIDENCE.probes_px, *(-p for p in EVIDENCE.probes_px)):
            there = (w + np.float32(moved_px) / speed[i]).astype(np.float32)
            at_other, seen = unlike(small, i, np.maximum(there, 0.0))
            others[i] = np.minimum(
                others[i], np.where((there < 0.0) | (seen < 0.5), np.inf, at_other)
            )

    list(pool.map(probe, range(len(small))))
    noise = np.float32(SHARED.noise_grey)
    ratio = np.where(np.isfinite(others), (others + noise) / (at_w + noise), 0.0).astype(np.float32)
    return np.stack([cv2.resize(x, shape[::-1], interpolation=cv2.INTER_LINEAR) for x in ratio])


def features(
    fine: Fine, sigma_w: np.ndarray, known: np.ndarray, out: np.ndarray, contrast: np.ndarray
) -> Iterator[np.ndarray]:
    """HxW float32 each, one by one (large pictures), in the order of ``FEATURES``. ``sigma_w`` and
    ``contrast`` HxW (1/m, grey levels), ``known`` HxW bool, ``out`` NxHxW from ``standing_out``."""
    r, w = fine.residuals, np.maximum(fine.w, np.float32(1e-9))
    agrees = r.trust >= RESIDUALS.least_trust
    best = np.zeros(w.shape, np.float32)
    for pair, stands_out in zip(agrees, out):
        np.maximum(best, np.where(pair, stands_out, np.float32(0.0)), out=best)
    stands, trust, trusted = (
        (best > EVIDENCE.stands_out).astype(np.float32),
        r.trust.max(axis=0),
        np.float32(known),
    )
    seen = r.seen.sum(axis=0)

    def about(image: np.ndarray, size_px: int) -> np.ndarray:
        return cv2.blur(image, (size_px, size_px))

    def step(size_px: int) -> np.ndarray:
        window = np.ones((size_px, size_px), np.uint8)
        step = cv2.dilate(fine.w, window)  # in place: large pictures
        step -= cv2.erode(fine.w, window)
        step /= w
        step += np.float32(SIGMA.steps[0])
        return np.clip(np.log(step, out=step), -6.0, 1.0, out=step)

    yield np.log(np.clip(sigma_w / w, 1e-3, 3.0))
    best += np.float32(EVIDENCE.nothing)
    yield np.log(best, out=best)
    del best
    yield trust
    yield np.divide(
        agrees.sum(axis=0, dtype=np.uint8), np.maximum(seen, np.float32(1.0)), dtype=np.float64
    )
    del agrees
    yield trusted
    yield about(stands, _NEAR_PX)
    yield about(stands, 3 * _NEAR_PX)
    yield about(trust, SHARED.around_px)
    yield about(trusted, SHARED.around_px)
    yield about(trusted, 3 * _NEAR_PX)
    yield step(SHARED.window_px)
    yield step(3 * SHARED.window_px)
    yield np.log(contrast + np.float32(1.0))
    yield seen / np.float32(len(r.seen))


def terms(
    column: np.ndarray, first: np.ndarray, k: int
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the three weights of feature ``k`` belong to: it (scaled), its square, and its product
    with the ``first`` (scaled)."""
    scaled = (column - np.float32(EVIDENCE.means[k])) / np.float32(EVIDENCE.scales[k])
    return (
        scaled,
        np.square(np.clip(scaled, -EVIDENCE.most_scales, EVIDENCE.most_scales)),
        scaled * first,
    )


def doubt(columns: Iterable[np.ndarray]) -> np.ndarray:
    """HxW float32: the probability that a depth is wrong by more than a tenth, by its
    ``features``."""
    logit, first = None, None
    for k, column in enumerate(columns):
        if logit is None:
            first = (column - np.float32(EVIDENCE.means[0])) / np.float32(EVIDENCE.scales[0])
            logit = np.full(column.shape, np.float32(EVIDENCE.constant))
        for y in range(0, len(logit), _BAND):
            band = slice(y, y + _BAND)
            for term, weight in zip(
                terms(column[band], first[band], k), EVIDENCE.weights[3 * k : 3 * k + 3]
            ):
                logit[band] += np.float32(weight) * term
        del column  # before the next is made
    np.clip(logit, -30.0, 30.0, out=logit)
    np.exp(np.negative(logit, out=logit), out=logit)
    logit += 1.0
    return np.divide(1.0, logit, out=logit)


def chance_of_wrong(pose_sigma_share: np.ndarray) -> np.ndarray:
    """HxW float32: the probability of an error above a tenth, where errors have the standard
    deviation ``pose_sigma_share`` (a share of the depth).

    >>> chance_of_wrong(np.array([0.0, 0.05, 0.1])).astype(float).round(3).tolist()
    [0.0, 0.046, 0.317]
    """
    return erfc(WRONG / (np.sqrt(2.0) * np.maximum(pose_sigma_share, 1e-6))).astype(np.float32)
