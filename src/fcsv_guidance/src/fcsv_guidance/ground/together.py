# SPDX-License-Identifier: Apache-2.0
"""The calibrated probability that a robot can stand by all maps together: their cells are
averaged, so that noise sinks with their number, and boosted trees judge what the average shows
below a footprint and around it. tools/train_ground.py finds the trees."""

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Sequence, Tuple

import cv2
import numpy as np

from fcsv_guidance.ground import kernels, standing, tuning

FEATURES = 32
TREES_FILE = Path(__file__).with_name("stand_trees.json")
LEVEL_CELLS = 15  # maps' heights differ by errors of pose, which are alike so far beside a cell
_LEVEL_M = 0.5  # heights that differ by more are of other surfaces
_FLOOR_M = 0.02  # of a cell's sigma: errors that its pixels have in common
_OUTLIER_SIGMAS = 3.0
WIDE_M = 0.5  # beside the footprint: the rim of a pit, or the mound that a cell lies on
_NEVER = 20.0  # log odds beyond all that a map says


@dataclass(frozen=True)
class Learnt:
    """Trees of ``name`` in TREES_FILE, and how far maps and how large a robot's radius may be that
    they judge; what no trees judge is weighed by number."""

    name: str
    from_m: float
    to_m: float
    largest_radius_m: float = np.inf


#: Of System III's vehicles 20 to 60 m away, and of Tellos about a small robot, on cells of 0.05 m.
LEARNT = (Learnt("far", 18.0, 60.0), Learnt("near", 1.5, 9.0, 0.25))


def averaged(maps: Sequence) -> Tuple:
    """The Ground that maps on one grid show on average, each levelled to the others first; and
    (rows, columns) how many know a cell, how far their heights spread (m), and how many lie beyond
    _OUTLIER_SIGMAS, which do not count where three and more know it."""

    def of(name):
        return np.array([getattr(ground, name) for ground in maps], np.float32)

    height, sigma = of("height_m"), np.hypot(of("sigma_m"), np.float32(_FLOOR_M))
    known = np.isfinite(height)
    count, off, middle = known.sum(0), np.zeros_like(height), _median(height)
    for one, up in zip(height, off):
        apart = np.nan_to_num(one - middle, nan=np.inf)
        alike = np.abs(apart) < _LEVEL_M
        up[:] = _around(np.where(alike, apart, 0.0)) / np.maximum(_around(alike), 1e-3)
    levelled = height - off
    with np.errstate(invalid="ignore", divide="ignore"):
        out = known & (np.abs(levelled - _median(levelled)) > _OUTLIER_SIGMAS * sigma)
        out &= count >= 3
        weight = np.where(known, sigma**-2, 0.0)
        counted = np.where(out, 0.0, weight)

        def mean(values):
            return np.where(counted > 0, counted * values, 0.0).sum(0) / counted.sum(0)

        layers = {name: mean(of(name) - off) for name in ("height_m", "low_m", "high_m")}
        layers.update((name, mean(of(name))) for name in ("roughness_m", "distance_m"))
        spread = np.where(known, weight * (levelled - layers["height_m"]) ** 2, 0.0).sum(0)
        spread = np.sqrt(spread / weight.sum(0))
        hangs = np.where(known, of("overhead_m") - off, np.inf).min(0)
        layers.update(sigma_m=counted.sum(0) ** -0.5, trust=np.fmax.reduce(of("trust")))
    layers["overhead_m"] = np.where(np.isfinite(layers["height_m"]), hangs, np.nan)
    return replace(maps[0], maps=(), **layers), count, np.nan_to_num(spread), out.sum(0)


def features(maps: Sequence, each: np.ndarray, whole: np.ndarray, robot):
    """(rows, columns, FEATURES) float32 of the footprint with its middle in each cell, lengths as
    shares of the robot's limits; and the averaged Ground.

    ``each``, ``whole`` (N, rows, columns): what each map alone says, and whether it knows all below
    the footprint.
    """
    ground, count, spread, out = averaged(maps)
    known, cell_m, step_m = ground.known, ground.grid.cell_m, robot.largest_step_m
    most, least = standing.most, standing.least
    radius_m, beside_m = robot.radius_m, standing.AROUND_M
    inner, outer, wide = (
        standing.disk(radius_m + more_m, cell_m) for more_m in (0.0, beside_m, WIDE_M)
    )
    high, low = (
        np.where(known, ground.high_m, -standing.FAR),
        np.where(known, ground.low_m, standing.FAR),
    )
    edges = np.where(known, most(high, standing.SIDE) - least(low, standing.SIDE), 0.0)
    middle, level = np.nan_to_num(ground.height_m), np.nan_to_num(ground.high_m - ground.low_m)
    slope, rough = _plane(ground.height_m, inner, cell_m)
    wide_slope, wide_rough = _plane(ground.height_m, wide, cell_m)
    room_m = np.where(known, np.minimum(ground.free_height_m, 5.0), 5.0) - robot.height_m
    far_m = np.where(known, ground.distance_m, 1.0)
    near = np.array([_around(one.known) > 1e-6 for one in maps])  # others' share does not matter
    unseen = (near & [~one.known for one in maps]).sum(0) / np.maximum(near.sum(0), 1)
    across = slope * 2.5 * cell_m

    def rise(around, half_m):
        return most(high, around) - least(low, around) - slope * 2 * half_m

    lengths_m = (
        most(edges, inner) - across,
        most(edges, outer) - across,
        rise(inner, radius_m),
        rise(outer, radius_m + beside_m),
        rough,
        wide_rough,
        most(edges, wide),
        middle - least(low, wide),
        most(high, wide) - middle,
        most(spread, inner),
        most(spread, outer),
        _share(spread, inner),
        _share(level, inner),
        _share(edges, inner),
        most(np.where(known, ground.sigma_m, 0.0), inner),
    )
    others = (
        most(slope, standing.disk(0.5 * robot.radius_m, cell_m)) / robot.largest_slope,
        wide_slope / robot.largest_slope,
        np.clip(-least(room_m, inner), -1, 1),
        np.log(np.maximum(most(far_m, inner), 1.0) / 30.0),
        np.log(np.maximum(least(far_m, inner), 1.0) / 30.0),
        least(np.where(known, count, 0), inner, 0.0),
        most(out, inner),
        _share(~known, outer),
        _share(~known, wide),
        _share(unseen, outer),
        np.nan_to_num(ground.trust),
    )
    layers = [length_m / step_m for length_m in lengths_m]
    layers += [*others, *_votes(each, whole)]
    return np.stack(layers, -1).astype(np.float32), ground


def probability(maps: Sequence, robot) -> np.ndarray:
    """(rows, columns) float32 of grounds on one grid; NaN where no map knows the whole footprint,
    and outside of LEARNT. What every map that knows it calls an obstacle stays one. Steps count up
    to TOGETHER_SHARE of the robot's."""
    robot = robot.climbing(tuning.TOGETHER_SHARE)
    each = np.array([standing.probability(ground, robot) for ground in maps])
    whole = np.array([standing.seen_below(ground, robot) for ground in maps])
    x, ground = features(maps, each, whole, robot)
    p = np.full(ground.grid.shape, np.nan, np.float32)
    for learnt in LEARNT:
        with np.errstate(invalid="ignore"):
            judged = (ground.distance_m >= learnt.from_m) & (ground.distance_m <= learnt.to_m)
        judged &= whole.any(0) & (robot.radius_m <= learnt.largest_radius_m)
        p[judged] = 1.0 / (1.0 + np.exp(-kernels.log_odds(x[judged], *trees(learnt.name))))
    best = np.where(whole, each, -1.0).max(0)
    return np.where(best <= tuning.OBSTACLE_P, np.minimum(p, best), p).astype(np.float32)


@lru_cache(len(LEARNT))
def trees(name: str) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What TREES_FILE holds of a Learnt: nodes' features (-1: a leaf), thresholds (of a leaf its log
    odds), nodes to go to where a feature is above; and the trees' first nodes. Below it is the
    next."""
    stored = json.loads(TREES_FILE.read_text())[name]
    names = ("feature", "threshold", "above", "first")
    kinds = (np.int64, np.float32, np.int64, np.int64)
    return tuple(np.array(stored[name], kind) for name, kind in zip(names, kinds))


def _votes(each: np.ndarray, whole: np.ndarray) -> list:
    """Counts what maps say alone: how many know the footprint, mean, least, largest, second largest log
    odds, and the least probability of those that know a part."""
    p = np.clip(np.where(whole, each, np.nan), 1e-4, 1.0 - 1e-4)
    odds = np.log(p) - np.log1p(-p)
    told = np.isfinite(odds)
    nobody = np.full((1, *told.shape[1:]), -_NEVER)  # of one map there is no second largest
    ranked = np.sort(np.concatenate([nobody, np.where(told, odds, -_NEVER)]), 0)
    mean = np.where(told, odds, 0.0).sum(0) / np.maximum(told.sum(0), 1)
    worst = np.where(told, odds, _NEVER).min(0)
    partly = np.where(np.isfinite(each) & ~whole, each, 2.0).min(0)
    return [told.sum(0), mean, worst, ranked[-1], ranked[-2], partly]


def _median(heights: np.ndarray) -> np.ndarray:
    """Takes the median of maps (N, rows, columns); NaN where none knows."""
    ordered, count = np.sort(heights, 0), np.isfinite(heights).sum(0)  # NaN last
    ends = (np.maximum(count - 1, 0) // 2, np.minimum(count // 2, np.maximum(count - 1, 0)))
    low, high = (np.take_along_axis(ordered, end[None], 0)[0] for end in ends)
    return 0.5 * (low + high)


def _around(values: np.ndarray) -> np.ndarray:
    side = (2 * LEVEL_CELLS + 1,) * 2
    return cv2.boxFilter(values.astype(np.float32), -1, side, borderType=cv2.BORDER_CONSTANT)


def _share(values: np.ndarray, around: np.ndarray) -> np.ndarray:
    weight = (around / around.sum()).astype(np.float32)
    return cv2.filter2D(values.astype(np.float32), -1, weight)


def _plane(height: np.ndarray, around: np.ndarray, cell_m: float) -> Tuple[np.ndarray, np.ndarray]:
    """Slope of the plane through the known cells ``around`` each, and how far heights spread about
    it (m); slope 0 where they span none."""
    known, n = np.isfinite(height), around.shape[0] // 2
    middle = float(np.median(height[known])) if known.any() else 0.0
    z, w = np.where(known, height - middle, 0.0), known.astype(float)
    y, x = np.mgrid[-n : n + 1, -n : n + 1] * cell_m

    def total(values, by):
        return cv2.filter2D(values, -1, around * by, borderType=cv2.BORDER_CONSTANT)

    s = np.maximum(total(w, 1.0), 1.0)
    mx, my, mz = total(w, x) / s, total(w, y) / s, total(z, 1.0) / s
    xx, yy = total(w, x * x) / s - mx**2, total(w, y * y) / s - my**2
    xy, zz = total(w, x * y) / s - mx * my, total(z * z, 1.0) / s - mz**2
    xz, yz = total(z, x) / s - mx * mz, total(z, y) / s - my * mz
    det = xx * yy - xy**2
    spans = known & (det > 0.02 * cell_m**4)
    det = np.where(spans, det, np.inf)
    gx, gy = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    return np.hypot(gx, gy), np.sqrt(np.maximum(zz - gx * xz - gy * yz, 0.0))
