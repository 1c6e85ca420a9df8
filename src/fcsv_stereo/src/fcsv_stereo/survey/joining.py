# SPDX-License-Identifier: Apache-2.0
"""The points of each view, joined with those that overlap it: a task a view, kept in OUT/points as
zarr with the key of what went into it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Optional, Tuple

import numpy as np

from fcsv_stereo.model import Progress
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.adjust import Placed
from fcsv_stereo.survey.document import Missing, Site
from fcsv_stereo.survey.earth import EarthFrame
from fcsv_stereo.survey.georeference import projected, projected_cloud
from fcsv_stereo.survey.kept import ViewFile, digest
from fcsv_stereo.survey.merge import SiteView, join_view, overlapping, site_view
from fcsv_stereo.survey.points import ViewPoints, read_points, write_points
from fcsv_stereo.survey.work import Crew, SurveyTask, completed

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
        """Key of all that the points are made of."""
        f = self.frame
        earth = f and [f.longitude_deg, f.latitude_deg, f.height_m, f.crs.to_wkt()]
        views = [[v.name, v.key, _numbers(p)] for v, p in ((self.own, self.placed), *self.others)]
        return digest([views, self.origin_m.tolist(), earth])

    def path(self, out: Path) -> Path:
        """Where the points are kept."""
        return out.absolute() / POINTS / f"{self.own.name}.zarr.zip"


def _numbers(placed: Placed) -> list:
    return [similarity.numbers(placed.S_site_cam), placed.relative.tolist()]


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


def join_views(site: Site, out: Path, crew: Crew, progress: Progress) -> Site:
    """The site with the points of all views that have a place, in the projected system where it is
    on the earth: kept ones, and those that the crew makes. Views whose points could not be joined
    are missing."""
    placed, frame = site.adjusted.placed, site.frame
    here = [v for v in site.views if v.name in placed]
    given = []
    for v in here:
        others = tuple((o.sent(), placed[o.name]) for o in overlapping(v, here, placed))
        given.append(JoinInput(v.sent(), placed[v.name], others, site.origin_m, frame))
    tasks = [SurveyTask(f"points of {g.own.name}", make_points, (g, out.absolute())) for g in given]

    def kept(i: int) -> Optional[ViewPoints]:
        return read_points(given[i].path(out), given[i].key)

    found, errors = completed(crew, tasks, kept, progress, "joining depths")
    missing = [Missing(tasks[i].name, here[i].source, said) for i, said in errors.items()]
    joined = {v.name: points or ViewPoints() for v, points in zip(here, found)}
    site = replace(site, joined=joined, missing=[*site.missing, *missing])
    if frame is None:
        return site
    adjusted = projected(site.adjusted, frame)
    return replace(site, adjusted=adjusted, origin_m=frame.rounded_origin())
