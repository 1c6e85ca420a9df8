# SPDX-License-Identifier: Apache-2.0
"""Finds the weights by which ``joint`` judges what speaks for a depth; prints them as
``tuning/evidence.py`` has them.

    python tools/train_evidence.py            maps seeded scenes and hard cases, none of them of `make bench`

A logistic regression of "wrong by more than a tenth, or in the sky". Held out in turn: each kind of
world.
"""

import argparse
import sys
from pathlib import Path
from typing import Iterator, List, Tuple

import numpy as np
from scipy.optimize import minimize
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parent))

from bench.hard_cases import LIGHTS, cases, lit
from bench.scenes import HORIZONTAL, LISTS, NOISES, SceneName, shoot
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint.checks.evidence import FEATURES, terms
from fcsv_stereo.joint.match import MatchOptions, match_jointly
from fcsv_stereo.joint.method import choose_pictures
from fcsv_stereo.joint.tuning import EVIDENCE
from fcsv_stereo.model import MapInput, PoseUncertainty
from fcsv_stereo.refinement import RefineOptions, refine

_WORLDS, _SEEDS, _HARD_SEED = ("street", "village", "field", "plain"), (21, 22), 31
_PIXELS = 30000  # drawn of each map
_RIDGE, _ROUNDS = 1e-4, 300


def main() -> int:
    """Map, learn, judge by worlds that were held out, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--keep", type=Path, help="a file for what the maps gave: learn again without mapping"
    )
    args = parser.parse_args()
    if args.keep and args.keep.exists():
        kept = np.load(args.keep)
        world, columns, wrong = kept["world"], kept["columns"], kept["wrong"]
    else:
        world, columns, wrong = _examples()
        if args.keep:
            np.savez(args.keep, world=world, columns=columns, wrong=wrong)
    for k, held_out in enumerate(_WORLDS):
        fitted = _fit(columns[world != k], wrong[world != k])
        _judge(held_out, _logit(columns[world == k], *fitted), wrong[world == k])
    _print(*_fit(columns, wrong))
    return 0


def _examples() -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of drawn pixels: number of the world (N,), features (N,F), whether the depth is wrong
    (N,)."""
    random, found = np.random.default_rng(5), []
    for k, given, true_depth in tqdm(list(_inputs()), unit="map", disable=None):
        try:
            columns, wrong = _mapped(given, true_depth)
        except StereoError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        drawn = random.permutation(len(wrong))[:_PIXELS]
        found.append((np.full(len(drawn), k), columns[drawn], wrong[drawn]))
    return tuple(np.concatenate(parts) for parts in zip(*found))


def _inputs() -> Iterator[Tuple[int, MapInput, np.ndarray]]:
    for k, world in enumerate(_WORLDS):
        for seed in _SEEDS:
            scene = shoot(SceneName(world, seed), LISTS["and V 5, 7, 10 m"])
            yield k, scene.given(HORIZONTAL, NOISES[0]), scene.true_depth
            yield k, scene.given(scene.baselines, NOISES[0]), scene.true_depth
            yield k, scene.given(HORIZONTAL[1:2], NOISES[0]), scene.true_depth
            name = list(LIGHTS)[seed % len(LIGHTS)]
            lighted = lit(
                scene.given(HORIZONTAL[::2], NOISES[0]), scene.name, scene.depths, LIGHTS[name]
            )
            yield k, lighted, scene.true_depth
        for case in cases(SceneName(world, _HARD_SEED), SceneName(_WORLDS[k - 1], _HARD_SEED + 1)):
            if not case.name.startswith("focal"):  # wrong everywhere, and no pixel can know
                yield k, case.given, case.true_depth


def _mapped(given: MapInput, true_depth: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    reference, others = choose_pictures(given.configurations)
    refined = refine(reference, others, RefineOptions(prior=given.prior))
    options = MatchOptions(adjust_poses=True, keep_features=True)
    pictures = [r.picture for r in refined.others]
    noise = [PoseUncertainty(r.uncertainty.noise) for r in refined.others]
    found = match_jointly(refined.reference, pictures, options, noise)
    answered = np.isfinite(found.depth) & ~(true_depth > 400.0)
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(found.depth / true_depth - 1.0) <= 0.1)
    return found.features[answered], wrong[answered]


def _scaled(columns: np.ndarray, means, scales) -> List[np.ndarray]:
    return [(c - m) / s for c, m, s in zip(columns.T, means, scales)]


def _design(columns: np.ndarray, means: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """(N, 1 + 3F), as ``checks.evidence`` has the terms."""
    first = (columns[:, 0] - means[0]) / scales[0]
    parts = [np.ones(len(columns), np.float32)]
    for k in range(columns.shape[1]):
        scaled = (columns[:, k] - means[k]) / scales[k]
        parts += [scaled, np.square(np.clip(scaled, -4.0, 4.0)), scaled * first]
    return np.stack(parts, axis=1).astype(np.float32)


def _fit(columns: np.ndarray, wrong: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, scales and weights (the constant first)."""
    means, scales = columns.mean(axis=0), columns.std(axis=0)
    design, target = _design(columns, means, scales), wrong.astype(np.float32)

    def loss(weights):
        p = 1.0 / (1.0 + np.exp(-np.clip(design @ weights.astype(np.float32), -30.0, 30.0)))
        value = -np.mean(target * np.log(p + 1e-9) + (1.0 - target) * np.log(1.0 - p + 1e-9))
        slope = design.T @ (p - target) / len(target)
        return float(value + _RIDGE * weights @ weights), (slope + 2.0 * _RIDGE * weights).astype(
            float
        )

    fitted = minimize(
        loss, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": _ROUNDS}
    )
    return means, scales, fitted.x


def _logit(columns: np.ndarray, means, scales, weights) -> np.ndarray:
    return _design(columns, means, scales) @ weights.astype(np.float32)


def _judge(name: str, logit: np.ndarray, wrong: np.ndarray) -> None:
    order = np.argsort(logit)
    shares = ", ".join(
        f"{s:.0%}: {wrong[order[: int(s * len(order))]].mean():.1%}"
        for s in (1.0, 0.9, 0.8, 0.7, 0.6)
    )
    print(f"{name}, held out: wrong of the surest {shares}")


def _print(means: np.ndarray, scales: np.ndarray, weights: np.ndarray) -> None:
    def told(values) -> str:
        return "(" + ", ".join(f"{v:.3f}" for v in values) + ")"

    print("constant", f"{weights[0]:.3f}")
    print("means", told(means))
    print("scales", told(scales))
    print("weights", told(weights[1:]))


if __name__ == "__main__":
    assert len(FEATURES) == len(EVIDENCE.means) and terms is not None
    sys.exit(main())
