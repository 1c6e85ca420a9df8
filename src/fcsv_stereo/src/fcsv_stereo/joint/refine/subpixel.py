# SPDX-License-Identifier: Apache-2.0
"""Sub-pixel inverse depth from the differences of all pictures."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Optional

import cv2
import numpy as np

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.refine.plane_fit import fit_band
from fcsv_stereo.joint.refine.residuals import Residuals, residuals
from fcsv_stereo.joint.tuning import LEAST_INFORMATION, PLANE_FIT, SHARED, SUBPIXEL
from fcsv_stereo.joint.views import Views


@dataclass(frozen=True)
class Fine:
    """``w`` (1/m), its ``variance`` by the matching alone (None: let go), and ``residuals`` at
    it."""

    w: np.ndarray
    variance: Optional[np.ndarray]
    residuals: Residuals

    def without_slopes(self) -> "Fine":
        """Gives the result without the variance and the residuals' slopes, which nothing asks for
        once sigma is known."""
        return Fine(self.w, None, replace(self.residuals, slope=None))

    def rows(self, rows: slice) -> "Fine":
        """The same of a part of the rows."""
        variance = None if self.variance is None else self.variance[rows]
        return Fine(self.w[rows], variance, self.residuals.rows(rows))


def refine(
    found: Views, w: np.ndarray, step: np.ndarray, iterations: int, pool: ThreadPoolExecutor
) -> Fine:
    """Gauss-Newton over all pairs; ``step`` (HxW, 1/m) is what the coarse map was uncertain by.

    With no ``iterations`` it is ``w`` itself, its variance 0 and not to be used.
    """
    w = w.astype(np.float32)
    variance = np.zeros_like(w)
    for _ in range(iterations):
        information, push, energy = _sums(residuals(found, w, pool), pool)
        prior = _prior(information)
        tau = (np.float32(SUBPIXEL.same_steps) * step + np.float32(SHARED.same) * w).astype(
            np.float32
        )
        out = np.empty_like(w)

        def run(y0, y1, arrays=(w, tau, information, push, energy, prior), out=out):
            fit_band(*arrays, y0, y1, out, variance)

        for_rows(pool, w.shape[0], run)
        w = np.maximum(out, 0.0, out=out)
        del information, push, energy, prior, tau, run  # as large as the next residuals
    # nothing asks for the differences any more: a picture's size for each pair
    return Fine(w, variance, replace(residuals(found, w, pool), difference=None))


def _prior(information: np.ndarray) -> np.ndarray:
    """HxW float32: information by which a pixel stays where it is."""
    about = cv2.blur(information, (2 * PLANE_FIT.radius_px + 1,) * 2)
    return (np.float32(SUBPIXEL.prior_share) * about + np.float32(LEAST_INFORMATION)).astype(
        np.float32
    )


def _sums(r: Residuals, pool: ThreadPoolExecutor) -> np.ndarray:
    """3xHxW float32: over the pairs information, push and energy, with Huber's weights."""
    out = np.empty((3, *r.trust.shape[1:]), np.float32)

    def run(y0, y1):
        trust, difference, slope = (x[:, y0:y1] for x in (r.trust, r.difference, r.slope))
        huber = np.minimum(1.0, SUBPIXEL.huber_grey / np.maximum(np.abs(difference), 1e-6))
        weight = trust * huber.astype(np.float32)
        weighed = weight * slope
        np.einsum("nij,nij->ij", weighed, slope, out=out[0, y0:y1])
        np.einsum("nij,nij->ij", weighed, difference, out=out[1, y0:y1])
        energy = np.einsum("nij,nij->ij", weight, np.square(difference))
        out[2, y0:y1] = energy / np.maximum(weight.sum(axis=0), 1e-3)

    for_rows(pool, out.shape[1], run)
    return out
