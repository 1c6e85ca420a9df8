# SPDX-License-Identifier: Apache-2.0
"""The site from above: digital surface model and orthophoto as cloud-optimised GeoTIFF (GDAL, by
rasterio)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fcsv_stereo.model import Cloud
from fcsv_stereo.products.from_above import cell_size_m, closed

_MOST_CELLS = 8000  # along the longer side
_KEPT_PERCENT = (0.1, 99.9)  # of x and of y: a stray point must not make the raster large
_BLOCK = 512
#: Of points in one cell the one counts that is surely highest: its height less so many sigma.
_SURE_SIGMAS = 2.0
_LOCAL = 'LOCAL_CS["site",UNIT["metre",1]]'


@dataclass(frozen=True)
class Surface:
    """(H,W) each: ``height`` m, ``sigma`` m, ``views``, NaN where nothing was seen, and ``rgb``
    (H,W,3) uint8. Row 0 lies at the largest y; ``x0_m``, ``y0_m``: the outer corner of its first
    cell."""

    height: np.ndarray
    sigma: np.ndarray
    views: np.ndarray
    rgb: np.ndarray
    cell_m: float
    x0_m: float
    y0_m: float


def surface_of(cloud: Cloud, origin_m: np.ndarray) -> Surface:
    """The highest sure point of each cell; gaps between close points take the nearest."""
    p = cloud.points_home_m.astype(float)
    low, high = np.percentile(p[:, :2], _KEPT_PERCENT, axis=0)
    cell_m = cell_size_m(p[:, :2], float((high - low).max()), _MOST_CELLS)
    first, last = (np.floor(v / cell_m).astype(int) for v in (low, high))
    columns, rows = last - first + 1
    column, row = (np.floor(p[:, :2] / cell_m).astype(int) - first).T
    row = rows - 1 - row
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    of = np.flatnonzero(inside)
    of = of[np.argsort(p[of, 2] - _SURE_SIGMAS * cloud.sigma_m[of], kind="stable")]
    index = np.full((rows, columns), -1)
    index[row[of], column[of]] = of  # the highest is written last
    seen = index >= 0
    index = closed(np.where(seen, index, np.nan), np.zeros((*index.shape, 3), np.uint8), seen)[0]
    seen = np.isfinite(index)
    at = np.where(seen, index, 0).astype(int)

    def band(values: np.ndarray) -> np.ndarray:
        return np.where(seen, values[at], np.nan).astype(np.float32)

    return Surface(
        band(p[:, 2] + origin_m[2]),
        band(cloud.sigma_m),
        band(cloud.baseline_index),
        np.where(seen[..., None], cloud.colors[at], 0).astype(np.uint8),
        cell_m,
        float(first[0] * cell_m + origin_m[0]),
        float((last[1] + 1) * cell_m + origin_m[1]),
    )


def write_surface(surface: Surface, dsm: Path, ortho: Path, crs: str = "") -> None:
    """``dsm``: bands height, sigma (m), views, NaN where nothing was seen. ``ortho``: red, green,
    blue, alpha. Both are cloud-optimised GeoTIFF; without ``crs`` of a local system in metres."""
    seen = np.isfinite(surface.height)
    bands = np.stack([surface.height, surface.sigma, surface.views])
    words = ("height (m)", "sigma (m)", "views")
    _write(bands, words, surface, dsm, crs, nodata=np.nan)
    alpha = np.where(seen, 255, 0).astype(np.uint8)
    rgba = np.concatenate([surface.rgb.transpose(2, 0, 1), alpha[None]])
    _write(rgba, ("red", "green", "blue", "alpha"), surface, ortho, crs)


def _write(bands: np.ndarray, words, surface: Surface, path: Path, crs: str, nodata=None) -> None:
    import rasterio
    from rasterio.enums import ColorInterp
    from rasterio.errors import RasterioError
    from rasterio.shutil import copy
    from rasterio.transform import Affine

    c = surface.cell_m
    profile = {
        "driver": "GTiff",
        "dtype": bands.dtype.name,
        "count": len(bands),
        "height": bands.shape[1],
        "width": bands.shape[2],
        "crs": rasterio.crs.CRS.from_user_input(crs or _LOCAL),
        "transform": Affine(c, 0.0, surface.x0_m, 0.0, -c, surface.y0_m),
        "nodata": nodata,
    }
    try:
        with rasterio.MemoryFile() as memory:
            with memory.open(**profile) as made:
                made.write(bands)
                made.descriptions = tuple(words)
                if nodata is None:
                    made.colorinterp = [
                        ColorInterp.red,
                        ColorInterp.green,
                        ColorInterp.blue,
                        ColorInterp.alpha,
                    ]
            with memory.open() as made:
                copy(made, str(path), driver="COG", compress="DEFLATE", blocksize=_BLOCK)
    except RasterioError as error:
        raise OSError(f"{path}: {error}") from error
