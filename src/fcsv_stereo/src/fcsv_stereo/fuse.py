# SPDX-License-Identifier: Apache-2.0
"""Fusion of depth of several configurations in one view (thesis 3.2 and 3.4)."""

from typing import List, Sequence, Tuple

import numpy as np

from fcsv_stereo.equations import ErrorThreshold, farthest


def segments(
    baselines_m: Sequence[float], focal_px: float, threshold: ErrorThreshold, floor_m: float = 0.0
) -> List[Tuple[float, float]]:
    """Effective range (m) of each baseline, in their order: from the next shorter one's farthest to its own (3.1).

    >>> [(round(a), round(b)) for a, b in segments([2, 4], 602.0, ErrorThreshold(0.1, True))]
    [(0, 120), (120, 241)]
    """
    ranges = {}
    near_m = floor_m
    for baseline_m in sorted(set(baselines_m)):
        far_m = farthest(baseline_m, focal_px, threshold)
        ranges[baseline_m] = (near_m, far_m)
        near_m = far_m
    return [ranges[b] for b in baselines_m]


def trim(depth: np.ndarray, range_m: Tuple[float, float]) -> np.ndarray:
    """Depth inside a range, NaN elsewhere (step 7 of 3.2)."""
    return np.where((depth > range_m[0]) & (depth <= range_m[1]), depth, np.nan).astype(np.float32)


def fuse_trimmed(
    depths: Sequence[np.ndarray], ranges_m: Sequence[Tuple[float, float]]
) -> Tuple[np.ndarray, np.ndarray]:
    """Depths of one axis, each trimmed to its range, in one picture; and which one gave each pixel (-1 none).

    Where two trimmed depths claim a pixel, the longer baseline wins.
    """
    fused = np.full(depths[0].shape, np.nan, np.float32)
    source = np.full(depths[0].shape, -1, np.int16)
    for i in sorted(range(len(depths)), key=lambda i: ranges_m[i][1]):
        trimmed = trim(depths[i], ranges_m[i])
        known = np.isfinite(trimmed)
        fused[known], source[known] = trimmed[known], i
    return fused, source


def fuse_axes(horizontal: np.ndarray, vertical: np.ndarray) -> np.ndarray:
    """The four cases of 3.4: none, one, the other, or the average of both."""
    both = np.isfinite(horizontal) & np.isfinite(vertical)
    fused = np.where(np.isfinite(horizontal), horizontal, vertical)
    fused[both] = (horizontal[both] + vertical[both]) / 2.0
    return fused.astype(np.float32)
