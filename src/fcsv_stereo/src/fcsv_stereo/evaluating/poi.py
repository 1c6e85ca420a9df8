# SPDX-License-Identifier: Apache-2.0
"""Evaluation by points of interest (thesis 6.7): what each configuration says of a box in the
reference picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Sequence

import numpy as np

from fcsv_geometry import config
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import MapResult

FILE = "poi.yaml"
PERCENTILES = (5, 25, 50, 75, 95)


@dataclass(frozen=True)
class PointOfInterest:
    """A box about pixel (u_px, v_px) of the reference picture; ``truth_m`` is its true depth where
    it is known."""

    name: str  # in the report
    u_px: float  # middle of the box in the reference picture
    v_px: float  # likewise
    width_px: int = 160  # of the box
    height_px: int = 30  # of the box
    truth_m: Optional[float] = None  # true depth, where it is known

    def __post_init__(self):
        if not self.name.strip():
            raise ValueError("name: is empty")
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(
                f"width_px, height_px: a box of {self.width_px}x{self.height_px} holds no pixel"
            )
        if self.truth_m is not None and not self.truth_m > 0:
            raise ValueError(f"truth_m: {self.truth_m} must be positive")

    def box(self, image: np.ndarray) -> np.ndarray:
        """The part (height_px, width_px) of an array (H,W,...) that lies in the box. Raises
        InputError outside."""
        u = int(np.ceil(self.u_px - self.width_px / 2.0))
        v = int(np.ceil(self.v_px - self.height_px / 2.0))
        height, width = image.shape[:2]
        if u < 0 or v < 0 or u + self.width_px > width or v + self.height_px > height:
            raise InputError(
                f"point of interest '{self.name}': columns {u} to {u + self.width_px - 1}, rows {v} to "
                f"{v + self.height_px - 1} do not lie in the reference picture of {width}x{height}"
            )
        return image[v : v + self.height_px, u : u + self.width_px]


@dataclass(frozen=True)
class PointsOfInterest:
    """The file: ``points_of_interest`` is a list of boxes with different names."""

    points_of_interest: List[PointOfInterest]  # with different names

    def __post_init__(self):
        names = [p.name for p in self.points_of_interest]
        if not names:
            raise ValueError("points_of_interest: the list is empty")
        twice = [n for n in names if names.count(n) > 1]
        if twice:
            raise ValueError(f"points_of_interest: two are named '{twice[0]}'")


@dataclass(frozen=True)
class Sample:
    """One configuration in one box: its depths (N, m) before trimming, and the share of the box
    that has one."""

    configuration: str
    depths_m: np.ndarray
    match_rate: float

    @property
    def percentiles_m(self) -> Optional[List[float]]:
        """Depth (m) at PERCENTILES; None where nothing matched."""
        return np.percentile(self.depths_m, PERCENTILES).tolist() if len(self.depths_m) else None


@dataclass(frozen=True)
class PoiResult:
    """A box, its true depth (m; median of the box where a whole truth is known) and every
    configuration in it."""

    poi: PointOfInterest
    truth_m: Optional[float]
    samples: List[Sample]

    def to_dict(self) -> dict:
        """Gives the sample for report.json."""
        return {
            "name": self.poi.name,
            "u_px": self.poi.u_px,
            "v_px": self.poi.v_px,
            "width_px": self.poi.width_px,
            "height_px": self.poi.height_px,
            "truth_m": self.truth_m,
            "percentiles": list(PERCENTILES),
            "configurations": [
                {"name": s.configuration, "match_rate": s.match_rate, "depth_m": s.percentiles_m}
                for s in self.samples
            ],
        }


def load_points(path: Path) -> List[PointOfInterest]:
    """Boxes from a file. Raises ConfigError naming file and field."""
    return config.load(path, PointsOfInterest).points_of_interest


def sample(
    result: MapResult, points: Sequence[PointOfInterest], true_depth: Optional[np.ndarray] = None
) -> List[PoiResult]:
    """Depth and match rate of every configuration in every box. Raises InputError for a box outside
    the picture."""
    return [_sample_one(result, p, true_depth) for p in points]


def _sample_one(
    result: MapResult, poi: PointOfInterest, true_depth: Optional[np.ndarray]
) -> PoiResult:
    samples = []
    for pair in result.pairs:
        depth = poi.box(pair.depth)
        known = depth[np.isfinite(depth)]
        samples.append(Sample(pair.configuration.name, known, known.size / depth.size))
    truth_m = poi.truth_m
    if truth_m is None and true_depth is not None:
        truth = poi.box(true_depth)
        truth_m = float(np.nanmedian(truth)) if np.isfinite(truth).any() else None
    return PoiResult(poi, truth_m, samples)
