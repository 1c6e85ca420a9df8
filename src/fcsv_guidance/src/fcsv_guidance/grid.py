# SPDX-License-Identifier: Apache-2.0
"""Cells of home, in which the ground is known and routes are planned."""

from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_guidance.errors import GroundError

_MOST_CELLS = 1 << 24
_LARGEST_CELL_M = 1e3
_FARTHEST_CELLS = 1e12  # from home's origin: whole numbers of float64, and their products


@dataclass(frozen=True)
class Grid:
    """Square cells in home: row 0 at the smallest y, column 0 at the smallest x; ``x0_m``,
    ``y0_m``: outer corner.

    >>> Grid(0.0, -1.0, 0.5, 4, 6).cell_of(1.2, -0.9)
    (0, 2)
    """

    x0_m: float
    y0_m: float
    cell_m: float
    rows: int
    columns: int

    def __post_init__(self):
        if not np.isfinite([self.x0_m, self.y0_m]).all() or not 0 < self.cell_m <= _LARGEST_CELL_M:
            raise GroundError(
                f"a grid at {self.x0_m}, {self.y0_m} m with cells of {self.cell_m} m cannot be laid"
            )
        if not 0 < self.rows * self.columns <= _MOST_CELLS or self.rows < 1:
            raise GroundError(
                f"a grid of {self.rows} x {self.columns} cells is empty or too large; take larger cells"
            )

    @classmethod
    def around(cls, low_m: Sequence[float], high_m: Sequence[float], cell_m: float) -> "Grid":
        """The grid from corner (x, y) to corner, on whole multiples of a cell. Raises GroundError
        where that is none, or too large."""
        with np.errstate(all="ignore"):
            low, high = np.asarray(low_m, float) / cell_m, np.asarray(high_m, float) / cell_m
        if not (np.abs([low, high]) < _FARTHEST_CELLS).all():
            raise GroundError(
                f"a grid from {low_m[0]:g}, {low_m[1]:g} to {high_m[0]:g}, {high_m[1]:g} m with cells "
                f"of {cell_m:g} m cannot be laid; take other cells"
            )
        first, last = np.floor(low), np.ceil(high)
        return cls(
            float(first[0] * cell_m),
            float(first[1] * cell_m),
            cell_m,
            *map(int, (last - first)[::-1]),
        )

    @property
    def shape(self) -> Tuple[int, int]:
        return self.rows, self.columns

    def part(self, window: Tuple[slice, slice]) -> "Grid":
        """The grid of a window (rows, columns)."""
        rows, columns = window
        x0_m = self.x0_m + columns.start * self.cell_m
        y0_m = self.y0_m + rows.start * self.cell_m
        size = rows.stop - rows.start, columns.stop - columns.start
        return Grid(x0_m, y0_m, self.cell_m, *size)

    def cell_of(self, x_m: float, y_m: float) -> Optional[Tuple[int, int]]:
        """Row and column; None outside."""
        row, column, inside = self.cells_of(x_m, y_m)
        return (int(row), int(column)) if inside else None

    def cells_of(self, x_m, y_m) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of places (any shape, m), 0 where they are outside; whether they are
        inside."""
        column = np.floor((np.asarray(x_m) - self.x0_m) / self.cell_m)
        row = np.floor((np.asarray(y_m) - self.y0_m) / self.cell_m)
        inside = (row >= 0) & (column >= 0) & (row < self.rows) & (column < self.columns)
        return np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int), inside

    @property
    def extent_m(self) -> Tuple[float, float, float, float]:
        """Outer edges (m): smallest and largest x, smallest and largest y, as matplotlib takes
        them."""
        x1_m = self.x0_m + self.columns * self.cell_m
        return self.x0_m, x1_m, self.y0_m, self.y0_m + self.rows * self.cell_m

    def clear_m(self, free: np.ndarray) -> np.ndarray:
        """(rows, columns) m: how far each cell's middle is from the nearest cell that is not
        ``free`` (rows, columns) bool; negative in these. Nothing is free beyond the grid."""
        padded = np.pad(np.asarray(free).astype(np.uint8), 1)
        far = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
        return (far - 0.5) * self.cell_m

    def middle_of(self, row, column) -> np.ndarray:
        """(...,2): x, y (m) of the middles of cells."""
        x, y = (
            self.x0_m + (np.asarray(column) + 0.5) * self.cell_m,
            self.y0_m + (np.asarray(row) + 0.5) * self.cell_m,
        )
        return np.stack([x, y], -1)
