# SPDX-License-Identifier: Apache-2.0
"""Whether a map knows what it does not know: hard cases and real photographs, beside SGBM with
exact poses."""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from bench.hard_cases import EXACT, Case, cases, foreign
from bench.photographs import measure_fountain, motorcycle
from bench.scenes import HORIZONTAL, NOISES, SceneName, shoot
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import RIG
from fcsv_stereo.model.kinds import WORDS, masks, supported
from fcsv_stereo.refinement import RefineOptions
from fcsv_stereo.thesis import Thesis, ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

_PLACES = (("street", 11), ("village", 12), ("field", 13))
_DRAWS = 20
_SURE, _WRONG = 0.1, 0.1
_MOST_M = 400.0
# as ``--rig`` makes them
RIG_OPTIONS = JointOptions(prior=RIG, refinement=RefineOptions(calibrated=True))


@dataclass(frozen=True)
class Row:
    """Of one map: shares of the picture, or of what is named."""

    case: str
    place: str
    told: float  # of the pixels with truth: what some pair supports
    wrong: float  # of these
    wrong_agreed: float  # of the pixels that are called agreed
    sky_sure: float  # of the sky: answered with sigma below a tenth
    within: Tuple[float, float]  # 1 and 2 sigma, of what is told
    sgbm: Tuple[float, float]  # answered, wrong of the answered


def measure_real() -> List[str]:
    """The page's lines."""
    rows, by_kind = [], {}
    for k, (world, seed) in enumerate(_PLACES):
        place, elsewhere = SceneName(world, seed), SceneName(*_PLACES[k - 1])
        for case in cases(place, elsewhere):
            rows.append(measured(case, str(place), by_kind))
            print(f"    {rows[-1]}", flush=True)
    pair = motorcycle()
    if pair is not None:
        for place, options in (("priors of photographs", None), ("--rig", RIG_OPTIONS)):
            rows.append(measured(pair, place, by_kind, options))
            print(f"    {rows[-1]}", flush=True)
    lines = [*table(rows), "", *_kind_table(by_kind), "", *measure_fountain()]
    print("\n".join(lines), flush=True)
    return [*lines, "", _refused()]


def measure_answered(scenes: Sequence[SceneName]) -> List[str]:
    """The page's lines: what a map holds without ``--complete``, on ordinary scenes, four
    horizontal pairs each."""
    rows, by_kind = [], {}
    for name in scenes:
        scene = shoot(name, HORIZONTAL)
        given, exact = scene.given(HORIZONTAL, NOISES[0]), scene.given(HORIZONTAL, EXACT)
        rows.append(measured(Case("as it is", given, scene.true_depth, exact), str(name), by_kind))
        print(f"    {rows[-1]}", flush=True)
    return [*table([*rows, _mean(rows)]), "", *_kind_table(by_kind)]


def _mean(rows: Sequence[Row]) -> Row:
    """Of each figure over the maps that have it."""

    def mean(name: str):
        values = np.array([getattr(r, name) for r in rows])
        known = values[np.isfinite(values).reshape(len(values), -1).all(1)]
        return known.mean(0) if len(known) else np.full(values.shape[1:], np.nan)

    names = ("told", "wrong", "wrong_agreed", "sky_sure", "within", "sgbm")
    return Row("**mean**", f"{len(rows)} maps", *map(mean, names))


def measured(
    case: Case, place: str, by_kind: Dict[str, list], options: Optional[JointOptions] = None
) -> Row:
    """A case's map, held against its truth, into a row; its pixels by kind into ``by_kind``."""
    nan = float("nan")
    try:
        whole = Joint().map(case.given, replace(options or JointOptions(), complete=True))
    except StereoError as error:
        print(f"    {case.name}, {place}: refused: {error}", flush=True)
        return Row(case.name, place, 0.0, nan, nan, nan, (nan, nan), _sgbm(case))
    true, sky = case.true_depth, np.isnan(case.true_depth)
    judged = np.isfinite(true) & (true <= _MOST_M)
    told = supported(whole.kind) & np.isfinite(whole.depth)
    off, true = np.abs(whole.depth - true), np.where(judged, true, 1.0)
    for name, mask in masks(whole.kind).items():
        here = mask & judged & np.isfinite(whole.depth)
        by_kind.setdefault(name, []).append(
            (mask.mean(), (off / true)[here], (off / whole.sigma)[here])
        )
    here = told & judged
    agreed = masks(whole.kind)["agreed"] & here
    wrong = tuple(
        float((off[part] > _WRONG * true[part]).mean()) if part.any() else nan
        for part in (here, agreed)
    )
    sure = told & (whole.sigma < _SURE * whole.depth)
    within = tuple(float((off[here] <= k * whole.sigma[here]).mean()) for k in (1.0, 2.0))
    return Row(
        case.name,
        place,
        float(here.sum() / judged.sum()),
        *wrong,
        float(sure[sky].mean()) if sky.any() else nan,
        within,
        _sgbm(case),
    )


def _sgbm(case: Case) -> Tuple[float, float]:
    """OpenCV's SGBM on the widest pair with exact poses: answered and wrong of it."""
    given = replace(case.exact, configurations=case.exact.configurations[-1:])
    try:
        result = Thesis().map(given, ThesisOptions(matcher="sgbm", window=DisparityWindow()))
    except StereoError:
        return 0.0, float("nan")
    judged = np.isfinite(case.true_depth) & (case.true_depth <= _MOST_M)
    here = judged & np.isfinite(result.depth)
    wrong = np.abs(result.depth[here] / case.true_depth[here] - 1.0) > _WRONG
    return float(here.sum() / judged.sum()), float(wrong.mean()) if here.any() else float("nan")


def _refused() -> str:
    """How many draws of pictures of two places are refused."""
    refused, told = 0, []
    for k in range(_DRAWS):
        worlds = ("street", "village", "field", "plain")
        given = foreign(SceneName(worlds[k % 4], 100 + k), SceneName(worlds[(k + 1) % 4], 200 + k))
        try:
            result = Joint().map(given)
            told.append(f"draw {k}: {result.coverage:.1%} covered")
        except StereoError:
            refused += 1
        print(f"    two places: {refused} of {k + 1} refused", flush=True)
    return f"Pictures of two different places, refused: {refused} of {_DRAWS}. " + "; ".join(told)


def table(rows: List[Row]) -> List[str]:
    """Markdown, a line each."""
    lines = [
        "| case | place | answered | wrong of it | of what agrees | sky, surely | within 1σ | 2σ "
        "| SGBM answered | wrong of it |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        shares = (r.told, r.wrong, r.wrong_agreed, r.sky_sure, *r.within, *r.sgbm)
        told = " | ".join("–" if np.isnan(s) else f"{s:.1%}" for s in shares)
        lines.append(f"| {r.case} | {r.place} | {told} |")
    return lines


def _kind_table(by_kind: Dict[str, list]) -> List[str]:
    lines = [
        "| kind | of the pictures | wrong by more than 10 % | within 1σ | within 2σ |",
        "|---|---|---|---|---|",
    ]
    for name, parts in by_kind.items():
        share = np.mean([p[0] for p in parts])
        off, sigmas = (np.concatenate([p[i] for p in parts]) for i in (1, 2))
        if not off.size:
            lines.append(f"| {WORDS[name]} | {share:.1%} | – | – | – |")
            continue
        told = " | ".join(
            f"{s:.1%}" for s in ((off > _WRONG).mean(), (sigmas <= 1).mean(), (sigmas <= 2).mean())
        )
        lines.append(f"| {WORDS[name]} | {share:.1%} | {told} |")
    return lines
