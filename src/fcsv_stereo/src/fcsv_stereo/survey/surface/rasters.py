# SPDX-License-Identifier: Apache-2.0
"""The site from above, made by tiles: digital surface model and orthophoto as cloud-optimised
GeoTIFF (GDAL, by rasterio)."""

import contextlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, Sequence, Tuple

import numpy as np
import rasterio
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import RasterioError
from rasterio.shutil import copy
from rasterio.transform import Affine
from rasterio.windows import Window
from scipy.spatial import cKDTree

from fcsv_stereo.model import Cloud
from fcsv_stereo.products.from_above import NEIGHBOURS, cell_of_m, closed
from fcsv_stereo.survey.surface.quantiles import quantiles

RASTERS = ("dsm.tif", "orthophoto.tif")
_MOST_CELLS = 8000  # along the longer side
_KEPT_SHARES = (0.001, 0.999)  # of x and of y: a stray point must not make the raster large
_MOST_READ = 4096  # along the longer side: of a thinned surface
_SPACED = 4000  # points whose neighbours tell the cells' size
_BLOCK = 512
_CACHE_MB = 64  # GDAL's own bound is a share of the machine
#: Of points in one cell the one counts that is surely highest: its height less so many sigma.
_SURE_SIGMAS = 2.0
#: Cells about a window on which the cells in it depend: gaps close over 4, by neighbours within 5.
HALO = 10
_RGBA = ("red", "green", "blue", "alpha")
_LOCAL = 'LOCAL_CS["site",UNIT["metre",1]]'


@dataclass(frozen=True)
class CellGrid:
    """Cells of ``cell_m``: those from ``first`` to ``last`` (2,), which are x and y in cells, less
    the site's origin."""

    cell_m: float
    first: Tuple[int, int]
    last: Tuple[int, int]

    @property
    def shape(self) -> Tuple[int, int]:
        """Rows and columns."""
        return self.last[1] - self.first[1] + 1, self.last[0] - self.first[0] + 1

    def cells(self, points: np.ndarray) -> np.ndarray:
        """(N,2) x and y in cells, of points (N,3) m."""
        return np.floor(points[:, :2].astype(float) / self.cell_m).astype(int)

    def grown(self) -> "CellGrid":
        """Adds the cells about it that may fill its gaps."""
        (x0, y0), (x1, y1) = self.first, self.last
        return CellGrid(self.cell_m, (x0 - HALO, y0 - HALO), (x1 + HALO, y1 + HALO))

    def common(self, other: "CellGrid") -> "CellGrid":
        """The cells that are in both."""
        first = (max(self.first[0], other.first[0]), max(self.first[1], other.first[1]))
        last = (min(self.last[0], other.last[0]), min(self.last[1], other.last[1]))
        return CellGrid(self.cell_m, first, last)

    def part(self, of: "CellGrid") -> Tuple[slice, slice]:
        """Where rows and columns of this one are in an array of a grid around it."""
        row, column = of.last[1] - self.last[1], self.first[0] - of.first[0]
        return slice(row, row + self.shape[0]), slice(column, column + self.shape[1])


def grid_of(clouds: Callable[[], Iterable[Cloud]]) -> CellGrid:
    """The grid of clouds, which are gone through several times, one after the other."""
    low, high = quantiles(lambda: (c.points_home_m[:, :2] for c in clouds()), _KEPT_SHARES)
    cell_m = cell_of_m(_apart_m(clouds), float((high - low).max()), _MOST_CELLS)
    first, last = (tuple(map(int, np.floor(v / cell_m))) for v in (low, high))
    return CellGrid(cell_m, first, last)


def _apart_m(clouds: Callable[[], Iterable[Cloud]]) -> np.ndarray:
    """(S,) m, how far some points are from their fourth neighbours, seen from above."""
    count, before = sum(map(len, clouds())), 0
    chosen = np.random.default_rng(0).choice(count, min(count, _SPACED), replace=False)
    some = np.empty((len(chosen), 2))
    for cloud in clouds():
        of = (chosen >= before) & (chosen < before + len(cloud))
        some[of] = cloud.points_home_m[chosen[of] - before, :2]
        before += len(cloud)
    nearest = np.full((len(some), NEIGHBOURS), np.inf)
    for cloud in clouds():
        tree = cKDTree(cloud.points_home_m[:, :2].astype(float))
        found = tree.query(some, k=range(1, NEIGHBOURS + 1))[0]  # infinite: there are not so many
        nearest = np.sort(np.hstack([nearest, found]), axis=1)[:, :NEIGHBOURS]
    return nearest[:, min(NEIGHBOURS, count) - 1]


@dataclass(frozen=True)
class Surface:
    """(H,W) each: ``height`` m, ``sigma`` m, ``views``, NaN where nothing was seen, and ``rgb``
    (H,W,3) uint8. Row 0 lies at the largest y."""

    height: np.ndarray
    sigma: np.ndarray
    views: np.ndarray
    rgb: np.ndarray

    @classmethod
    def empty(cls, shape: Tuple[int, int]) -> "Surface":
        """Nothing was seen."""
        bands = (np.full(shape, np.nan, np.float32) for _ in range(3))
        return cls(*bands, np.zeros((*shape, 3), np.uint8))


class Highest:
    """The highest point, by ``key`` (N,), of each cell of a window, of clouds one after the other:
    of equal ones the last."""

    def __init__(self, window: CellGrid, origin_m: np.ndarray):
        self._window, self._origin_m = window, origin_m
        self._key = np.full(window.shape, -np.inf)
        self.surface = Surface.empty(window.shape)

    def add(self, cloud: Cloud, key: np.ndarray) -> None:
        """Looks at another cloud."""
        w, s = self._window, self.surface
        column, row = (w.cells(cloud.points_home_m) - w.first).T
        row = w.shape[0] - 1 - row
        inside = (column >= 0) & (column < w.shape[1]) & (row >= 0) & (row < w.shape[0])
        of = np.flatnonzero(inside)
        of = of[np.argsort(key[of], kind="stable")]
        index = np.full(w.shape, -1)
        index[row[of], column[of]] = of  # the highest is written last
        better = (index >= 0) & (np.where(index >= 0, key[index], 0.0) >= self._key)
        at = index[better]
        self._key[better] = key[at]
        s.height[better] = cloud.points_home_m[at, 2].astype(float) + self._origin_m[2]
        s.sigma[better], s.views[better] = cloud.sigma_m[at], cloud.baseline_index[at]
        s.rgb[better] = cloud.colors[at]


def surface_of(clouds: Iterable[Cloud], window: CellGrid, origin_m: np.ndarray) -> Surface:
    """The highest sure point of each cell of a window; gaps between close points take the nearest,
    as they do without a window."""
    around = window.grown()
    highest = Highest(around, origin_m)
    for cloud in clouds:
        z = cloud.points_home_m[:, 2].astype(float)
        highest.add(cloud, z - _SURE_SIGMAS * cloud.sigma_m)
    surface = highest.surface
    seen = np.isfinite(surface.height)
    index = np.where(seen, np.arange(seen.size).reshape(seen.shape), np.nan)
    if seen.sum() >= NEIGHBOURS:
        index = closed(index, np.zeros((*seen.shape, 3), np.uint8), seen)[0]
    index = index[window.part(around)]
    seen, at = np.isfinite(index), np.nan_to_num(index).astype(int)
    bands = (getattr(surface, f.name) for f in fields(Surface))
    *numbers, rgb = (b.reshape(-1, *b.shape[2:])[at] for b in bands)
    return Surface(*(np.where(seen, b, np.nan) for b in numbers), np.where(seen[..., None], rgb, 0))


def write_rasters(
    tiles: Iterable[Tuple[CellGrid, Surface]],
    whole: CellGrid,
    origin_m: np.ndarray,
    folder: Path,
    crs: str = "",
) -> None:
    """``RASTERS`` of the tiles, one tile in memory at a time. The first: bands height, sigma (m),
    views, NaN where nothing was seen; the second: red, green, blue, alpha. Both are cloud-optimised
    GeoTIFF; without ``crs`` of a local system in metres. Raises OSError."""
    corner_m = (
        whole.first[0] * whole.cell_m + origin_m[0],
        (whole.last[1] + 1) * whole.cell_m + origin_m[1],
    )
    dsm_bands = ("height (m)", "sigma (m)", "views")
    place = whole.shape, whole.cell_m, corner_m, crs
    with _cog(folder / RASTERS[0], dsm_bands, np.float32, *place) as dsm, _cog(
        folder / RASTERS[1], _RGBA, np.uint8, *place
    ) as ortho:
        for cells, s in tiles:
            where = Window.from_slices(*cells.part(whole))
            dsm.write(np.stack([s.height, s.sigma, s.views]), window=where)
            alpha = np.where(np.isfinite(s.height), 255, 0).astype(np.uint8)
            ortho.write(np.concatenate([s.rgb.transpose(2, 0, 1), alpha[None]]), window=where)


@contextlib.contextmanager
def _cog(
    path: Path,
    bands: Sequence[str],
    kind: type,
    shape: Tuple[int, int],
    cell_m: float,
    corner_m: Tuple[float, float],
    crs: str,
) -> Iterator[Any]:
    """A dataset that is written by windows, and is ``path`` when the block is left: as of
    ``write_cog``."""
    picture, raw = tuple(bands) == _RGBA, path.with_name(f".{path.name}.raw")
    profile = {
        "driver": "GTiff",
        "dtype": np.dtype(kind).name,
        "count": len(bands),
        "height": shape[0],
        "width": shape[1],
        "crs": rasterio.crs.CRS.from_user_input(crs or _LOCAL),
        "transform": Affine(cell_m, 0.0, corner_m[0], 0.0, -cell_m, corner_m[1]),
        "nodata": None if picture else np.nan,
        "tiled": True,
        "blockxsize": _BLOCK,
        "blockysize": _BLOCK,
        "sparse_ok": True,
        "bigtiff": "IF_SAFER",
    }
    try:
        with rasterio.Env(GDAL_CACHEMAX=_CACHE_MB):
            with rasterio.open(raw, "w", **profile) as made:
                yield made
                made.descriptions = tuple(bands)
                if picture:
                    made.colorinterp = [ColorInterp[name] for name in _RGBA]
            copy(str(raw), str(path), driver="COG", compress="DEFLATE", blocksize=_BLOCK)
    except RasterioError as error:
        raise OSError(f"{path}: {error}") from error
    finally:
        raw.unlink(missing_ok=True)


def write_cog(
    path: Path, bands: Dict[str, np.ndarray], cell_m: float, corner_m: Tuple[float, float], crs: str
) -> None:
    """Cloud-optimised GeoTIFF of ``bands`` (H,W) by what they hold, whose row 0 lies at the largest
    y; ``corner_m``: x, y of the outer corner of the first cell. NaN is "no data"; four bands red,
    green, blue, alpha are a picture. Without ``crs`` the system is local, in metres. Raises
    OSError."""
    values = np.stack(list(bands.values()))
    with _cog(path, tuple(bands), values.dtype, values.shape[1:], cell_m, corner_m, crs) as made:
        made.write(values)


@dataclass(frozen=True)
class Rasters:
    """A surface, its cells' side, and x, y of the outer corner of the first one."""

    surface: Surface
    cell_m: float
    corner_m: Tuple[float, float]


def read_rasters(folder: Path) -> Rasters:
    """What ``write_rasters`` wrote, of large ones each n-th cell."""
    dsm, ortho = (rasterio.open(folder / name) for name in RASTERS)
    with dsm, ortho:
        n = -(-max(dsm.shape) // _MOST_READ)
        shape = tuple(-(-s // n) for s in dsm.shape)
        bands, rgb = (
            d.read([1, 2, 3], out_shape=(3, *shape), resampling=Resampling.nearest)
            for d in (dsm, ortho)
        )
        transform = dsm.transform
    surface = Surface(*bands, np.ascontiguousarray(rgb.transpose(1, 2, 0)))
    return Rasters(surface, transform.a * n, (transform.c, transform.f))
