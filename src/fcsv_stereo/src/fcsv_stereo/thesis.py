# SPDX-License-Identifier: Apache-2.0
"""The thesis's method, faithfully: select, rectify, match, reproject, trim, fuse."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.depth import depth_from_disparity, points_from_depth, resample
from fcsv_stereo.equations import ErrorThreshold, depth_error
from fcsv_stereo.errors import MatchingError
from fcsv_stereo.fuse import fuse_axes, fuse_trimmed, segments
from fcsv_stereo.inputs import ConfigurationInput, MapInput, Picture
from fcsv_stereo.matchers import DisparityWindow, match, match_rate
from fcsv_stereo.rectify import RECTIFIERS, RectifiedPair
from fcsv_stereo.result import Cloud, ImageEntry, MapResult, PairResult, Reference

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ThesisOptions:
    """Choices of the method; ``rectifier`` None takes home for sessions and bouguet for photographs."""

    matcher: str = "quasi-dense"
    rectifier: Optional[str] = None
    window: DisparityWindow = field(default_factory=DisparityWindow)
    threshold: ErrorThreshold = field(default_factory=lambda: ErrorThreshold(0.1, True))
    bracket_s: float = 0.5  # 5.4: pictures of the other camera this near the middle are tried
    threads: int = 2


@dataclass
class _Matched:
    """One configuration after matching."""

    given: ConfigurationInput
    reference: Picture
    other: Picture
    pair: RectifiedPair
    disparity: np.ndarray
    points_home: np.ndarray
    candidates: List[Tuple[str, float]]


def map_thesis(given: MapInput, options: ThesisOptions, progress: Progress) -> MapResult:
    """The map of all configurations in the first reference picture. Raises MatchingError where nothing matched."""
    timing_s: Dict[str, float] = {"refine": 0.0}
    started = time.perf_counter()
    matched = _match_all(given, options, progress)
    timing_s["match"] = time.perf_counter() - started

    started = time.perf_counter()
    reference = matched[0].reference
    T_cam_home = transforms.invert(reference.T_home_cam)
    depths = [resample(m.points_home.reshape(-1, 3), T_cam_home, reference.camera) for m in matched]
    ranges_m = _ranges(given, matched, options)
    depth, sigma, source = _fuse(given, matched, depths, ranges_m)
    cloud = _cloud(reference, depth, sigma, source)
    timing_s["fuse"] = time.perf_counter() - started
    if not len(cloud):
        raise MatchingError("no pixel of any pair lies in its effective range; see --disparity and --error")
    pairs = [_pair_result(m, d, r) for m, d, r in zip(matched, depths, ranges_m)]
    view = Reference(
        reference.name, reference.stamp_s, reference.vehicle, reference.image, reference.camera, reference.T_home_cam
    )
    return MapResult("thesis", view, _images(matched), pairs, depth, sigma, cloud, timing_s, list(given.warnings))


def select(given: ConfigurationInput, bracket_s: float) -> Tuple[Picture, List[Picture]]:
    """5.4: the reference picture in the middle of the window, and the others within the bracket about it."""
    middle_s = (given.references[0].stamp_s + given.references[-1].stamp_s) / 2.0
    reference = min(given.references, key=lambda p: abs(p.stamp_s - middle_s))
    near = [p for p in given.others if abs(p.stamp_s - reference.stamp_s) <= bracket_s]
    return reference, near or [min(given.others, key=lambda p: abs(p.stamp_s - reference.stamp_s))]


def _match_all(given: MapInput, options: ThesisOptions, progress: Progress) -> List[_Matched]:
    rectifier = RECTIFIERS[options.rectifier or ("home" if given.kind == "session" else "bouguet")]
    offset_px = 0.0 if given.kind == "session" else None
    selected = [select(c, options.bracket_s) for c in given.configurations]
    total, done = sum(len(others) for _, others in selected), 0
    matched = []
    with ThreadPoolExecutor(options.threads) as pool:
        for configuration, (reference, others) in zip(given.configurations, selected):
            axis = configuration.configuration.axis

            def attempt(other, reference=reference, axis=axis):
                pair = rectifier(reference, other, axis)
                return pair, match(pair, options.matcher, options.window, offset_px)

            tried = []
            for outcome in pool.map(attempt, others):
                tried.append(outcome)
                done += 1
                progress(configuration.configuration.name, done, total)
            rates = [match_rate(d) for _, d in tried]
            best = int(np.argmax(rates))
            pair, disparity = tried[best]
            points = points_from_depth(depth_from_disparity(pair, disparity), pair.K_reference)
            points_home = points @ pair.R_home_rect.T + reference.T_home_cam[:3, 3]
            candidates = [(o.name, r) for o, r in zip(others, rates)]
            matched.append(
                _Matched(
                    configuration, reference, others[best], pair, disparity, points_home.astype(np.float32), candidates
                )
            )
    return matched


def _ranges(given: MapInput, matched: List[_Matched], options: ThesisOptions) -> List[Tuple[float, float]]:
    """Effective ranges by 3.1, per axis; photographs are independent pairs and each keeps its whole range."""
    ranges: List[Optional[Tuple[float, float]]] = [None] * len(matched)
    for axis in ("horizontal", "vertical"):
        index = [i for i, m in enumerate(matched) if m.given.configuration.axis == axis]
        if not index:
            continue
        focal_px = matched[index[0]].pair.K_reference[0, 0]
        baselines = [round(m.given.configuration.baseline_m, 3) for m in (matched[i] for i in index)]
        for i, range_m in zip(index, segments(baselines, focal_px, options.threshold)):
            ranges[i] = range_m if given.kind == "session" else (0.0, range_m[1])
    return ranges


def _fuse(given, matched, depths, ranges_m):
    """Fused depth, its sigma by 2.12 for one pixel, and which pair gave each pixel."""
    fused, sources, sigmas = {}, {}, {}
    for axis in ("horizontal", "vertical"):
        index = [i for i, m in enumerate(matched) if m.given.configuration.axis == axis]
        if not index:
            continue
        depth, source = fuse_trimmed([depths[i] for i in index], [ranges_m[i] for i in index])
        baselines = np.array([abs(matched[i].pair.baseline_m) for i in index] + [np.nan])
        focal_px = matched[index[0]].pair.K_reference[0, 0]
        fused[axis] = depth
        sources[axis] = np.where(source >= 0, np.array([*index, -1])[source], -1)
        sigmas[axis] = depth_error(depth, baselines[source], focal_px).astype(np.float32)
    if len(fused) == 1:
        axis = next(iter(fused))
        return fused[axis], sigmas[axis], sources[axis]
    h, v = fused["horizontal"], fused["vertical"]
    source = np.where(sources["horizontal"] >= 0, sources["horizontal"], sources["vertical"])
    both = np.isfinite(h) & np.isfinite(v)
    sigma = np.where(np.isfinite(h), sigmas["horizontal"], sigmas["vertical"])
    sigma[both] = np.hypot(sigmas["horizontal"], sigmas["vertical"])[both] / 2.0
    return fuse_axes(h, v), sigma.astype(np.float32), source


def _cloud(reference: Picture, depth: np.ndarray, sigma: np.ndarray, source: np.ndarray) -> Cloud:
    known = np.isfinite(depth)
    points_cam = points_from_depth(depth, reference.camera.K)[known]
    points_home = points_cam @ reference.T_home_cam[:3, :3].T + reference.T_home_cam[:3, 3]
    return Cloud(
        points_home.astype(np.float32), reference.image[known], sigma[known], source[known].astype(np.uint8)
    )  # fmt: skip


def _pair_result(m: _Matched, depth: np.ndarray, range_m: Tuple[float, float]) -> PairResult:
    return PairResult(
        m.given.configuration, m.reference.name, m.other.name, m.pair.reference, m.pair.other, m.disparity, depth,
        match_rate(m.disparity), range_m, m.candidates, m.reference.T_home_cam, m.other.T_home_cam,
    )  # fmt: skip


def _images(matched: List[_Matched]) -> List[ImageEntry]:
    pictures = {p.name: p for m in matched for p in (m.reference, m.other)}
    return [ImageEntry(p.name, p.vehicle, p.stamp_s, p.T_home_cam, p.T_home_cam) for p in pictures.values()]
