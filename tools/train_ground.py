# SPDX-License-Identifier: Apache-2.0
"""Fits the weights of fcsv_guidance.ground.standing on drawn and mapped places, and prints them for
tuning.py; with --far or --near the trees of fcsv_guidance.ground.together, and writes them.

python tools/train_ground.py [--seeds 11 12 13] [--robot config/robots/rescue.yaml]
python tools/train_ground.py --far out/maps --seeds 1 2 3 4 5
python tools/train_ground.py --near out/maps --seeds 11 12 13 14 15 16 --robot config/robots/small.yaml
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_ground import grid_of
from scipy.optimize import minimize
from sklearn.ensemble import GradientBoostingClassifier

from fcsv_guidance.ground import together
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.ground.standing import FREE_SIGN, features, probability, seen_below
from fcsv_guidance.robot import load_robot
from fcsv_sim.robot.gimbals.rehearsal import small_survey
from fcsv_sim.robot.places.mapped import SurveyPlan, mapped_place
from fcsv_sim.robot.places.survey import stations, survey
from fcsv_sim.world.footing import Footing, footprints
from fcsv_sim.world.town import Town

_FARTHEST_M, _SHRINK = 60.0, 1e-4
_DRAWN, _RATE = 240_000, 0.15  # of the boosted trees: footprints, learning rate


def samples(world: str, seed: int, robot):
    """Features (N, FEATURES) of all cells whose footprint one map knows, and whether the robot can
    stand there."""
    town = Town.generate(seed, world)
    grid = grid_of(town.plan, 0.1)
    clear = Footing.of(town.plan).clearance(robot)
    inside, stands = footprints(town.plan, clear, grid)
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


def samples_together(world: str, seed: int, robots, folder: Path, survey_plan: SurveyPlan):
    """The same of together.features over all maps of a place for each robot. ``folder`` keeps the
    maps, whose stations are chosen without the trees."""
    survey_plan = replace(survey_plan, more=0)
    place = mapped_place(world, seed, robots[0], folder / f"{world}-{seed}", None, survey_plan)
    maps = [ground for ground in place.grounds if ground is not None]
    nearest_m = np.fmin.reduce([ground.distance_m for ground in maps])
    for robot in robots:
        each = np.array([probability(ground, robot) for ground in maps])
        whole = np.array([seen_below(ground, robot) for ground in maps])
        clear = place.footing.clearance(robot)
        inside, stands = footprints(place.town.plan, clear, maps[0].grid)
        used = inside & whole.any(0) & (nearest_m <= _FARTHEST_M)
        yield together.features(maps, each, whole, robot)[0][used], stands[used]


def far_samples(seeds, robot, folder: Path):
    """What System III's vehicles see."""
    for world, number in [("rubble", n) for n in seeds] + [("maze", n) for n in seeds[:2]]:
        yield from samples_together(world, number, [robot], folder, SurveyPlan())


def near_samples(seeds, robot, folder: Path):
    """What Tellos see about a small robot, and about two that climb more."""
    larger = replace(robot, radius_m=0.2, height_m=0.3, largest_step_m=0.06)
    robots = [robot, replace(robot, largest_step_m=0.05), larger]
    for number in seeds:
        for world in ("small_maze", "small_rubble"):
            yield from samples_together(world, number, robots, folder, small_survey().plan())


def boosted(x: np.ndarray, y: np.ndarray) -> dict:
    """Trees as together.trees takes them, of gradient boosting of y (N, bool) on x (N, K)."""
    drawn = np.random.default_rng(0).choice(len(y), min(len(y), _DRAWN), replace=False)
    model = GradientBoostingClassifier(
        n_estimators=60,
        max_leaf_nodes=12,
        max_depth=None,
        min_samples_leaf=100,
        learning_rate=_RATE,
        subsample=0.25,
        max_features=12,
        random_state=0,
    ).fit(x[drawn], y[drawn])
    prior = float(model.init_.class_prior_[1])
    out: dict = {"feature": [-1], "threshold": [np.log(prior / (1.0 - prior))], "above": [0]}

    def add(tree, node: int) -> None:
        at, leaf = len(out["feature"]), tree.children_left[node] < 0
        out["feature"].append(-1 if leaf else int(tree.feature[node]))
        out["threshold"].append(_RATE * tree.value[node].item() if leaf else tree.threshold[node])
        out["above"].append(0)
        if not leaf:
            add(tree, tree.children_left[node])
            out["above"][at] = len(out["feature"])
            add(tree, tree.children_right[node])

    out["first"] = [0]
    for estimator in model.estimators_[:, 0]:
        out["first"].append(len(out["feature"]))
        add(estimator.tree_, 0)
    out["threshold"] = [float(f"{value:.9g}") for value in out["threshold"]]
    return out


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13])
    parser.add_argument("--robot", default="config/robots/rescue.yaml")
    for name, what in (("far", "of System III"), ("near", "of System I")):
        parser.add_argument(
            f"--{name}",
            type=Path,
            metavar="MAPS",
            help=f"fits the trees {what}; MAPS keeps its maps",
        )
    args = parser.parse_args(argv)
    robot = load_robot(args.robot)
    for name, source in (("far", far_samples), ("near", near_samples)):
        folder = getattr(args, name)
        if folder:
            x, y = _joined(source(args.seeds, robot, folder))
            stored = json.loads(together.TREES_FILE.read_text())
            stored[name] = boosted(x, y)
            together.TREES_FILE.write_text(json.dumps(stored) + "\n")
            print(f"{together.TREES_FILE}: trees '{name}' written")
    if args.far or args.near:
        return 0
    x, y = _joined(
        s
        for world in ("maze", "rubble")
        for seed in args.seeds
        for s in samples(world, seed, robot)
    )
    print("STAND_WEIGHTS = (" + ", ".join(f"{w:.3f}" for w in fitted(x, y)) + ")")
    return 0


def _joined(samples_of_places):
    x, y = (np.concatenate(part) for part in zip(*samples_of_places))
    print(f"{len(y)} footprints, {y.mean():.1%} can be stood on")
    return x, y


if __name__ == "__main__":
    sys.exit(main())
