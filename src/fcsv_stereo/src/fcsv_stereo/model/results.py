# SPDX-License-Identifier: Apache-2.0
"""What a mapping method gives back: the map, and everything a person needs to judge it."""

from dataclasses import dataclass, field, replace
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.model.inputs import NO_SHIFT
from fcsv_stereo.model.pairs import Pair
from fcsv_stereo.model.pictures import Reference

#: what is told of the way to a map: the step that begins, the share of the work (0 to 1) behind it
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ImageEntry:
    """A picture of the map; ``prior_T_home_cam`` is its pose before refinement. ``left_out`` says
    why the map does not rest on it, None: it does."""

    name: str
    vehicle: str
    stamp_s: float
    T_home_cam: np.ndarray
    prior_T_home_cam: np.ndarray
    refined: bool = False
    inliers: Optional[int] = None
    epipolar_rms_px: Optional[float] = None
    left_out: Optional[str] = None

    @property
    def turned_deg(self) -> float:
        """Says by how many degrees refinement turned it."""
        return float(np.degrees(transforms.rotation_angle(self.prior_T_home_cam, self.T_home_cam)))

    @property
    def moved_m(self) -> float:
        """How far refinement moved it."""
        return float(np.linalg.norm(self.T_home_cam[:3, 3] - self.prior_T_home_cam[:3, 3]))


@dataclass(frozen=True)
class Cloud:
    """N points in home: float32 (N,3) m, uint8 (N,3) RGB, float32 (N,) standard deviation in m,
    uint8 (N,) pair."""

    points_home_m: np.ndarray
    colors: np.ndarray
    sigma_m: np.ndarray
    baseline_index: np.ndarray

    def __len__(self) -> int:
        return len(self.points_home_m)

    def __getitem__(self, which) -> "Cloud":
        return Cloud(*(getattr(self, n)[which] for n in Cloud.__dataclass_fields__))


def concatenate(clouds: Sequence[Cloud]) -> Cloud:
    """Clouds of one home (maps of several configurations, or of one again and again) after each
    other."""
    return Cloud(
        *(np.concatenate([getattr(c, n) for c in clouds]) for n in Cloud.__dataclass_fields__)
    )


@dataclass(frozen=True)
class CloudCut:
    """Bounds of a cloud (farthest depth in m, largest sigma; None: any) and how many points lay
    beyond each; what was too far counts as that alone."""

    range_m: Optional[float]
    sigma: Optional[ErrorThreshold]
    beyond_range: int
    beyond_sigma: int

    def to_dict(self) -> dict:
        """Gives the counts for report.json."""
        share, metres = None, None
        if self.sigma is not None:
            share, metres = (
                (self.sigma.value, None) if self.sigma.relative else (None, self.sigma.value)
            )
        return {
            "range_m": self.range_m,
            "sigma_share": share,
            "sigma_m": metres,
            "beyond_range": self.beyond_range,
            "beyond_sigma": self.beyond_sigma,
        }


@dataclass
class MapResult:
    """A map and its evidence. ``depth`` and ``sigma`` are float32 HxW (m), NaN where there is
    nothing."""

    method: str
    reference: Reference
    images: List[ImageEntry]
    pairs: Sequence[Pair]
    depth: np.ndarray
    sigma: np.ndarray
    cloud: Cloud
    timing_s: Dict[str, float] = field(default_factory=dict)
    warnings: List[str] = field(default_factory=list)
    # uint8 HxW, ``model.kinds``; by default one pair where there is a depth
    kind: Optional[np.ndarray] = None
    # other pictures before which nothing can have moved unseen
    watched: List[str] = field(default_factory=list)
    # of sessions, by other picture (instants.skews)
    skews_s: Mapping[str, float] = field(default_factory=dict)
    # of sweeps, by vehicle (sweeps.ClockOffset)
    clocks: Mapping[str, Any] = field(default_factory=dict)
    # by vehicle, pictures not needed (picture_list.spare)
    spare: Mapping[str, int] = field(default_factory=dict)
    cut: Optional[CloudCut] = None  # what was left out of the cloud (cloud_bounds)
    # sentences: what may be wrong and would show nowhere
    unseen: List[str] = field(default_factory=list)
    # of the orthophoto (products.holes.HoleShares); None: none was asked for
    holes: Optional[Any] = None
    gps: Optional[Any] = None  # where on the earth (sessions.SessionGps)
    #: (3,): poses and points plus this are in home (local_origin)
    origin_m: np.ndarray = field(default_factory=NO_SHIFT.copy)
    # what the near field brought (near.join.NearJoin); None: there is none
    near: Optional[Any] = None
    # where a robot can stand (products.ground.GroundShown); None: none was asked for
    ground: Optional[Any] = None

    def __post_init__(self):
        if self.kind is None and self.depth is not None:
            self.kind = np.isfinite(self.depth).astype(np.uint8)

    def keep(self, stays: np.ndarray) -> "MapResult":
        """The map with depth, sigma and points only where ``stays`` (HxW bool). Until the cloud is
        bounded or joined with another it has a point for each pixel with a depth, row by row: so it
        must be here and in ``with_sigma``.
        """
        depth, sigma = (
            np.where(stays, x, np.float32(np.nan)).astype(np.float32)
            for x in (self.depth, self.sigma)
        )
        return replace(
            self, depth=depth, sigma=sigma, cloud=self.cloud[stays[np.isfinite(self.depth)]]
        )

    def with_sigma(self, sigma: np.ndarray) -> "MapResult":
        """The map with another ``sigma`` (HxW float32, m)."""
        return replace(
            self, sigma=sigma, cloud=replace(self.cloud, sigma_m=sigma[np.isfinite(self.depth)])
        )

    @property
    def is_shifted(self) -> bool:
        """Whether poses and points are not home's own coordinates."""
        return bool(np.any(self.origin_m))

    @property
    def coverage(self) -> float:
        """Share of the reference picture's pixels that have a depth."""
        return float(np.isfinite(self.depth).mean())

    @property
    def points(self) -> int:
        return len(self.cloud)
