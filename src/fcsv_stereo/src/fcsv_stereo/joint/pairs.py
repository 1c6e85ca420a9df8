# SPDX-License-Identifier: Apache-2.0
"""What each pair contributed to a joint map: its share, its useful range, and its rectified view
when asked for."""

import weakref
from dataclasses import replace
from typing import Any, Callable, ClassVar, Dict, List, Optional, Tuple, TypeVar

import cv2
import numpy as np

from fcsv_stereo.joint.tuning import PAIRS, SHARED
from fcsv_stereo.model import Configuration, Picture
from fcsv_stereo.rectify import RectifiedPair, bouguet, home

T = TypeVar("T")

_BAND = 64  # rows at a time: large pictures


class JointPair:
    """A ``Pair`` of a joint map; rectified pictures and disparity are made when they are looked at,
    and kept until another pair's are: a large picture's are as large as the map.

    ``depth`` is the joint depth (HxW float32, m, NaN) where this pair agrees with it. ``disparity``
    is that depth seen in the rectified view: px along the pair's axis.
    """

    shares_depth = True
    _looked_at: ClassVar[Callable[[], Optional["JointPair"]]] = staticmethod(lambda: None)

    def __init__(
        self,
        configuration: Configuration,
        reference: Picture,
        other: Picture,
        depth: np.ndarray,
        agrees: np.ndarray,
        effective_range_m: Tuple[float, float],
        level: bool,
    ):
        """``depth`` (HxW float32, m, NaN) is the map's; ``agrees`` (HxW bool) where this pair
        agrees with it."""
        self.configuration = configuration
        self._map_depth, self._agrees = depth, agrees & np.isfinite(depth)
        self.effective_range_m = effective_range_m
        self.match_rate = float(self._agrees.mean())
        self.reference_name, self.other_name = reference.name, other.name
        self.candidates: List[Tuple[str, float]] = [(other.name, self.match_rate)]
        self.T_home_cam_reference, self.T_home_cam_other = reference.T_home_cam, other.T_home_cam
        self.camera_other = other.camera
        self._pictures = reference, other
        self._level = level
        self._views: Dict[str, Any] = {}

    @property
    def depth(self) -> np.ndarray:
        """HxW float32 (m, NaN): the map's where this pair agrees."""
        return np.where(self._agrees, self._map_depth, np.float32(np.nan))

    def only(self, stays: np.ndarray) -> "JointPair":
        """The same pair with depth only where ``stays`` (HxW bool)."""
        agrees = self._agrees & stays
        kept = JointPair(
            self.configuration,
            *self._pictures,
            self._map_depth,
            agrees,
            self.effective_range_m,
            self._level,
        )
        kept.match_rate, kept.candidates = self.match_rate, self.candidates
        return kept

    def in_metres(
        self, unit_m: float, picture_in_metres: Callable[[Picture], Picture], depth: np.ndarray
    ) -> "JointPair":
        """The same pair, whose lengths are in units of ``unit_m``, with lengths in metres;
        ``depth`` is the map's."""
        configuration = replace(
            self.configuration, baseline_m=self.configuration.baseline_m * unit_m
        )
        near_m, far_m = self.effective_range_m
        reference, other = map(picture_in_metres, self._pictures)
        kept = JointPair(
            configuration,
            reference,
            other,
            depth,
            self._agrees,
            (near_m * unit_m, far_m * unit_m),
            self._level,
        )
        kept.match_rate, kept.candidates = self.match_rate, self.candidates
        return kept

    @property
    def pictures(self) -> Tuple[Picture, Picture]:
        """The reference picture and the other one, posed as the map used them."""
        return self._pictures

    def _view(self, name: str, make: Callable[[], T]) -> T:
        """What ``make`` gives, made once while no other pair is looked at."""
        before = JointPair._looked_at()
        if before is not self:
            if before is not None:
                before._views = {}
            JointPair._looked_at = weakref.ref(self)
        views = self._views
        if name not in views:
            views[name] = make()
        return views[name]

    @property
    def _rectified(self) -> RectifiedPair:
        make = home if self._level else bouguet
        return self._view("rectified", lambda: make(*self._pictures, self.configuration.axis))

    @property
    def reference_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""
        return self._rectified.reference

    @property
    def other_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""
        return self._rectified.other

    @property
    def disparity(self) -> np.ndarray:
        """HxW float32 (px, NaN where none) in the rectified view."""
        return self._view("disparity", self._disparity)

    def _disparity(self) -> np.ndarray:
        depth = self.depth
        return np.concatenate([self._disparity_band(depth, y) for y in range(0, len(depth), _BAND)])

    def _disparity_band(self, depth: np.ndarray, first_row: int) -> np.ndarray:
        """Gives the disparity of the rectified view's rows from ``first_row`` on; ``depth`` as
        above, whole."""
        pair, reference = self._rectified, self._pictures[0]
        R_cam_rect = reference.T_home_cam[:3, :3].T @ pair.R_home_rect
        height, width = depth.shape
        rows = np.arange(first_row, min(first_row + _BAND, height), dtype=float)
        u, v = np.meshgrid(np.arange(width, dtype=float), rows)
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(pair.K_reference).T
        seen = rays @ R_cam_rect.T
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
        camera = reference.camera
        maps = [
            m.astype(np.float32) for m in (camera.fx * x + camera.cx, camera.fy * y + camera.cy)
        ]
        depth = cv2.remap(depth, *maps, cv2.INTER_NEAREST, borderValue=float("nan"))
        points = rays * (depth / seen[..., 2])[..., None] - pair.p_rect_other_m
        i = pair.axis_index
        with np.errstate(divide="ignore", invalid="ignore"):
            projected = pair.K_other[i, i] * points[..., i] / points[..., 2] + pair.K_other[i, 2]
        return ((u, v)[i] - projected).astype(np.float32)


class NearestUseful:
    """The depth (m) below which a pair's matches stop agreeing with the joint map, from the
    evidence.

    ``agrees`` and ``sees`` are HxW bool. In bands of depth (with their neighbours, lest one object
    decides) the share of the map's pixels that the pair agrees with is held against its usual
    share; what it does not see is lost too. What the thesis left open beside equation 3.1's
    farthest depth.
    """

    def __init__(self, depth: np.ndarray):
        """``depth`` (HxW, m, NaN) is the map's, of all pairs: its bands are found once."""
        self._known = np.isfinite(depth)
        depths = depth[self._known]
        if not len(depths):
            return
        low, high = np.log2(np.percentile(depths, [0.5, 99.5]))
        count = max(2, int(np.ceil((high - low) * PAIRS.bins_per_doubling)))
        self._edges = np.exp2(np.linspace(low, high, count + 1))
        # 0: nearer than all
        band = np.searchsorted(self._edges, depths, side="right").astype(np.int16)
        band[depths == self._edges[-1]] = count  # the last one holds its end, as histograms do
        self._band = band
        self._of = self._counted(band)

    def _counted(self, bands: np.ndarray) -> np.ndarray:
        """Counts by band, with its neighbours."""
        count = len(self._edges) - 1
        return np.convolve(np.bincount(bands, minlength=count + 2)[1 : count + 1], np.ones(3))[1:-1]

    def of(self, agrees: np.ndarray, sees: np.ndarray) -> float:
        """Gives the nearest useful distance of a pair."""
        if not self._known.any():
            return 0.0
        edges, of = self._edges, self._of
        agreeing = self._counted(self._band[(agrees & sees)[self._known]])
        enough = of >= SHARED.least_pixels
        if not enough.any():
            return float(edges[-1])
        share = agreeing / np.maximum(of, 1.0)
        usual = np.percentile(share[enough], PAIRS.usual_percentile)
        nearer_than_best = np.arange(len(of)) < np.argmax(share * enough)
        failing = np.flatnonzero(enough & (share < PAIRS.least_share * usual) & nearer_than_best)
        return float(edges[failing[-1] + 1]) if failing.size else float(edges[0])
