# SPDX-License-Identifier: Apache-2.0
"""Figures of a map, each a matplotlib figure."""

from typing import Callable, Tuple

import matplotlib

matplotlib.use("Agg")

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from fcsv_geometry import transforms
from fcsv_stereo.evaluating.evaluation import Evaluation
from fcsv_stereo.model import Axis, MapResult, Pair
from fcsv_stereo.model.kinds import WORDS, masks
from fcsv_stereo.near import NEAR_BASELINE

DEPTH_MAP = "turbo_r"
_NONE = "#20242b"
_MOST_POINTS = 150000  # of a cloud that are drawn
_DRAWN_PX = 1000  # longer side of what is drawn; figures are narrower
#: Of a logarithmic axis: below the first its numbers are evenly spaced; above the others fewer of
#: them are written.
_FEW_DECADES, _MANY_DECADES, _MOST_DECADES = 0.6, 2.2, 3.5
_MOST_RINGS = 8  # about the origin of a map from above
_AHEAD = float(np.cos(np.radians(30.0)))
_KIND_COLOURS = {
    "agreed": "#009e73",
    "one pair": "#a8ddb5",
    "hidden": "#d55e00",
    "outside": "#e69f00",
    "blank": "#cc79a7",
    "sky": "#56b4e9",
    "moved": "#f0e442",
    "near": "#0072b2",
    "nothing": _NONE,
}


def drawn_picture(image: np.ndarray) -> np.ndarray:
    """A picture made smaller to what a figure shows of it: matplotlib takes long for large ones."""
    scale = _DRAWN_PX / max(image.shape[:2])
    return (
        cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        if scale < 1.0
        else image
    )


def drawn_values(image: np.ndarray) -> np.ndarray:
    """The same of an HxW image whose values must not be mixed."""
    step = max(1, round(max(image.shape) / _DRAWN_PX))
    return image[::step, ::step]


def picture(image: np.ndarray, title: str):
    """A photograph."""
    figure, axes = plt.subplots(figsize=(7.2, 5.4))
    axes.imshow(drawn_picture(image))
    axes.set_title(title, fontsize=10)
    axes.axis("off")
    return figure


def pair(p: Pair):
    """Both rectified pictures with a few corresponding lines, and the disparity beside them."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.0))
    for ax, image, name in zip(
        axes, (p.reference_rectified, p.other_rectified), (p.reference_name, p.other_name)
    ):
        image = drawn_picture(image)
        ax.imshow(image)
        ax.set_title(name, fontsize=9)
        _lines(ax, image.shape, p.configuration.axis)
        ax.axis("off")
    shown = np.abs(p.disparity)
    known = shown[np.isfinite(shown)]
    top = float(np.percentile(known, 99)) if known.size else 1.0
    drawn = axes[2].imshow(drawn_values(shown), cmap=_with_none("turbo"), vmin=0, vmax=top)
    axes[2].set_title(f"disparity, {p.match_rate:.0%} matched", fontsize=9)
    axes[2].axis("off")
    figure.colorbar(drawn, ax=axes[2], label="px", shrink=0.85)
    figure.tight_layout()
    return figure


def depth_colours(image: np.ndarray) -> Tuple[Callable[[np.ndarray], np.ndarray], float, float]:
    """Colours (RGBA, 0 to 1) of depth (HxW m) on a logarithmic scale, and the ends of the scale,
    m."""
    norm = _log_norm(image)
    colormap = _with_none(DEPTH_MAP)
    return (lambda values: colormap(norm(np.ma.masked_invalid(values)))), norm.vmin, norm.vmax


def _log_norm(image: np.ndarray) -> LogNorm:
    known = image[np.isfinite(image) & (image > 0)]
    low, high = np.percentile(known, [1, 99]) if known.size else (1.0, 10.0)
    return LogNorm(max(low, 1e-3), max(high, low * 1.01))


def depth(image: np.ndarray, title: str, label: str = "m"):
    """Depth or sigma on a logarithmic scale of colour."""
    figure, axes = plt.subplots(figsize=(7.2, 4.9))
    norm = _log_norm(image)
    drawn = axes.imshow(drawn_values(image), cmap=_with_none(DEPTH_MAP), norm=norm)
    axes.set_title(title, fontsize=10)
    axes.axis("off")
    bar = figure.colorbar(drawn, ax=axes, label=label, shrink=0.85)
    round_numbers(bar.ax.yaxis)
    return figure


def kinds(kind: np.ndarray):
    """Why each pixel has its depth, or none, in colours that colour-blind people tell apart (Okabe
    and Ito 2008)."""
    found = {name: mask for name, mask in masks(drawn_values(kind)).items() if mask.any()}
    kind = drawn_values(kind)
    image = np.zeros((*kind.shape, 3))
    figure, axes = plt.subplots(figsize=(7.2, 5.4))
    for name, mask in found.items():
        image[mask] = matplotlib.colors.to_rgb(_KIND_COLOURS[name])
        axes.scatter([], [], color=_KIND_COLOURS[name], marker="s", label=WORDS[name])
    axes.imshow(image)
    axes.set_title("why a pixel has its depth, or none", fontsize=10)
    axes.axis("off")
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncol=2, frameon=False)
    return figure


def depth_error(found: np.ndarray, truth: np.ndarray):
    """Relative error against truth; grey where nothing was answered."""
    with np.errstate(invalid="ignore", divide="ignore"):
        error = (found / truth - 1.0) * 100.0
    figure, axes = plt.subplots(figsize=(7.2, 4.9))
    drawn = axes.imshow(drawn_values(error), cmap=_with_none("RdBu", "#b8b8b8"), vmin=-20, vmax=20)
    axes.set_title("error of depth against truth (red: too near)", fontsize=10)
    axes.axis("off")
    figure.colorbar(drawn, ax=axes, label="% of the distance", shrink=0.85, extend="both")
    return figure


def from_above(result: MapResult, by_baseline: bool):
    """The cloud seen from above with a distance grid; x forward is up.

    Where home does not lie level, from above the reference camera: forward is its optical axis. See
    T_view_home.
    """
    cloud = result.cloud
    keep = np.random.default_rng(0).choice(len(cloud), min(_MOST_POINTS, len(cloud)), replace=False)
    points, index = (
        transforms.apply(T_view_home(result), cloud.points_home_m[keep]),
        cloud.baseline_index[keep],
    )
    reach = (
        float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 99.5)) if len(points) else 10.0
    )
    figure, axes = plt.subplots(figsize=(7.2, 7.2))
    if by_baseline:
        colors = plt.get_cmap("tab10")(index % 10)
        for i, p in enumerate(result.pairs):
            axes.scatter(
                [], [], color=plt.get_cmap("tab10")(i % 10), label=p.configuration.name, s=20
            )
        if result.near is not None:
            colors[index == NEAR_BASELINE] = matplotlib.colors.to_rgba(_KIND_COLOURS["near"])
            axes.scatter([], [], color=_KIND_COLOURS["near"], label="depth camera", s=20)
        axes.legend(
            fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncol=3, frameon=False
        )
    else:
        colors = cloud.colors[keep] / 255.0
    axes.scatter(-points[:, 1], points[:, 0], c=colors, s=0.6, marker="s", linewidths=0)
    around = result.reference.is_level and result.reference.looks_down
    _rings(axes, reach, 180 if around else 60)
    if not around:
        _field_of_view(axes, result, reach)
    axes.set_aspect("equal")
    axes.set_xlim(*(np.array([-1.06, 1.06] if around else [-0.62, 0.62]) * reach))
    axes.set_ylim(*(np.array([-1.06 if around else -0.04, 1.06]) * reach))
    origin = "home" if np.array_equal(T_view_home(result), np.eye(4)) else "the reference camera"
    axes.set_xlabel(f"to the right of {origin} (m)")
    axes.set_ylabel(f"ahead of {origin} (m)")
    axes.set_title(
        "map from above, " + ("by configuration" if by_baseline else "in colour"), fontsize=10
    )
    return figure


def errors_by_range(result: MapResult, truth: np.ndarray, evaluation: Evaluation):
    """Median and 90th percentile of the error over distance, with the prediction of equation
    2.12."""
    known = np.isfinite(result.depth) & np.isfinite(truth) & (truth <= evaluation.most_m)
    edges = np.linspace(0, evaluation.most_m, 21)
    middle, half, ninety, predicted = [], [], [], []
    for a, b in zip(edges, edges[1:]):
        inside = known & (truth > a) & (truth <= b)
        if inside.sum() < 30:
            continue
        error = np.abs(result.depth[inside] - truth[inside])
        middle.append((a + b) / 2)
        half.append(np.median(error))
        ninety.append(np.percentile(error, 90))
        predicted.append(np.median(result.sigma[inside]))
    figure, axes = plt.subplots(figsize=(7.2, 4.2))
    axes.plot(middle, half, "o-", label="median error")
    axes.plot(middle, ninety, "o--", label="90 % are below", alpha=0.7)
    axes.plot(middle, predicted, "r:", label="predicted (median sigma)")
    axes.set_xlabel("true distance (m)")
    axes.set_ylabel("error of depth (m)")
    axes.set_ylim(0, 3.0 * max([*predicted, *half, 1.0]))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=3, frameon=False)
    return figure


def histogram(result: MapResult):
    """How far the mapped pixels are."""
    values = result.depth[np.isfinite(result.depth) & (result.depth > 0)]
    figure, axes = plt.subplots(figsize=(7.2, 3.2))
    if values.size:
        log_histogram(axes, values, values.min(), values.max() * 1.001, 80)
        axes.set_xscale("log")
        round_numbers(axes.xaxis)
    for p in result.pairs:
        if values.size and p.effective_range_m[1] < values.max():
            axes.axvline(p.effective_range_m[1], color="#c0392b", lw=0.8, ls="--")
    axes.set_xlabel("depth (m); dashed: where effective ranges end (3.1)")
    axes.set_ylabel("pixels")
    return figure


def log_histogram(axes, values: np.ndarray, low: float, high: float, bins: int) -> None:
    """Bars of even width on a logarithmic axis: counted by logarithms, which is quick for millions
    of values."""
    counts, edges = np.histogram(np.log(np.maximum(values, low)), bins, (np.log(low), np.log(high)))
    axes.hist(np.exp(edges[:-1]), np.exp(edges), weights=counts, color="#3a6ea5")


def round_numbers(axis) -> None:
    """Plain numbers on a logarithmic axis (of an Axes or a colour bar) of matplotlib, as many as
    have room."""
    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    if decades < _FEW_DECADES:  # 1, 2, 3, 5 may have no number in it
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
        return
    digits = (
        (1, 2, 3, 5) if decades < _MANY_DECADES else (1, 3) if decades < _MOST_DECADES else (1,)
    )
    formatter = FuncFormatter(lambda value, _position: _round_number(value, digits))
    axis.set_major_formatter(formatter)
    axis.set_minor_formatter(formatter)


def _round_number(value: float, digits) -> str:
    """20 and not 2e1; nothing where its first digit is none of ``digits``."""
    digit = round(value / 10.0 ** np.floor(np.log10(value) + 1e-9)) if value > 0 else 0
    return f"{value:g}" if digit in digits else ""


def _with_none(name: str, color: str = _NONE) -> ListedColormap:
    """A colormap that shows NaN in a colour; matplotlib's own way to say so differs between its
    versions."""
    colors = plt.get_cmap(name)(np.linspace(0.0, 1.0, 256))
    try:
        return ListedColormap(colors, bad=color)  # from 3.11 on, where set_bad goes away
    except TypeError:
        colormap = ListedColormap(colors)
        colormap.set_bad(color)
        return colormap


def _lines(axes, shape, axis: Axis) -> None:
    for k in range(1, 6):
        if axis is Axis.HORIZONTAL:
            axes.axhline(shape[0] * k / 6, color="#ffe14d", lw=0.6)
        else:
            axes.axvline(shape[1] * k / 6, color="#ffe14d", lw=0.6)


def _rings(axes, reach: float, to_deg: float) -> None:
    """Circles of distance about the origin, about eight at most, to an angle on both sides of
    ahead."""
    power = 10.0 ** np.floor(np.log10(max(reach, 1e-9) / _MOST_RINGS))
    step = next(s * power for s in (1, 2, 5, 10) if _MOST_RINGS * s * power >= reach)
    angles = np.radians(np.linspace(-to_deg, to_deg, 121))
    for r in np.arange(step, reach * 1.1, step):
        axes.plot(r * np.sin(angles), r * np.cos(angles), color="#888888", lw=0.6, alpha=0.7)
        axes.text(r * np.sin(angles[-1]) * 0.52, r * 0.995, f"{r:g} m", fontsize=7, color="#444444")


def T_view_home(result: MapResult) -> np.ndarray:
    """Gives the transform from home to the frame that is drawn from above: home itself where it is
    level and the map lies ahead of it.

    Photographs may stand elsewhere and look anywhere: then x is ahead of the reference camera,
    where that stands, or the upper edge of a picture that looks down.
    """
    reference = result.reference
    if reference.is_level:
        T = reference.T_home_cam
        ahead = -T[:2, 1] if reference.looks_down else T[:2, 2]
        known = result.depth[np.isfinite(result.depth)]
        near_m = max(1.0, float(np.median(known)) if known.size else 0.0)
        at_home = np.hypot(*T[:2, 3]) < near_m and not result.is_shifted
        if at_home and not reference.looks_down and ahead[0] > _AHEAD * np.hypot(*ahead):
            return np.eye(4)
        return transforms.invert(
            transforms.from_xyz_yaw([*T[:2, 3], 0.0], float(np.arctan2(ahead[1], ahead[0])))
        )
    T_view_cam = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
    return T_view_cam @ transforms.invert(result.reference.T_home_cam)


def _field_of_view(axes, result: MapResult, reach: float) -> None:
    camera, T = result.reference.camera, T_view_home(result) @ result.reference.T_home_cam
    for u in (0, camera.width - 1):
        d = T[:3, :3] @ np.array([(u - camera.cx) / camera.fx, 0.0, 1.0])
        d = d / np.linalg.norm(d) * reach * 1.1
        p = T[:3, 3]
        axes.plot([-p[1], -(p[1] + d[1])], [p[0], p[0] + d[0]], color="#2c7fb8", lw=0.9)
