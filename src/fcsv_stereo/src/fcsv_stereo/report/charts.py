# SPDX-License-Identifier: Apache-2.0
"""Charts of the report: time per step, ranges per baseline, pose corrections, sigma."""

from typing import Sequence

import matplotlib.pyplot as plt
import numpy as np

from fcsv_stereo.model import MapResult
from fcsv_stereo.report.evidence import PairEvidence, correction
from fcsv_stereo.report.figures import log_histogram, round_numbers

#: of a run, in their order
STEPS = ("load", "refine", "match", "fuse", "near", "write")


def timing(result: MapResult):
    """One bar, a colour a step."""
    figure, axes = plt.subplots(figsize=(12, 1.5))
    left = 0.0
    for i, name in enumerate(s for s in STEPS if result.timing_s.get(s)):
        seconds = result.timing_s[name]
        axes.barh(0, seconds, left=left, color=f"C{i}", label=f"{name} {seconds:.2f} s")
        left += seconds
    axes.set_yticks([])
    axes.set_xlabel("s")
    axes.legend(
        ncol=len(STEPS), fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False
    )
    return figure


def ranges(result: MapResult, evidence: Sequence[PairEvidence]):
    """Per baseline: the effective range of the planner (pale) and the depths that the map took from
    it (full)."""
    figure, axes = plt.subplots(figsize=(12, 0.9 + 0.45 * len(result.pairs)))
    top = max([e.carried_m[1] for e in evidence if e.carried_m] + [10.0])
    for i, (p, e) in enumerate(zip(result.pairs, evidence)):
        near, far = p.effective_range_m
        far = min(far, 1.1 * top)
        axes.barh(i, far - near, left=near, color=f"C{i % 10}", alpha=0.25, height=0.8)
        if e.carried_m:
            axes.barh(
                i,
                e.carried_m[1] - e.carried_m[0],
                left=e.carried_m[0],
                color=f"C{i % 10}",
                height=0.4,
            )
    axes.set_yticks(range(len(result.pairs)))
    axes.set_yticklabels([p.configuration.name for p in result.pairs], fontsize=9)
    axes.invert_yaxis()
    axes.set_xlim(0, 1.1 * top)
    axes.set_xlabel(
        "depth (m); pale: effective range, full: 5th to 95th percentile of what it gave"
    )
    axes.grid(alpha=0.3, axis="x")
    return figure


def corrections(result: MapResult):
    """Degrees and metres by picture."""
    images = [i for i in result.images if i.name != result.reference.name]
    found = np.array([correction(i) for i in images])
    figure, both = plt.subplots(1, 2, figsize=(12, 1.0 + 0.35 * len(images)), sharey=True)
    for axes, column, label in zip(both, (0, 1), ("turned by (deg)", "moved by (m)")):
        axes.barh(
            range(len(images)),
            found[:, column],
            color=["#3a6ea5" if i.refined else "#bbbbbb" for i in images],
        )
        axes.set_xlabel(label)
        axes.grid(alpha=0.3, axis="x")
    both[0].set_yticks(range(len(images)))
    both[0].set_yticklabels([i.name for i in images], fontsize=9)
    both[0].invert_yaxis()
    return figure


def sigma(result: MapResult):
    """How sure the map is: sigma in metres (logarithmic), and as a share of the distance."""
    known = np.isfinite(result.depth) & np.isfinite(result.sigma) & (result.sigma > 0)
    values, share = result.sigma[known], result.sigma[known] / result.depth[known] * 100.0
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 3.2))
    if values.size:
        log_histogram(left, values, max(values.min(), 1e-4), values.max() * 1.001, 70)
        right.hist(np.minimum(share, 20.0), bins=80, range=(0.0, 20.0), color="#3a6ea5")
        right.axvline(float(np.median(share)), color="#c0392b", ls="--", lw=1)
    left.set_xscale("log")
    if values.size:
        round_numbers(left.xaxis)
    left.set_xlabel("sigma (m)")
    right.set_xlabel("sigma (% of the distance; last bar: 20 and more; dashed: median)")
    for axes in (left, right):
        axes.set_ylabel("pixels")
    return figure
