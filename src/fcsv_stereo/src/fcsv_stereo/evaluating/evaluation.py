# SPDX-License-Identifier: Apache-2.0
"""A map against truth: the figures that the thesis and its successors are compared by."""

from dataclasses import asdict, dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.evaluating.depth_metrics import DepthMetrics, depth_metrics
from fcsv_stereo.evaluating.truth import Truth
from fcsv_stereo.model import MapResult

BANDS_M = ((0.0, 50.0), (50.0, 100.0), (100.0, 200.0), (200.0, 400.0))
LEAST_SHARE = 2e-4  # of a picture that something takes that is judged: 60 pixels of 640 x 480


@dataclass(frozen=True)
class Band:
    """Pixels whose truth lies in a range (m); shares are of its pixels, or of the answered ones
    where said."""

    range_m: Tuple[float, float]
    pixels: int
    coverage: float
    within_10_percent: float
    wrong_of_answered: float
    median_relative_error: Optional[float]


@dataclass(frozen=True)
class Moving:
    """Something that moves, in the reference picture: its true distance (m, median), and of its
    pixels the share that is answered and the share that is off by more than a tenth;
    ``median_relative_error``: of the answered ones.
    """

    name: str
    pixels: int
    distance_m: float
    answered: float
    wrong: float
    median_relative_error: Optional[float]

    @property
    def words(self) -> str:
        """Says the figures for a table."""
        e = self.median_relative_error
        error = "" if e is None else f", median error {e:.1%}"
        return f"{self.name}, which moves, at {self.distance_m:.1f} m: {self.answered:.0%} of it answered{error}"


@dataclass(frozen=True)
class Evaluation:
    """``overall`` is the band up to ``most_m``; pose errors are of each picture relative to the
    reference.

    ``metrics``: those of the field, of the pixels up to ``most_m`` that have a depth and a sigma;
    None where there is none. ``scale``: depth over truth, the median of the answered pixels;
    ``within_2_sigma_scaled``: the share within two sigma once all depths are divided by it.
    """

    most_m: float
    overall: Band
    bands: List[Band]
    within_1_sigma: float
    within_2_sigma: float
    pose_errors: Dict[str, Tuple[float, float]]
    moving: Tuple[Moving, ...] = ()
    metrics: Optional[DepthMetrics] = None
    scale: float = 1.0
    within_2_sigma_scaled: Optional[float] = None

    def to_dict(self) -> dict:
        """Gives the figures for report.json, with the main figures on top."""
        return {
            "range_m": self.most_m,
            "within_10_percent": self.overall.within_10_percent,
            "coverage": self.overall.coverage,
            "wrong_of_answered": self.overall.wrong_of_answered,
            "median_relative_error": self.overall.median_relative_error,
            "within_1_sigma": self.within_1_sigma,
            "within_2_sigma": self.within_2_sigma,
            "scale": self.scale,
            "within_2_sigma_scaled": self.within_2_sigma_scaled,
            "metrics": None if self.metrics is None else self.metrics.to_dict(),
            "bands": [asdict(b) for b in self.bands],
            "pose_errors": {
                n: {"rotation_deg": r, "position_m": p} for n, (r, p) in self.pose_errors.items()
            },
            "moving": [asdict(m) for m in self.moving],
        }


def evaluate(
    result: MapResult,
    truth: Optional[Truth],
    true_depth: np.ndarray,
    most_m: float = 400.0,
    on: Optional[Mapping[str, np.ndarray]] = None,
) -> Evaluation:
    """Compares a map with the truth of all pixels whose true depth is at most ``most_m``. ``on``:
    pixels (H,W bool) of each thing that moves."""
    overall = band(result.depth, true_depth, (0.0, most_m))
    bands = [band(result.depth, true_depth, r) for r in BANDS_M if r[0] < most_m]
    judged = np.isfinite(result.depth) & (true_depth <= most_m)
    sigma = np.maximum(result.sigma, 1e-6)
    answered, true, spread = result.depth[judged], true_depth[judged], sigma[judged]
    error = np.abs(answered - true) / spread
    shares = [float((error <= k).mean()) if error.size else 0.0 for k in (1.0, 2.0)]
    scale = float(np.median(answered / true)) if answered.size else 1.0
    scaled = (
        float((np.abs(answered / scale - true) <= 2.0 * spread).mean()) if answered.size else None
    )
    stated = judged & np.isfinite(sigma)
    depth, sigma, true = (a[stated] for a in (result.depth, sigma, true_depth))
    metrics = depth_metrics(depth, sigma, true, by_distance(true, most_m))
    poses = {}
    if truth is not None:
        poses = {i.name: truth.relative_errors(result.reference, i) for i in result.images}
    on_movers = moving(result.depth, true_depth, on or {})
    return Evaluation(most_m, overall, bands, *shares, poses, on_movers, metrics, scale, scaled)


def by_distance(true_depth: np.ndarray, most_m: float) -> Dict[str, np.ndarray]:
    """Pixels (bool, shaped as ``true_depth``) of each band of distance (m), by name."""
    bands = [r for r in BANDS_M if r[0] < most_m]
    return {f"{a:.0f} to {b:.0f} m": (true_depth > a) & (true_depth <= b) for a, b in bands}


def moving(
    depth: np.ndarray, true_depth: np.ndarray, on: Mapping[str, np.ndarray]
) -> Tuple[Moving, ...]:
    """What a depth image (H,W) says of things that move; ``on`` as in ``evaluate``. What is hardly
    seen is left out."""
    return tuple(
        _moving(n, depth[m], true_depth[m])
        for n, m in on.items()
        if m.sum() >= LEAST_SHARE * m.size
    )


def _moving(name: str, found: np.ndarray, true: np.ndarray) -> Moving:
    known = np.isfinite(found)
    relative = np.abs(found[known] / true[known] - 1.0)
    error = float(np.median(relative)) if relative.size else None
    wrong = float((relative > 0.1).sum() / found.size)
    return Moving(name, found.size, float(np.median(true)), float(known.mean()), wrong, error)


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
