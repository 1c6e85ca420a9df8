# SPDX-License-Identifier: Apache-2.0
"""What each pair contributed to a joint map: its share, its useful range, and its rectified view when asked for."""

from dataclasses import replace
from functools import cached_property
from typing import Callable, List, Tuple

import cv2
import numpy as np

from fcsv_stereo.joint.tuning import PAIRS
from fcsv_stereo.model import Configuration, Picture
from fcsv_stereo.rectify import RectifiedPair, bouguet, home


class JointPair:
    """A ``Pair`` of a joint map; rectified pictures and disparity are made when they are looked at.

    ``depth`` is the joint depth (HxW float32, m, NaN) where this pair agrees with it. ``disparity`` is that depth seen
    in the rectified view: px along the pair's axis.
    """

    shares_depth = True

    def __init__(
        self, configuration: Configuration, reference: Picture, other: Picture, depth: np.ndarray,
        effective_range_m: Tuple[float, float], level: bool,
    ):  # fmt: skip
        self.configuration = configuration
        self.depth = depth
        self.effective_range_m = effective_range_m
        self.match_rate = float(np.isfinite(depth).mean())
        self.reference_name, self.other_name = reference.name, other.name
        self.candidates: List[Tuple[str, float]] = [(other.name, self.match_rate)]
        self.T_home_cam_reference, self.T_home_cam_other = reference.T_home_cam, other.T_home_cam
        self.camera_other = other.camera
        self._pictures = reference, other
        self._level = level

    def only(self, stays: np.ndarray) -> "JointPair":
        """The same pair with depth only where ``stays`` (HxW bool)."""
        depth = np.where(stays, self.depth, np.float32(np.nan))
        kept = JointPair(self.configuration, *self._pictures, depth, self.effective_range_m, self._level)
        kept.match_rate, kept.candidates = self.match_rate, self.candidates
        return kept

    def in_metres(self, unit_m: float, picture_in_metres: Callable[[Picture], Picture]) -> "JointPair":
        """The same pair, whose lengths are in units of ``unit_m``, with lengths in metres."""
        configuration = replace(self.configuration, baseline_m=self.configuration.baseline_m * unit_m)
        near_m, far_m = self.effective_range_m
        depth, pictures = self.depth * np.float32(unit_m), map(picture_in_metres, self._pictures)
        kept = JointPair(configuration, *pictures, depth, (near_m * unit_m, far_m * unit_m), self._level)
        kept.match_rate, kept.candidates = self.match_rate, self.candidates
        return kept

    @property
    def pictures(self) -> Tuple[Picture, Picture]:
        """The reference picture and the other one, posed as the map used them."""
        return self._pictures

    @cached_property
    def _rectified(self) -> RectifiedPair:
        return (home if self._level else bouguet)(*self._pictures, self.configuration.axis)

    @property
    def reference_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""
        return self._rectified.reference

    @property
    def other_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""
        return self._rectified.other

    @cached_property
    def disparity(self) -> np.ndarray:
        """HxW float32 (px, NaN where none) in the rectified view."""
        pair, reference = self._rectified, self._pictures[0]
        R_cam_rect = reference.T_home_cam[:3, :3].T @ pair.R_home_rect
        height, width = self.depth.shape
        u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(pair.K_reference).T
        seen = rays @ R_cam_rect.T
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
        camera = reference.camera
        maps = [m.astype(np.float32) for m in (camera.fx * x + camera.cx, camera.fy * y + camera.cy)]
        depth = cv2.remap(self.depth, *maps, cv2.INTER_NEAREST, borderValue=float("nan"))
        points = rays * (depth / seen[..., 2])[..., None] - pair.p_rect_other_m
        i = pair.axis_index
        with np.errstate(divide="ignore", invalid="ignore"):
            projected = pair.K_other[i, i] * points[..., i] / points[..., 2] + pair.K_other[i, 2]
        return ((u, v)[i] - projected).astype(np.float32)


def nearest_useful_m(depth: np.ndarray, agrees: np.ndarray, sees: np.ndarray) -> float:
    """The depth (m) below which a pair's matches stop agreeing with the joint map, from the evidence.

    ``agrees`` and ``sees`` are HxW bool. In bands of depth (with their neighbours, lest one object decides) the share
    of the map's pixels that the pair agrees with is held against its usual share; what it does not see is lost too.
    What the thesis left open beside equation 3.1's farthest depth.
    """
    known = np.isfinite(depth)
    if not known.any():
        return 0.0
    low, high = np.log2(np.percentile(depth[known], [0.5, 99.5]))
    count = max(2, int(np.ceil((high - low) * PAIRS.bins_per_doubling)))
    edges = np.exp2(np.linspace(low, high, count + 1))
    of, agreeing = (np.histogram(depth[m], edges)[0] for m in (known, known & agrees & sees))
    of, agreeing = (np.convolve(x, np.ones(3))[1:-1] for x in (of, agreeing))
    enough = of >= PAIRS.least_pixels
    if not enough.any():
        return float(edges[-1])
    share = agreeing / np.maximum(of, 1.0)
    usual = np.percentile(share[enough], PAIRS.usual_percentile)
    nearer_than_best = np.arange(count) < np.argmax(share * enough)
    failing = np.flatnonzero(enough & (share < PAIRS.least_share * usual) & nearer_than_best)
    return float(edges[failing[-1] + 1]) if failing.size else float(edges[0])
