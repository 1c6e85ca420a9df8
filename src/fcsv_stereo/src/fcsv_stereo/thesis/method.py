# SPDX-License-Identifier: Apache-2.0
"""The thesis's method, faithfully: select, rectify, match, reproject, trim, fuse."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.depth import cloud_of, depth_from_disparity, points_from_depth, resample
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import InputError, MatchingError
from fcsv_stereo.model import (
    AXES,
    ConfigurationInput,
    ImageEntry,
    InputKind,
    MapInput,
    MapResult,
    Method,
    PairResult,
    Picture,
    Progress,
    Reference,
    silent,
)
from fcsv_stereo.rectify import RECTIFIERS, Rectification, RectifiedPair
from fcsv_stereo.thesis.fuse import Layer, effective_ranges, fuse_layers
from fcsv_stereo.thesis.matchers import DisparityWindow, match, match_rate
from fcsv_stereo.thesis.selection import SelectionOptions, select

_LEAST_SHARE = 0.002  # of the picture: SGBM and Quasi-Dense match as much in pictures of nothing


@dataclass(frozen=True)
class ThesisOptions:
    """Choices of the method; ``rectifier`` (or its word) None takes home for sessions and bouguet
    for photographs.

    ``trim_m`` holds trim points (m) by hand, per axis (6.6). ``across_axes`` divides the range
    among all baselines, whatever their axis, as for several configurations at once (3.6, figure
    3.15); otherwise each axis covers it.
    """

    matcher: str = "quasi-dense"
    rectifier: Optional[Rectification] = None
    window: DisparityWindow = field(default_factory=DisparityWindow)
    threshold: ErrorThreshold = field(default_factory=lambda: ErrorThreshold(0.1, True))
    selection: SelectionOptions = field(default_factory=SelectionOptions)
    trim_m: Mapping[str, Sequence[float]] = field(default_factory=dict)
    across_axes: bool = False
    threads: int = 2

    def __post_init__(self):
        if self.rectifier is not None:
            object.__setattr__(self, "rectifier", Rectification(self.rectifier))
        unknown = set(self.trim_m) - {*AXES, "all"}
        if unknown or ("all" in self.trim_m) != (self.across_axes and bool(self.trim_m)):
            raise InputError(
                "trim points by hand are given per axis (--trim-horizontal, --trim-vertical), or for all baselines "
                "together with --across-axes (--trim-all)"
            )


class Thesis(Method):
    """Pair by pair, as the thesis did it."""

    name = "thesis"
    options = ThesisOptions

    def map(
        self, given: MapInput, options: Optional[ThesisOptions] = None, progress: Progress = silent
    ) -> MapResult:
        """See map_thesis."""
        return map_thesis(given, options or ThesisOptions(), progress)

    @property
    def quick(self) -> ThesisOptions:
        """Block matching."""
        return ThesisOptions(matcher="bm")

    def with_depth_steps(self, options: ThesisOptions, steps: int) -> ThesisOptions:
        """Disparities; Quasi-Dense, the default, grows from seeds and searches no window: SGBM
        does."""
        least_px = options.window.least_px
        return replace(options, window=DisparityWindow(least_px, least_px + steps), matcher="sgbm")


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
    """The map of all configurations in the first reference picture. Raises MatchingError where
    nothing matched."""
    timing_s: Dict[str, float] = {"refine": 0.0}
    started = time.perf_counter()
    warnings = list(given.warnings)
    matched = _match_all(given, options, progress, warnings)
    timing_s["match"] = time.perf_counter() - started

    started = time.perf_counter()
    reference = matched[0].reference
    depths = [
        resample(m.points_home.reshape(-1, 3), reference.T_home_cam, reference.camera)
        for m in matched
    ]
    layers = [_layer(m, d) for m, d in zip(matched, depths)]
    ranges_m = effective_ranges(layers, options.threshold, options.trim_m, options.across_axes)
    if given.kind is not InputKind.SESSION:  # independent pairs: each keeps what is near
        ranges_m = [(0.0, far_m) for _, far_m in ranges_m]
    depth, sigma, source = fuse_layers(layers, ranges_m, options.across_axes)
    if reference.blank is not None:
        depth[reference.blank], sigma[reference.blank] = np.nan, np.nan
    cloud = cloud_of(reference, depth, sigma, source)
    timing_s["fuse"] = time.perf_counter() - started
    if len(cloud) < _LEAST_SHARE * depth.size:
        raise MatchingError(
            f"{len(cloud)} of {depth.size} pixels have a match in the effective range of their pair, and so few may be "
            "chance: too little texture, only sky, or see --disparity and --error"
        )
    pairs = [_pair_result(m, d, r) for m, d, r in zip(matched, depths, ranges_m)]
    view = Reference.of(reference)
    return MapResult(
        "thesis", view, _images(matched), pairs, depth, sigma, cloud, timing_s, warnings
    )


def _match_all(
    given: MapInput, options: ThesisOptions, progress: Progress, warnings: List[str]
) -> List[_Matched]:
    """Every configuration matched; what cannot be rectified is left out and named in
    ``warnings``."""
    session = given.kind is InputKind.SESSION
    rectifier = RECTIFIERS[
        options.rectifier or (Rectification.HOME if session else Rectification.BOUGUET)
    ]
    offset_px = 0.0 if session else None
    selected = [select(c, options.selection) for c in given.configurations]
    total, done = sum(len(others) for _, others in selected), 0
    matched = []
    with ThreadPoolExecutor(options.threads) as pool:
        for configuration, (reference, others) in zip(given.configurations, selected):
            what = configuration.configuration

            def attempt(other, reference=reference, what=what):
                try:
                    _require_one_size(reference, other)
                    pair = rectifier(reference, other, what.axis, what.tilt_rad)
                except MatchingError as error:
                    return other, error, None
                return other, pair, match(pair, options.matcher, options.window, offset_px)

            tried = []
            for other, pair, disparity in pool.map(attempt, others):
                done += 1
                progress(f"matching {what.name}", done / total)
                if disparity is None:
                    warnings.append(f"left out: {pair}")
                else:
                    tried.append((other, pair, disparity))
            if tried:
                matched.append(_best(configuration, reference, tried))
    if not matched:
        raise MatchingError(f"no pair can be rectified: {'; '.join(warnings)}")
    return matched


def _require_one_size(reference: Picture, other: Picture) -> None:
    if reference.image.shape != other.image.shape:
        sizes = [f"{p.name} is {p.camera.width}x{p.camera.height}" for p in (reference, other)]
        raise MatchingError(
            f"{', '.join(sizes)}: these matchers need pictures of one size (--method joint does not)"
        )


def _best(configuration: ConfigurationInput, reference: Picture, tried) -> _Matched:
    """The pair with the best match rate (5.4), and its points in home."""
    rates = [match_rate(disparity) for _, _, disparity in tried]
    other, pair, disparity = tried[int(np.argmax(rates))]
    points = points_from_depth(depth_from_disparity(pair, disparity), pair.K_reference)
    points_home = (points @ pair.R_home_rect.T + reference.T_home_cam[:3, 3]).astype(np.float32)
    candidates = [(o.name, r) for (o, _, _), r in zip(tried, rates)]
    return _Matched(configuration, reference, other, pair, disparity, points_home, candidates)


def _layer(m: _Matched, depth: np.ndarray) -> Layer:
    what = m.given.configuration
    i = m.pair.axis_index
    return Layer(
        what.axis,
        round(what.baseline_m, 3),
        abs(m.pair.baseline_m),
        m.pair.K_reference[i, i],
        depth,
    )


def _pair_result(m: _Matched, depth: np.ndarray, range_m: Tuple[float, float]) -> PairResult:
    return PairResult(
        m.given.configuration,
        m.reference.name,
        m.other.name,
        m.pair.reference,
        m.pair.other,
        m.disparity,
        depth,
        match_rate(m.disparity),
        range_m,
        m.candidates,
        m.reference.T_home_cam,
        m.other.T_home_cam,
        m.other.camera,
    )


def _images(matched: List[_Matched]) -> List[ImageEntry]:
    pictures = {p.name: p for m in matched for p in (m.reference, m.other)}
    return [
        ImageEntry(p.name, p.vehicle, p.stamp_s, p.T_home_cam, p.T_home_cam)
        for p in pictures.values()
    ]
