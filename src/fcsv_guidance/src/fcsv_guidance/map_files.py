# SPDX-License-Identifier: Apache-2.0
"""The ground in files that robots and GIS read: map_server's pair, and layers as GeoTIFF."""

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional

import cv2
import numpy as np

from fcsv_guidance import standing, tuning
from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground import Grid, Ground, cell_probability
from fcsv_guidance.robot import Robot
from fcsv_stereo.products.from_above import write_geotiff
from fcsv_stereo.survey.rasters import write_cog

UNKNOWN = -1  # nav_msgs/OccupancyGrid
#: map_server's thresholds of occupancy: free below, occupied above, unknown between (trinary) or
#: graded (scaled)
FREE_BELOW, OCCUPIED_ABOVE = 1.0 - tuning.FREE_P, 1.0 - tuning.OBSTACLE_P
#: the same of an OccupancyGrid's values
FREE_PERCENT, OCCUPIED_PERCENT = round(100 * FREE_BELOW), round(100 * OCCUPIED_ABOVE)
_TRINARY = {"free": 254, "unknown": 205, "occupied": 0}  # map_saver's greys
_HEIGHT = "height"
_LAYERS = ("height_m", "sigma_m", "roughness_m", "distance_m")


def occupancy(
    ground: Ground, robot: Robot, stands: np.ndarray, alone: Optional[np.ndarray] = None
) -> np.ndarray:
    """(rows, columns) int8 of nav_msgs/OccupancyGrid: -1 where unknown, else 100 times 1 - p.

    A cell is free (at most FREE_PERCENT) where the robot can stand somewhere with it below its
    footprint: p is the best of ``stands`` (stand_probability) there. It is occupied (at least
    OCCUPIED_PERCENT) where it is not free and an obstacle itself. A planner inflates by the
    footprint, as ``move_base`` does, and so finds again where it can stand. ``alone``:
    cell_probability, where it is known already.
    """
    covering = standing.disk(robot.radius_m, ground.grid.cell_m)
    p = standing.most(np.where(np.isfinite(stands), stands, -1.0), covering)
    alone = cell_probability(ground, robot) if alone is None else alone
    with np.errstate(invalid="ignore"):
        obstacle = (p < tuning.FREE_P) & (alone <= tuning.OBSTACLE_P)
    # rounded up: what is below FREE_P stays above FREE_PERCENT
    percent = np.ceil(100.0 * (1.0 - np.where(obstacle, alone, p)) - 1e-3)
    percent = np.where(obstacle, percent, np.minimum(percent, OCCUPIED_PERCENT - 1))
    return np.where(ground.known & ((p >= 0) | obstacle), percent, UNKNOWN).astype(np.int8)


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
        raise OSError(f"{path}: cannot be written; is the disk full?")
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


@dataclass(frozen=True)
class SitePlace:
    """What a site's coordinates in a grid lack: ``origin_m`` (3,), which the grid leaves out, and
    the reference system ``crs``, empty for a frame of its own."""

    crs: str
    origin_m: np.ndarray


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
