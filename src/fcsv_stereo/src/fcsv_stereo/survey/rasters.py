# SPDX-License-Identifier: Apache-2.0
"""The site from above: digital surface model and orthophoto as cloud-optimised GeoTIFF (GDAL, by
rasterio)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Tuple

import numpy as np

from fcsv_stereo.model import Cloud
from fcsv_stereo.products.from_above import cell_size_m, closed

_MOST_CELLS = 8000  # along the longer side
_KEPT_PERCENT = (0.1, 99.9)  # of x and of y: a stray point must not make the raster large
_BLOCK = 512
#: Of points in one cell the one counts that is surely highest: its height less so many sigma.
_SURE_SIGMAS = 2.0
_RGBA = ("red", "green", "blue", "alpha")
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
    corner_m = surface.x0_m, surface.y0_m
    dsm_bands = {"height (m)": surface.height, "sigma (m)": surface.sigma, "views": surface.views}
    write_cog(dsm, dsm_bands, surface.cell_m, corner_m, crs)
    alpha = np.where(np.isfinite(surface.height), 255, 0).astype(np.uint8)
    rgba = dict(zip(_RGBA, (*surface.rgb.transpose(2, 0, 1), alpha)))
    write_cog(ortho, rgba, surface.cell_m, corner_m, crs)


def write_cog(
    path: Path, bands: Dict[str, np.ndarray], cell_m: float, corner_m: Tuple[float, float], crs: str
) -> None:
    """Cloud-optimised GeoTIFF of ``bands`` (H,W) by what they hold, whose row 0 lies at the largest
    y; ``corner_m``: x, y of the outer corner of the first cell. NaN is "no data"; four bands red,
    green, blue, alpha are a picture. Without ``crs`` the system is local, in metres. Raises
    OSError."""
    import rasterio
    from rasterio.enums import ColorInterp
    from rasterio.errors import RasterioError
    from rasterio.shutil import copy
    from rasterio.transform import Affine

    values, picture = np.stack(list(bands.values())), tuple(bands) == _RGBA
    profile = {
        "driver": "GTiff",
        "dtype": values.dtype.name,
        "count": len(values),
        "height": values.shape[1],
        "width": values.shape[2],
        "crs": rasterio.crs.CRS.from_user_input(crs or _LOCAL),
        "transform": Affine(cell_m, 0.0, corner_m[0], 0.0, -cell_m, corner_m[1]),
        "nodata": None if picture else np.nan,
    }
    try:
        with rasterio.MemoryFile() as memory:
            with memory.open(**profile) as made:
                made.write(values)
                made.descriptions = tuple(bands)
                if picture:
                    made.colorinterp = [ColorInterp[name] for name in _RGBA]
            with memory.open() as made:
                copy(made, str(path), driver="COG", compress="DEFLATE", blocksize=_BLOCK)
    except RasterioError as error:
        raise OSError(f"{path}: {error}") from error
