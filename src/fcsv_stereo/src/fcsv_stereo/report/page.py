# SPDX-License-Identifier: Apache-2.0
"""The page: plain HTML with its pictures inside, to be read anywhere and without a network."""

import html
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.evaluation import Evaluation
from fcsv_stereo.model import MapResult
from fcsv_stereo.poi import PoiResult
from fcsv_stereo.report import evidence, sections
from fcsv_stereo.report.markup import STYLE
from fcsv_stereo.report.sections import ReportData

#: Title and maker of every section, in order; one that gives nothing is left out. A new page is a line here.
SECTIONS: List[Tuple[str, Callable[[ReportData], List[str]]]] = [
    ("Summary", sections.summary),
    ("Against truth", sections.truth),
    ("Map from above", sections.from_above),
    ("Configurations", sections.configurations),
    ("Poses", sections.poses),
    ("Seams", sections.seams),
    ("Confidence", sections.confidence),
    ("Timing", sections.timing),
    ("Points of interest", sections.points_of_interest),
    ("Pairs", sections.pairs),
]


def write_report(
    result: MapResult,
    out_dir: Path,
    evaluation: Optional[Evaluation] = None,
    true_depth: Optional[np.ndarray] = None,
    points: Sequence[PoiResult] = (),
) -> Path:
    """``out_dir``/report.html of a map; with truth where it is known, and points of interest where they were given."""
    found = [evidence.pair_evidence(result, i) for i in range(len(result.pairs))]
    data = ReportData(result, found, evidence.seams(result), evaluation, true_depth, points)
    drawn = [(title, make(data)) for title, make in SECTIONS]
    drawn = [(title, parts) for title, parts in drawn if parts]
    count = f"{len(result.pairs)} configuration{'' if len(result.pairs) == 1 else 's'}"
    title = f"Map of {count}, method {html.escape(result.method)}"
    links = "".join(f'<a href="#{_anchor(t)}">{t}</a>' for t, _ in drawn)
    body = [f"<h1>{title}</h1>", f"<nav>{links}</nav>"]
    for name, parts in drawn:
        body += [f'<h2 id="{_anchor(name)}">{name}</h2>', *parts]
    head = f"<meta charset='utf-8'><title>{title}</title><style>{STYLE}</style>"
    path = Path(out_dir) / "report.html"
    page = f"<!doctype html><html lang='en'><head>{head}</head><body>" + "\n".join(body) + "</body></html>"
    path.write_text(page, encoding="utf-8")
    return path


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")
