# SPDX-License-Identifier: Apache-2.0
"""Whether maps show one place in one frame: maps of flights that set home at different places do
not, and walls of one would lie in free ground of the other."""

from itertools import combinations
from typing import Optional

import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground.model import Ground

#: of the heights that two maps know in common. True pairs of 22 mazes and 10 fields: 0.36 and more,
#: each map's best 0.64; the same moved by 8 and 15 m: 0.15 and 0.09 in the middle, one in ten more
LEAST_ALIKE = 0.3
_STANDS_OUT_M, _CELLS, _STANDING_CELLS = 0.3, 500, 300  # else they say nothing of it
_LOW_M, _HIGH_M = -1.0, 1.5  # one tower must not decide


def require_one_frame(ground: Ground) -> None:
    """Raises GroundError that names a map whose walls, blocks and holes lie elsewhere than those of
    every other that shows them."""
    best = {}
    for pair in combinations(range(len(ground.maps)), 2):
        alike = _alike(*(ground.maps[k].height_m for k in pair))
        if alike is None:
            continue
        for one, other in (pair, pair[::-1]):
            best[one] = max(best.get(one, (alike, other)), (alike, other))
    for one in sorted(best, reverse=True):  # whoever came later
        alike, other = best[one]
        if alike < LEAST_ALIKE:
            raise GroundError(
                f"{ground.views[one]}: its walls and blocks lie elsewhere than in "
                f"{ground.views[other]} (heights correlate by {alike:.2f}): have both the same "
                "home? Join flights with homes of their own by 'survey', and give its folder"
            )


def _alike(height_m: np.ndarray, other_m: np.ndarray) -> Optional[float]:
    """Correlation of the heights that both know; None where too little stands out of the ground."""
    both = np.isfinite(height_m) & np.isfinite(other_m)
    if both.sum() < _CELLS:
        return None
    heights = [h[both] - np.median(h[both]) for h in (height_m, other_m)]
    if min((np.abs(h) > _STANDS_OUT_M).sum() for h in heights) < _STANDING_CELLS:
        return None
    a, b = (np.clip(h, _LOW_M, _HIGH_M) for h in heights)
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum()))
