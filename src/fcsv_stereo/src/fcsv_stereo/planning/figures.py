# SPDX-License-Identifier: Apache-2.0
"""A plan in pictures: error over distance (figure 2.3) and the segments of the baselines (figure
3.7)."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from fcsv_stereo.equations import depth_error
from fcsv_stereo.planning.plan import Plan, along


def error_curves(plan: Plan):
    """Equation 2.12 of every baseline, and the accepted error; a matplotlib figure."""
    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    z, accepted = _threshold(plan)
    for b in _first_axis(plan):
        error = _error(plan, b, z)
        axes.plot(z, error, label=f"{b.baseline_m:.4g} m")
    axes.plot(z, accepted, "k--", lw=1.0, label="accepted")
    _finish(axes, plan, accepted)
    axes.set_title("error of depth (2.12)", fontsize=10)
    return figure


def segments(plan: Plan):
    """Each baseline's error over its own range, bold, and the trim points; a matplotlib figure."""
    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    z, accepted = _threshold(plan)
    for i, b in enumerate(_first_axis(plan)):
        color = plt.get_cmap("tab10")(i % 10)
        inside = np.linspace(b.range_m[0], b.range_m[1], 100)
        axes.plot(z, _error(plan, b, z), color=color, lw=0.7, alpha=0.6)
        axes.plot(
            inside,
            _error(plan, b, inside),
            color=color,
            lw=3.0,
            label=f"$b_{i + 1}$ = {b.baseline_m:.4g} m",
        )
        axes.axvspan(*b.range_m, color=color, alpha=0.10)
        axes.axvline(b.range_m[1], color=color, lw=0.8, ls=":")
        words = f"$s_{i + 1}$\n{b.range_m[0]:.0f} to {b.range_m[1]:.0f} m"
        axes.text(
            np.mean(b.range_m),
            0.6,
            words,
            transform=axes.get_xaxis_transform(),
            ha="center",
            fontsize=8,
        )
    axes.plot(z, accepted, "k--", lw=1.0, label="accepted")
    _finish(axes, plan, accepted)
    axes.set_title("effective range of each baseline", fontsize=10)
    return figure


def _first_axis(plan: Plan):
    return [b for b in plan.baselines if b.axis == plan.request.axes[0]]


def _error(plan: Plan, b, z):
    focal_px, _ = along(plan.request.camera, b.axis)
    return depth_error(z, b.baseline_m, focal_px, plan.request.disparity_error_px)


def _threshold(plan: Plan):
    request = plan.request
    z = np.linspace(0.0, request.range_m * 1.1, 400)
    accepted = request.threshold.value * (z if request.threshold.relative else np.ones_like(z))
    return z, accepted


def _finish(axes, plan: Plan, accepted) -> None:
    axes.axvline(plan.request.range_m, color="#888888", lw=0.8)
    axes.set_xlim(0, plan.request.range_m * 1.1)
    axes.set_ylim(0, 2.0 * float(np.max(accepted)))
    axes.set_xlabel("distance (m)")
    axes.set_ylabel("error of depth (m)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left")
