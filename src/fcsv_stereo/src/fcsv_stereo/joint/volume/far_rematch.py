# SPDX-License-Identifier: Apache-2.0
"""What is far, once more at full size: there a level of the smaller volume is much of the depth, and few are needed."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import List, Tuple

import numpy as np

from fcsv_stereo.joint.checks.reliability import well_matched
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.winner import coarse

_FAR_PX = 40.0  # of movement in the fastest pair; what moves less is far
_STEP_PX = 0.5
_LEVELS = int(_FAR_PX / _STEP_PX) + 1
_OVERLAP = 16  # rows: of strips, for windows and paths
_MARGIN = 0.9  # share of the nearest level up to which a match counts: the volume's end draws what is beyond it
_SAME = 0.25  # share of inverse depth by which a match may differ from the surface that was chosen
_LEAST_SHARE = 0.01  # of a row
_HIGHEST = 0.0  # windows in level planes change nothing here
#: By which what the volume leaves uncertain is less than a level of the smaller one.
FINER = np.float32(0.4)


def sharpened(found: Views, w: np.ndarray, most_cells: int, pool: ThreadPoolExecutor) -> Tuple[np.ndarray, np.ndarray]:
    """Inverse depth ``w`` (HxW, 1/m; of the pictures ``found``) with what is far matched again, and where (HxW bool).

    A match has to agree with the surface that was chosen: this gives edges and depths, it finds nothing new. Volumes
    have ``most_cells`` each, about: large pictures are matched in strips.
    """
    limit = _FAR_PX / max(float(np.hypot(found.projections[:, 9], found.projections[:, 10]).max()), 1e-9)
    far = (w > 0) & (w < limit)
    nearest = np.where(far.mean(axis=1) > _LEAST_SHARE, np.float32(limit), np.float32(0.0))
    out, good = w.copy(), np.zeros(w.shape, np.bool_)
    for rows in _strips(np.flatnonzero(nearest), most_cells // (w.shape[1] * _LEVELS)):
        around = slice(max(rows.start - _OVERLAP, 0), rows.stop + _OVERLAP)
        match = coarse(_band(found, around), nearest[around], _HIGHEST, _LEVELS, pool, _STEP_PX)
        inner = slice(rows.start - around.start, rows.stop - around.start)
        again, matched = match.w[inner], well_matched(match)[inner]
        alike = np.abs(again - w[rows]) < _SAME * w[rows]
        good[rows] = alike & matched & far[rows] & (again < _MARGIN * limit)
        out[rows] = np.where(good[rows], again, w[rows])
    return out, good


def _strips(rows: np.ndarray, tall: int) -> List[slice]:
    """Of ``tall`` rows at most from the first to the last of ``rows``; never of fewer than they overlap by."""
    if not len(rows):
        return []
    tall, end = max(tall - 2 * _OVERLAP, _OVERLAP), int(rows[-1]) + 1
    return [slice(start, min(start + tall, end)) for start in range(int(rows[0]), end, tall)]


def _band(found: Views, rows: slice) -> Views:
    """The same pictures with a part of the reference's rows."""
    projections, falling = found.projections.copy(), found.falling.copy()
    projections[:, 2:9:3] += projections[:, 1:9:3] * np.float32(rows.start)
    falling[2] += falling[1] * rows.start
    reference = np.ascontiguousarray(found.reference[rows])
    return replace(found, reference=reference, projections=projections, falling=falling)
