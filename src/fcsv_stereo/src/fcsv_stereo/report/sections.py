# SPDX-License-Identifier: Apache-2.0
"""The report's sections, each a list of parts out of what the report knows."""

from dataclasses import dataclass
from typing import List, Optional, Sequence

import numpy as np

from fcsv_stereo.evaluating.depth_metrics import TITLES
from fcsv_stereo.evaluating.evaluation import Evaluation
from fcsv_stereo.evaluating.poi import PoiResult
from fcsv_stereo.map_files.cloud_bounds import in_words
from fcsv_stereo.model import MapResult
from fcsv_stereo.model.kinds import WORDS, masks
from fcsv_stereo.report import charts, figures, poi
from fcsv_stereo.report.cloud_view import cloud_view
from fcsv_stereo.report.evidence import PairEvidence, Seam, correction, sigma_bands
from fcsv_stereo.report.parts import (
    Figures,
    Heading,
    Paragraph,
    Part,
    Table,
    Tone,
    image,
    note,
    number,
    percent,
    side,
)
from fcsv_stereo.report.pixel_view import pixel_view
from fcsv_stereo.report.plain_words import warnings

_GROUND = (
    "The folder ground/ holds it for robots: map_server, GeoTIFF, OctoMap (docs/user/guidance.md). Free: by the "
    "calibrated probability that the robot can stand with its middle there. What no pixel touched is unknown."
)


@dataclass(frozen=True)
class ReportData:
    """What sections draw from; truth is None where it is not known. ``shown`` are the pairs'
    figures."""

    result: MapResult
    evidence: List[PairEvidence]
    seams: List[Seam]
    evaluation: Optional[Evaluation] = None
    true_depth: Optional[np.ndarray] = None
    points: Sequence[PoiResult] = ()
    shown: Sequence[Part] = ()


def summary(data: ReportData) -> List[Part]:
    """Warnings in plain words, the main figures, the map at a glance."""
    result, e = data.result, data.evaluation
    found = warnings(result, data.evidence, data.seams, e)
    parts = [Paragraph(w, Tone.WARNING) for w in found]
    unseen = _unseen(result)
    parts += [Paragraph(u) for u in unseen if parts]
    parts = parts or [Paragraph(" ".join(["Nothing stands out as wrong.", *unseen]), Tone.GOOD)]
    known = result.depth[np.isfinite(result.depth)]
    span = (
        f"{np.percentile(known, 1):.1f} to {np.percentile(known, 99):.0f} m" if known.size else "–"
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = result.sigma / result.depth
    relative = relative[np.isfinite(relative)]
    origin = ", ".join(f"{v:.0f}" for v in result.origin_m)
    shift = [("add to x, y, z of map.ply and map.pcd", origin)] if result.is_shifted else []
    rows = [
        ("reference picture", result.reference.name),
        *shift,
        ("configurations", str(len(result.pairs))),
        ("points", f"{result.points:,}"),
        *(
            [("left out of the cloud", in_words(result.cut))]
            if result.cut and in_words(result.cut)
            else []
        ),
        ("coverage of the picture", f"{result.coverage:.1%}"),
        ("depth, 1st to 99th percentile", span),
        (
            "sigma over distance, median",
            percent(float(np.median(relative)) if relative.size else None, 2),
        ),
        *((f"time offset of {v}'s camera", c.words) for v, c in result.clocks.items()),
        ("processing", number(result.timing_s.get("total"), "{:.1f} s")),
    ]
    if e is not None:
        o = e.overall
        rows += [
            (
                f"within 10 % of truth, of all pixels to {e.most_m:.0f} m",
                f"{o.within_10_percent:.1%}",
            ),
            ("wrong by more, of the answered", f"{o.wrong_of_answered:.1%}"),
            ("median error", percent(o.median_relative_error, 2)),
        ]
    shares = Table(("pixels", "share"), _kinds(result))
    return [*parts, Table((), rows), image(figures.kinds(result.kind)), shares]


def picture_and_depth(data: ReportData) -> List[Part]:
    """Both in one place; what each pixel is."""
    result = data.result
    if not np.isfinite(result.depth).any():
        return [side(figures.picture(result.reference.image, f"reference {result.reference.name}"))]
    said = (
        "± is one standard deviation of the depths' errors, taken as independent. An error of the scale (of the "
        "baselines) comes on top: it is one for the whole map."
    )
    return [pixel_view(result), note(said)]


def _unseen(result: MapResult) -> List[str]:
    """What may be wrong and would show nowhere: in poses and cameras that were taken as they came,
    or by refinement."""
    if any(i.refined for i in result.images):
        return result.unseen
    return [
        "Poses were taken as they came: a baseline or a focal length of another length, or a small turn of the cameras "
        "towards each other, makes all depths wrong and shows nowhere.",
        *result.unseen,
    ]


def _kinds(result: MapResult) -> List[Sequence[str]]:
    shares = {name: float(mask.mean()) for name, mask in masks(result.kind).items()}
    return [(WORDS[name], f"{share:.1%}") for name, share in shares.items() if share > 0.0]


def timing(data: ReportData) -> List[Part]:
    """Seconds by step."""
    if not any(data.result.timing_s.values()):
        return [note("not measured")]
    # as they came, then the sum
    order = [*charts.STEPS, *(k for k in data.result.timing_s if k not in charts.STEPS)]
    rows = [(k, f"{data.result.timing_s[k]:.2f} s") for k in order if k in data.result.timing_s]
    return [image(charts.timing(data.result)), Table(("step", "time"), rows)]


def configurations(data: ReportData) -> List[Part]:
    """Pairs with baseline, overlap, epipolar offset, match rate, range."""
    rows = []
    for p, e in zip(data.result.pairs, data.evidence):
        tracked = np.linalg.norm(p.T_home_cam_other[:3, 3] - p.T_home_cam_reference[:3, 3])
        carried = "–" if e.carried_m is None else f"{e.carried_m[0]:.0f} to {e.carried_m[1]:.0f} m"
        near, far = p.effective_range_m
        rows.append(
            (
                p.configuration.name,
                p.configuration.axis,
                f"{p.configuration.baseline_m:.2f} m",
                f"{tracked:.2f} m",
                f"{np.degrees(p.configuration.tilt_rad):.1f}°",
                f"{e.overlap:.0%}",
                number(e.epipolar_rms_px, "{:.2f} px"),
                f"{p.match_rate:.1%}",
                f"{near:.0f} to {far:.0f} m",
                carried,
                f"{e.points:,}",
                _skew(data.result.skews_s.get(p.other_name)),
            )
        )
    head = (
        "configuration",
        "axis",
        "baseline",
        "tracked",
        "tilt",
        "overlap",
        "epipolar rms",
        "matched",
        "effective range",
        "depths it gave",
        "points",
        "skew",
    )
    said = (
        "Overlap: share of the reference's view that the other camera sees. Epipolar rms: how far corresponding "
        "corners lie off the line on which they are looked for, in the rectified pictures; below 1 px is good. Depths "
        "it gave: 5th to 95th percentile of the points that the map took from this baseline. Skew: between its picture "
        "and the reference camera's nearest one of the same recording; what moved in it is not where it was."
    )
    parts = [Table(head, rows), note(said)]
    return parts + ([image(charts.ranges(data.result, data.evidence))] if rows else [])


def _skew(skew_s: Optional[float]) -> str:
    return "–" if skew_s is None else f"{1e3 * skew_s:.0f} ms"


def poses(data: ReportData) -> List[Part]:
    """Corrections of the refinement by picture."""
    rows = []
    for i in data.result.images:
        degrees, metres = correction(i)
        state = (
            "reference" if i.name == data.result.reference.name else "yes" if i.refined else "no"
        )
        rows.append(
            (
                i.name,
                state,
                f"{degrees:.3f}°",
                f"{metres:.3f} m",
                "–" if i.inliers is None else f"{i.inliers:,}",
                number(i.epipolar_rms_px, "{:.2f} px"),
            )
        )
    head = ("picture", "refined", "turned by", "moved by", "inliers", "epipolar rms after")
    if not any(i.refined for i in data.result.images):
        return [
            Table(head, rows),
            note(f"Method {data.result.method} uses the recorded poses as they are."),
        ]
    return [Table(head, rows), image(charts.corrections(data.result))]


def from_above(data: ReportData) -> List[Part]:
    """The cloud from above, in colour and by configuration; how far the pixels are."""
    above = side(figures.from_above(data.result, False), figures.from_above(data.result, True))
    return [above, *_orthophoto(data.result), image(figures.histogram(data.result))]


def _orthophoto(result: MapResult) -> List[Part]:
    holes = result.holes
    if holes is None:
        return []
    said = (
        f"Orthophoto, cells within the picture's field of view: {holes.filled:.1%} filled, "
        f"{holes.without_evidence:.1%} holes without evidence ({holes.hidden:.1%} behind something nearer, "
        f"{holes.unanswered:.1%} where the cloud has no depth, {holes.below:.1%} below the picture), "
        f"{holes.open:.2%} holes of a surface that was seen."
    )
    return [note(said)]


def ground(data: ReportData) -> List[Part]:
    """Where the robot that was named can stand. Nothing where no ground was asked for."""
    found = data.result.ground
    if found is None:
        return []
    return [Paragraph(found.summary), Figures((found.jpeg,), False), note(_GROUND)]


def in_three_dimensions(data: ReportData) -> List[Part]:
    """The thinned cloud, to be turned by hand."""
    if not data.result.points:
        return []
    view = cloud_view(data.result)
    share = "all" if view.shown == view.points else f"{view.shown:,} drawn at random of"
    said = (
        f"Shown: {share} {view.points:,} points; red: the reference camera, blue: the others. Drag to turn, scroll to "
        "come nearer, drag with the right button to move. Click two points for their distance and, where home "
        "is level, height; Escape clears. No network is needed."
    )
    return [view, note(said)]


def confidence(data: ReportData) -> List[Part]:
    """Sigma as a picture, as histograms, by range."""
    rows = [
        (
            f"{b['from_m']:.0f} to {b['to_m']:.0f} m"
            if np.isfinite(b["to_m"])
            else f"beyond {b['from_m']:.0f} m",
            f"{b['pixels']:,}",
            f"{b['sigma_m']:.2f} m",
            f"{b['share']:.2%}",
        )
        for b in sigma_bands(data.result)
    ]
    return [
        side(figures.depth(data.result.sigma, "standard deviation of depth")),
        image(charts.sigma(data.result)),
        Table(("mapped depth", "pixels", "median sigma", "of the distance"), rows),
    ]


def seams(data: ReportData) -> List[Part]:
    """Whether neighbouring baselines agree where one takes over."""
    if not data.seams:
        return [note("No two baselines of one axis overlap in range.")]
    rows = [
        (f"{s.shorter} → {s.longer}", f"{s.at_m:.0f} m", f"{s.pixels:,}", f"{s.step:+.1%}")
        for s in data.seams
    ]
    shared = all(p.shares_depth for p in data.result.pairs)
    of = (
        "corners near it, as each pair alone would place them"
        if shared
        else "pixels near it that both saw"
    )
    said = f"Step: median of the longer baseline's depth over the shorter's, less one, of the {of}."
    return [Table(("from → to", "at", "corners" if shared else "pixels", "step"), rows), note(said)]


def truth(data: ReportData) -> List[Part]:
    """Errors against truth by range; poses against truth."""
    e = data.evaluation
    if e is None or data.true_depth is None:
        return []
    rows = [
        (
            f"{b.range_m[0]:.0f} to {b.range_m[1]:.0f} m",
            f"{b.pixels:,}",
            f"{b.coverage:.1%}",
            f"{b.within_10_percent:.1%}",
            f"{b.wrong_of_answered:.1%}",
            percent(b.median_relative_error, 2),
        )
        for b in e.bands
    ]
    turned = [(n, f"{r:.3f}°", f"{p:.3f} m") for n, (r, p) in e.pose_errors.items()]
    return [
        Table(
            ("range", "pixels", "covered", "within 10 %", "wrong of answered", "median error"), rows
        ),
        side(
            figures.depth(data.true_depth, "true depth"),
            figures.depth_error(data.result.depth, data.true_depth),
        ),
        side(figures.errors_by_range(data.result, data.true_depth, e)),
        Paragraph(
            f"Errors within one predicted standard deviation: {e.within_1_sigma:.0%} (68 % is right), within two: "
            f"{e.within_2_sigma:.0%} (95 %)."
        ),
        *([Table((), tuple(zip(TITLES, e.metrics.cells())))] if e.metrics is not None else []),
        *(Paragraph(f"{m.words[0].upper()}{m.words[1:]}.") for m in e.moving),
        Paragraph("Poses relative to the reference picture:"),
        Table(("picture", "rotation error", "position error"), turned),
    ]


def points_of_interest(data: ReportData) -> List[Part]:
    """Boxes in the reference picture, and what every configuration found in them (thesis 6.7)."""
    if not data.points:
        return []
    head = ("point", "true depth", "configuration", "matched", "median depth", "5 % to 95 %")
    return [
        side(poi.boxes(data.result, data.points)),
        image(poi.distributions(data.points)),
        Table(head, poi.rows(data.points)),
    ]


def pairs(data: ReportData) -> List[Part]:
    """Rectified pictures and disparity of every pair."""
    parts = []
    for p, figure in zip(data.result.pairs, data.shown):
        tried = ", ".join(f"{n} {r:.1%}" for n, r in p.candidates)
        parts.append(Heading(p.configuration.name))
        parts += [Paragraph(f"Match rates: {tried}")] if tried else []
        parts.append(figure)
    return parts
