# SPDX-License-Identifier: Apache-2.0
"""The points of each view, joined with those that overlap it: a task a view, kept in OUT/points as
zarr with the key of what went into it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.adjust import Placed
from fcsv_stereo.survey.document import Missing
from fcsv_stereo.survey.earth import EarthFrame
from fcsv_stereo.survey.georeference import projected_cloud
from fcsv_stereo.survey.kept import ViewFile, digest
from fcsv_stereo.survey.merge import SiteView, join_view, overlapping, site_view
from fcsv_stereo.survey.points import ViewPoints, read_points, write_points
from fcsv_stereo.survey.progress import Begin
from fcsv_stereo.survey.work import Crew, SurveyTask

POINTS = "points"


@dataclass(frozen=True)
class JoinInput:
    """A view, where it is, and likewise those that may see what it sees. Points are less
    ``origin_m`` (3,), in the metres of the adjustment or, with ``frame``, of its projection."""

    own: ViewFile
    placed: Placed
    others: Tuple[Tuple[ViewFile, Placed], ...]
    origin_m: np.ndarray
    frame: Optional[EarthFrame] = None

    @property
    def key(self) -> str:
        """Of all that the points are made of."""
        f = self.frame
        earth = f and [f.longitude_deg, f.latitude_deg, f.height_m, f.crs.to_wkt()]
        views = [[v.name, v.key, _numbers(p)] for v, p in ((self.own, self.placed), *self.others)]
        return digest([views, self.origin_m.tolist(), earth])

    def path(self, out: Path) -> Path:
        """Where the points are kept."""
        return out.absolute() / POINTS / f"{self.own.name}.zarr.zip"


def _numbers(placed: Placed) -> list:
    return [similarity.numbers(placed.S_site_cam), placed.relative.tolist()]


def kept_points(given: JoinInput, out: Path) -> Optional[ViewPoints]:
    """The points as an earlier survey left them; None where they are of something else, or are not
    whole."""
    return read_points(given.path(out), given.key)


def make_points(given: JoinInput, out: Path) -> None:
    """A task: joins a view's points with those of others, which it reads one by one, and keeps
    them."""

    def in_site(view: ViewFile, placed: Placed) -> SiteView:
        return site_view(view.load(), placed, given.origin_m)

    joined = join_view(in_site(given.own, given.placed), (in_site(*o) for o in given.others))
    cloud = joined.cloud
    if given.frame is not None:
        cloud = projected_cloud(cloud, given.frame, given.origin_m)
    counts = {n: getattr(joined, n) for n in ("duplicates", "seen_through", "agreed")}
    write_points(cloud, counts, given.path(out), given.key)


def join_views(
    files: Sequence[ViewFile],
    placed: Dict[str, Placed],
    place: Tuple[np.ndarray, Optional[EarthFrame]],
    out: Path,
    crew: Crew,
    begin: Begin,
    shares: Tuple[float, float],
) -> Tuple[Dict[str, ViewPoints], List[Missing]]:
    """The points of all views that have a place, by name: kept ones, and those that the crew makes;
    and views whose points could not be joined. ``place``: the origin (3,) that the adjustment leaves
    out, and its frame on the earth."""
    here = [v for v in files if v.name in placed]
    given = [
        JoinInput(
            v, placed[v.name], tuple((o, placed[o.name]) for o in overlapping(v, here, placed)), *place
        )
        for v in here
    ]
    new = [g for g in given if kept_points(g, out) is None]
    tasks = [SurveyTask(f"points of {g.own.name}", make_points, (g, out.absolute())) for g in new]
    errors: Dict[str, str] = {}
    for done, outcome in enumerate(crew.run(tasks), 1):
        if outcome.error:
            errors[new[outcome.number].own.name] = outcome.error
        share = shares[0] + (shares[1] - shares[0]) * done / len(tasks)
        begin(f"joining depths, {done} of {len(tasks)}", share)
    found = {g.own.name: kept_points(g, out) or ViewPoints() for g in given}
    for name, points in found.items():
        if points.path is None:
            errors.setdefault(name, f"what was written to {out / POINTS} is gone; the same command goes on")
    return found, [
        Missing(f"points of {v.name}", v.source, errors[v.name]) for v in here if v.name in errors
    ]
