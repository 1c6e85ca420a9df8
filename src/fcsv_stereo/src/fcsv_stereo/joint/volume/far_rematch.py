# SPDX-License-Identifier: Apache-2.0
"""What is far, once more at full size: there a level of the smaller volume is much of the depth,
and few are needed."""

from concurrent.futures import ThreadPoolExecutor
from typing import List, Tuple

import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.projecting import place, ray
from fcsv_stereo.joint.tuning import FAR_REMATCH, SHARED
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.winner import match_volume, well_matched

_OVERLAP = 16  # rows of strips, for windows and paths


def sharpened(
    found: Views, w: np.ndarray, most_cells: int, pool: ThreadPoolExecutor
) -> Tuple[np.ndarray, np.ndarray]:
    """Inverse depth ``w`` (HxW, 1/m; of the pictures ``found``) with what is far matched again, and
    where (HxW bool).

    A match has to agree with the surface that was chosen: this gives edges and depths, it finds
    nothing new. Rows in which no other picture shows what is far are left as they are. Volumes have
    ``most_cells`` each, about: large pictures are matched in strips.
    """
    far_px, step_px = FAR_REMATCH.far_px, FAR_REMATCH.step_px
    limit = far_px / max(found.fastest_px_m, 1e-9)
    far = (w > 0) & (w < limit)
    shown = np.empty(len(w))
    for_rows(
        pool, len(w), lambda y0, y1: _shown(w, far, found.projections, found.sizes, y0, y1, shown)
    )
    nearest = np.where(shown > FAR_REMATCH.least_share, np.float32(limit), np.float32(0.0))
    out, good = w.copy(), np.zeros(w.shape, np.bool_)
    for rows in _strips(np.flatnonzero(nearest), most_cells // (w.shape[1] * FAR_REMATCH.levels)):
        around = slice(max(rows.start - _OVERLAP, 0), rows.stop + _OVERLAP)
        match = match_volume(
            found.rows(around),
            nearest[around],
            0.0,  # no level planes: they change nothing here
            FAR_REMATCH.levels,
            pool,
            step_px,
        )
        inner = slice(rows.start - around.start, rows.stop - around.start)
        again, matched = match.w[inner], well_matched(match)[inner]
        alike = np.abs(again - w[rows]) < FAR_REMATCH.same * w[rows]
        # above the limit's margin a match may be the volume's end, which draws what is nearer
        good[rows] = alike & matched & far[rows] & (again < (1.0 - SHARED.step) * limit)
        out[rows] = np.where(good[rows], again, w[rows])
    return out, good


@njit(cache=True, nogil=True)
def _shown(w, far, projections, sizes, y0, y1, share):
    """Into ``share`` (H) which share of each row is ``far`` and in view of some other picture."""
    width = w.shape[1]
    for v in range(y0, y1):
        count = 0
        for u in range(width):
            if not far[v, u]:
                continue
            for i in range(projections.shape[0]):
                a, b, c = ray(projections, i, u, v)
                x, y, z, _ = place(a, b, c, projections, i, w[v, u])
                if z > 0 and x >= 0 and y >= 0 and x <= sizes[i, 1] - 1 and y <= sizes[i, 0] - 1:
                    count += 1
                    break
        share[v] = count / width


def _strips(rows: np.ndarray, tall: int) -> List[slice]:
    """Cuts strips of ``tall`` rows at most from the first to the last of ``rows``; never of fewer
    than they overlap by."""
    if not len(rows):
        return []
    tall, end = max(tall - 2 * _OVERLAP, _OVERLAP), int(rows[-1]) + 1
    return [slice(start, min(start + tall, end)) for start in range(int(rows[0]), end, tall)]
