# SPDX-License-Identifier: Apache-2.0
"""Whether sigma holds the error of a scale that all poses share; the tables are in docs/lab/photographs.md.

.venv/bin/python tools/bench_scale.py [--draws 14] [--maps 0] [--scale-percent 5]

All positions of a scene of make bench are multiplied by one scale that is drawn, and have independent errors besides.
The same poses are given three ways: with nothing said of the scale; with its standard deviation in each position apart
(as import_photos wrote until 2026-11-25); with it as ``scale_sigma``, one for all. Scales are compared after
refinement, and of --maps draws a scene the whole map's errors with its sigma.
"""

import argparse
from dataclasses import replace
from typing import Dict, List, Tuple

import cv2
import numpy as np

from bench.scenes import HORIZONTAL, NOISES, Baselines, Scene, SceneName, shoot
from fcsv_stereo.joint import Joint
from fcsv_stereo.model import MapInput, PosePrior
from fcsv_stereo.refinement import KnownFeatures, RefineOptions, refine

_PLACES = (SceneName("street", 31), SceneName("village", 32), SceneName("field", 33))
_LISTS: Dict[str, Baselines] = {"H 4 m": HORIZONTAL[1:2], "H 2, 4, 6, 8 m": HORIZONTAL}
_MOST_M = 400.0
NOTHING, APART, ONE = "nothing said", "in each position apart", "`scale_sigma`"


def statements(scale_sigma: float) -> Dict[str, PosePrior]:
    """What is said of the same poses."""
    prior = NOISES[0].prior
    apart = float(np.hypot(prior.position_share, scale_sigma))
    return {
        NOTHING: prior,
        APART: replace(prior, position_share=apart),
        ONE: replace(prior, scale_sigma=scale_sigma),
    }


def drawn(scene: Scene, baselines: Baselines, scale: float, random: np.random.Generator) -> MapInput:
    """Poses with the noise of make bench, all positions times ``scale`` about the reference."""
    given = scene.given(baselines, NOISES[0])
    p_ref = scene.reference.T_home_cam[:3, 3]
    truth = scene.true_poses()
    configurations = []
    for c in given.configurations:
        (other,) = c.others
        T = truth[other.name].copy()
        turn = cv2.Rodrigues(random.normal(0.0, NOISES[0].rotation_rad, 3))[0]
        arm_m = T[:3, 3] - p_ref
        off_m = random.normal(0.0, NOISES[0].prior.position_sigma_m(float(np.linalg.norm(arm_m))), 3)
        T[:3, :3], T[:3, 3] = T[:3, :3] @ turn, p_ref + scale * (arm_m + off_m)
        configurations.append(replace(c, others=[replace(other, T_home_cam=T)]))
    return replace(given, configurations=configurations)


def scale_error(scene: Scene, given: MapInput, prior: PosePrior, known: KnownFeatures) -> Tuple[float, float]:
    """Of the longest baseline after refinement: its length over the true one, less one, and what is stated for it."""
    others = [c.others[0] for c in given.configurations]
    last = refine(scene.reference, others, RefineOptions(prior=prior, known=known)).others[-1]
    p_ref = scene.reference.T_home_cam[:3, 3]
    arm = last.picture.T_home_cam[:3, 3] - p_ref
    true_m = float(np.linalg.norm(scene.true_poses()[last.picture.name][:3, 3] - p_ref))
    stated = float(np.sqrt(arm @ last.covariance[3:, 3:] @ arm)) / float(arm @ arm)
    return float(np.linalg.norm(arm)) / true_m - 1.0, stated


def map_errors(scene: Scene, given: MapInput, prior: PosePrior) -> np.ndarray:
    """Of a map's answered pixels, in sigmas."""
    result = Joint().map(replace(given, prior=prior))
    here = np.isfinite(result.depth) & (scene.true_depth <= _MOST_M)
    return (np.abs(result.depth - scene.true_depth) / result.sigma)[here]


def within(errors: np.ndarray) -> str:
    """Shares within 1 and 2 standard deviations, as cells of a table."""
    return " | ".join(f"{(np.abs(errors) <= k).mean():.0%}" for k in (1, 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=14, help="of each of three scenes")
    parser.add_argument("--maps", type=int, default=0, help="of these draws, that are mapped")
    parser.add_argument("--scale-percent", type=float, default=5.0, help="standard deviation of the scale drawn")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    said = statements(args.scale_percent / 100.0)
    scales: Dict[Tuple[str, str], List[Tuple[float, float]]] = {}
    maps: Dict[Tuple[str, str], List[np.ndarray]] = {}
    for place in _PLACES:
        scene, known = shoot(place, HORIZONTAL), KnownFeatures()
        for name, baselines in _LISTS.items():
            random = np.random.default_rng([*place.words(), 17])
            for draw in range(args.draws):
                scale = 1.0 + random.normal(0.0, args.scale_percent / 100.0)
                given = drawn(scene, baselines, scale, random)
                for words, prior in said.items():
                    scales.setdefault((name, words), []).append(scale_error(scene, given, prior, known))
                    if draw < args.maps:
                        maps.setdefault((name, words), []).append(map_errors(scene, given, prior))
            print(f"    {place}, {name}: {args.draws} draws", flush=True)
    print("| pictures | scale's uncertainty | draws | rms error of the scale | stated, median | within 1σ | 2σ |")
    print("|---" * 7 + "|")
    for (name, words), pairs in scales.items():
        error, stated = np.array(pairs).T
        rms = np.sqrt(np.mean(error**2))
        print(f"| {name} | {words} | {len(error)} | {rms:.2%} | {np.median(stated):.2%} | {within(error / stated)} |")
    if maps:
        print("\n| pictures | scale's uncertainty | maps | pixels within 1σ | 2σ |\n|---|---|---|---|---|")
    for (name, words), parts in maps.items():
        print(f"| {name} | {words} | {len(parts)} | {within(np.concatenate(parts))} |")


if __name__ == "__main__":
    main()
