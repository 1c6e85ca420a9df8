# SPDX-License-Identifier: Apache-2.0
"""One baseline at a time: range and row spacing (figures 3.1 to 3.3), error against equation 2.12
(3.4 to 3.6)."""

import matplotlib.pyplot as plt
import methods
import numpy as np
from page import Page, metres, panels, percent
from scenes import CAMERA, Scene, Shot, city

from fcsv_geometry import transforms
from fcsv_stereo.equations import depth_error
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

_WINDOW = DisparityWindow(11, 256)  # 3.1
_SPACING_AT_M = 100.0


def growing(page: Page) -> None:
    """3 to 8 m in steps of 1 m, exact poses, as in AirSim."""
    scene, baselines = city(), [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    rows, depths, pictures = [], {}, []
    for b in baselines:
        given, truth = scene.given([Shot("horizontal", b)])
        pictures.append(given.configurations[0].others[0].image)
        for name in methods.names():
            depth = methods.run(
                name, given, ThesisOptions(window=_WINDOW, threshold=methods.UNTRIMMED)
            ).depth
            depths[name, b] = depth
            near, far = band(depth, truth, (0.0, 40.0)), band(depth, truth, (200.0, 400.0))
            spacing_m = _spacing(depth)
            rows.append(
                (
                    f"{b:g} m",
                    name,
                    f"{np.nanpercentile(depth, 99.5):.0f} m",
                    f"{CAMERA.fx * b / 11:.0f} m",
                    "continuous" if spacing_m is None else metres(spacing_m),
                    metres(depth_error(_SPACING_AT_M, b, CAMERA.fx)),
                    percent(near.within_10_percent),
                    percent(far.within_10_percent),
                )
            )
    page.text(
        "## Growing baseline (figures 3.1 to 3.3)",
        "One pair at a time, nothing trimmed, disparities of 11 to 256 px, poses exact. As the baseline grows, "
        "the reach grows (11 px are f b / 11), the rows move closer together as 2.12 says for one pixel, and "
        "near pixels are lost. This is the effective range of 3.1.",
    )
    head = (
        "baseline",
        "method",
        "reach (99.5 %)",
        "f b / 11 px",
        "rows apart at 100 m",
        "2.12, 1 px",
        "0–40 m within 10 %",
        "200–400 m within 10 %",
    )
    page.table(head, rows)
    titles = [f"{b:g} m" for b in baselines]
    page.figure(
        panels(pictures, titles, 3), "3_1_pictures", "Pictures of the second camera, 3 to 8 m"
    )
    for name in methods.names():
        shown = [depths[name, b] for b in baselines]
        page.figure(panels(shown, titles, 3), f"3_2_depth_{name}", f"Depth by baseline, {name}")
        page.figure(
            _above(shown, titles),
            f"3_3_above_{name}",
            f"Points of each baseline from above, {name}",
        )


def house(page: Page) -> None:
    """A house at 15 to 30 m with 1, 2 and 3 m."""
    scene = Scene(2, transforms.from_xyz_yaw([30.0, 0.0, 6.0], np.radians(25.0)))
    columns, rows_px = slice(150, 500), slice(190, 400)
    rows, drawn = [], {}
    for b in (1.0, 2.0, 3.0):
        given, truth = scene.given([Shot("horizontal", b)])
        for name in methods.names():
            depth = methods.run(
                name, given, ThesisOptions(window=_WINDOW, threshold=methods.UNTRIMMED)
            ).depth
            true, found = truth[rows_px, columns], depth[rows_px, columns]
            on_house = (true > 12.0) & (true < 32.0)
            known = on_house & np.isfinite(found)
            error, bound = np.abs(found - true)[known], depth_error(true[known], b, CAMERA.fx)
            drawn[name, b] = true[known], error
            rows.append(
                (
                    f"{b:g} m",
                    name,
                    percent(known.sum() / on_house.sum()),
                    percent(float((error <= bound).mean())),
                    metres(float(np.median(error))),
                    metres(float(np.median(bound))),
                    f"{np.median(error / bound):.2f}",
                )
            )
    page.text(
        "## Error on a house against equation 2.12 (figures 3.4 to 3.6)",
        "Every pixel of the house, poses exact. The bound is 2.12 for one pixel.",
    )
    page.table(
        (
            "baseline",
            "method",
            "answered",
            "below the bound",
            "median error",
            "median bound",
            "median of error / bound",
        ),
        rows,
    )
    page.figure(
        _scatter(drawn), "3_6_error", "Error of each point over its distance; red: equation 2.12"
    )


def _spacing(depth: np.ndarray):
    """Distance (m) between the rows of points near 100 m; None where depths do not come in rows."""
    z = depth[(depth > 0.88 * _SPACING_AT_M) & (depth < 1.12 * _SPACING_AT_M)]
    values, counts = np.unique(np.round(z, 2), return_counts=True)
    rows = values[counts > 0.02 * len(z)]
    if len(rows) < 2 or counts[counts > 0.02 * len(z)].sum() < 0.5 * len(z):
        return None
    return float(np.median(np.diff(rows)))


def _above(depths, titles):
    figure, axes = plt.subplots(1, len(depths), figsize=(2.5 * len(depths), 4.6), sharey=True)
    u = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    for ax, depth, title in zip(axes, depths, titles):
        z = depth[::2, ::2]
        x = np.broadcast_to(u[::2], z.shape) * z
        ax.scatter(x, z, s=0.3, c="#1f4e79", linewidths=0)
        ax.set(xlim=(-130, 130), ylim=(0, 450), title=title, xlabel="to the right (m)")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("ahead (m)")
    figure.tight_layout()
    return figure


def _scatter(drawn):
    names, baselines = sorted({n for n, _ in drawn}, reverse=True), sorted({b for _, b in drawn})
    figure, axes = plt.subplots(
        len(baselines),
        len(names),
        figsize=(5.5 * len(names), 2.4 * len(baselines)),
        squeeze=False,
        sharex=True,
    )
    for row, b in zip(axes, baselines):
        for ax, name in zip(row, names):
            true, error = drawn[name, b]
            z = np.linspace(12, 32, 50)
            ax.scatter(true[::3], error[::3], s=0.6, linewidths=0)
            ax.plot(z, depth_error(z, b, CAMERA.fx), "r--")
            ax.set_ylim(0, 2.2 * depth_error(32.0, b, CAMERA.fx))
            ax.set_title(f"{name}, {b:g} m", fontsize=9)
            ax.set_ylabel("error (m)")
    for ax in axes[-1]:
        ax.set_xlabel("true distance (m)")
    figure.tight_layout()
    return figure
