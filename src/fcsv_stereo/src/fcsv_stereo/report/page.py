# SPDX-License-Identifier: Apache-2.0
"""The page: plain HTML with its pictures inside, to be read anywhere and without a network."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import jinja2
import numpy as np

from fcsv_geometry.version import VERSION
from fcsv_stereo.evaluating.evaluation import Evaluation
from fcsv_stereo.evaluating.poi import PoiResult
from fcsv_stereo.model import MapResult
from fcsv_stereo.report import evidence, figures, near, pictures, sections
from fcsv_stereo.report.naming import named, picture_names
from fcsv_stereo.report.origin import Origin
from fcsv_stereo.report.parts import Part, image
from fcsv_stereo.report.sections import ReportData

NOT_KNOWN = Origin()
#: Title and maker of every section, in order; one that gives nothing is left out. A new page is a
#: line here.
SECTIONS: List[Tuple[str, Callable[[ReportData], List[Part]]]] = [
    ("Summary", sections.summary),
    ("Picture and depth", sections.picture_and_depth),
    ("Against truth", sections.truth),
    ("Map from above", sections.from_above),
    ("In three dimensions", sections.in_three_dimensions),
    ("Configurations", sections.configurations),
    ("Ground sample distance", pictures.ground_sample),
    ("Pictures", pictures.pictures),
    ("Poses", sections.poses),
    ("Seams", sections.seams),
    ("Near field", near.near_field),
    ("Ground", sections.ground),
    ("Confidence", sections.confidence),
    ("Timing", sections.timing),
    ("Points of interest", sections.points_of_interest),
    ("Pairs", sections.pairs),
]


@dataclass(frozen=True)
class Section:
    """A section that was made."""

    title: str
    parts: List[Part]

    @property
    def anchor(self) -> str:
        """Its place in the page's address."""
        return self.title.lower().replace(" ", "-")


def write_report(
    result: MapResult,
    out_dir: Path,
    evaluation: Optional[Evaluation] = None,
    true_depth: Optional[np.ndarray] = None,
    points: Sequence[PoiResult] = (),
    origin: Origin = NOT_KNOWN,
) -> Path:
    """``out_dir``/report.html of a map; with truth where it is known, and points of interest where
    they were given. ``origin`` stands at its top."""
    if evaluation is not None:
        names = picture_names(result)
        errors = {names.get(n, n): e for n, e in evaluation.pose_errors.items()}
        evaluation = replace(evaluation, pose_errors=errors)
    result = named(result)
    found, shown = [], []
    for i, pair in enumerate(result.pairs):  # a pair's rectified pictures are made once, and let go
        found.append(evidence.pair_evidence(result, i))
        shown.append(image(figures.pair(pair)))
    data = ReportData(
        result, found, evidence.seams(result, found), evaluation, true_depth, points, shown
    )
    drawn = [Section(title, make(data)) for title, make in SECTIONS]
    count = f"{len(result.pairs)} configuration{'' if len(result.pairs) == 1 else 's'}"
    title = f"Map of {count}, method {result.method}"
    path = Path(out_dir) / "report.html"
    path.write_text(
        render(title, origin.rows(result), [s for s in drawn if s.parts]), encoding="utf-8"
    )
    return path


def render(title: str, origin: Sequence[Tuple[str, str]], sections: Sequence[Section]) -> str:
    """The page's HTML; ``origin`` are the rows of the table at its top."""
    has_views = any(p.kind in ("cloud_view", "pixel_view") for s in sections for p in s.parts)
    template = _environment().get_template("report.html")
    return template.render(
        title=title, origin=origin, sections=sections, version=VERSION, has_views=has_views
    )


def _environment() -> jinja2.Environment:
    """Templates beside this file (so that they are found in a devel space, too); what they are
    given is escaped."""
    loader = jinja2.FileSystemLoader(str(Path(__file__).resolve().parent / "templates"))
    return jinja2.Environment(
        loader=loader, autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
