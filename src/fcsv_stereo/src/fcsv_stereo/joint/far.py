# SPDX-License-Identifier: Apache-2.0
"""What is far, once more at full size: there a level of the smaller volume is much of the depth, and few are needed."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Tuple

import numpy as np

from fcsv_stereo.joint.coarse import coarse
from fcsv_stereo.joint.sweep import Views

_FAR_PX = 40.0  # of movement in the fastest pair; what moves less is far
_STEP_PX = 0.5
_MARGIN = 0.9  # share of the nearest level up to which a match counts: the volume's end draws what is beyond it
_SAME = 0.25  # share of inverse depth by which a match may differ from the surface that was chosen
_LEAST_SHARE = 0.01  # of a row
_HIGHEST = 0.0
_MOST_COST, _LEAST_MARGIN = 110, 0.03  # as trust's: volume units, and share of the best sum
#: By which what the volume leaves uncertain is less than a level of the smaller one.
FINER = np.float32(0.4)


def sharpened(found: Views, w: np.ndarray, most_levels: int, pool: ThreadPoolExecutor) -> Tuple[np.ndarray, np.ndarray]:
    """Inverse depth ``w`` (HxW, 1/m; of the pictures ``found``) with what is far matched again, and where (HxW bool).

    A match has to agree with the surface that was chosen: this gives edges and depths, it finds nothing new.
    """
    limit = _FAR_PX / max(float(np.hypot(found.projections[:, 9], found.projections[:, 10]).max()), 1e-9)
    rows = np.flatnonzero(((w > 0) & (w < limit)).mean(axis=1) > _LEAST_SHARE)
    good = np.zeros(w.shape, np.bool_)
    if not len(rows):
        return w, good
    band = slice(rows[0], rows[-1] + 1)
    part = _band(found, band)
    nearest = np.zeros(part.shape[0], np.float32)
    nearest[rows - rows[0]] = limit
    match = coarse(part, nearest, _HIGHEST, most_levels, pool, _STEP_PX)
    good[band] = (
        (match.w > 0) & (match.w < _MARGIN * limit) & (np.abs(match.w - w[band]) < _SAME * w[band])
        & (match.cost < _MOST_COST) & (match.margin > _LEAST_MARGIN)
    )  # fmt: skip
    out = w.copy()
    out[band] = np.where(good[band], match.w, w[band])
    return out, good


def _band(found: Views, rows: slice) -> Views:
    """The same pictures with a part of the reference's rows."""
    projections, falling = found.projections.copy(), found.falling.copy()
    projections[:, 2:9:3] += projections[:, 1:9:3] * np.float32(rows.start)
    falling[2] += falling[1] * rows.start
    reference = np.ascontiguousarray(found.reference[rows])
    return replace(found, reference=reference, projections=projections, falling=falling)
