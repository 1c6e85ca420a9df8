# SPDX-License-Identifier: Apache-2.0
"""Sub-pixel inverse depth from the differences of all pictures."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.refine.plane_fit import fit_band
from fcsv_stereo.joint.refine.residuals import Residuals, residuals
from fcsv_stereo.joint.tuning import SUBPIXEL
from fcsv_stereo.joint.views import Views


@dataclass(frozen=True)
class Fine:
    """``w`` (1/m), its ``variance`` by the matching alone, and ``residuals`` at it."""

    w: np.ndarray
    variance: np.ndarray
    residuals: Residuals


def refine(found: Views, w: np.ndarray, step: np.ndarray, iterations: int, pool: ThreadPoolExecutor) -> Fine:
    """Gauss-Newton over all pairs; ``step`` (HxW, 1/m) is what the coarse map was uncertain by.

    With no ``iterations`` it is ``w`` itself, its variance 0 and not to be used.
    """
    w = w.astype(np.float32)
    variance = np.zeros_like(w)
    for _ in range(iterations):
        r = residuals(found, w, pool)
        information, push, energy = _sums(r)
        prior = _prior(information)
        tau = (np.float32(SUBPIXEL.same_steps) * step + np.float32(SUBPIXEL.same) * w).astype(np.float32)
        out = np.empty_like(w)

        def run(y0, y1, arrays=(w, tau, information, push, energy, prior), out=out):
            fit_band(*arrays, y0, y1, out, variance)

        for_rows(pool, w.shape[0], run)
        w = np.maximum(out, 0.0)
    return Fine(w, variance, residuals(found, w, pool))


def _prior(information: np.ndarray) -> np.ndarray:
    """HxW float32: information by which a pixel stays where it is."""
    about = cv2.blur(information, (SUBPIXEL.prior_px,) * 2)
    return (np.float32(SUBPIXEL.prior_share) * about + np.float32(SUBPIXEL.prior_least)).astype(np.float32)


def _sums(r: Residuals):
    """Over the pairs: information, push and energy, with Huber's weights."""
    weight = r.trust * np.minimum(1.0, SUBPIXEL.huber_grey / np.maximum(np.abs(r.difference), 1e-6)).astype(np.float32)
    weighed = weight * r.slope
    information = np.einsum("nij,nij->ij", weighed, r.slope)
    push = np.einsum("nij,nij->ij", weighed, r.difference)
    energy = np.einsum("nij,nij->ij", weight, np.square(r.difference)) / np.maximum(weight.sum(axis=0), 1e-3)
    return information, push, energy.astype(np.float32)
