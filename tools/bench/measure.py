# SPDX-License-Identifier: Apache-2.0
"""What a method makes of a scene, in figures."""

import time
from dataclasses import dataclass, fields, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from bench.scenes import Scene
from fcsv_geometry import transforms
from fcsv_stereo.errors import StereoError
from fcsv_stereo.evaluating.depth_metrics import DepthMetrics
from fcsv_stereo.evaluating.evaluation import band, evaluate
from fcsv_stereo.model import ImageEntry, MapInput, MapResult
from fcsv_stereo.pipeline import METHODS

MOST_M = 400.0


@dataclass(frozen=True)
class Figures:
    """Of one map, or the mean of several: pixels with truth up to 400 m; rotation errors in
    degrees.

    ``seconds`` by the clock on the wall, ``cpu_seconds`` of all threads: what a shared machine does
    not stretch. ``metrics``: those of the field; None where nothing is answered.
    """

    within_10: float
    covered: float
    wrong_of_answered: float
    median: float
    median_far: float
    within_1_sigma: float
    within_2_sigma: float
    rotation_median_deg: float
    rotation_worst_deg: float
    seconds: float
    cpu_seconds: float
    metrics: Optional[DepthMetrics] = None


def run(name: str, given: MapInput, options=None) -> Tuple[MapResult, float, float]:
    """The map (``options`` None: the method's own, every pixel answered), and the seconds after
    load: on the wall, and of the processor."""
    started, started_cpu = time.perf_counter(), time.process_time()
    result = METHODS[name].map(given, options or METHODS[name].complete)
    return result, time.perf_counter() - started, time.process_time() - started_cpu


def measure(name: str, given: MapInput, scene: Scene) -> Figures:
    """All figures of a method on a scene; a method that refuses scores nothing and is not
    hidden."""
    try:
        result, seconds, cpu_seconds = run(name, given)
    except StereoError as error:
        print(f"    {name} refused: {error}", flush=True)
        nan = float("nan")
        return Figures(0.0, 0.0, 0.0, nan, nan, nan, nan, nan, nan, nan, nan)
    return figures(result, scene, seconds, cpu_seconds)


def figures(result: MapResult, scene: Scene, seconds: float, cpu_seconds: float) -> Figures:
    """A map against a scene's truth."""
    e = evaluate(result, None, scene.true_depth, MOST_M)
    far = band(result.depth, scene.true_depth, (200.0, MOST_M)).median_relative_error
    errors = np.array(rotation_errors_deg(result.images, result.reference.name, scene.true_poses()))
    median = e.overall.median_relative_error
    return Figures(
        e.overall.within_10_percent,
        e.overall.coverage,
        e.overall.wrong_of_answered,
        np.nan if median is None else median,
        np.nan if far is None else far,
        e.within_1_sigma,
        e.within_2_sigma,
        float(np.median(errors)),
        float(errors.max()),
        seconds,
        cpu_seconds,
        e.metrics,
    )


def rotation_errors_deg(
    images: Sequence[ImageEntry], reference: str, true: Dict[str, np.ndarray]
) -> List[float]:
    """Of every picture's rotation relative to the reference's."""
    R_found = {i.name: i.T_home_cam for i in images}
    return relative_rotations_deg(R_found, reference, true)


def relative_rotations_deg(
    found: Dict[str, np.ndarray], reference: str, true: Dict[str, np.ndarray]
) -> List[float]:
    """Angles between found and true rotations relative to the reference (poses T_world_cam, any
    world), in degrees."""
    errors = []
    for name in found:
        if name != reference:
            T_found = transforms.invert(found[reference]) @ found[name]
            T_true = transforms.invert(true[reference]) @ true[name]
            errors.append(float(np.degrees(transforms.rotation_angle(T_true, T_found))))
    return errors


def mean(rows: Sequence[Figures]) -> Figures:
    """Over scenes; the worst rotation error stays the worst, and a scene without a figure is left
    out of its mean."""
    values = {"metrics": mean_metrics([r.metrics for r in rows if r.metrics is not None])}
    for f in fields(Figures):
        if f.name == "metrics":
            continue
        column = np.array([getattr(r, f.name) for r in rows], float)
        known = column[np.isfinite(column)]
        pick = np.max if f.name == "rotation_worst_deg" else np.mean
        values[f.name] = float(pick(known)) if known.size else float("nan")
    return Figures(**values)


def mean_metrics(rows: Sequence[DepthMetrics]) -> Optional[DepthMetrics]:
    """Over scenes; the worst group stays the worst of all scenes' groups."""
    if not rows:
        return None
    others = ("interval_coverage", "worst_group")
    names = [f.name for f in fields(DepthMetrics) if f.name not in others]
    shares = np.mean([[share for _, share in r.interval_coverage] for r in rows], axis=0)
    levels = [level for level, _ in rows[0].interval_coverage]
    worst = [r.worst_group for r in rows if r.worst_group is not None]
    return replace(
        rows[0],
        **{n: float(np.mean([getattr(r, n) for r in rows])) for n in names},
        interval_coverage=tuple(zip(levels, shares.tolist())),
        worst_group=min(worst, key=lambda g: g.coverage) if worst else None,
    )


def prior_errors_deg(given: MapInput, scene: Scene) -> List[float]:
    """Rotation errors before any refinement."""
    found = {scene.reference.name: scene.reference.T_home_cam}
    found.update({p.name: p.T_home_cam for c in given.configurations for p in c.others})
    return relative_rotations_deg(found, scene.reference.name, scene.true_poses())


def ratio(rows: Sequence[Figures], base: Optional[Sequence[Figures]], name: str) -> Optional[float]:
    """``name`` (seconds, cpu_seconds) over that of the base, scene by scene: the median of the
    ratios."""
    if not base or len(base) != len(rows):
        return None
    ratios = np.array([getattr(a, name) / getattr(b, name) for a, b in zip(rows, base)])
    return float(np.nanmedian(ratios)) if np.isfinite(ratios).any() else None
