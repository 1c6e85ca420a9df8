# SPDX-License-Identifier: Apache-2.0
"""docs/lab/benchmarks.md out of figures."""

from typing import Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from bench.colmap_poses import PosesFound
from bench.growth import Sample, exponent
from bench.measure import Figures, mean, ratio
from bench.scenes import SceneName
from fcsv_stereo.evaluating import depth_metrics

#: method, list, noise -> figures by scene, in the scenes' order
Results = Dict[Tuple[str, str, str], List[Figures]]
BASE = "thesis"
_HEAD = (
    "",
    "within 10 %",
    "covered",
    "wrong of answered",
    "median error",
    "median 200–400 m",
    "rotation error, median",
    "worst",
    "seconds",
    "of the processor",
)


def requirement_table(results: Results, lists: Sequence[str], noises: Sequence[str]) -> List[str]:
    """What is required of ``joint``, and the means of every method beside it."""
    methods = list(dict.fromkeys(key[0] for key in results))
    rows = [
        "| figure (mean of the scenes) | `joint` must | "
        + " | ".join(f"`{m}`" for m in methods)
        + " |"
    ]
    rows.append("|---|---|" + "---|" * len(methods))
    for title, must, key, value in _requirements(lists, noises):
        cells = []
        for method in methods:
            mine = results.get((method, *key))
            cells.append(value(mine, results.get((BASE, *key))) if mine else "–")
        rows.append(f"| {title} | {must} | " + " | ".join(cells) + " |")
    return rows


def _requirements(lists, noises):
    """title, bound, (list, noise), cell of a method's figures (and of the base's)."""
    h, hv, low, high = (*lists[:2], *noises[:2])

    def figure(name, text):
        return lambda mine, base: text(getattr(mean(mine), name))

    def field(index):
        return lambda mine, base: _field(mean(mine))[index]

    def times(mine, base):
        found = [ratio(mine, base, name) for name in ("seconds", "cpu_seconds")]
        return "–" if None in found else f"{found[0]:.2f} ({found[1]:.2f})"

    return [
        (f"within 10 %, {h}", "≥ 90 %", (h, low), figure("within_10", _percent)),
        (f"within 10 %, {hv}", "≥ 93 %", (hv, low), figure("within_10", _percent)),
        (f"median relative error, {h}", "≤ 0.8 %", (h, low), figure("median", _fine)),
        (f"median relative error 200–400 m, {h}", "≤ 1.5 %", (h, low), figure("median_far", _fine)),
        (
            f"wrong by more than 10 %, of the answered, {h}",
            "≤ 4 %",
            (h, low),
            figure("wrong_of_answered", _percent),
        ),
        (
            f"rotation error, median, {hv}",
            "≤ 0.01°",
            (hv, low),
            figure("rotation_median_deg", _degrees),
        ),
        (
            f"rotation error, worst, {hv}",
            "≤ 0.035°",
            (hv, low),
            figure("rotation_worst_deg", _degrees),
        ),
        (f"seconds after load over `{BASE}`'s (of the processor), {h}", "≤ 0.33", (h, low), times),
        (
            f"seconds after load over `{BASE}`'s (of the processor), {hv}",
            "≤ 0.33",
            (hv, low),
            times,
        ),
        (f"errors within 1 sigma, {h}", "60–75 %", (h, low), figure("within_1_sigma", _percent)),
        (f"errors within 2 sigma, {h}", "90–97 %", (h, low), figure("within_2_sigma", _percent)),
        (f"within 10 %, {h}, noise {high}", "≥ 85 %", (h, high), figure("within_10", _percent)),
        *(
            (f"{title}, {h}", "", (h, low), field(i))
            for i, title in enumerate(depth_metrics.TITLES)
        ),
    ]


def scene_tables(results: Results, scenes: Sequence[str]) -> List[str]:
    """A table for each list and noise: methods by scene, and their mean; of the first one the
    field's metrics, too."""
    lines: List[str] = []
    keys = list(dict.fromkeys(k[1:] for k in results))
    for key in keys:
        lines += [
            "",
            f"### {key[0]}, pose noise {key[1]}",
            "",
            *_by_scene(results, scenes, key, _HEAD, _cells),
        ]
        if key == keys[0]:
            head = ("", *depth_metrics.TITLES)
            lines += ["", "The field's metrics of the same maps:", ""]
            lines += _by_scene(results, scenes, key, head, lambda f: " | ".join(_field(f)))
    return lines


def _by_scene(
    results: Results, scenes: Sequence[str], key: Tuple[str, str], head, cells
) -> List[str]:
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for method in dict.fromkeys(k[0] for k in results):
        rows = results.get((method, *key), [])
        lines += [f"| `{method}`, {scene} | {cells(f)} |" for scene, f in zip(scenes, rows)]
        if len(rows) > 1:
            lines.append(f"| **`{method}`, mean** | {cells(mean(rows))} |")
    return lines


def pose_table(poses: Sequence[Tuple[SceneName, Union[PosesFound, str], PosesFound]]) -> List[str]:
    """COLMAP's poses beside those of our refinement, scene by scene and over all."""
    lines = [
        "| scene | by | placed | rotation error, median | worst | places, rms | seconds (of the processor) |",
        "|---|---|---|---|---|---|---|",
    ]
    by: Dict[str, List[PosesFound]] = {"COLMAP": [], "ours": []}
    for name, *found in poses:
        for who, f in zip(by, found):
            if isinstance(f, str):
                lines.append(f"| {name} | {who} | {f} | – | – | – | – |")
                continue
            by[who].append(f)
            lines.append(f"| {name} | {who} | {f.placed} of {f.pictures} | {_poses(f)} |")
    for who, rows in by.items():
        if len(rows) > 1:
            errors = [e for r in rows for e in r.errors_deg]
            means = [
                float(np.mean([getattr(r, n) for r in rows]))
                for n in ("places_rms_m", "seconds", "cpu_seconds")
            ]
            counts = (sum(r.placed for r in rows), sum(r.pictures for r in rows))
            both = PosesFound(errors, means[0], *counts, *means[1:])
            lines.append(f"| **all** | {who} | {counts[0]} of {counts[1]} | {_poses(both)} |")
    return [
        *lines,
        "",
        "COLMAP has the pictures and the focal length, no priors, and so no scale. Ours is refinement alone, with",
        "priors of the smaller noise, before joint matching aligns poses to the pixels (the first table has them after",
        "that). Rotations are relative to the reference. Places are compared after the similarity that fits best.",
    ]


def _poses(f: PosesFound) -> str:
    median, worst = (_degrees(float(pick(f.errors_deg))) for pick in (np.median, np.max))
    return f"{median} | {worst} | {100 * f.places_rms_m:.1f} cm | {f.seconds:.1f} ({f.cpu_seconds:.1f})"


def growth_table(samples: Sequence[Sample]) -> List[str]:
    """Exponents of every series (1 is linear) and where each ends."""
    lines = [
        "| method, against | processor time grows with exponent | memory | last measured |",
        "|---|---|---|---|",
    ]
    for method in dict.fromkeys(s.method for s in samples):
        for series, unit in (("size", "megapixels"), ("pairs", "pairs"), ("steps", "depth steps")):
            mine = [s for s in samples if s.series == series and s.method == method]
            if mine:
                last = f"{mine[-1].x:.3g} {unit}: {mine[-1].seconds:.1f} s ({mine[-1].cpu_seconds:.1f} of "
                last += f"the processor), {mine[-1].memory_mib:.0f} MiB"
                slopes = [_slope(exponent(mine, value)) for value in ("cpu_seconds", "memory_mib")]
                lines.append(f"| `{method}`, {series} | {slopes[0]} | {slopes[1]} | {last} |")
    return lines


def _cells(f: Figures) -> str:
    values = [
        _percent(f.within_10),
        _percent(f.covered),
        _percent(f.wrong_of_answered),
        _fine(f.median),
        _fine(f.median_far),
        _degrees(f.rotation_median_deg),
        _degrees(f.rotation_worst_deg),
        _seconds(f.seconds),
        _seconds(f.cpu_seconds),
    ]
    return " | ".join(values)


def _field(f: Figures) -> Sequence[str]:
    """The field's metrics, where there are any."""
    return ["–"] * len(depth_metrics.TITLES) if f.metrics is None else f.metrics.cells()


def _percent(x: float) -> str:
    return "–" if np.isnan(x) else f"{x:.1%}"


def _fine(x: float) -> str:
    return "–" if np.isnan(x) else f"{x:.2%}"


def _degrees(x: float) -> str:
    return "–" if np.isnan(x) else f"{x:.3f}°"


def _seconds(x: float) -> str:
    return "–" if np.isnan(x) else f"{x:.1f}"


def _slope(x: Optional[float]) -> str:
    return "–" if x is None else f"{x:.2f}"
