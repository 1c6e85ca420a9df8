# SPDX-License-Identifier: Apache-2.0
"""The ground in files that robots and GIS read: map_server's pair, and layers as GeoTIFF."""

from pathlib import Path
from typing import Dict, List, Optional

import cv2
import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.ground.occupancy import (
    FREE_BELOW,
    FREE_PERCENT,
    OCCUPIED_ABOVE,
    OCCUPIED_PERCENT,
    UNKNOWN,
)
from fcsv_guidance.ground.site_views import SitePlace
from fcsv_stereo.products.from_above import write_geotiff
from fcsv_stereo.survey.surface.rasters import write_cog

_TRINARY = {"free": 254, "unknown": 205, "occupied": 0}  # map_saver's greys
_HEIGHT = "height"
_LAYERS = ("height_m", "sigma_m", "roughness_m", "distance_m")


def write_map_server(
    occupied: np.ndarray, grid: Grid, folder: Path, name: str, scaled: bool = False
) -> List[Path]:
    """NAME.pgm and NAME.yaml; their paths. Scaled it is NAME.png: map_server tells what is unknown
    from grades of occupancy by transparency, which a PGM cannot hold.

    Raises OSError where the disk does not take them.
    """
    picture = _scaled(occupied) if scaled else _trinary(occupied)
    path = Path(folder) / f"{name}{'.png' if scaled else '.pgm'}"
    if not cv2.imwrite(str(path), np.ascontiguousarray(picture[::-1])):
        raise OSError(f"{path.name}: cannot be written; is the disk full?")
    lines = [
        f"image: {path.name}",
        f"resolution: {grid.cell_m:.6f}",
        f"origin: [{grid.x0_m:.6f}, {grid.y0_m:.6f}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_ABOVE:.2f}",
        f"free_thresh: {FREE_BELOW:.2f}",
        f"mode: {'scale' if scaled else 'trinary'}",
    ]
    described = path.with_suffix(".yaml")
    described.write_text("\n".join(lines) + "\n")
    return [path, described]


def _trinary(occupied: np.ndarray) -> np.ndarray:
    """uint8; what is neither surely free nor surely an obstacle is unknown to the robot."""
    grey = np.full(occupied.shape, _TRINARY["unknown"], np.uint8)
    grey[(occupied >= 0) & (occupied <= FREE_PERCENT)] = _TRINARY["free"]
    grey[occupied >= OCCUPIED_PERCENT] = _TRINARY["occupied"]
    return grey


def _scaled(occupied: np.ndarray) -> np.ndarray:
    """(rows, columns, 4) uint8: grey by occupancy; transparent where unknown, which map_server
    reads as unknown."""
    grey = np.rint(255 * (1 - np.maximum(occupied, 0) / 100.0)).astype(np.uint8)
    grey[occupied == UNKNOWN] = _TRINARY["unknown"]  # between the thresholds, which are asked first
    return np.dstack([grey, grey, grey, np.where(occupied == UNKNOWN, 0, 255).astype(np.uint8)])


def layers_of(ground: Ground, stands: np.ndarray) -> Dict[str, np.ndarray]:
    """Layers (rows, columns) by the names of their files; ``stand`` is the probability
    ``stands``."""
    return {
        **plain_layers(ground),
        "slope": ground.slope(1.5 * ground.grid.cell_m),
        "step": ground.step_m,
        "free_height": ground.free_height_m,
        "stand": stands,
    }


def plain_layers(ground: Ground) -> Dict[str, np.ndarray]:
    """Those of ``layers_of`` that are the ground's own."""
    return {name[:-2]: getattr(ground, name) for name in _LAYERS}


def write_layers(
    layers: Dict[str, np.ndarray], grid: Grid, folder: Path, place: Optional[SitePlace] = None
) -> List[Path]:
    """NAME.tif of each of ``layers_of``; NaN where unknown. Row 0 of a file lies at the largest y.
    Of a site with a ``place`` they are cloud-optimised and in its reference system. Their paths."""
    paths = []
    top_m = grid.y0_m + grid.rows * grid.cell_m
    for name, values in layers.items():
        if values.shape != grid.shape:
            raise GroundError(f"layer {name} has shape {values.shape}, not the grid's {grid.shape}")
        paths.append(Path(folder) / f"{name}.tif")
        shown = values[::-1].astype(np.float32)
        if place is None:
            write_geotiff(paths[-1], shown, grid.cell_m, grid.x0_m, top_m)
            continue
        shown = shown + np.float32(place.origin_m[2]) if name == _HEIGHT else shown
        corner_m = grid.x0_m + place.origin_m[0], top_m + place.origin_m[1]
        write_cog(paths[-1], {name: shown}, grid.cell_m, corner_m, place.crs)
    return paths
