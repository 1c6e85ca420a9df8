# SPDX-License-Identifier: Apache-2.0
"""Points of interest in the report: where the boxes lie (figure 6.8), and what was found in them
(figure 6.9)."""

from typing import List, Sequence

import matplotlib.pyplot as plt
import numpy as np

from fcsv_stereo.evaluating.poi import PoiResult
from fcsv_stereo.model import MapResult

_COLORS = ("#d62728", "#2ca02c", "#1f77b4", "#ff7f0e", "#9467bd", "#17becf")


def boxes(result: MapResult, points: Sequence[PoiResult]):
    """The reference picture with the boxes (figure 6.8)."""
    figure, axes = plt.subplots(figsize=(7.2, 5.4))
    axes.imshow(result.reference.image)
    for i, p in enumerate(points):
        corner = (p.poi.u_px - p.poi.width_px / 2.0, p.poi.v_px - p.poi.height_px / 2.0)
        axes.add_patch(
            plt.Rectangle(
                corner, p.poi.width_px, p.poi.height_px, fill=False, lw=2.0, edgecolor=color(i)
            )
        )
        axes.text(
            corner[0],
            corner[1] - 4,
            p.poi.name,
            color=color(i),
            fontsize=9,
            weight="bold",
            bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.5},
        )
    axes.set_title("points of interest", fontsize=10)
    axes.axis("off")
    return figure


def distributions(points: Sequence[PoiResult]):
    """Per box: depth by configuration against truth, and the share that matched (figure 6.9)."""
    names = [s.configuration for s in points[0].samples]
    figure, rows = plt.subplots(
        len(points),
        2,
        figsize=(12, 2.9 * len(points)),
        squeeze=False,
        gridspec_kw={"width_ratios": [1.6, 1.0]},
    )
    for i, (p, (left, right)) in enumerate(zip(points, rows)):
        _depths(left, p, color(i))
        right.bar(
            range(len(names)), [100.0 * s.match_rate for s in p.samples], color=color(i), alpha=0.8
        )
        right.set_ylim(0, 100)
        right.set_ylabel("matched (%)")
        for axes in (left, right):
            axes.set_xticks(range(len(names)))
            axes.set_xticklabels(names, rotation=20, ha="right", fontsize=8)
            axes.grid(alpha=0.3, axis="y")
    figure.tight_layout()
    return figure


def rows(points: Sequence[PoiResult]) -> List[Sequence[str]]:
    """Table: box, truth, configuration, matched, median depth, 5th to 95th percentile."""
    found = []
    for p in points:
        truth = "-" if p.truth_m is None else f"{p.truth_m:.1f} m"
        for s in p.samples:
            span = s.percentiles_m
            words = (
                ("-", "-")
                if span is None
                else (f"{span[2]:.1f} m", f"{span[0]:.1f} to {span[-1]:.1f} m")
            )
            found.append((p.poi.name, truth, s.configuration, f"{s.match_rate:.0%}", *words))
    return found


def color(index: int) -> str:
    """Gives the colour of a box, the same in every figure."""
    return _COLORS[index % len(_COLORS)]


def _depths(axes, p: PoiResult, box_color: str) -> None:
    for k, s in enumerate(p.samples):
        if len(s.depths_m):
            axes.boxplot(
                s.depths_m,
                positions=[k],
                widths=0.55,
                whis=(5, 95),
                showfliers=False,
                patch_artist=True,
                boxprops={"facecolor": box_color, "alpha": 0.6},
                medianprops={"color": "black"},
            )
    if p.truth_m is not None:
        axes.axhline(p.truth_m, color="black", ls="--", lw=1.2)
    middles = [np.median(s.depths_m) for s in p.samples if len(s.depths_m)] + (
        [p.truth_m] if p.truth_m else []
    )
    if middles:
        axes.set_ylim(0, 2.0 * max(middles))
    axes.set_xlim(-0.6, len(p.samples) - 0.4)
    axes.set_ylabel(f"{p.poi.name}: depth (m)")
