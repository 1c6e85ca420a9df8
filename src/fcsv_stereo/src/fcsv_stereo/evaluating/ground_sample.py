# SPDX-License-Identifier: Apache-2.0
"""Ground sample distance: what one pixel of the reference picture covers, across the line of
sight."""

from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from fcsv_stereo.model import MapResult

_DISTANCES_M = (5.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0)


@dataclass(frozen=True)
class GroundSample:
    """``per_m``: metres of a pixel at 1 m of depth, of the coarser axis; it grows in proportion to
    the depth. ``median_depth_m`` is that of the mapped pixels, None where there are none."""

    per_m: float
    median_depth_m: Optional[float]

    @classmethod
    def of(cls, result: MapResult) -> "GroundSample":
        """Takes a sample of a map's reference picture."""
        known = result.depth[np.isfinite(result.depth)]
        median_m = float(np.median(known)) if known.size else None
        return cls(1.0 / min(result.reference.camera.fx, result.reference.camera.fy), median_m)

    def at_m(self, depth_m: float) -> float:
        """Metres of a pixel at a depth.

        >>> round(GroundSample(1 / 602.0, None).at_m(301.0), 3)
        0.5
        """
        return self.per_m * depth_m

    def table(self) -> List[Tuple[float, float]]:
        """Depths and metres of a pixel there: round depths, and the median among them."""
        depths = {*_DISTANCES_M, *([self.median_depth_m] if self.median_depth_m else [])}
        return [(d, self.at_m(d)) for d in sorted(depths)]

    def to_dict(self) -> dict:
        """Gives the sample for report.json."""
        median_m = self.median_depth_m
        return {
            "m_per_px_at_1_m": self.per_m,
            "median_depth_m": median_m,
            "at_median_m": None if median_m is None else self.at_m(median_m),
        }
