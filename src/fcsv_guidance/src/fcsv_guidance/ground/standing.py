# SPDX-License-Identifier: Apache-2.0
"""The calibrated probability that a robot can stand: a logistic regression on what one map shows
below a footprint.

Its weights (tuning.STAND_WEIGHTS) come of tools/train_ground.py, on seeds that the tests and the
tables do not use.
"""

from typing import Tuple

import cv2
import numpy as np
from scipy.special import ndtr

from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground import tuning

FAR = 1e6
SIDE = np.ones((3, 3), np.uint8)
AROUND_M = 0.25  # what is seen so near beside the footprint counts too
_KNOTS = (0.0, 0.3, 0.8, 1.5, 4.0)  # of a limit of the robot
FEATURES = 28
_CLOSES_P = 0.8  # of a gap between free footprints, by all maps together
_BELOW_FREE_P = np.nextafter(np.float32(tuning.FREE_P), np.float32(0.0))
FREE_SIGN = 2  # features whose weight may have any sign: 1 and distance. All others only lower p.


def disk(radius_m: float, cell_m: float) -> np.ndarray:
    """(2n+1, 2n+1) uint8: cells whose middle lies within the radius and half a cell."""
    n = int(np.ceil(radius_m / cell_m))
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    return (np.hypot(x, y) * cell_m <= radius_m + 0.5 * cell_m).astype(np.uint8)


def require_fine_cells(cell_m: float, robot, field: str) -> None:
    """Raises GroundError that names the ``field`` where a robot's footprint does not span two
    cells: what stops it could hide in the heights of one."""
    if cell_m > robot.radius_m:
        raise GroundError(
            f"{field}: {cell_m:g} m is above the radius of {robot.name}, {robot.radius_m:g} m: what "
            "stops it could hide in a cell; take smaller cells"
        )


def slope_radius_m(ground, robot) -> float:
    """Radius of the plane whose slope counts for a robot: its footprint, and cells enough."""
    return max(robot.radius_m, 1.5 * ground.grid.cell_m)


def features(ground, robot, slopes=None) -> np.ndarray:
    """(rows, columns, FEATURES) float32 of the footprint with its middle in each cell of a Ground
    of one map, as shares of the robot's limits; the first is 1. Only where the whole footprint is
    known do they mean anything. ``slopes`` (rows, columns) within slope_radius_m, where they are
    there already."""
    slopes = ground.slope(slope_radius_m(ground, robot)) if slopes is None else slopes
    known, cell_m = ground.known, ground.grid.cell_m
    step_m, slope = robot.largest_step_m, robot.largest_slope
    inner = disk(robot.radius_m, cell_m)
    outer = disk(robot.radius_m + AROUND_M, cell_m)
    high, low = np.where(known, ground.high_m, -FAR), np.where(known, ground.low_m, FAR)
    edges = np.where(known, most(high, SIDE) - least(low, SIDE), 0.0)
    plane = np.nan_to_num(slopes)
    room = np.where(known, np.minimum(ground.free_height_m, 5.0), 5.0) - robot.height_m

    edge = most(edges, inner) / step_m
    edge_around = most(edges, outer) / step_m
    steep = most(plane, inner) / slope
    rise = (most(high, inner) - least(low, inner)) / step_m
    rise_around = (most(high, outer) - least(low, outer)) / step_m
    rough = _spread(np.where(known, ground.height_m, 0.0), known, inner) / step_m
    sigma = np.clip(most(np.where(known, ground.sigma_m, 0.0), inner) / step_m, 0, 3)
    far = np.log(np.maximum(most(np.where(known, ground.distance_m, 1.0), inner), 1.0) / 30.0)
    hangs = np.clip(-least(room, inner), -1, 1)
    pieces = [_pieces(values) for values in (edge, edge_around, steep, rise, rise_around, rough)]
    return np.stack([np.ones_like(edge), far, *sum(pieces, []), sigma, hangs], -1).astype(
        np.float32
    )


def _pieces(values: np.ndarray) -> list:
    """What of the values lies in each interval between _KNOTS: a weight on each is a line with
    corners there."""
    return [np.clip(values - low, 0.0, high - low) for low, high in zip(_KNOTS[:-1], _KNOTS[1:])]


def probability(ground, robot) -> np.ndarray:
    """(rows, columns) float32 of a Ground of one map; NaN where a cell below the footprint is
    unknown, unless what is known there is an obstacle."""
    slopes = ground.slope(slope_radius_m(ground, robot))
    inner = disk(robot.radius_m, ground.grid.cell_m)
    weights = np.asarray(tuning.STAND_WEIGHTS, np.float32)
    p = 1.0 / (1.0 + np.exp(-(features(ground, robot, slopes) @ weights)))
    p = np.minimum(p, beyond_limits(ground, robot, inner, slopes))
    touched = most(ground.known, inner) > 0
    return np.where(seen_below(ground, robot) | (touched & (p <= tuning.OBSTACLE_P)), p, np.nan)


def by_one(ground, robot) -> Tuple[np.ndarray, np.ndarray]:
    """What ``weighed`` takes of one map: its probability, and whether it knows the whole
    footprint."""
    return probability(ground, robot.climbing(tuning.STEP_SHARE)), seen_below(ground, robot)


def beyond_limits(ground, robot, inner: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """(rows, columns), near to 0 where the plane below the robot is surely steeper (``slopes``) than it
    climbs, or where something surely hangs lower over its footprint ``inner`` than it is high; 1 elsewhere. A
    bound: the places that the weights were learnt on have neither slopes nor beams."""
    sigma_m = np.where(ground.known, ground.sigma_m, 0.0)
    room_m = np.where(ground.known, ground.free_height_m, np.inf) - robot.height_m
    with np.errstate(invalid="ignore", divide="ignore"):
        room = least(np.minimum(room_m, FAR), inner) / (np.sqrt(2.0) * most(sigma_m, inner))
        sigma = slope_sigma(ground, slope_radius_m(ground, robot))
        climb = (robot.largest_slope - slopes) / sigma
    z = np.fmin(climb, room)
    return np.where(z < -tuning.BEYOND_SIGMAS, ndtr(z), 1.0).astype(np.float32)


def slope_sigma(ground, half_m: float) -> np.ndarray:
    """(rows, columns): standard deviation of the slope of the plane through cells within
    ``half_m``."""
    sigma: np.ndarray = ground.sigma_m * np.sqrt(12.0) / (2 * half_m) / np.sqrt(2.0)
    return sigma


def seen_below(ground, robot) -> np.ndarray:
    """(rows, columns) bool: whether all cells below the footprint are known."""
    return least(ground.known, disk(robot.radius_m, ground.grid.cell_m), 0.0) > 0


def weighed(each, whole, around: np.ndarray, together=None) -> np.ndarray:
    """Weighs the probabilities of maps, (N, rows, columns) each with NaN where unknown, for a
    footprint ``around`` a cell; NaN where none knows.

    What their average says, ``together`` (rows, columns), counts where it is known: a gap between
    free footprints closes there from _CLOSES_P on. Elsewhere it goes by number: maps that know the
    ``whole`` (N, rows, columns) bool footprint and call it free must
    be twice as many as those that know it and contradict them. A map that knows part of a footprint
    is no witness against one that knows it whole. What is contradicted is no more than
    CONTRADICTED_P, and OBSTACLE_P and less where none calls it free and one an obstacle. A
    footprint of whose every part a free footprint was found is free, too, where more maps show these
    than call it an obstacle: between two maps' edges no gap stays, and no way leads across a step,
    whose both sides are free.
    """
    each, whole = np.asarray(each), np.asarray(whole)
    known = np.isfinite(each)
    with np.errstate(invalid="ignore"):
        free, against, obstacle = (
            (whole & said).sum(0)
            for said in (
                each >= tuning.FREE_P,
                each < tuning.CONTRADICTED_P,
                each <= tuning.OBSTACLE_P,
            )
        )
    best = np.where(known, each, -1.0).max(0)
    worst = np.where(known, each, 2.0).min(0)
    n, found = max(around.shape), (free >= 1) & (free >= 2 * against)
    closes = cv2.dilate(free.astype(np.float32), around) > obstacle  # maps that call a part free
    if together is not None:
        found = np.where(np.isfinite(together), together >= tuning.FREE_P, found)
        closes = np.where(np.isfinite(together), together >= _CLOSES_P, closes)
    covered = cv2.morphologyEx(np.pad(found.astype(np.uint8), n), cv2.MORPH_CLOSE, around)
    found |= (covered[n:-n, n:-n] > 0) & closes
    p = np.where(best >= tuning.FREE_P, tuning.CONTRADICTED_P, best)
    p = np.where((best < tuning.FREE_P) & (worst <= tuning.OBSTACLE_P), worst, p)
    p = np.where(known.any(0), p, np.nan)
    best = np.where(whole & known, each, 0.0).max(0)
    if together is not None:
        p = np.where(np.isfinite(together), np.minimum(together, _BELOW_FREE_P), p)
        best = np.where(np.isfinite(together), together, best)
    return np.where(found, np.maximum(best, tuning.FREE_P), p).astype(np.float32)


def most(values: np.ndarray, around: np.ndarray) -> np.ndarray:
    """The largest value (float32) of the cells ``around`` each."""
    return cv2.dilate(
        values.astype(np.float32), around, borderType=cv2.BORDER_CONSTANT, borderValue=-FAR
    )


def least(values: np.ndarray, around: np.ndarray, outside: float = FAR) -> np.ndarray:
    """The smallest value (float32) of the cells ``around`` each."""
    return cv2.erode(
        values.astype(np.float32), around, borderType=cv2.BORDER_CONSTANT, borderValue=outside
    )


def _spread(height: np.ndarray, known: np.ndarray, around: np.ndarray) -> np.ndarray:
    weights = around.astype(float)
    count = np.maximum(cv2.filter2D(known.astype(float), -1, weights), 1.0)
    mean = cv2.filter2D(height.astype(float), -1, weights) / count
    square = cv2.filter2D(height.astype(float) ** 2, -1, weights) / count
    return np.sqrt(np.maximum(square - mean**2, 0.0))
