# SPDX-License-Identifier: Apache-2.0
"""The map from above: an orthophoto (PNG with world file) and a height map (GeoTIFF), both of the
highest points.

Map coordinates are those of home: x (forward) to the right, y (left) upwards, metres. So every GIS
reads them without a rotation; the vehicles look to the right.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fcsv_stereo.model import Cloud, Reference
from fcsv_stereo.model.inputs import NO_SHIFT
from fcsv_stereo.products import spanned

_MOST_CELLS = 1500  # along the longer side
_LEAST_CELL_M = 0.01
NEIGHBOURS = 5  # of a point, itself the first
_CLOSE_CELLS = 5.0  # four neighbours within so many
_KEPT_PERCENT = (0.1, 99.9)  # of x and of y: a stray point must not make the map coarse
_CITATION = "home of the stereo session: x forward, y left, z up, metres|"


@dataclass(frozen=True)
class Raster:
    """``height`` (H,W) float32 m above home, NaN where nothing was seen; ``rgb`` (H,W,3) uint8
    likewise 0.

    Row 0 lies at the largest y. ``x0_m``, ``y0_m``: the outer corner of the first cell.
    """

    height: np.ndarray
    rgb: np.ndarray
    cell_m: float
    x0_m: float
    y0_m: float


def write_from_above(
    cloud: Cloud,
    folder: Path,
    reference: Optional[Reference] = None,
    origin_m: np.ndarray = NO_SHIFT,
) -> Raster:
    """orthophoto.png, orthophoto.pgw, height.tif; ``reference`` as in rasterize. The raster is in
    the cloud's coordinates, the files in those plus ``origin_m``."""
    raster = rasterize(cloud, reference=reference)
    alpha = np.where(np.isfinite(raster.height), 255, 0).astype(np.uint8)
    bgra = np.dstack([raster.rgb[..., ::-1], alpha])
    if not cv2.imwrite(str(folder / "orthophoto.png"), bgra):
        raise OSError("orthophoto.png was refused")
    c = raster.cell_m
    lines = (c, 0.0, 0.0, -c, raster.x0_m + origin_m[0] + c / 2, raster.y0_m + origin_m[1] - c / 2)
    (folder / "orthophoto.pgw").write_text("".join(f"{v:.6f}\n" for v in lines))
    _write_height(raster, folder / "height.tif", origin_m)
    return raster


def rasterize(cloud: Cloud, cell_m: float = 0.0, reference: Optional[Reference] = None) -> Raster:
    """The highest point of every cell. With a ``reference`` picture every cell that its pixels'
    surfaces touch (``spanned``). Between close points that no pixel of it shows the nearest fills.

    ``cell_m`` 0 takes 1, 2 or 5 times a power of ten: as fine as most points are dense, 1500 cells
    a side at most.
    """
    p = cloud.points_home_m.astype(float)
    low, high = np.percentile(p[:, :2], _KEPT_PERCENT, axis=0)
    cell_m = cell_m or cell_size_m(p[:, :2], float((high - low).max()))
    (x_first, y_first), (x_last, y_last) = (
        np.floor(low / cell_m).astype(int),
        np.floor(high / cell_m).astype(int),
    )
    shape = y_last - y_first + 1, x_last - x_first + 1
    x, y = np.floor(p[:, :2] / cell_m).astype(int).T
    row, column = y_last - y, x - x_first
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
    # the highest is written last
    order = np.flatnonzero(inside)[np.argsort(p[inside, 2], kind="stable")]
    height = np.full(shape, np.nan, np.float32)
    rgb = np.zeros((*shape, 3), np.uint8)
    height[row[order], column[order]] = p[order, 2]
    rgb[row[order], column[order]] = cloud.colors[order]
    origin = float(x_first * cell_m), float((y_last + 1) * cell_m)
    if reference is not None:
        surfaces = spanned.Surfaces.of(cloud, reference)
        inside[surfaces.index[surfaces.index >= 0]] = False
        spanned.span(cloud, surfaces, reference, origin, cell_m, height, rgb)
    loose = np.zeros(shape, bool)
    loose[row[inside], column[inside]] = True
    return Raster(*closed(height, rgb, loose), cell_m, *origin)


def cell_size_m(xy_m: np.ndarray, extent_m: float, most_cells: int = _MOST_CELLS) -> float:
    """1, 2 or 5 times a power of ten, so that three points (N,2) in four have four neighbours
    within a cell's side; at most ``most_cells`` along ``extent_m``."""
    some = xy_m[np.random.default_rng(0).permutation(len(xy_m))[:4000]]
    neighbours = min(NEIGHBOURS, len(xy_m))
    return cell_of_m(cKDTree(xy_m).query(some, k=[neighbours])[0], extent_m, most_cells)


def cell_of_m(apart_m: np.ndarray, extent_m: float, most_cells: int) -> float:
    """The same of how far some points are from their fourth neighbours."""
    least = max(extent_m / most_cells, float(np.percentile(apart_m, 75)), _LEAST_CELL_M)
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= least * (1 - 1e-6)))


def closed(height: np.ndarray, rgb: np.ndarray, known: np.ndarray):
    """Heights (H,W), NaN where none, and colours (H,W,3): cells between ``known`` ones take the
    nearest one's value where these lie close; a lone one stays one cell."""
    if not known.any():
        return height, rgb
    cells = np.argwhere(known)
    neighbours = min(NEIGHBOURS, len(cells))
    apart = (
        cKDTree(cells).query(cells, k=[neighbours])[0][:, 0]
        if neighbours > 1
        else np.ones(len(cells))
    )
    reach = np.zeros(height.shape, np.float32)
    reach[known] = np.where(apart <= _CLOSE_CELLS, 0.75 * apart, 0.0)
    distance, label = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.zeros(int(label.max()) + 1, np.int64)
    nearest[label[known]] = np.flatnonzero(known)
    source = nearest[label].ravel()
    near = distance.ravel() <= reach.ravel()[source]
    source = np.where(near & ~np.isfinite(height.ravel()), source, np.arange(height.size))
    filled, colour = height.ravel()[source], rgb.reshape(-1, 3)[source]
    return filled.reshape(height.shape), colour.reshape(rgb.shape)


def _write_height(raster: Raster, path: Path, origin_m: np.ndarray) -> None:
    """The height map; float32, or float64 where heights are far from home's."""
    height = raster.height.astype(float) + origin_m[2] if origin_m[2] else raster.height
    write_geotiff(path, height, raster.cell_m, raster.x0_m + origin_m[0], raster.y0_m + origin_m[1])


def write_geotiff(path: Path, values: np.ndarray, cell_m: float, x0_m: float, y0_m: float) -> None:
    """GeoTIFF 1.1 with a user-defined (local) coordinate system, cells as areas, NaN where nothing
    was seen.

    Row 0 of ``values`` (H,W) lies at the largest y; ``x0_m``, ``y0_m``: the outer corner of its
    first cell.
    """
    import tifffile  # only where the product is asked for

    user_defined, pixel_is_area = 32767, 1
    keys = [
        1,
        1,
        1,
        4,
        1024,
        0,
        1,
        user_defined,
        1025,
        0,
        1,
        pixel_is_area,
        1026,
        34737,
        len(_CITATION),
        0,
        3076,
        0,
        1,
        9001,
    ]
    tags = [
        (33550, "d", 3, (cell_m, cell_m, 0.0), False),
        (33922, "d", 6, (0.0, 0.0, 0.0, x0_m, y0_m, 0.0), False),
        (34735, "H", len(keys), keys, False),
        (34737, "s", 0, _CITATION, False),
        (42113, "s", 0, "nan", False),
    ]
    tifffile.imwrite(
        path, values, compression="zlib", extratags=tags, metadata=None, software=False
    )
