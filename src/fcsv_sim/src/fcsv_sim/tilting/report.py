# SPDX-License-Identifier: Apache-2.0
"""The trial's outcomes as a table, as curves, and as pictures."""

import io
from pathlib import Path
from typing import List, Sequence

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter
from PIL import Image

from fcsv_sim.tilting.trial import PairOutcome

HEAD = (
    "thing",
    "distance",
    "inward",
    "shown",
    "covered",
    "within 10 %",
    "without bars",
    "within 2.12",
    "median error",
    "2.12, 1 px",
    "poses",
    "by the drawing",
)
_COLOURS = {False: "#8a8f98", True: "#c2410c"}
_NAMES = {False: "parallel", True: "tilted"}
_NONE = "#20242b"


def table(outcomes: Sequence[PairOutcome]) -> List[str]:
    """Lines of Markdown, one row each; what stands as it did (parallel beyond a distance) has one
    row."""
    lines = [f"| {' | '.join(HEAD)} |", "|" + "---|" * len(HEAD)]
    for o in outcomes:
        if o.tilt and any(p.view is o.view and not p.tilt for p in outcomes):
            continue
        inward = f"{np.degrees(np.mean(o.angles)):.1f}°" if o.tilt else "parallel"
        ends = [f"{1e3 * v:.1f} mm" if np.isfinite(v) else "–" for v in (o.error_m, o.bound_m)]
        shares = [f"{v:.0%}" for v in (o.shown, o.covered, o.right, o.unbarred, o.bounded)]
        poses = "as read" if o.refused else "refined"
        drawn = f"{o.drawn:.0%}" if np.isfinite(o.drawn) else "–"
        lines.append(
            f"| {' | '.join([o.thing, f'{o.distance_m:g} m', inward, *shares, *ends, poses, drawn])} |"
        )
    return lines


def write_curves(outcomes: Sequence[PairOutcome], file: Path) -> None:
    """Share within 10 % and median error over the distance, beside equation 2.12; a column for each
    thing."""
    things = list(dict.fromkeys(o.thing for o in outcomes))
    figure, axes = plt.subplots(
        2,
        len(things),
        figsize=(4.0 * len(things), 6.0),
        squeeze=False,
        sharex=True,
        sharey="row",
        layout="constrained",
    )
    for column, thing in zip(axes.T, things):
        for tilt in (False, True):
            rows = [o for o in outcomes if o.thing == thing and o.tilt is tilt]
            z = [o.distance_m for o in rows]
            style = {"color": _COLOURS[tilt], "marker": "o", "ms": 4, "label": _NAMES[tilt]}
            column[0].plot(z, [100.0 * o.right for o in rows], **style)
            column[0].plot(
                z,
                [100.0 * o.unbarred for o in rows],
                color=_COLOURS[tilt],
                ls="--",
                lw=0.8,
                label=f"{_NAMES[tilt]}, without bars",
            )
            column[1].plot(z, [1e3 * o.error_m for o in rows], **style)
            column[1].plot(
                z,
                [1e3 * o.bound_m for o in rows],
                color=_COLOURS[tilt],
                ls=":",
                label=f"2.12 for 1 px, {_NAMES[tilt]}",
            )
        column[0].set(title=thing, xscale="log", ylim=(0, 102))
        column[1].set(yscale="log", xlabel="distance (m)")
        column[1].xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        column[1].set_xticks([0.3, 0.5, 1.0, 2.0, 5.0, 10.0])
        column[1].minorticks_off()
        for ax in column:
            ax.grid(alpha=0.3)
    axes[0][0].set_ylabel("of its pixels within 10 % (%)")
    axes[1][0].set_ylabel("median error (mm)")
    axes[0][0].legend(fontsize=8)
    axes[1][-1].legend(fontsize=7, loc="lower right")
    _save(figure, file)


def write_pictures(outcomes: Sequence[PairOutcome], distance_m: float, file: Path) -> None:
    """Writes pictures of every thing at one distance, parallel and tilted: the left picture, and
    depths of the thing alone."""
    chosen = [o for o in outcomes if o.distance_m == distance_m]
    things = list(dict.fromkeys(o.thing for o in chosen))
    figure, axes = plt.subplots(
        len(things), 4, figsize=(14.0, 2.75 * len(things)), squeeze=False, layout="constrained"
    )
    colours = plt.get_cmap("turbo_r").with_extremes(bad=_NONE)
    drawn = None
    for row, thing in zip(axes, things):
        for k, o in enumerate(
            sorted((o for o in chosen if o.thing == thing), key=lambda o: o.tilt)
        ):
            row[2 * k].imshow(o.view.image)
            row[2 * k].set_title(f"{thing}, {distance_m:g} m, {_NAMES[o.tilt]}", fontsize=9)
            drawn = row[2 * k + 1].imshow(
                np.where(o.view.thing, o.depth, np.nan),
                cmap=colours,
                vmin=0.6 * distance_m,
                vmax=1.5 * distance_m,
            )
            row[2 * k + 1].set_title(f"within 10 %: {o.right:.0%}", fontsize=9)
    for ax in axes.ravel():
        ax.axis("off")
    figure.colorbar(drawn, ax=axes, label="depth of the thing (m)", shrink=0.6, pad=0.01)
    _save(figure, file)


def _save(figure, file: Path) -> None:
    """Saves the figure with a palette of 128 colours: a quarter of the size, and no difference to
    the eye."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=72)
    plt.close(figure)
    Image.open(data).convert("RGB").quantize(128).save(file, optimize=True)
