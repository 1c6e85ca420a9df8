# SPDX-License-Identifier: Apache-2.0
"""The page: plain HTML with its pictures inside, to be read anywhere and without a network."""

import base64
import html
import io
from pathlib import Path
from typing import List, Optional, Sequence

import matplotlib.pyplot as plt
import numpy as np

from fcsv_stereo.evaluation import Evaluation
from fcsv_stereo.report import figures
from fcsv_stereo.result import MapResult

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1200px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; margin: 1em 0; } th, td { padding: .25em .9em; text-align: right; }
th { border-bottom: 2px solid #888; } td { border-bottom: 1px solid #e4e4e4; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 1em 0; } img { max-width: 100%; height: auto; } .side { display: flex; flex-wrap: wrap; gap: 1em; }
.side > * { flex: 1 1 460px; } .warning { background: #fff4d6; border-left: 4px solid #e0a800; padding: .5em 1em; }
"""


def write_report(
    result: MapResult,
    out_dir: Path,
    evaluation: Optional[Evaluation] = None,
    true_depth: Optional[np.ndarray] = None,
) -> Path:
    """``out_dir``/report.html of a map; with truth where it is known."""
    parts = [f"<h1>Map of {len(result.pairs)} configurations, method {html.escape(result.method)}</h1>"]
    parts += [f'<p class="warning">{html.escape(w)}</p>' for w in result.warnings]
    parts += [_summary(result, evaluation), _configurations(result)]
    parts += ["<h2>Map</h2>", _side(figures.from_above(result, False), figures.from_above(result, True))]
    reference = figures.picture(result.reference.image, f"reference {result.reference.name}")
    parts += [_side(reference, figures.depth(result.depth, "depth"))]
    parts += [_side(figures.depth(result.sigma, "standard deviation"), figures.histogram(result))]
    if evaluation is not None and true_depth is not None:
        parts += _truth(result, evaluation, true_depth)
    parts += _pairs(result)
    head = f"<meta charset='utf-8'><title>fcsv map</title><style>{_STYLE}</style>"
    page = f"<!doctype html><html lang='en'><head>{head}</head>"
    path = Path(out_dir) / "report.html"
    path.write_text(page + "<body>" + "\n".join(parts) + "</body></html>")
    return path


def _summary(result: MapResult, evaluation: Optional[Evaluation]) -> str:
    known = result.depth[np.isfinite(result.depth)]
    rows = [
        ("reference picture", result.reference.name),
        ("points", f"{result.points:,}"),
        ("coverage of the picture", f"{result.coverage:.1%}"),
        ("depth, 1st to 99th percentile", f"{np.percentile(known, 1):.1f} to {np.percentile(known, 99):.0f} m"),
        ("processing", f"{result.timing_s.get('total', float('nan')):.1f} s"),
    ]
    rows += [(f"&emsp;{k}", f"{v:.2f} s") for k, v in result.timing_s.items() if k != "total"]
    if evaluation is not None:
        o = evaluation.overall
        rows += [
            (f"within 10 % of truth, of all pixels to {evaluation.most_m:.0f} m", f"{o.within_10_percent:.1%}"),
            ("wrong by more, of the answered", f"{o.wrong_of_answered:.1%}"),
            ("median error", "-" if o.median_relative_error is None else f"{o.median_relative_error:.2%}"),
        ]
    return "<h2>Summary</h2>" + _table(("", ""), rows)


def _configurations(result: MapResult) -> str:
    rows = [
        (
            html.escape(p.configuration.name), p.configuration.axis, f"{p.configuration.baseline_m:.2f} m",
            f"{np.linalg.norm(p.T_home_cam_other[:3, 3] - p.T_home_cam_reference[:3, 3]):.2f} m",
            f"{p.effective_range_m[0]:.0f} to {p.effective_range_m[1]:.0f} m", f"{p.match_rate:.1%}",
            str(len(p.candidates)),
        )
        for p in result.pairs
    ]  # fmt: skip
    head = ("configuration", "axis", "baseline", "tracked", "effective range", "matched", "pictures tried")
    return "<h2>Configurations</h2>" + _table(head, rows)


def _truth(result: MapResult, evaluation: Evaluation, true_depth: np.ndarray) -> List[str]:
    rows = [
        (
            f"{b.range_m[0]:.0f} to {b.range_m[1]:.0f} m", f"{b.pixels:,}", f"{b.coverage:.1%}",
            f"{b.within_10_percent:.1%}", f"{b.wrong_of_answered:.1%}",
            "-" if b.median_relative_error is None else f"{b.median_relative_error:.2%}",
        )
        for b in evaluation.bands
    ]  # fmt: skip
    poses = [(html.escape(n), f"{r:.3f}", f"{p:.3f}") for n, (r, p) in evaluation.pose_errors.items()]
    return [
        "<h2>Against truth</h2>",
        _table(("range", "pixels", "covered", "within 10 %", "wrong of answered", "median error"), rows),
        _side(figures.depth(true_depth, "true depth"), figures.depth_error(result.depth, true_depth)),
        _side(figures.errors_by_range(result, true_depth, evaluation)),
        f"<p>Errors within one predicted standard deviation: {evaluation.within_1_sigma:.0%}, "
        f"within two: {evaluation.within_2_sigma:.0%}.</p>",
        "<p>Poses relative to the reference picture:</p>",
        _table(("picture", "rotation error (deg)", "position error (m)"), poses),
    ]


def _pairs(result: MapResult) -> List[str]:
    parts = ["<h2>Pairs</h2>"]
    for p in result.pairs:
        tried = ", ".join(f"{html.escape(n)} {r:.1%}" for n, r in p.candidates)
        parts += [
            f"<h3>{html.escape(p.configuration.name)}</h3>",
            f"<p>Match rates: {tried}</p>",
            _image(figures.pair(p)),
        ]
    return parts


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{h}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def _side(*drawn) -> str:
    return '<div class="side">' + "".join(_image(f) for f in drawn) + "</div>"


def _image(figure) -> str:
    data = io.BytesIO()
    figure.savefig(data, format="jpeg", dpi=95, bbox_inches="tight", pil_kwargs={"quality": 85})
    plt.close(figure)
    return f'<figure><img src="data:image/jpeg;base64,{base64.b64encode(data.getvalue()).decode()}"></figure>'
