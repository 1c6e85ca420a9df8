# SPDX-License-Identifier: Apache-2.0
"""The ground in percents of nav_msgs/OccupancyGrid."""

from typing import Optional

import numpy as np

from fcsv_guidance.ground import standing, tuning
from fcsv_guidance.ground.model import Ground, cell_probability
from fcsv_guidance.robot import Robot

UNKNOWN = -1  # nav_msgs/OccupancyGrid
#: map_server's thresholds of occupancy: free below, occupied above, unknown between (trinary) or
#: graded (scaled)
FREE_BELOW, OCCUPIED_ABOVE = 1.0 - tuning.FREE_P, 1.0 - tuning.OBSTACLE_P
#: the same of an OccupancyGrid's values
FREE_PERCENT, OCCUPIED_PERCENT = round(100 * FREE_BELOW), round(100 * OCCUPIED_ABOVE)


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
    percent = _rounded_up(np.where(obstacle, alone, p))
    percent = np.where(obstacle, percent, np.minimum(percent, OCCUPIED_PERCENT - 1))
    return np.where(ground.known & ((p >= 0) | obstacle), percent, UNKNOWN).astype(np.int8)


def percents_of(p: np.ndarray) -> np.ndarray:
    """int8 of ``p``; -1 where it is NaN.

    >>> percents_of(np.array([1.0, 0.98, 0.979, 0.0, np.nan])).tolist()
    [0, 2, 3, 100, -1]
    """
    percents = _rounded_up(np.nan_to_num(p))
    return np.where(np.isfinite(p), np.clip(percents, 0, 100), UNKNOWN).astype(np.int8)


def _rounded_up(p: np.ndarray) -> np.ndarray:
    """100 (1 - p), so that what is below FREE_P stays above FREE_PERCENT."""
    return np.ceil(100.0 * (1.0 - p) - 1e-3)
