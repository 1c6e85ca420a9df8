# SPDX-License-Identifier: Apache-2.0
"""Fits the weights of fcsv_guidance.standing on drawn and mapped places, and prints them for
tuning.py.

python tools/train_ground.py [--seeds 11 12 13] [--robot config/robots/rescue.yaml]
"""

import argparse
import sys

import numpy as np
from bench_ground import footing_of, grid_of
from scipy.optimize import minimize

from fcsv_guidance.ground import ground_from
from fcsv_guidance.robot import load_robot
from fcsv_guidance.standing import FREE_SIGN, features, seen_below
from fcsv_sim.robot.survey import stations, survey
from fcsv_sim.world.town import Town

_FARTHEST_M, _SHRINK = 60.0, 1e-4


def samples(world: str, seed: int, robot):
    """Features (N, FEATURES) of all cells whose footprint one map knows, and whether the robot can
    stand there."""
    town = Town.generate(seed, world)
    grid = grid_of(town.plan, 0.1)
    inside, stands = footing_of(town.plan, grid, robot)
    for view in survey(town, stations(town.plan), seed):
        ground = ground_from([view], grid=grid)
        used = inside & seen_below(ground, robot) & (ground.distance_m <= _FARTHEST_M)
        yield features(ground, robot)[used].astype(float), stands[used]


def fitted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Weights of the logistic regression of y (N, bool) on x (N, K), slightly shrunk."""
    scale = np.maximum(x.std(0), 1e-6)
    scale[0] = 1.0

    def loss(w):
        z = (x / scale) @ w
        p = 1.0 / (1.0 + np.exp(-z))
        return np.logaddexp(0, np.where(y, -z, z)).mean() + _SHRINK * (w @ w), (
            (x / scale).T @ (p - y) / len(y) + 2 * _SHRINK * w
        )

    bounds = [(None, None)] * FREE_SIGN + [(None, 0.0)] * (x.shape[1] - FREE_SIGN)
    return (
        minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds).x / scale
    )


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13])
    parser.add_argument("--robot", default="config/robots/rescue.yaml")
    args = parser.parse_args(argv)
    robot = load_robot(args.robot)
    found = [
        s
        for world in ("maze", "rubble")
        for seed in args.seeds
        for s in samples(world, seed, robot)
    ]
    x, y = (np.concatenate(part) for part in zip(*found))
    print(f"{len(y)} footprints, {y.mean():.1%} can be stood on")
    print("STAND_WEIGHTS = (" + ", ".join(f"{w:.3f}" for w in fitted(x, y)) + ")")
    return 0


if __name__ == "__main__":
    sys.exit(main())
