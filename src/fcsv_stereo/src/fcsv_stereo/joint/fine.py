# SPDX-License-Identifier: Apache-2.0
"""From the coarse map to the full size: which surface each pixel belongs to, and its sub-pixel inverse depth."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from fcsv_stereo.joint.edges import choose_band
from fcsv_stereo.joint.photometric import Residuals, residuals
from fcsv_stereo.joint.planes import fit_band
from fcsv_stereo.joint.sweep import Views
from fcsv_stereo.joint.volume import pair_weights

_HUBER = 4.0  # grey levels
_STEP = 0.05  # a step of inverse depth, as a share of the nearer
_REACH = 3
_RADIUS = 4
_LIKENESS = 8.0
_CUT = 40.0


@dataclass(frozen=True)
class Fine:
    """``w`` (1/m), its ``variance`` by the matching alone, the ``spread`` of w in its surroundings, ``residuals``."""

    w: np.ndarray
    variance: np.ndarray
    spread: np.ndarray
    residuals: Residuals


def choose_surface(found: Views, grey: np.ndarray, w: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """Full-size inverse depth from a coarser one (1/m): of the surfaces about a pixel the one that fits it best."""
    size = found.shape[::-1]
    kernel = np.ones((_REACH, _REACH), np.uint8)
    own, near, far = (
        cv2.resize(c, size, interpolation=cv2.INTER_NEAREST) for c in (w, cv2.dilate(w, kernel), cv2.erode(w, kernel))
    )
    edge = near - far > _STEP * near
    smooth = cv2.resize(w, size, interpolation=cv2.INTER_LINEAR)
    first = np.where(edge, own, smooth)
    candidates = np.stack([first, near, far])
    best = np.empty_like(first)
    weights = pair_weights(len(found))

    def run(y: int) -> None:
        views = found.reference, found.others, found.sizes, found.projections
        choose_band(grey, *views, candidates, edge, weights, _RADIUS, np.float32(_LIKENESS), np.float32(_CUT),
                    y, min(y + 16, size[1]), best)  # fmt: skip

    list(pool.map(run, range(0, size[1], 16)))
    return best


def refine(found: Views, w: np.ndarray, step: np.ndarray, iterations: int, pool: ThreadPoolExecutor) -> Fine:
    """Gauss-Newton over all pairs; ``step`` (HxW, 1/m) is what the coarse map was uncertain by."""
    w = w.astype(np.float32)
    variance, spread = np.zeros_like(w), np.zeros_like(w)
    for _ in range(iterations):
        r = residuals(found, w, pool)
        information, push, energy = _sums(r)
        prior = (np.float32(0.02) * cv2.blur(information, (7, 7)) + np.float32(1e-6)).astype(np.float32)
        tau = (np.float32(2.0) * step + np.float32(0.02) * w).astype(np.float32)
        out = np.empty_like(w)
        bands = [(y, min(y + 32, w.shape[0])) for y in range(0, w.shape[0], 32)]

        def run(band, arrays=(w, tau, information, push, energy, prior), out=out):
            fit_band(*arrays, *band, out, variance, spread)

        list(pool.map(run, bands))
        w = np.maximum(out, 0.0)
    return Fine(w, variance, spread, residuals(found, w, pool))


def _sums(r: Residuals):
    """Over the pairs: information, push and energy, with Huber's weights."""
    weight = r.trust * np.minimum(1.0, _HUBER / np.maximum(np.abs(r.difference), 1e-6)).astype(np.float32)
    weighed = weight * r.slope
    information = np.einsum("nij,nij->ij", weighed, r.slope)
    push = np.einsum("nij,nij->ij", weighed, r.difference)
    energy = np.einsum("nij,nij->ij", weight, np.square(r.difference)) / np.maximum(weight.sum(axis=0), 1e-3)
    return information, push, energy.astype(np.float32)
