# SPDX-License-Identifier: Apache-2.0
"""A picture that shows where the board was seen, how well each corner fits, and the error of each
view."""

from pathlib import Path

import numpy as np

from fcsv_tracking.cameras.intrinsics import GRID, Intrinsics, occupied


def write_coverage(path: Path, found: Intrinsics, title: str) -> None:
    """PNG: corners coloured by their residual, cells without a corner shaded; error per view beside
    it."""
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(12, 5), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1])
    _corners(left, found)
    left.set_title(
        f"{title}: {len(found.views)} views, {found.coverage:.0%} of the cells, rms {found.rms_px:.2f} px"
    )
    names = [v.name for v in found.views]
    right.barh(names, found.errors_px, color="#118ab2")
    right.axvline(found.rms_px, color="#ef476f", label="rms of all")
    right.invert_yaxis()
    right.tick_params(axis="y", labelsize=8 if len(names) < 30 else 5)
    right.set_xlabel("error of the view [px]")
    right.legend(loc="lower right")
    figure.savefig(str(path))


def _corners(axes, found: Intrinsics) -> None:
    camera = found.camera
    cells = occupied(found.views, (camera.width, camera.height))
    extent = (-0.5, camera.width - 0.5, camera.height - 0.5, -0.5)
    axes.imshow(
        np.where(cells, np.nan, 1.0),
        extent=extent,
        cmap="Greys",
        vmin=0,
        vmax=4,
        interpolation="nearest",
    )
    pixels = np.concatenate([v.corners_px for v in found.views])
    misses = np.concatenate([np.linalg.norm(r, axis=1) for r in found.residuals_px])
    points = axes.scatter(
        *pixels.T, c=misses, s=8, cmap="viridis", vmin=0, vmax=max(3 * found.rms_px, 1e-3)
    )
    axes.figure.colorbar(points, ax=axes, label="distance from where it should be [px]", shrink=0.8)
    for k in range(1, GRID[0]):
        axes.axvline(k * camera.width / GRID[0] - 0.5, color="#bbbbbb", linewidth=0.6)
    for k in range(1, GRID[1]):
        axes.axhline(k * camera.height / GRID[1] - 0.5, color="#bbbbbb", linewidth=0.6)
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel="u [px]", ylabel="v [px]")
