# SPDX-License-Identifier: Apache-2.0
"""Leads from inputs to OUT/: maps, edges, adjustment, one cloud, its files."""

import itertools
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.writing import in_words, require_folder
from fcsv_stereo.errors import OutputError, SurveyError
from fcsv_stereo.map_files.output import write_ply
from fcsv_stereo.model import Progress, concatenate
from fcsv_stereo.products.clouds import write_laz
from fcsv_stereo.survey import inputs, merge
from fcsv_stereo.survey.document import (
    CLOUDS,
    Missing,
    Site,
    adjustment_document,
    origin_of,
    site_document,
)
from fcsv_stereo.survey.edges import Edge, find_edge
from fcsv_stereo.survey.features import features_of
from fcsv_stereo.survey.georeference import WorldInput, WorldOptions, place, projected
from fcsv_stereo.survey.inputs import Source
from fcsv_stereo.survey.maps import VIEWS, MapOptions, map_of
from fcsv_stereo.survey.matching import may_overlap
from fcsv_stereo.survey.page import write_page
from fcsv_stereo.survey.station import prior_of
from fcsv_stereo.survey.views import View, read_view

FILES = (*CLOUDS, "site.html", "adjustment.json", "site.json")
_LEAST_MIB = 50
Begin = Callable[[str, float], None]


def check_out(out: Path) -> None:
    """An earlier survey may be continued, anything else is left alone. Raises OutputError."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out}: is a file; give a folder with -o")
    foreign = (
        [p.name for p in out.iterdir() if p.name not in (*FILES, VIEWS)] if out.exists() else []
    )
    foreign = [name for name in foreign if not name.startswith(".site.")]  # what a stopped run left
    if foreign:
        raise OutputError(
            f"{out}: holds '{foreign[0]}', which is not of a survey; give another folder with -o"
        )


def run(
    paths: Sequence[Path],
    out: Path,
    options: Optional[MapOptions] = None,
    begin: Begin = lambda step, share: None,
    world: Optional[WorldOptions] = None,
) -> Site:
    """The site of all inputs, written to ``out``; what could not be mapped or placed is in its
    ``missing``.

    Raises FcsvError where an input is none, where a station.yaml is wrong, or where nothing could
    be mapped.
    """
    check_out(out)
    given = (world or WorldOptions()).read()
    require_folder(out.absolute(), _LEAST_MIB)
    sources = inputs.sources_of(paths)
    views, missing = _mapped(sources, out, options or MapOptions(), begin)
    if not views:
        raise SurveyError(
            "no view could be mapped: " + "; ".join(f"{m.name}: {m.reason}" for m in missing)
        )
    begin("comparing views", 0.7)
    edges = edges_between(views)
    site = site_of(views, edges, missing, begin, given)
    begin("writing the site", 0.95)
    write(site, out)
    return site


def site_of(
    views: List[View],
    edges: List[Edge],
    missing: Sequence[Missing],
    begin: Begin = lambda *_: None,
    given: Optional[WorldInput] = None,
) -> Site:
    """Views adjusted and joined, on the earth where control points or GPS say where."""
    given = given or WorldOptions().read()
    adjusted, frame, world = place(views, edges, given)
    missing = list(missing)
    if given.control is not None and world is None:
        why = next(r for r in adjusted.remarks if r.startswith("the site is not in the world's"))
        missing.append(Missing("world", str(given.control.path), why))
    missing = [
        *missing,
        *(
            Missing(v.name, v.source, adjusted.lost[v.name])
            for v in views
            if v.name in adjusted.lost
        ),
    ]
    if len(views) > 1 and not any(e.kept for e in adjusted.edges):
        said = "no two views were joined: each that has a place stays at its station, and errors of scale stay"
        adjusted = replace(adjusted, remarks=[*adjusted.remarks, said])
    begin("joining depths", 0.8)
    origin_m = origin_of(list(adjusted.placed.values()))
    placed = [v for v in views if v.name in adjusted.placed]
    cloud, parts = merge.join(placed, adjusted.placed, origin_m)
    if frame is not None:
        adjusted, parts, origin_m = projected(adjusted, parts, frame, origin_m)
        cloud = concatenate([p.cloud for p in parts])
    joined = {v.name: p for v, p in zip(placed, parts)}
    return Site(views, adjusted, cloud, joined, origin_m, missing, world)


def edges_between(views: Sequence[View]) -> List[Edge]:
    """An edge, or why there is none, for all pairs that may overlap."""
    features = [features_of(v) for v in views]
    pairs = itertools.combinations(range(len(views)), 2)
    return [
        find_edge(views[i], views[j], features[i], features[j])
        for i, j in pairs
        if may_overlap(views[i], views[j])
    ]


def _mapped(
    sources: List[Source], out: Path, options: MapOptions, begin: Begin
) -> Tuple[List[View], List[Missing]]:
    """A view of each source, in order, and those of which there is none."""
    views, missing = [], []
    keys = {s.name: inputs.content_key(s.path) for s in sources}
    same = inputs.copies(keys)
    paths: Dict[str, Path] = {s.name: s.path for s in sources}
    for i, source in enumerate(sources):
        if source.name in same:
            of = same[source.name]
            why = f"is the same as {of} ({paths[of]}): a copy tells nothing new; take one of the two away"
            missing.append(Missing(source.name, str(source.path), why))
            continue
        try:
            told = _told(source.name, i, len(sources), begin)
            folder = map_of(source, keys[source.name], out, options, told)
            views.append(_view(source, folder))
        except (FcsvError, ValueError) as error:
            missing.append(Missing(source.name, str(source.path), str(error)))
        except OSError as error:
            missing.append(Missing(source.name, str(source.path), in_words(error, out / VIEWS)))
    return views, missing


def _view(source: Source, folder: Path) -> View:
    """The view of a map, with what its photograph says besides."""
    view = read_view(folder, source.name, str(source.path), _prior(source))
    taken_with, gps = inputs.photograph_of(source, view.picture)
    return replace(view, taken_with=taken_with, gps=gps)


def _prior(source: Source):
    return lambda T_home_cam, name: prior_of(source.station, T_home_cam, source.level, name)


def _told(name: str, i: int, count: int, begin: Begin) -> Progress:
    """Maps are the first 70 % of a survey."""
    begin(f"map {i + 1} of {count}: {name}", 0.7 * i / count)
    return lambda step, done, total: begin(
        f"map {i + 1} of {count}: {name}, {step}", 0.7 * (i + done / max(total, 1)) / count
    )


def write(site: Site, out: Path) -> None:
    """Cloud, page and documents into ``out``; an earlier survey's stay until these are whole.
    Raises OutputError."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".site.", dir=out) as made:
            folder = Path(made)
            last = ("views", "views that agree on it")
            write_ply(site.cloud, folder / CLOUDS[0], site.origin_m, last[0])
            crs = site.world.crs if site.world else ""
            write_laz(site.cloud, folder / CLOUDS[1], site.origin_m, last, crs)
            write_page(site, folder / "site.html")
            (folder / "adjustment.json").write_text(
                json.dumps(adjustment_document(site), indent=1, allow_nan=False)
            )
            (folder / "site.json").write_text(
                json.dumps(site_document(site), indent=1, allow_nan=False)
            )
            for name in FILES:  # site.json last: it tells of all others
                (folder / name).replace(out / name)
    except OSError as error:
        raise OutputError(in_words(error, out)) from error
