# SPDX-License-Identifier: Apache-2.0
"""Squares of a site: a task a tile makes its LAZ and its part of the rasters from the points of the
views that touch it, kept in OUT/tiles with the key of what went into them; and beside them the site's
octree, which one task makes meanwhile."""

import itertools
import json
import zlib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Set, Tuple

import numpy as np

from fcsv_geometry.programs.writing import whole_file, write_whole
from fcsv_stereo.model import Cloud, Progress
from fcsv_stereo.products.clouds import LazFile
from fcsv_stereo.survey.document import OCTREE, VIEWS_DIMENSION, Missing, Site, Tile, withdraw
from fcsv_stereo.survey.surface.octree import write_copc
from fcsv_stereo.survey.surface.points import ViewPoints, kept_attributes, read_arrays, write_arrays
from fcsv_stereo.survey.surface.rasters import HALO, CellGrid, Surface, grid_of, surface_of
from fcsv_stereo.survey.tasks.crew import Crew, SurveyTask, completed
from fcsv_stereo.survey.views.view_file import digest

TILES = "tiles"
_ENDINGS = ("laz", "zarr.zip")
_SIDE = 512  # cells
_AT_ONCE = 1 << 20  # bytes

Square = Tuple[int, int]


@dataclass(frozen=True)
class TileInput:
    """A square by its number along x and y, the views that touch it or the cells about it, the grid
    of the site, its origin (3,) m and reference system. A square at the border has the points
    beyond it, too."""

    square: Square
    parts: Tuple[ViewPoints, ...]
    whole: CellGrid
    origin_m: np.ndarray
    crs: str

    @property
    def name(self) -> str:
        """It stays when the site grows.

        >>> TileInput((-1, 2), (), None, None, "").name
        'x-1_y2'
        """
        return "x{}_y{}".format(*self.square)

    @property
    def window(self) -> CellGrid:
        """Its cells."""
        x, y = (_SIDE * n for n in self.square)
        return CellGrid(self.whole.cell_m, (x, y), (x + _SIDE - 1, y + _SIDE - 1))

    @property
    def key(self) -> str:
        """Key of all that the tile is made of."""
        ends = [[n == end for n, end in zip(self.square, side)] for side in _ends(self.whole)]
        place = [self.whole.cell_m, self.square, ends, self.origin_m.tolist(), self.crs]
        return digest([[p.key for p in self.parts], place])

    def path(self, out: Path, ending: str) -> Path:
        """Where it is kept."""
        return out.absolute() / TILES / f"{self.name}.{ending}"

    def own(self, cloud: Cloud) -> Cloud:
        """The cloud's points in the square."""
        return cloud[(_squares(self.whole, cloud.points_home_m) == self.square).all(axis=1)]


def _ends(whole: CellGrid) -> Tuple[Square, Square]:
    first, last = (tuple(n // _SIDE for n in of) for of in (whole.first, whole.last))
    return first, last


def _squares(whole: CellGrid, points: np.ndarray, cells: int = 0) -> np.ndarray:
    """(N,2) numbers of the squares of points (N,3), moved by so many ``cells``."""
    return np.clip((whole.cells(points) + cells) // _SIDE, *_ends(whole))


def touched(parts: Iterable[ViewPoints], whole: CellGrid) -> Dict[Square, List[ViewPoints]]:
    """The squares that hold points, and of each the views that have some in it or in the cells
    about it, of which one is in memory at a time."""
    owned: Set[Square] = set()
    found: Dict[Square, List[ViewPoints]] = {}
    for part in parts:
        points = part.load().points_home_m
        owned |= _distinct(_squares(whole, points))
        moves = itertools.product((-HALO, HALO), repeat=2)
        for square in set().union(*(_distinct(_squares(whole, points, m)) for m in moves)):
            found.setdefault(square, []).append(part)
    return {square: found[square] for square in sorted(owned)}


def _distinct(squares: np.ndarray) -> Set[Square]:
    in_one = squares @ np.array([1, 1j])  # numpy takes ten times as long to sort rows
    return {(int(s.real), int(s.imag)) for s in np.unique(in_one)}


def make_tile(given: TileInput, out: Path) -> None:
    """A task: a tile's LAZ, and its part of the rasters; one view is in memory at a time."""
    note = given.path(out, "zarr.zip")
    withdraw(out)
    note.unlink(missing_ok=True)  # a tile without it is made again
    clouds = (p.load() for p in given.parts)
    surface = surface_of(clouds, given.window, given.origin_m)
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    laz = given.path(out, "laz")
    corner_m = np.array([*np.array(given.window.first) * given.window.cell_m, 0.0])
    with LazFile(laz, corner_m, given.origin_m, VIEWS_DIMENSION, given.crs) as file:
        for part in given.parts:
            cloud = given.own(part.load())
            if len(cloud):
                file.add(cloud)
                count += len(cloud)
                low = np.minimum(low, cloud.points_home_m.min(axis=0))
                high = np.maximum(high, cloud.points_home_m.max(axis=0))
    box = [(v.astype(float) + given.origin_m).tolist() for v in (low, high)]
    told = {"count": count, "low_m": box[0], "high_m": box[1]}
    arrays = {f.name: getattr(surface, f.name) for f in fields(Surface)}
    write_arrays(arrays, {"key": given.key, "tile": told, "laz": _crc32(laz)}, note)


def _crc32(path: Path) -> Optional[int]:
    """Checksum of a file; None where it cannot be read."""
    sum_ = 0
    try:
        with path.open("rb") as file:
            while part := file.read(_AT_ONCE):
                sum_ = zlib.crc32(part, sum_)
    except OSError:
        return None
    return sum_


def _kept(given: TileInput, out: Path) -> Optional[Tile]:
    """The tile as an earlier survey left it; None where it is of something else, or not whole."""
    laz = given.path(out, "laz")
    told = kept_attributes(given.path(out, "zarr.zip"), given.key)
    if told is None or told.get("laz", 0) != _crc32(laz):
        return None
    return Tile(given.name, [f"{TILES}/{laz.name}"], **told["tile"])


@dataclass(frozen=True)
class OctreeInput:
    """The views of a site, the corners (2,3) m of their points less ``origin_m`` (3,), its reference
    system."""

    parts: Tuple[ViewPoints, ...]
    box_m: np.ndarray
    origin_m: np.ndarray
    crs: str

    @property
    def key(self) -> str:
        """Key of all that the octree is made of."""
        return digest([[p.key for p in self.parts], self.origin_m.tolist(), self.crs])

    def is_kept(self, out: Path) -> Optional[bool]:
        """True; None where OUT's octree is of something else, or not whole."""
        try:
            told = json.loads(_octree_note(out).read_text())
            return told == {"key": self.key, "laz": _crc32(out / OCTREE)} or None
        except (OSError, ValueError):
            return None


def _octree_note(out: Path) -> Path:
    return out / TILES / f"{OCTREE}.json"


def make_octree(given: OctreeInput, out: Path) -> None:
    """A task: the site's octree; points of one view after the other are in memory."""

    def clouds() -> Iterator[Cloud]:
        return (p.load() for p in given.parts)

    withdraw(out)
    _octree_note(out).unlink(missing_ok=True)
    with whole_file(out / TILES / OCTREE) as partial:
        write_copc(clouds, given.box_m, partial, given.origin_m, given.crs)
    (out / TILES / OCTREE).replace(out / OCTREE)
    document = {"key": given.key, "laz": _crc32(out / OCTREE)}
    write_whole(_octree_note(out), json.dumps(document))


@dataclass(frozen=True)
class SiteTiles:
    """The grid of a site, and the tiles that are there."""

    whole: CellGrid
    made: List[TileInput]

    def surfaces(self, out: Path) -> Iterator[Tuple[CellGrid, Surface]]:
        """Each tile's cells in the grid, and its part of the rasters. Raises OSError."""
        for given in self.made:
            names = [f.name for f in fields(Surface)]
            arrays = read_arrays(given.path(out, "zarr.zip"), names)
            cells = given.window.common(self.whole)
            part = cells.part(given.window)
            yield cells, Surface(**{name: values[part] for name, values in arrays.items()})


def make_tiles(
    site: Site, out: Path, crew: Crew, progress: Progress
) -> Tuple[Site, Optional[SiteTiles]]:
    """The site with its tiles, None where it has no points: kept ones, and those that the crew
    makes; and OUT's octree. What could not be made is missing; what is of another site is
    removed."""
    if not site.count:
        _remove_others(out)
        _octree_note(out).unlink(missing_ok=True)
        return site, None
    whole = grid_of(site.clouds)
    given = [
        TileInput(square, tuple(parts), whole, site.origin_m, site.crs)
        for square, parts in touched(site.joined.values(), whole).items()
    ]
    octree = OctreeInput(tuple(site.parts()), site.box_m, site.origin_m, site.crs)
    tasks = [SurveyTask(OCTREE, make_octree, (octree, out.absolute()))]  # it takes longest
    tasks += [SurveyTask(f"tile {g.name}", make_tile, (g, out.absolute())) for g in given]

    def kept(i: int) -> Any:
        return _kept(given[i - 1], out) if i else octree.is_kept(out)

    (_, *found), errors = completed(crew, tasks, kept, progress, "making tiles")
    missing = [Missing(tasks[i].name, "", said) for i, said in errors.items()]
    made = [g for i, g in enumerate(given, 1) if i not in errors]
    _remove_others(out, [g.path(out, ending) for g in made for ending in _ENDINGS])
    if 0 in errors:
        (out / OCTREE).unlink(missing_ok=True)
    tiles = [t for t in found if t is not None]
    return replace(site, tiles=tiles, missing=[*site.missing, *missing]), SiteTiles(whole, made)


def _remove_others(out: Path, files: Sequence[Path] = ()) -> None:
    """Removes all tiles but these ``files``; what is named otherwise is not a survey's."""
    for path in (p for e in _ENDINGS for p in (out / TILES).glob(f"x*_y*.{e}")):
        if path.absolute() not in files and not path.is_dir():
            withdraw(out)
            path.unlink()
