# SPDX-License-Identifier: Apache-2.0
"""Whether the robot's footprint touches the true world, and how it stands on it."""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.world.footing import Clearance, Footing


@dataclass(frozen=True)
class TrueGround:
    """A place under a robot's wheels; ``clear`` of that robot."""

    footing: Footing
    clear: Clearance

    def room_m(self, x_m: float, y_m: float) -> float:
        """Measures the room from the footprint's edge to the nearest wall, block, beam below the
        robot's height, step, hole or slope beyond its bounds; negative where the footprint touches
        it."""
        return float(self.clear.at(x_m, y_m)) - self.clear.robot.radius_m

    def T_world_robot(self, x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        """4x4: the footprint's plane of least squares on what it stands on; x to where it
        drives."""
        grid, top = self.footing.grid, self.footing.top_m
        n = int(np.ceil(self.clear.robot.radius_m / grid.cell_m))
        row, column, _ = grid.cells_of(x_m, y_m)
        rows = np.clip(np.arange(row - n, row + n + 1), 0, grid.rows - 1)
        columns = np.clip(np.arange(column - n, column + n + 1), 0, grid.columns - 1)
        off = grid.middle_of(*np.meshgrid(rows, columns, indexing="ij")) - (x_m, y_m)
        under = np.hypot(off[..., 0], off[..., 1]) <= self.clear.robot.radius_m
        z = top[np.ix_(rows, columns)][under]
        A = np.column_stack([off[under], np.ones(len(z))])
        (gx, gy, z0), *_ = np.linalg.lstsq(A, z, rcond=None)
        up = np.array([-gx, -gy, 1.0]) / np.sqrt(gx**2 + gy**2 + 1.0)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
        ahead = ahead - (ahead @ up) * up
        ahead /= np.linalg.norm(ahead)
        return transforms.transform(
            np.column_stack([ahead, np.cross(up, ahead), up]), np.array([x_m, y_m, z0])
        )
