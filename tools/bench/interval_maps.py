# SPDX-License-Identifier: Apache-2.0
"""Depths with intervals by several methods on one rectified pair, in the field's metrics."""

import time
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Union

import numpy as np

from bench.rectified import RectifiedCase
from fcsv_stereo.errors import StereoError
from fcsv_stereo.evaluating import depth_metrics
from fcsv_stereo.evaluating.depth_metrics import ause, inlier_ratio, overconfident_share
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import MapResult
from fcsv_stereo.thesis import Thesis, ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

MOST_M, LEVEL = 400.0, 0.9
_WRONG = 0.1
_HEAD = (
    "pair",
    "by",
    "answered",
    "mean relative error",
    "within 3 %",
    "wrong by more than 10 %",
    "AUSE",
    "overconfident",
    "in its interval",
    "width, median",
    "of the depth",
    "where both answer: in its interval",
    "width, median",
    "seconds of the processor",
)


@dataclass(frozen=True)
class IntervalMap:
    """All (H,W): ``depth`` (m, NaN where none), whether the truth is ``inside`` the interval of
    90 %, and that interval's ``width_px`` in disparity. The last two are None where a method states
    no uncertainty. ``seconds`` are of the processor.
    """

    depth: np.ndarray
    inside: Optional[np.ndarray]
    width_px: Optional[np.ndarray]
    seconds: float

    @staticmethod
    def of_disparity(
        case: RectifiedCase,
        disparity: np.ndarray,
        low_px: np.ndarray,
        high_px: np.ndarray,
        seconds: float,
    ) -> "IntervalMap":
        """Of disparities and their bounds (px, NaN where there are none)."""
        shift = disparity + case.doffs_px
        with np.errstate(invalid="ignore", divide="ignore"):
            known = (shift > 0) & np.isfinite(low_px)
            depth = np.where(known, case.focal_baseline_px_m / shift, np.nan)
            true = case.disparity(case.true_depth)
            inside = (low_px <= true) & (true <= high_px)
            return IntervalMap(depth, inside, high_px - low_px, seconds)

    @staticmethod
    def of_sigma(case: RectifiedCase, result: MapResult, seconds: float) -> "IntervalMap":
        """Of a map: the interval is its depth +- 1.645 sigma."""
        half_m = depth_metrics.interval_sigmas(LEVEL) * result.sigma
        with np.errstate(invalid="ignore"):
            inside = np.abs(result.depth - case.true_depth) <= half_m
            width_px = 2.0 * half_m * case.focal_baseline_px_m / np.square(result.depth)
        return IntervalMap(result.depth, inside, width_px, seconds)


Answer = Union[IntervalMap, str]


def joint_on(case: RectifiedCase) -> Answer:
    """``joint`` with the pair's poses known, and only what it answers by itself."""
    started = time.process_time()
    try:
        result = Joint().map(case.given(), JointOptions())
    except StereoError as error:
        return f"refused: {error}"
    return IntervalMap.of_sigma(case, result, time.process_time() - started)


def sgbm_on(case: RectifiedCase) -> Answer:
    """OpenCV's SGBM, which states no uncertainty."""
    started = time.process_time()
    try:
        options = ThesisOptions(matcher="sgbm", window=DisparityWindow())
        result = Thesis().map(case.given(), options)
    except StereoError as error:
        return f"refused: {error}"
    return IntervalMap(result.depth, None, None, time.process_time() - started)


def interval_table(rows: Sequence["PairRow"]) -> List[str]:
    """A row for each pair and method, and a mean over the pairs of each method."""
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" * len(_HEAD) + "|"]
    lines += [f"| {r.pair} | {r.by} | {r.cells()} |" for r in rows]
    for by in dict.fromkeys(r.by for r in rows):
        mine = [r for r in rows if r.by == by]
        if len(mine) > 1:
            lines.append(f"| **mean** | {by} | {_mean(mine).cells()} |")
    return lines


@dataclass(frozen=True)
class PairRow:
    """Figures of a method on a pair, by name; absent where there is none. ``failed`` says why."""

    pair: str
    by: str
    figures: Dict[str, float]
    failed: str = ""

    def cells(self) -> str:
        """For the table."""
        if self.failed:
            return " | ".join([self.failed, *("–" for _ in _FORMATS[1:])])
        values = [self.figures.get(name, np.nan) for name, _ in _FORMATS]
        formats = [f for _, f in _FORMATS]
        return " | ".join("–" if np.isnan(v) else f.format(v) for v, f in zip(values, formats))


_FORMATS = (
    ("answered", "{:.1%}"),
    ("mean_relative_error", "{:.2%}"),
    ("within_3", "{:.1%}"),
    ("wrong", "{:.1%}"),
    ("ause", "{:.3f}"),
    ("overconfident", "{:.1%}"),
    ("inside", "{:.1%}"),
    ("width_px", "{:.2f} px"),
    ("width", "{:.1%}"),
    ("both_inside", "{:.1%}"),
    ("both_width_px", "{:.2f} px"),
    ("seconds", "{:.1f}"),
)


def pair_rows(case: RectifiedCase, answers: Dict[str, Answer]) -> List[PairRow]:
    """Of one pair, pixels with truth up to 400 m. "Both": those that all with intervals answer."""
    judged = np.isfinite(case.true_depth) & (case.true_depth <= MOST_M)
    maps = {by: a for by, a in answers.items() if isinstance(a, IntervalMap)}
    with_intervals = [m for m in maps.values() if m.inside is not None]
    both = np.logical_and.reduce([judged, *(np.isfinite(m.depth) for m in with_intervals)])
    return [
        PairRow(case.name, by, _figures(case, maps[by], judged, both))
        if by in maps
        else PairRow(case.name, by, {}, str(answer))
        for by, answer in answers.items()
    ]


def _figures(
    case: RectifiedCase, found: IntervalMap, judged: np.ndarray, both: np.ndarray
) -> Dict[str, float]:
    here = judged & np.isfinite(found.depth)
    depth, true = found.depth[here].astype(float), case.true_depth[here].astype(float)
    figures = {"answered": here.sum() / max(1, judged.sum()), "seconds": found.seconds}
    if not here.any():
        return figures
    error = np.abs(depth - true) / true
    figures["mean_relative_error"], figures["within_3"] = error.mean(), inlier_ratio(depth, true)
    figures["wrong"] = (error > _WRONG).mean()
    if found.inside is None or found.width_px is None:
        return figures
    relative = found.width_px[here] * depth / case.focal_baseline_px_m
    figures["ause"] = ause(error, relative)
    figures["overconfident"] = overconfident_share(error, relative)
    figures["width"] = np.median(relative)
    for prefix, part in (("", here), ("both_", both)):
        if part.any():
            figures[f"{prefix}inside"] = found.inside[part].mean()
            figures[f"{prefix}width_px"] = np.median(found.width_px[part])
    return figures


def _mean(rows: Sequence[PairRow]) -> PairRow:
    """Of each figure over the pairs that have it."""
    names = [name for name, _ in _FORMATS]
    values = {n: [r.figures[n] for r in rows if n in r.figures] for n in names}
    means = {n: float(np.mean(v)) for n, v in values.items() if v}
    return PairRow("**mean**", rows[0].by, means)
