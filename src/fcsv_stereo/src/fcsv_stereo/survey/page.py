# SPDX-License-Identifier: Apache-2.0
"""site.html: the plan with views and edges, what each view sees, tables of views, edges and loops."""

from pathlib import Path
from typing import List

import matplotlib.pyplot as plt
import numpy as np

from fcsv_stereo.report.page import Section, render
from fcsv_stereo.report.parts import Paragraph, Part, Table, Tone, image, note, number
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site, overlaps

_MOST_DRAWN = 300_000  # points of the plan's picture
_WEDGE_SHARE = 0.12  # length of a view's wedge, of the plan's width
_CUT_PERCENT = (1.0, 99.0)


def write_page(site: Site, path: Path) -> None:
    """The page, with its pictures inside."""
    sections = [
        Section("Summary", _summary(site)), Section("Plan", [image(_plan(site)), _plan_words()]),
        Section("Coverage", [image(_coverage(site)), note("Height, how many views agree on a point, how sure it is.")]),
        Section("Views", _views(site)), Section("Edges", _edges(site)), Section("Loops", _loops(site)),
    ]  # fmt: skip
    placed = len(site.adjusted.placed)
    title = f"Site of {placed} view{'' if placed == 1 else 's'}"
    path.write_text(render(title, [], [s for s in sections if s.parts]), encoding="utf-8")


def _summary(site: Site) -> List[Part]:
    parts: List[Part] = [Paragraph(f"{m.name} is missing: {m.reason}", Tone.WARNING) for m in site.missing]
    parts += [Paragraph(r, Tone.WARNING) for r in site.adjusted.remarks]
    alone = [n for n, p in site.adjusted.placed.items() if p.alone]
    if alone and len(site.adjusted.placed) > 1:
        parts.append(Paragraph(f"Overlap no other view and stay at their stations: {', '.join(alone)}.", Tone.WARNING))
    parts = parts or [Paragraph("All views are joined; nothing stands out as wrong.", Tone.GOOD)]
    cloud, kept = site.cloud, sum(e.kept for e in site.adjusted.edges)
    several = float((cloud.baseline_index > 1).mean()) if len(cloud) else float("nan")
    rows = [
        ("points", f"{len(cloud):,}"), ("seen by two views or more", number(several, "{:.0%}")),
        ("median sigma", number(float(np.median(cloud.sigma_m)) if len(cloud) else None, "{:.2f} m")),
        ("seen through and left out", f"{sum(j.seen_through for j in site.joined.values()):,}"),
        ("pairs of views joined", f"{kept} of {len(site.adjusted.edges)}"),
        ("origin of the cloud", ", ".join(f"{v:.0f}" for v in site.origin_m) + " m"),
    ]  # fmt: skip
    return [*parts, Table((), rows)]


def _plan_words() -> Part:
    return note(
        "x to the right, y upwards (m). Wedges: where each view looks. Lines: edges that count, "
        "with their residual; dotted red: thrown out."
    )


def _shown(site: Site) -> np.ndarray:
    count = len(site.cloud)
    return np.random.default_rng(0).permutation(count)[:_MOST_DRAWN]


def _limits(site: Site, points: np.ndarray, sigma_m: np.ndarray):
    """Corners that hold all views and the surer half of the points."""
    places = np.array([similarity.place(p.S_site_cam)[:2] for p in site.adjusted.placed.values()]).reshape(-1, 2)
    low, high = places.min(axis=0), places.max(axis=0)
    sure = points[sigma_m <= np.median(sigma_m)] if len(points) else points
    if len(points):
        low = np.minimum(low, np.percentile(sure[:, :2], _CUT_PERCENT[0], axis=0))
        high = np.maximum(high, np.percentile(sure[:, :2], _CUT_PERCENT[1], axis=0))
    margin = 0.05 * max(float((high - low).max()), 1.0)
    return low - margin, high + margin


def _plan(site: Site):
    figure, axes = plt.subplots(figsize=(12, 9))
    shown = _shown(site)
    points = site.cloud.points_home_m[shown].astype(float) + site.origin_m
    low, high = _limits(site, points, site.cloud.sigma_m[shown])
    order = np.argsort(points[:, 2])  # the highest is drawn last
    axes.scatter(*points[order, :2].T, c=site.cloud.colors[shown][order] / 255.0, s=0.6, rasterized=True)
    at = {n: similarity.place(p.S_site_cam)[:2] for n, p in site.adjusted.placed.items()}
    for e in (e for e in site.adjusted.edges if e.a in at and e.b in at and e.S_a_b is not None):
        x, y = np.array([at[e.a], at[e.b]]).T
        axes.plot(x, y, "k-" if e.kept else "r:", lw=1.2)
        if e.kept:
            axes.annotate(f"{e.residual_m:.2f}", (x.mean(), y.mean()), fontsize=7, ha="center")
    length = _WEDGE_SHARE * float((high - low).max())
    for view in (v for v in site.views if v.name in at):
        p = site.adjusted.placed[view.name]
        edge_u = np.array([0.0, view.camera.width - 1.0])
        sides = np.column_stack([(edge_u - view.camera.cx) / view.camera.fx, np.zeros(2), np.ones(2)])
        ends = (sides @ similarity.rotation(p.S_site_cam).T)[:, :2]
        ends = at[view.name] + length * ends / np.maximum(np.linalg.norm(ends, axis=1, keepdims=True), 1e-9)
        colour = "tab:red" if p.alone else "tab:blue"
        axes.fill(*np.vstack([at[view.name], ends]).T, color=colour, alpha=0.25)
        axes.plot(*at[view.name], "o", color=colour, ms=4)
        axes.annotate(view.name, at[view.name], fontsize=9, weight="bold", xytext=(4, 4), textcoords="offset points")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)", aspect="equal")
    return figure


def _coverage(site: Site):
    figure, three = plt.subplots(1, 3, figsize=(18, 6))
    shown = _shown(site)
    points = site.cloud.points_home_m[shown].astype(float) + site.origin_m
    low, high = _limits(site, points, site.cloud.sigma_m[shown])
    inside = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
    points, shown = points[inside], shown[inside]
    values = (
        ("height (m)", points[:, 2], "terrain"), ("views", site.cloud.baseline_index[shown], "viridis"),
        ("sigma (m)", site.cloud.sigma_m[shown], "magma"),
    )  # fmt: skip
    for axes, (label, value, colours) in zip(three, values):
        if len(points):
            least, most = np.percentile(value, [1, 98])
            most = max(most, least + 1e-3)
            drawn = axes.scatter(*points[:, :2].T, c=value, s=0.4, cmap=colours, vmin=least, vmax=most, rasterized=True)
            figure.colorbar(drawn, ax=axes, label=label, shrink=0.7)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", aspect="equal")
    return figure


def _views(site: Site) -> List[Part]:
    rows = []
    for name, p in site.adjusted.placed.items():
        joined = site.joined[name]
        rows.append((
            name, f"{p.scale:.4f} ± {p.sigma_scale:.4f}", f"{p.sigma_m:.2f} m", f"{np.degrees(p.sigma_yaw_rad):.2f}°",
            ", ".join(overlaps(site.adjusted, name)) or "none", f"{len(joined.cloud):,}", f"{joined.agreed:,}",
            f"{joined.seen_through:,}",
        ))  # fmt: skip
    head = ("view", "scale", "place ±", "yaw ±", "joined with", "own points", "seen by two", "seen through")
    return [Table(head, rows)]


def _edges(site: Site) -> List[Part]:
    rows = [
        (f"{e.a} – {e.b}", "yes" if e.kept else "no", f"{e.matches}", number(e.residual_m, "{:.2f} m"), e.reason)
        for e in site.adjusted.edges
    ]
    return [Table(("views", "counts", "matches", "residual", "reason"), rows)] if rows else []


def _loops(site: Site) -> List[Part]:
    rows = [
        (", ".join(p.views), f"{p.closing_m:.2f} m", f"{p.closing_deg:.2f}°", f"{p.closing_scale:.2%}")
        for p in site.adjusted.loops
    ]
    return [Table(("round", "closes to", "turn", "scale"), rows)] if rows else []
