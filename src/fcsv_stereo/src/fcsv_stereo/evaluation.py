# SPDX-License-Identifier: Apache-2.0
"""A map against truth: the figures that the thesis and its successors are compared by."""

from dataclasses import asdict, dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.model import MapResult
from fcsv_stereo.truth import Truth

BANDS_M = ((0.0, 50.0), (50.0, 100.0), (100.0, 200.0), (200.0, 400.0))


@dataclass(frozen=True)
class Band:
    """Pixels whose truth lies in a range (m); shares are of its pixels, or of the answered ones where said."""

    range_m: Tuple[float, float]
    pixels: int
    coverage: float
    within_10_percent: float
    wrong_of_answered: float
    median_relative_error: Optional[float]


@dataclass(frozen=True)
class Evaluation:
    """``overall`` is the band up to ``most_m``; pose errors are of each picture relative to the reference."""

    most_m: float
    overall: Band
    bands: List[Band]
    within_1_sigma: float
    within_2_sigma: float
    pose_errors: Dict[str, Tuple[float, float]]

    def to_dict(self) -> dict:
        """For report.json, with the main figures on top."""
        return {
            "range_m": self.most_m,
            "within_10_percent": self.overall.within_10_percent,
            "coverage": self.overall.coverage,
            "wrong_of_answered": self.overall.wrong_of_answered,
            "median_relative_error": self.overall.median_relative_error,
            "within_1_sigma": self.within_1_sigma,
            "within_2_sigma": self.within_2_sigma,
            "bands": [asdict(b) for b in self.bands],
            "pose_errors": {n: {"rotation_deg": r, "position_m": p} for n, (r, p) in self.pose_errors.items()},
        }


def evaluate(result: MapResult, truth: Optional[Truth], true_depth: np.ndarray, most_m: float = 400.0) -> Evaluation:
    """Of all pixels whose true depth is at most ``most_m``."""
    overall = band(result.depth, true_depth, (0.0, most_m))
    bands = [band(result.depth, true_depth, r) for r in BANDS_M if r[0] < most_m]
    judged = np.isfinite(result.depth) & (true_depth <= most_m)
    error = np.abs(result.depth[judged] - true_depth[judged]) / np.maximum(result.sigma[judged], 1e-6)
    shares = [float((error <= k).mean()) if error.size else 0.0 for k in (1.0, 2.0)]
    poses = {}
    if truth is not None:
        poses = {i.name: truth.relative_errors(result.reference, i) for i in result.images}
    return Evaluation(most_m, overall, bands, shares[0], shares[1], poses)


def band(depth: np.ndarray, true_depth: np.ndarray, range_m: Sequence[float]) -> Band:
    """Figures of the pixels whose truth lies in (range_m[0], range_m[1]]."""
    with np.errstate(invalid="ignore"):
        inside = (true_depth > range_m[0]) & (true_depth <= range_m[1])
    pixels = int(inside.sum())
    if pixels == 0:
        return Band(tuple(range_m), 0, 0.0, 0.0, 0.0, None)
    answered = inside & np.isfinite(depth)
    relative = np.abs(depth[answered] / true_depth[answered] - 1.0)
    good = int((relative <= 0.1).sum())
    wrong = float((relative > 0.1).mean()) if relative.size else 0.0
    median = float(np.median(relative)) if relative.size else None
    return Band(tuple(range_m), pixels, relative.size / pixels, good / pixels, wrong, median)
