# SPDX-License-Identifier: Apache-2.0
"""Leads from inputs to OUT/: maps, edges, adjustment, each view's points, the site's files."""

import contextlib
import json
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.writing import in_words, require_folder
from fcsv_stereo.errors import DamagedMapError, OutputError, SurveyError
from fcsv_stereo.map_files.output import write_clouds
from fcsv_stereo.model import part
from fcsv_stereo.products.clouds import LazFile
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.document import (
    CLOUDS,
    OCTREE,
    VIEWS_DIMENSION,
    Missing,
    Site,
    adjustment_document,
    origin_of,
    site_document,
    withdraw,
)
from fcsv_stereo.survey.edges.edge import Edge, posed_edge
from fcsv_stereo.survey.edges.pairs import compared_pairs
from fcsv_stereo.survey.lock import LOCK, alone_in
from fcsv_stereo.survey.output.extras import EXTRAS, ExtraOptions, write_extras
from fcsv_stereo.survey.output.page import write_page
from fcsv_stereo.survey.placing.adjust import Adjusted
from fcsv_stereo.survey.placing.georeference import WorldInput, WorldOptions, place
from fcsv_stereo.survey.surface.rasters import RASTERS, write_rasters
from fcsv_stereo.survey.tasks.crew import Crew, SurveyTask, WorkOptions, completed
from fcsv_stereo.survey.tasks.edge_files import EDGES, kept_edge, make_edge
from fcsv_stereo.survey.tasks.joining import PLACED, POINTS, join_views
from fcsv_stereo.survey.tasks.maps import VIEWS, MapOptions, forget_map, kept_map, make_map
from fcsv_stereo.survey.tasks.progress import Begin, MapsProgress
from fcsv_stereo.survey.tasks.tiles import TILES, SiteTiles, make_tiles
from fcsv_stereo.survey.views import inputs
from fcsv_stereo.survey.views.inputs import Source
from fcsv_stereo.survey.views.station import flown_prior, prior_of
from fcsv_stereo.survey.views.view import View, read_view
from fcsv_stereo.survey.views.view_file import ViewFile, view_file

FILES = (*CLOUDS, *RASTERS, *EXTRAS.values(), "site.html", "adjustment.json", "site.json")
_LEAST_MIB = 50
_KEPT = (VIEWS, EDGES, PLACED, POINTS, TILES)  # folders of what goes on
_MOST_APART_M = 1e6
_STAGED = ".site."  # begins the name of a folder whose files are not whole yet
_STAGED_MAP = ".*.????????"  # likewise (StagedFolder)
_MAPPED, _COMPARED, _JOINED, _TILED = 0.7, 0.8, 0.9, 0.95  # of a survey's time, for those who wait


def check_out(out: Path) -> None:
    """An earlier survey may be continued, anything else is left alone. Raises OutputError."""
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out}: is a file; give a folder with -o")
    foreign = (
        [p.name for p in out.iterdir() if p.name not in (*FILES, *_KEPT)] if out.exists() else []
    )
    foreign = [n for n in foreign if n != LOCK and not n.startswith(_STAGED)]
    if foreign:
        raise OutputError(
            f"{out}: holds '{foreign[0]}', which is not of a survey; give another folder with -o"
        )


def _remove_leftovers(out: Path) -> None:
    """Removes what a survey left that was killed while it wrote."""
    for left in (*out.glob(f"{_STAGED}*"), *out.glob(f"{VIEWS}/{_STAGED_MAP}")):
        shutil.rmtree(left, ignore_errors=True)
    for left in (p for p in out.glob("*/*.partial") if p.is_file()):
        with contextlib.suppress(OSError):
            left.unlink()


def run(
    paths: Sequence[Path],
    out: Path,
    options: Optional[MapOptions] = None,
    begin: Begin = lambda step, share: None,
    world: Optional[WorldOptions] = None,
    work: Optional[WorkOptions] = None,
    every: int = 0,
    extras: Optional[ExtraOptions] = None,
    neighbours: int = tuning.NEIGHBOURS,
) -> Site:
    """The site of all inputs, written to ``out``; what could not be mapped, placed or made is in
    its ``missing``. ``neighbours``: see ``compared_pairs``.

    Raises FcsvError where an input is none, where a station.yaml is wrong, where another survey
    writes to ``out``, or where nothing could be mapped.
    """
    if neighbours < 0:
        raise SurveyError(f"--neighbours: is 0 or more, got {neighbours}")
    check_out(out)
    given = (world or WorldOptions()).read()
    require_folder(out.absolute(), _LEAST_MIB)
    sources = inputs.sources_of(paths, every)
    with alone_in(out):
        _remove_leftovers(out)
        with Crew(work or WorkOptions()) as crew:
            mapped = _mapped(sources, out, options or MapOptions(), crew, begin)
            if not mapped.views:
                reasons = "; ".join(f"{m.name}: {m.reason}" for m in mapped.missing)
                raise SurveyError(f"no view could be mapped: {reasons}")
            begin("comparing views", _MAPPED)
            views = mapped.views
            edges, uncompared = edges_between(views, out, crew, begin, neighbours)
            edges = with_posed(edges, views)
            site = placed_site(views, edges, [*mapped.missing, *uncompared], given)
            begin("joining depths", _COMPARED)
            site = join_views(site, out, crew, part(begin, _COMPARED, _JOINED))
            begin("making tiles", _JOINED)
            site, tiles = make_tiles(site, out, crew, part(begin, _JOINED, _TILED))
            begin("writing the site", _TILED)
            return write(site, tiles, out, extras)


def placed_site(
    views: List[ViewFile], edges: List[Edge], missing: Sequence[Missing], given: WorldInput
) -> Site:
    """Views adjusted, on the earth where control points or GPS say where; no points yet."""
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
    adjusted = replace(adjusted, remarks=[*adjusted.remarks, *_uncompared(adjusted)])
    _require_one_site(adjusted)
    origin_m = origin_of(list(adjusted.placed.values()))
    return Site(views, adjusted, {}, origin_m, missing, world, frame)


def _require_one_site(adjusted: Adjusted) -> None:
    """Raises SurveyError where places are farther apart than the millimetres of a LAZ reach."""
    places = {n: similarity.place(p.S_site_cam) for n, p in adjusted.placed.items()}
    if not places:
        return
    first = next(iter(places))
    apart_m = {n: float(np.linalg.norm(at - places[first])) for n, at in places.items()}
    far = max(apart_m, key=lambda n: apart_m[n])
    if apart_m[far] > _MOST_APART_M:
        raise SurveyError(
            f"{first} and {far} lie {apart_m[far] / 1000.0:,.0f} km apart, which is no site: state both by "
            "station.yaml, GPS or control points of one frame"
        )


def _uncompared(adjusted: Adjusted) -> List[str]:
    """A remark on views that were compared with none: a wrong station looks like this."""
    compared = {name for e in adjusted.edges for name in (e.a, e.b)}
    apart = [name for name in adjusted.placed if name not in compared]
    if len(adjusted.placed) < 2 or not apart:
        return []
    named = ", ".join(apart)
    return [
        f"by the stations no other view sees what {named} sees, so nothing was compared; if one does, correct "
        "place_m, heading_deg or their sigmas"
    ]


def edges_between(
    views: Sequence[ViewFile], out: Path, crew: Crew, begin: Begin, neighbours: int
) -> Tuple[List[Edge], List[Missing]]:
    """An edge, or why there is none, for all pairs that are compared: kept ones, and those that the
    crew finds; and pairs that could not be compared."""
    pairs = compared_pairs(views, neighbours)
    tasks = []
    for p in pairs:
        given = p.a.sent(), p.b.sent(), out.absolute(), p.look_alike
        tasks.append(SurveyTask(f"{p.a.name} with {p.b.name}", make_edge, given))
    progress = part(begin, _MAPPED, _COMPARED)
    found, errors = completed(
        crew, tasks, lambda i: kept_edge(pairs[i].a, pairs[i].b, out), progress, "comparing views"
    )
    missing = [Missing(tasks[i].name, "", said) for i, said in errors.items()]
    return [e for e in found if e is not None], missing


def with_posed(edges: List[Edge], views: Sequence[View]) -> List[Edge]:
    """Edges, and those that the poses of a folder of photographs or of one flight state where
    features gave none: from each of its references to the next, unless their priors state it."""
    by_folder: Dict[str, List[View]] = {}
    for v in views:
        by_folder.setdefault(v.source, []).append(v)
    posed = {
        (a.name, b.name): posed_edge(a, b)
        for of in by_folder.values()
        for a, b in zip(of[:-1], of[1:])
        if not (a.prior.placed and b.prior.placed)
    }
    kept = {(e.a, e.b) for e in edges if e.kept}
    return [e for e in edges if e.kept or (e.a, e.b) not in posed] + [
        e for pair, e in posed.items() if pair not in kept
    ]


@dataclass(frozen=True)
class _Mapped:
    """Views in the order of their inputs, and what is missing."""

    views: List[ViewFile]
    missing: List[Missing]


def _mapped(
    sources: List[Source], out: Path, options: MapOptions, crew: Crew, begin: Begin
) -> _Mapped:
    """A view of each source, by maps that are there or that the crew makes."""
    keys = inputs.source_keys(sources)
    same = inputs.copies(keys)
    paths: Dict[str, Path] = {s.name: s.path for s in sources}
    errors: Dict[str, str] = {
        n: f"is the same as {of} ({paths[of]}): a copy tells nothing new; take one of the two away"
        for n, of in same.items()
    }
    own = [s for s in sources if s.name not in same]
    folders = {s.name: kept_map(s, keys[s.name], out, options) for s in own}
    new = [s for s in own if folders[s.name] is None]
    tasks = [_map_task(s, keys[s.name], out, options) for s in new]
    if crew.elsewhere(tasks):
        tasks = [_map_task(s, keys[s.name], out, options.on_one_core()) for s in new]
    progress = MapsProgress([s.name for s in new], begin, _MAPPED)
    progress.begin(crew.elsewhere(tasks))
    for outcome in crew.run(tasks, progress.advance):
        name = new[outcome.number].name
        if outcome.error:
            errors[name] = outcome.error
        else:
            folders[name] = out / VIEWS / name
        progress.ended(outcome.number)
    views: List[ViewFile] = []
    for source in (s for s in own if s.name not in errors):
        try:
            folder = Path(str(folders[source.name]))
            view = _view(source, folder)
            if not view.known.any():
                raise SurveyError(
                    f"{folder}: its map shows no depth that is sure enough for a cloud"
                )
            views.append(view_file(view, folder, f"{keys[source.name]} {options.words()}"))
        except DamagedMapError as error:
            errors[source.name] = f"{error}{forget_map(source, out)}"
        except (FcsvError, ValueError) as error:
            errors[source.name] = str(error)
        except OSError as error:
            errors[source.name] = in_words(error, out / VIEWS)
    missing = [Missing(s.name, str(s.path), errors[s.name]) for s in sources if s.name in errors]
    return _Mapped(views, missing)


def _map_task(source: Source, key: str, out: Path, options: MapOptions) -> SurveyTask:
    return SurveyTask(
        source.name, make_map, (_anywhere(source), key, out.absolute(), options), True, tells=True
    )


def _anywhere(source: Source) -> Source:
    """The source by a path that does not depend on the working directory."""
    return replace(source, path=source.path.absolute())


def _view(source: Source, folder: Path) -> View:
    """The view of a map, with what its photograph says besides."""
    view = read_view(folder, source.name, str(source.path), _prior(source))
    taken_with, gps = inputs.photograph_of(source, view.picture)
    flown = view.gps if source.leads else None  # the fixes of one flight count once
    return replace(view, taken_with=taken_with, gps=gps or flown)


def _prior(source: Source):
    if source.view:
        return lambda T, name: flown_prior(source.station, source.in_site, T, name)
    return lambda T_home_cam, name: prior_of(source.station, T_home_cam, source.level, name)


def write(
    site: Site, tiles: Optional[SiteTiles], out: Path, extras: Optional[ExtraOptions] = None
) -> Site:
    """Cloud, products, page and documents into ``out``; an earlier survey's stay until these are
    whole. The site with what is said of products. Raises OutputError."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=_STAGED, dir=out) as made:
            folder = Path(made)
            last, origin_m = VIEWS_DIMENSION, site.origin_m
            write_clouds(site.clouds(), site.count, folder / CLOUDS[0], origin_m, last[0])
            if tiles is not None:
                with LazFile(folder / CLOUDS[1], site.box_m[0], origin_m, last, site.crs) as laz:
                    for cloud in site.clouds():
                        laz.add(cloud)
                write_rasters(tiles.surfaces(out), tiles.whole, origin_m, folder, site.crs)
            site = write_extras(site, extras or ExtraOptions(), folder)
            write_page(site, folder / "site.html")
            (folder / "adjustment.json").write_text(
                json.dumps(adjustment_document(site), indent=1, allow_nan=False)
            )
            (folder / "site.json").write_text(
                json.dumps(site_document(site), indent=1, allow_nan=False)
            )
            withdraw(out)
            for name in FILES:  # site.json last: it tells of all others
                if name == OCTREE and tiles is not None:
                    continue  # a task made it there
                _remove(out / name)  # of a cloud without points, or not asked for, there is none
                if (folder / name).exists():
                    (folder / name).replace(out / name)
    except OSError as error:
        raise OutputError(in_words(error, out)) from error
    return site


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
