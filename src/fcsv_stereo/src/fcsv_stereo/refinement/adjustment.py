# SPDX-License-Identifier: Apache-2.0
"""Pictures linked, tracked and adjusted once, as they are given."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement.consensus import Consensus, adjust_robustly
from fcsv_stereo.refinement.copies import without_copies
from fcsv_stereo.refinement.features import FeatureView, prepare, rays_of
from fcsv_stereo.refinement.graph import link_all, start_poses
from fcsv_stereo.refinement.links import PairLink
from fcsv_stereo.refinement.rolling_shutter import ReadoutTurns
from fcsv_stereo.refinement.time_offset import motions
from fcsv_stereo.refinement.tracks import observe
from fcsv_stereo.refinement.types import RefineOptions

_SIFT_FEATURES = 1500


class Clock:
    """Seconds of each kind of step."""

    def __init__(self):
        self.laps_s: Dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Count the time since the last call under a name."""
        now = time.perf_counter()
        self.laps_s[name] = self.laps_s.get(name, 0.0) + now - self._last
        self._last = now


@dataclass(frozen=True)
class Adjustment:
    """Holds an adjustment of ``pictures``, the reference first; ``direct`` are their links with it
    by number. ``turns`` by which they were straightened, None: they are as they came.
    ``focal_scale`` by which their cameras were multiplied already."""

    pictures: List[Picture]
    views: List[FeatureView]
    direct: Dict[int, PairLink]
    consensus: Consensus
    unmoving: List[str] = field(default_factory=list)  # warnings
    turns: Optional[ReadoutTurns] = None
    focal_scale: float = 1.0

    @property
    def cameras(self) -> Dict[int, PinholeCamera]:
        """Gives the cameras of the features, by picture."""
        return {k: v.camera for k, v in enumerate(self.views)}


def adjusted(pictures: List[Picture], options: RefineOptions, clock: Clock) -> Adjustment:
    """Features, links, tracks and the robust adjustment; copies of a picture have no say."""
    look = prepare if options.known is None else options.known.prepare
    with ThreadPoolExecutor(options.threads) as pool:
        views = list(pool.map(lambda p: look(p, _SIFT_FEATURES), pictures))
    clock.lap("features")
    return _adjusted_views(views, options, clock)


def with_cameras(
    found: Adjustment, factors: Dict[int, float], options: RefineOptions, clock: Clock
) -> Adjustment:
    """Linked, tracked and adjusted again, with focal lengths of some pictures multiplied, by
    number."""
    views = [_with_focal(v, factors[k]) if k in factors else v for k, v in enumerate(found.views)]
    return replace(_adjusted_views(views, options, clock), turns=found.turns)


def _with_focal(view: FeatureView, factor: float) -> FeatureView:
    def scaled(camera: PinholeCamera) -> PinholeCamera:
        return replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)

    camera, picture = scaled(view.camera), replace(view.picture, camera=scaled(view.picture.camera))
    return replace(view, picture=picture, camera=camera, rays=rays_of(camera, view.uv))


def _adjusted_views(views: List[FeatureView], options: RefineOptions, clock: Clock) -> Adjustment:
    pictures = [v.picture for v in views]
    with ThreadPoolExecutor(options.threads) as pool:
        direct, between = link_all(views, options, pool)
        direct, between = without_copies(views, direct, between, options)
        trusted = [l for l in direct.values() if not l.reason] + between
        starts = start_poses(len(views), trusted)
        trusted = [l for l in trusted if l.a in starts and l.b in starts]
        clock.lap("match")
        found = observe(views, trusted, options.features, pool) if trusted else None
        clock.lap("track")
    moving, unmoving = motions(pictures[0], pictures[1:], options)
    consensus = adjust_robustly(views, found, trusted, starts, moving, options)
    clock.lap("adjust")
    return Adjustment(pictures, views, direct, consensus, unmoving)
