# SPDX-License-Identifier: Apache-2.0
"""The truth of a place for a robot on the ground: where its footprint touches something."""

from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np

from fcsv_guidance.grid import Grid
from fcsv_guidance.robot import Robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.world.place import PlacePlan

_RESTS_M = 0.05  # a solid whose lower side is so near to what is below rests on it
_SLOPE_REACH_M = 0.2
_EDGE_M = 0.15  # beside a footprint: the truth ends at the place's edge


@dataclass(frozen=True)
class Footing:
    """Columns of ``grid``, in m above the world's origin: ``ground_m``, ``top_m`` of what stands on
    it, ``overhead_m``: the lowest that hangs above, inf where nothing does.
    """

    grid: Grid
    ground_m: np.ndarray
    top_m: np.ndarray
    overhead_m: np.ndarray

    @classmethod
    def of(cls, plan: PlacePlan, cell_m: float = 0.05) -> "Footing":
        """Finds the footing of a place's area."""
        x0, x1, y0, y1 = plan.area_m
        x, y = np.meshgrid(
            np.arange(x0 + cell_m / 2, x1, cell_m), np.arange(y0 + cell_m / 2, y1, cell_m)
        )
        ground = plan.drawn_height(x, y)
        top, overhead = ground.copy(), np.full(ground.shape, np.inf)
        spans = []
        for solid in plan.solids:
            low, high = solid.corners_m[:, :2].min(0), solid.corners_m[:, :2].max(0)
            rows = slice(*_bounds(low[1], high[1], y0, cell_m, len(x)))
            columns = slice(*_bounds(low[0], high[0], x0, cell_m, x.shape[1]))
            spans.append((rows, columns, *solid.span_m(x[rows, columns], y[rows, columns])))
        for hangs in (False, True):  # first what stands on the ground: the rest may lie on it
            for rows, columns, low, high in spans:
                rests = low <= (top if hangs else ground)[rows, columns] + _RESTS_M
                top[rows, columns] = np.where(
                    rests, np.maximum(top[rows, columns], high), top[rows, columns]
                )
                if hangs:
                    lowest = np.minimum(overhead[rows, columns], low)
                    overhead[rows, columns] = np.where(rests, overhead[rows, columns], lowest)
        return cls(Grid(x0, y0, cell_m, *ground.shape), ground, top, overhead)

    def impassable(self, robot: Robot) -> np.ndarray:
        """(rows, columns) bool: no part of the robot's footprint may be there: an edge higher than
        its step, what hangs lower than its height, a slope that it does not hold."""
        lowest = cv2.erode(self.top_m, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
        n = max(1, int(round(_SLOPE_REACH_M / self.grid.cell_m)))
        wide = np.pad(self.ground_m, n, mode="edge")
        run = 2 * n * self.grid.cell_m
        gx = (wide[n:-n, 2 * n :] - wide[n:-n, : -2 * n]) / run
        gy = (wide[2 * n :, n:-n] - wide[: -2 * n, n:-n]) / run
        steep = np.hypot(gx, gy) > robot.largest_slope
        return (
            (self.top_m - lowest > robot.largest_step_m)
            | (self.overhead_m - self.top_m < robot.height_m)
            | steep
        )

    def clearance(self, robot: Robot) -> "Clearance":
        """How far from every place the nearest is that stops the robot."""
        return Clearance(self.grid, self.grid.clear_m(~self.impassable(robot)), robot)


@dataclass(frozen=True)
class Clearance:
    """``far_m`` (rows, columns) of ``grid``: how far (m) a column's middle is from the nearest that
    stops ``robot``."""

    grid: Grid
    far_m: np.ndarray
    robot: Robot

    def at(self, x_m, y_m) -> np.ndarray:
        """m, of places (any shape); negative outside of the area."""
        row, column, inside = self.grid.cells_of(x_m, y_m)
        return np.where(inside, self.far_m[row, column], -1.0)

    def touches(self, x_m, y_m) -> np.ndarray:
        """Whether the footprint with its middle there touches something, or leaves the place."""
        return self.at(x_m, y_m) < self.robot.radius_m

    def stopped(self, x_m, y_m, cell_m: float) -> np.ndarray:
        """Whether what stops the robot is in a cell of this size with its middle there, however
        thin it is; False outside of the area."""
        inside = self.grid.cells_of(x_m, y_m)[2]
        return inside & (self.at(x_m, y_m) <= cell_m / np.sqrt(2.0))

    def leads(self, start_m, goal_m, margin_m: float = 0.0) -> bool:
        """Whether a way with so much margin leads from start to goal (x, y). Raises SimulationError
        where either is no place for the robot."""
        stands = self.far_m >= self.robot.radius_m + margin_m
        _, parts = cv2.connectedComponents(stands.astype(np.uint8), connectivity=4)
        found = []
        for name, (x, y) in (("start", start_m), ("goal", goal_m)):
            if self.at(x, y) < self.robot.radius_m + margin_m:
                raise SimulationError(
                    f"the {name} ({x:.1f}, {y:.1f}) m is no place for the robot {self.robot.name}"
                )
            found.append(parts[self.grid.cell_of(x, y)])
        return found[0] == found[1]


def footprints(plan: PlacePlan, clear: Clearance, grid: Grid) -> Tuple[np.ndarray, np.ndarray]:
    """(rows, columns) bool of ``grid`` twice: where the truth reaches all around the footprint, and
    whether the robot can stand there."""
    x, y = np.moveaxis(grid.middle_of(*np.indices(grid.shape)), -1, 0)
    x0, x1, y0, y1 = plan.area_m
    edge = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
    return edge > clear.robot.radius_m + _EDGE_M, ~clear.touches(x, y)


def _bounds(low: float, high: float, origin: float, cell_m: float, count: int):
    first, last = int(np.floor((low - origin) / cell_m)), int(np.ceil((high - origin) / cell_m)) + 1
    return max(0, min(first, count)), max(0, min(last, count))
