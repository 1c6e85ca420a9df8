# SPDX-License-Identifier: Apache-2.0
"""The points of each view, joined with those that overlap it. A task a view puts its depth into the
site, kept in OUT/placed, a second one joins it with the depths of others, kept in OUT/points: zarr
with the key of what went into it."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo.model import Progress, part
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Missing, Site
from fcsv_stereo.survey.placing.adjust import Placed
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.placing.georeference import projected, projected_cloud
from fcsv_stereo.survey.surface.merge import (
    SiteDepth,
    SiteView,
    join_view,
    overlapping,
    site_place,
    site_view,
)
from fcsv_stereo.survey.surface.points import (
    ViewPoints,
    kept_attributes,
    read_arrays,
    read_points,
    write_arrays,
    write_points,
)
from fcsv_stereo.survey.tasks.crew import Crew, SurveyTask, completed
from fcsv_stereo.survey.views.view_file import ViewFile, digest

PLACED, POINTS = "placed", "points"
_PLACED_SHARE = 0.2  # of the time, for those who wait
_ARRAYS = ("depth", "sigma", "sky")


@dataclass(frozen=True)
class PlacedFile:
    """A view and where it is, less ``origin_m`` (3,), in the metres of the adjustment."""

    of: ViewFile
    placed: Placed
    origin_m: np.ndarray

    @property
    def key(self) -> str:
        """Key of all that its depth in the site is made of."""
        numbers = [similarity.numbers(self.placed.S_site_cam), self.placed.relative.tolist()]
        return digest([self.of.name, self.of.key, numbers, self.origin_m.tolist()])

    def path(self, out: Path) -> Path:
        """Where that is kept."""
        return out.absolute() / PLACED / f"{self.of.name}.zarr.zip"

    def is_kept(self, out: Path) -> Optional[bool]:
        """True; None where what is kept is of something else, or not whole."""
        return True if kept_attributes(self.path(out), self.key) else None

    def load(self, out: Path) -> SiteDepth:
        """The depth that was kept. Raises OSError."""
        place = site_place(self.placed, self.origin_m)
        return SiteDepth(
            self.of.name, self.of.camera, *place, **read_arrays(self.path(out), _ARRAYS)
        )

    def view(self, out: Path) -> SiteView:
        """The same with its view. Raises SurveyError, OSError."""
        kept = {f.name: getattr(self.load(out), f.name) for f in fields(SiteDepth)}
        return SiteView(**kept, view=self.of.load())


@dataclass(frozen=True)
class JoinInput:
    """A view and those that may see what it sees; with ``frame`` its points go into that frame's
    projection."""

    own: PlacedFile
    others: Tuple[PlacedFile, ...]
    frame: Optional[EarthFrame] = None

    @property
    def key(self) -> str:
        """Key of all that the points are made of."""
        f = self.frame
        earth = f and [f.longitude_deg, f.latitude_deg, f.height_m, f.crs.to_wkt()]
        return digest([[p.key for p in (self.own, *self.others)], earth])

    def path(self, out: Path) -> Path:
        """Where the points are kept."""
        return out.absolute() / POINTS / f"{self.own.of.name}.zarr.zip"


def place_view(given: PlacedFile, out: Path) -> None:
    """A task: a view's depth in the site, and keeps it."""
    seen = site_view(given.of.load(), given.placed, given.origin_m)
    arrays = {name: getattr(seen, name) for name in _ARRAYS}
    write_arrays(arrays, {"key": given.key}, given.path(out))


def make_points(given: JoinInput, out: Path) -> None:
    """A task: joins a view's points with those of others, which it reads one by one, and keeps
    them."""
    joined = join_view(given.own.view(out), (o.load(out) for o in given.others))
    cloud = joined.cloud
    if given.frame is not None:
        cloud = projected_cloud(cloud, given.frame, given.own.origin_m)
    counts = {n: getattr(joined, n) for n in ("duplicates", "seen_through", "agreed")}
    write_points(cloud, counts, given.path(out), given.key)


def join_views(site: Site, out: Path, crew: Crew, progress: Progress) -> Site:
    """The site with the points of all views that have a place, in the projected system where it is
    on the earth: kept ones, and those that the crew makes. Views whose points could not be joined
    are missing."""
    frame, out = site.frame, out.absolute()
    files, missing = _placed(site, out, crew, part(progress, 0.0, _PLACED_SHARE))
    here = [v for v in site.views if v.name in files]
    given = []
    for v in here:
        others = overlapping(v, here, site.adjusted.placed)
        given.append(JoinInput(files[v.name], tuple(files[o.name] for o in others), frame))
    tasks = [SurveyTask(_points_of(v), make_points, (g, out)) for v, g in zip(here, given)]

    def kept(i: int) -> Optional[ViewPoints]:
        return read_points(given[i].path(out), given[i].key)

    rest = part(progress, _PLACED_SHARE, 1.0)
    found, errors = completed(crew, tasks, kept, rest, "joining depths")
    missing += [Missing(tasks[i].name, here[i].source, said) for i, said in errors.items()]
    joined = {name: ViewPoints() for name in site.adjusted.placed}
    joined.update((v.name, points) for v, points in zip(here, found) if points)
    site = replace(site, joined=joined, missing=[*site.missing, *missing])
    if frame is None:
        return site
    adjusted = projected(site.adjusted, frame)
    return replace(site, adjusted=adjusted, origin_m=frame.rounded_origin())


def _placed(
    site: Site, out: Path, crew: Crew, progress: Progress
) -> Tuple[Dict[str, PlacedFile], List[Missing]]:
    """The depths in the site of all views that have a place, by name; those that could not be put
    there are missing."""
    placed = site.adjusted.placed
    here = [v for v in site.views if v.name in placed]
    files = [PlacedFile(v.sent(), placed[v.name], site.origin_m) for v in here]
    tasks = [SurveyTask(_points_of(v), place_view, (f, out)) for v, f in zip(here, files)]
    _, errors = completed(crew, tasks, lambda i: files[i].is_kept(out), progress, "placing depths")
    missing = [Missing(tasks[i].name, here[i].source, said) for i, said in errors.items()]
    return {f.of.name: f for i, f in enumerate(files) if i not in errors}, missing


def _points_of(view: ViewFile) -> str:
    return f"points of {view.name}"
