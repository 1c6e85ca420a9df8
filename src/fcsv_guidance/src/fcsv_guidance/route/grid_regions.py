# SPDX-License-Identifier: Apache-2.0
"""Percents of nav_msgs/OccupancyGrid as arrays: what of them changed, and what a follower takes
from them."""

from dataclasses import dataclass
from typing import Optional

import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.occupancy import FREE_PERCENT
from fcsv_guidance.messages import ClearanceMap


@dataclass(frozen=True)
class Region:
    """A rectangle of a grid from ``row`` and ``column`` on, with its new ``percents`` (rows,
    columns) int8."""

    row: int
    column: int
    percents: np.ndarray


def changed_region(before: np.ndarray, after: np.ndarray) -> Optional[Region]:
    """The smallest rectangle that holds all cells that changed; None where none did."""
    rows, columns = np.nonzero(before != after)
    if not len(rows):
        return None
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    return Region(int(top), int(left), after[top:bottom, left:right])


def with_region(percents: np.ndarray, region: Region) -> np.ndarray:
    """A copy with the region in its place. Raises GroundError where it does not lie within."""
    rows, columns = region.percents.shape
    if min(region.row, region.column) < 0 or (
        region.row + rows > percents.shape[0] or region.column + columns > percents.shape[1]
    ):
        raise GroundError(
            f"an update of {rows} x {columns} cells at row {region.row}, column {region.column} is outside of the grid "
            f"of {percents.shape[0]} x {percents.shape[1]}"
        )
    changed = percents.copy()
    changed[region.row : region.row + rows, region.column : region.column + columns] = (
        region.percents
    )
    return changed


def clearance_map(stamp_s: float, grid: Grid, stands: np.ndarray) -> ClearanceMap:
    """How far each cell is from where the robot must not stand, by percents ``stands`` (rows,
    columns) of where it can; beyond the grid it must not."""
    clear_m = grid.clear_m((stands >= 0) & (stands <= FREE_PERCENT))
    return ClearanceMap(stamp_s, grid, np.maximum(clear_m, 0.0))
