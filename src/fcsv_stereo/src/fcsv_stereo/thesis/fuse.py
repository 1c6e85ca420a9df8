# SPDX-License-Identifier: Apache-2.0
"""Fusion of depth of several configurations in one view (thesis 3.2, 3.4 and 3.6)."""

from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import Axis


@dataclass(frozen=True)
class Layer:
    """Depth of one configuration in the map's reference picture (H,W float32, m, NaN where none),
    untrimmed.

    ``baseline_m`` is the nominal one, which ranges go by; ``measured_m`` that of the pair, which
    its error goes by.
    """

    axis: Axis
    baseline_m: float
    measured_m: float
    focal_px: float
    depth: np.ndarray


def segments(
    baselines_m: Sequence[float], focal_px: float, threshold: ErrorThreshold, floor_m: float = 0.0
) -> List[Tuple[float, float]]:
    """Effective range (m) of each baseline, in their order: from the next shorter one's farthest to
    its own (3.1).

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


def segments_by_hand(
    baselines_m: Sequence[float], ends_m: Sequence[float], axis: str, floor_m: float = 0.0
) -> List[Tuple[float, float]]:
    """The same with the far ends (m) that a person gave, one per baseline in growing order (6.6);
    an end that repeats the one before leaves that baseline out. Raises InputError where they do not
    fit.

    >>> segments_by_hand([4, 2], [30, 60], "horizontal")
    [(30.0, 60.0), (0.0, 30.0)]
    """
    ascending = sorted(set(baselines_m))
    names = ", ".join(f"{b:g}" for b in ascending)
    if len(ends_m) != len(ascending):
        raise InputError(
            f"{len(ends_m)} {axis} trim points for {len(ascending)} baselines ({names} m); give one for each"
        )
    edges = [floor_m, *map(float, ends_m)]
    if (
        not all(np.isfinite(edges))
        or any(b < a for a, b in zip(edges, edges[1:]))
        or edges[-1] <= floor_m
    ):
        raise InputError(
            f"{axis} trim points {' '.join(f'{e:g}' for e in ends_m)} m must be positive and not fall"
        )
    ranges = dict(zip(ascending, zip(edges, edges[1:])))
    return [ranges[b] for b in baselines_m]


def trim(depth: np.ndarray, range_m: Tuple[float, float]) -> np.ndarray:
    """Depth inside a range, NaN elsewhere (step 7 of 3.2)."""
    return np.where((depth > range_m[0]) & (depth <= range_m[1]), depth, np.nan).astype(np.float32)


def fuse_axes(horizontal: np.ndarray, vertical: np.ndarray) -> np.ndarray:
    """The four cases of 3.4: none, one, the other, or the average of both."""
    both = np.isfinite(horizontal) & np.isfinite(vertical)
    fused = np.where(np.isfinite(horizontal), horizontal, vertical)
    fused[both] = (horizontal[both] + vertical[both]) / 2.0
    return fused.astype(np.float32)


def effective_ranges(
    layers: Sequence[Layer],
    threshold: ErrorThreshold,
    trim_m: Mapping[str, Sequence[float]],
    across_axes: bool,
) -> List[Tuple[float, float]]:
    """Range (m) of each layer: by 3.1, or by hand where ``trim_m`` has its axis; ``across_axes``
    takes all as one."""
    ranges: List[Optional[Tuple[float, float]]] = [None] * len(layers)
    for name, index in _groups(layers, across_axes).items():
        baselines = [layers[i].baseline_m for i in index]
        if name in trim_m:
            found = segments_by_hand(baselines, trim_m[name], name)
        else:
            found = segments(baselines, layers[index[0]].focal_px, threshold)
        for i, range_m in zip(index, found):
            ranges[i] = range_m
    unused = set(trim_m) - set(_groups(layers, across_axes))
    if unused:
        raise InputError(
            f"{unused.pop()} trim points are given, but no such configuration was flown"
        )
    return ranges


def fuse_layers(
    layers: Sequence[Layer], ranges_m: Sequence[Tuple[float, float]], across_axes: bool
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, its sigma by 2.12 for one pixel, and the layer that gave each pixel (-1 none); all
    (H,W).

    Per axis the baselines are trimmed and laid over each other (3.2), then both axes fused (3.4).
    ``across_axes`` first fuses the axes of equal baselines (3.4), then lays all baselines over each
    other (3.6).
    """
    single = [_single(i, layer, r) for i, (layer, r) in enumerate(zip(layers, ranges_m))]
    if not across_axes:
        per_axis = [
            _overlay([single[i] for i in index]) for index in _groups(layers, False).values()
        ]
        return per_axis[0] if len(per_axis) == 1 else _average(*per_axis)
    by_range: Dict[Tuple[float, float], list] = {}
    for one, range_m in zip(single, ranges_m):
        by_range.setdefault(range_m, []).append(one)
    steps = []
    for range_m in sorted(by_range, key=lambda r: r[1]):
        fused, *rest = by_range[range_m]
        for one in rest:
            fused = _average(fused, one)
        steps.append(fused)
    return _overlay(steps)


def _groups(layers: Sequence[Layer], across_axes: bool) -> Dict[str, List[int]]:
    """Which layers share out the range among them; within a group in order of their range."""
    names = ["all"] * len(layers) if across_axes else [layer.axis for layer in layers]
    groups = {n: [i for i, m in enumerate(names) if m == n] for n in ("all", *Axis)}
    return {n: sorted(i, key=lambda k: layers[k].baseline_m) for n, i in groups.items() if i}


def _single(index: int, layer: Layer, range_m: Tuple[float, float]):
    depth = trim(layer.depth, range_m)
    sigma = depth_error(depth, layer.measured_m, layer.focal_px).astype(np.float32)
    return depth, sigma, np.where(np.isfinite(depth), index, -1)


def _overlay(steps):
    """Later ones over earlier ones: where two trimmed depths claim a pixel, the longer baseline
    wins."""
    depth, sigma, source = (a.copy() for a in steps[0])
    for d, s, i in steps[1:]:
        known = np.isfinite(d)
        depth[known], sigma[known], source[known] = d[known], s[known], i[known]
    return depth, sigma, source


def _average(h, v):
    """3.4, with the standard deviation of the average where both know."""
    both = np.isfinite(h[0]) & np.isfinite(v[0])
    sigma = np.where(np.isfinite(h[0]), h[1], v[1])
    sigma[both] = np.hypot(h[1], v[1])[both] / 2.0
    return fuse_axes(h[0], v[0]), sigma.astype(np.float32), np.where(h[2] >= 0, h[2], v[2])
