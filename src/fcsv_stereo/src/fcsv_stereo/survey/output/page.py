# SPDX-License-Identifier: Apache-2.0
"""site.html: the plan with views and edges, what each view sees, tables of views, edges and
loops."""

from pathlib import Path
from typing import Dict, List, Tuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patheffects import withStroke

from fcsv_stereo.report.page import Section, render
from fcsv_stereo.report.parts import Paragraph, Part, Table, Tone, image, note, number
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.document import Site, overlaps
from fcsv_stereo.survey.placing.world import unlikely_points
from fcsv_stereo.survey.surface.quantiles import quantiles
from fcsv_stereo.survey.surface.rasters import CellGrid, Highest, Surface

_PLAN_CELLS, _COVERAGE_CELLS = 700, 300  # along the longer side
_MOST_LABELLED = 12  # views; with more the edges' residuals would cover each other
_WEDGE_SHARE = 0.12  # length of a view's wedge, of the plan's width
_CUT_SHARES = (0.01, 0.99)


def write_page(site: Site, path: Path) -> None:
    """The page, with its pictures inside."""
    limits = _limits(site)
    plan, coverage = (_from_above(site, *limits, n) for n in (_PLAN_CELLS, _COVERAGE_CELLS))
    told = note("Height, how many views agree on a point, how sure it is.")
    sections = [
        Section("Summary", _summary(site)),
        Section("Plan", [image(_plan(site, *plan)), _plan_words()]),
        Section("Coverage", [image(_coverage(*coverage)), told] if site.count else []),
        Section("World", _world(site)),
        Section("Views", _views(site)),
        Section("Edges", _edges(site)),
        Section("Loops", _loops(site)),
    ]
    placed = len(site.adjusted.placed)
    title = f"Site of {placed} view{'' if placed == 1 else 's'}"
    path.write_text(render(title, [], [s for s in sections if s.parts]), encoding="utf-8")


def _summary(site: Site) -> List[Part]:
    parts: List[Part] = [
        Paragraph(f"{m.name} is missing: {m.reason}", Tone.WARNING) for m in site.missing
    ]
    parts += [Paragraph(r, Tone.WARNING) for r in site.adjusted.remarks]
    if site.world is not None:
        parts += [Paragraph(r, Tone.WARNING) for r in unlikely_points(site.world.fit.points)]
    alone = [n for n, p in site.adjusted.placed.items() if p.alone]
    if alone and len(site.adjusted.placed) > 1:
        parts.append(
            Paragraph(
                f"Overlap no other view and stay at their stations: {', '.join(alone)}.",
                Tone.WARNING,
            )
        )
    parts = parts or [Paragraph("All views are joined; nothing stands out as wrong.", Tone.GOOD)]
    kept = sum(e.kept for e in site.adjusted.edges)
    several = sum(int((c.baseline_index > 1).sum()) for c in site.clouds())
    rows = [
        ("points", f"{site.count:,}"),
        ("seen by two views or more", number(several / max(site.count, 1), "{:.0%}")),
        ("median sigma", number(site.median_sigma_m, "{:.2f} m")),
        ("seen through and left out", f"{sum(j.seen_through for j in site.joined.values()):,}"),
        ("pairs of views joined", f"{kept} of {len(site.adjusted.edges)}"),
        *site.extras.items(),
        ("origin of the cloud", ", ".join(f"{v:.0f}" for v in site.origin_m) + " m"),
    ]
    return [*parts, Table((), rows)]


def _plan_words() -> Part:
    return note(
        "x to the right, y upwards (m). Wedges: where each view looks, with its number in the "
        "table of views. Lines: edges that count, with their residual; dotted red: thrown out."
    )


def _limits(site: Site) -> Tuple[np.ndarray, np.ndarray]:
    """Corners (x, y m) that hold all views and the surer half of the points."""
    places = np.array(
        [similarity.place(p.S_site_cam)[:2] for p in site.adjusted.placed.values()]
    ).reshape(-1, 2)
    low, high = places.min(axis=0), places.max(axis=0)
    if site.count:
        median_m = site.median_sigma_m
        sure = quantiles(
            lambda: (c.points_home_m[c.sigma_m <= median_m, :2] for c in site.clouds()), _CUT_SHARES
        )
        low = np.minimum(low, sure[0] + site.origin_m[:2])
        high = np.maximum(high, sure[1] + site.origin_m[:2])
    margin = 0.05 * max(float((high - low).max()), 1.0)
    return low - margin, high + margin


def _from_above(site: Site, low: np.ndarray, high: np.ndarray, cells: int) -> Tuple[Surface, Tuple]:
    """The highest points of so many cells along the longer side between two corners (x, y m), and
    left, right, lower, upper edge (m) of these cells."""
    cell_m = float((high - low).max()) / cells
    first, last = (np.floor((v - site.origin_m[:2]) / cell_m).astype(int) for v in (low, high))
    highest = Highest(CellGrid(cell_m, tuple(first), tuple(last)), site.origin_m)
    for cloud in site.clouds():
        highest.add(cloud, cloud.points_home_m[:, 2].astype(float))
    left, lower = first * cell_m + site.origin_m[:2]
    right, upper = (last + 1) * cell_m + site.origin_m[:2]
    return highest.surface, (left, right, lower, upper)


def _plan(site: Site, surface: Surface, extent: Tuple):
    figure, axes = plt.subplots(figsize=(12, 9))
    seen = np.where(np.isfinite(surface.height)[..., None], surface.rgb, 255)
    axes.imshow(seen, extent=extent, interpolation="nearest")
    at = {n: similarity.place(p.S_site_cam)[:2] for n, p in site.adjusted.placed.items()}
    for e in (e for e in site.adjusted.edges if e.a in at and e.b in at and e.S_a_b is not None):
        x, y = np.array([at[e.a], at[e.b]]).T
        axes.plot(x, y, "k-" if e.kept else "r:", lw=1.2)
        if e.kept and e.residual_m is not None and len(at) <= _MOST_LABELLED:
            axes.annotate(f"{e.residual_m:.2f}", (x.mean(), y.mean()), fontsize=7, ha="center")
    length = _WEDGE_SHARE * max(extent[1] - extent[0], extent[3] - extent[2])
    for view in (v for v in site.views if v.name in at):
        p = site.adjusted.placed[view.name]
        edge_u = np.array([0.0, view.camera.width - 1.0])
        sides = np.column_stack(
            [(edge_u - view.camera.cx) / view.camera.fx, np.zeros(2), np.ones(2)]
        )
        ends = (sides @ similarity.rotation(p.S_site_cam).T)[:, :2]
        ends = at[view.name] + length * ends / np.maximum(
            np.linalg.norm(ends, axis=1, keepdims=True), 1e-9
        )
        colour = "tab:red" if p.alone else "tab:blue"
        axes.fill(*np.vstack([at[view.name], ends]).T, color=colour, alpha=0.25)
        axes.plot(*at[view.name], "o", color=colour, ms=4)
        axes.annotate(
            _numbers(site)[view.name],
            at[view.name] + 1.15 * (ends.mean(axis=0) - at[view.name]),
            fontsize=13,
            weight="bold",
            ha="center",
            va="center",
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="x (m)", ylabel="y (m)", aspect="equal")
    _in_whole_metres(axes)
    return figure


def _in_whole_metres(axes) -> None:
    """Coordinates of the world are read as they are, without a power of ten beside the axis."""
    axes.ticklabel_format(style="plain", useOffset=False)


def _numbers(site: Site) -> Dict[str, str]:
    """Numbers of the placed views, from 1 on, by name."""
    return {name: str(i) for i, name in enumerate(site.adjusted.placed, 1)}


def _coverage(surface: Surface, extent: Tuple):
    figure, three = plt.subplots(1, 3, figsize=(18, 6))
    values = (
        ("height (m)", surface.height, "terrain"),
        ("views", surface.views, "viridis"),
        ("sigma (m)", surface.sigma, "magma"),
    )
    for axes, (label, shown, colours) in zip(three, values):
        if np.isfinite(shown).any():
            least, most = np.nanpercentile(shown, [1, 98])
            drawn = axes.imshow(
                shown,
                extent=extent,
                cmap=colours,
                vmin=least,
                vmax=max(most, least + 1e-3),
                interpolation="nearest",
            )
            figure.colorbar(drawn, ax=axes, label=label, shrink=0.7)
        axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="x (m)", aspect="equal")
        _in_whole_metres(axes)
        axes.locator_params(axis="x", nbins=4)  # numbers of the world are long
    return figure


def _world(site: Site) -> List[Part]:
    if site.world is None:
        return []
    fit = site.world.fit
    rows = [
        ("reference system", site.world.crs),
        ("heights", site.world.heights),
        ("place ±", f"{fit.sigma_m:.2f} m"),
        ("heading ±", f"{np.degrees(fit.sigma_heading_rad):.3f}°"),
        ("scale ±", f"{fit.sigma_scale:.2%}"),
    ]
    parts: List[Part] = [Table((), rows)]
    points = [
        (
            p.name,
            p.kind,
            *(f"{v:+.3f}" for v in p.off_m),
            f"{np.max(p.sigma_m):.3f}",
            f"more than {tuning.UNLIKELY_SIGMAS:g} sigma" if p.unlikely else "",
            ", ".join(p.views),
        )
        for p in fit.points
    ]
    if points:
        head = ("point", "kind", "east (m)", "north (m)", "up (m)", "± (m)", "off by", "seen by")
        parts.append(Table(head, points))
    fixes = [
        (
            r.statement.view,
            "yes" if r.used else "no",
            *(f"{v:+.2f}" for v in r.off_m),
            f"{r.sigma_m[0]:.2f}",
        )
        for r in fit.gps
    ]
    if fixes:
        head = ("GPS of", "counts", "east (m)", "north (m)", "up (m)", "± (m)")
        parts.append(Table(head, fixes))
    return parts


def _views(site: Site) -> List[Part]:
    rows, numbers = [], _numbers(site)
    for name, p in site.adjusted.placed.items():
        joined = site.joined[name]
        others = [numbers[n] for n in overlaps(site.adjusted, name)]
        rows.append(
            (
                numbers[name],
                name,
                f"{p.scale:.4f} ± {p.sigma_scale:.4f}",
                f"{p.sigma_m:.2f} m",
                f"{np.degrees(p.sigma_yaw_rad):.2f}°",
                ", ".join(others) or "none",
                f"{joined.count:,}",
                f"{joined.agreed:,}",
                f"{joined.seen_through:,}",
            )
        )
    head = (
        "",
        "view",
        "scale",
        "place ±",
        "yaw ±",
        "joined with",
        "own points",
        "seen by two",
        "seen through",
    )
    return [Table(head, rows)]


def _edges(site: Site) -> List[Part]:
    numbers = _numbers(site)
    rows = [
        (
            " – ".join(numbers.get(n, n) for n in (e.a, e.b)),
            "yes" if e.kept else "no",
            f"{e.matches}",
            number(e.residual_m, "{:.2f} m"),
            e.reason,
        )
        for e in site.adjusted.edges
    ]
    return [Table(("views", "counts", "matches", "residual", "reason"), rows)] if rows else []


def _loops(site: Site) -> List[Part]:
    numbers = _numbers(site)
    rows = [
        (
            " – ".join(numbers[n] for n in p.views),
            f"{p.closing_m:.2f} m",
            f"{p.closing_deg:.2f}°",
            f"{p.closing_scale:.2%}",
        )
        for p in site.adjusted.loops
    ]
    return [Table(("round", "closes to", "turn", "scale"), rows)] if rows else []
