# SPDX-License-Identifier: Apache-2.0
"""Pose refinement measured on the scenes of make bench: errors against truth, scale, covariance,
seconds.

.venv/bin/python tools/bench_refinement.py --seeds 1 2 3 4 5 6
"""

import argparse
import time
from dataclasses import dataclass, field, replace
from typing import List

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from bench.scenes import LISTS, SceneName, shoot
from fcsv_geometry import transforms
from fcsv_stereo.refinement import RefineOptions, refine

NOISES = ((0.15, 0.01), (0.5, 0.03))  # degrees per axis, share of the baseline


@dataclass
class Errors:
    """Of refined pictures; ``score`` is the squared error of the pose over its covariance, per
    degree of freedom."""

    rotation_deg: List[float] = field(default_factory=list)
    position_m: List[float] = field(default_factory=list)
    scale: List[float] = field(default_factory=list)
    score: List[float] = field(default_factory=list)
    seconds: List[float] = field(default_factory=list)
    refused: int = 0

    def add(self, reference, refined, T_true):
        """One picture."""
        if not refined.refined:
            self.refused += 1
            return
        T = refined.picture.T_home_cam
        rotation = Rotation.from_matrix(T_true[:3, :3].T @ T[:3, :3]).as_rotvec()
        error = np.concatenate([rotation, T[:3, 3] - T_true[:3, 3]])
        lengths = [np.linalg.norm(p[:3, 3] - reference.T_home_cam[:3, 3]) for p in (T, T_true)]
        self.rotation_deg.append(float(np.degrees(np.linalg.norm(rotation))))
        self.position_m.append(float(np.linalg.norm(error[3:])))
        self.scale.append(float(lengths[0] / lengths[1] - 1.0))
        self.score.append(
            float(error @ np.linalg.solve(refined.uncertainty.covariance, error) / 6.0)
        )

    def row(self, *names) -> str:
        """Of the table."""
        if not self.rotation_deg:
            return f"| {' | '.join([*map(str, names), *'–––––', '–', str(self.refused)])} |"
        values = [
            f"{np.median(self.rotation_deg):.4f}",
            f"{np.max(self.rotation_deg):.4f}",
            f"{np.median(self.position_m):.3f}",
            f"{np.sqrt(np.mean(np.square(self.scale))):.2%}",
            f"{np.mean(self.score):.2f}",
            f"{np.median(self.seconds):.2f}",
            str(self.refused),
        ]
        return f"| {' | '.join([*map(str, names), *values])} |"


def with_noise(reference, others, noise, random):
    """Priors off by (degrees per axis, share of the baseline)."""
    out = []
    for p in others:
        baseline_m = np.linalg.norm(p.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
        off_m = random.normal(0.0, noise[1] * baseline_m, 3) / np.sqrt(3.0)
        off = transforms.from_xyz_rpy(off_m, random.normal(0.0, np.radians(noise[0]), 3))
        out.append(replace(p, T_home_cam=p.T_home_cam @ off))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    totals = {}
    print(
        "| pictures | noise | seed | rotation median deg | worst | position m | scale rms | score | seconds | refused |"
    )
    print("|---" * 10 + "|")
    for seed in args.seeds:
        scene = shoot(SceneName("street", seed), LISTS["and V 5, 7, 10 m"], clean=True)
        reference, all_others = scene.reference, scene.others
        for count in (4, len(all_others)):
            for noise in NOISES:
                names = (count + 1, f"{noise[0]:g} deg, {noise[1]:.0%}")
                others = with_noise(
                    reference, all_others[:count], noise, np.random.default_rng(1000 + seed)
                )
                one, total = Errors(), totals.setdefault(names, Errors())
                started = time.perf_counter()
                result = refine(reference, others, RefineOptions(threads=args.threads))
                seconds = time.perf_counter() - started
                for errors in (one, total):
                    errors.seconds.append(seconds)
                    for refined, truth in zip(result.others, all_others):
                        errors.add(reference, refined, truth.T_home_cam)
                print(one.row(*names, seed), flush=True)
    for names, total in totals.items():
        print(total.row(*names, "all"))


if __name__ == "__main__":
    main()
