# SPDX-License-Identifier: Apache-2.0
"""Height of the ground under a mission, from a GeoTIFF: a surface model of `survey`, or another one.

A raster in a reference system of the earth is laid under home by the mission's `home_fix`; one
without (a survey's of local metres) is in home itself, x and y. Only heights against the take-off
place count, so that neither ellipsoid nor geoid matters; a surface errs by its sigma, and what grew
since.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Optional, Tuple

import numpy as np

from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.stations import HomeFix

_MOST_CELLS = 200_000_000
_HOME_RADIUS_M = 3.0  # the take-off place is so near to home


@dataclass(frozen=True)
class Terrain:
    """``height_m`` (H,W) above the take-off place, NaN where it is not known; ``cell_of`` gives
    columns and rows of places x, y (m) in home."""

    height_m: np.ndarray
    cell_of: Callable[[np.ndarray, np.ndarray], Tuple[np.ndarray, np.ndarray]]

    def at(self, xy_m: np.ndarray) -> np.ndarray:
        """(N,) highest ground (m above the take-off place) in the cells about places (N, 2) in home;
        NaN where it is not known."""
        columns, rows = self.cell_of(*np.asarray(xy_m, float).T)
        found = np.full(len(columns), -np.inf)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                found = np.fmax(found, self._cells(columns + dx, rows + dy))
        known = np.isfinite(self._cells(columns, rows))
        return np.where(known, found, np.nan)

    def _cells(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        height, width = self.height_m.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
        return np.where(inside, self.height_m[rows, columns], np.nan)


def read_terrain(path: Path, fix: Optional[HomeFix]) -> Terrain:
    """The first band of a GeoTIFF. Raises MissionError naming the file and what is wrong: it cannot
    be read, needs a `home_fix`, or does not know the ground at home."""
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(path) as raster:
            if raster.width * raster.height > _MOST_CELLS:
                raise MissionError(f"terrain: {path} is too large; cut it to the fence")
            band = raster.read(1, masked=True).astype(np.float32).filled(np.nan)
            crs, to_cell = raster.crs, ~raster.transform
    except (RasterioError, OSError) as error:
        raise MissionError(f"terrain: {path} cannot be read ({error}); give a GeoTIFF") from error
    on_earth = crs is not None and (crs.is_geographic or crs.is_projected)
    if on_earth and fix is None:
        raise MissionError(f"terrain: {path} is in {crs}: give the mission's home_fix, too")

    def cell_of(x_m: np.ndarray, y_m: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        x, y = _on_earth(x_m, y_m, fix, crs) if on_earth else (x_m, y_m)
        columns = to_cell.a * x + to_cell.b * y + to_cell.c
        rows = to_cell.d * x + to_cell.e * y + to_cell.f
        return np.floor(columns).astype(int), np.floor(rows).astype(int)

    terrain = Terrain(band, cell_of)
    at_home = terrain.at(_about_home())
    if not np.isfinite(at_home).any():
        raise MissionError(f"terrain: {path} does not know the ground at home, x 0, y 0 m")
    return Terrain(band - float(np.nanmedian(at_home)), cell_of)


def _about_home() -> np.ndarray:
    """Places (N, 2) about home, one of which is the take-off place."""
    line = np.linspace(-_HOME_RADIUS_M, _HOME_RADIUS_M, 7)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def _on_earth(x_m: np.ndarray, y_m: np.ndarray, fix: HomeFix, crs) -> Tuple[np.ndarray, np.ndarray]:
    """Places of home in a reference system, by the plane that touches the ellipsoid at home."""
    from rasterio.crs import CRS
    from rasterio.warp import transform

    c, s = math.cos(math.radians(fix.course_deg)), math.sin(math.radians(fix.course_deg))
    north_m, east_m = c * x_m + s * y_m, s * x_m - c * y_m
    at = f"+lat_0={fix.latitude_deg!r} +lon_0={fix.longitude_deg!r}"
    plane = CRS.from_string(f"+proj=ortho {at} +datum=WGS84 +units=m")
    x, y = transform(plane, crs, east_m.tolist(), north_m.tolist())
    return np.array(x), np.array(y)
