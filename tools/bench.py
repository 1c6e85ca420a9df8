# SPDX-License-Identifier: Apache-2.0
"""make bench: the figures of docs/results.md, measured on this machine; tables to docs/benchmarks.md."""

import argparse
import os
import platform
import time
from pathlib import Path

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.world.town import Town
from fcsv_stereo.evaluation import band
from fcsv_stereo.inputs import ConfigurationInput, MapInput, Picture
from fcsv_stereo.result import Configuration
from fcsv_stereo.thesis import ThesisOptions, map_thesis

LISTS = {
    "horizontal 2, 4, 6, 8 m": [("horizontal", b) for b in (2.0, 4.0, 6.0, 8.0)],
    "and vertical 5, 7, 10 m": [("horizontal", b) for b in (2.0, 4.0, 6.0, 8.0)]
    + [("vertical", b) for b in (5.0, 7.0, 10.0)],
}
CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0))


def noisy(T_home_cam, baseline_m, random):
    """A prior as a flight gives it: 0.15 degrees per axis, 1 % of the baseline."""
    rotation = random.normal(0.0, np.radians(0.15), 3)
    return T_home_cam @ transforms.from_xyz_rpy(random.normal(0.0, 0.01 * baseline_m, 3) / np.sqrt(3), rotation)


def scene(seed, configurations):
    """Rendered pictures with scattered places (3 cm, 1 degree) and noisy priors; and the reference's true depth."""
    random = np.random.default_rng(seed)
    renderer = Renderer(Town.generate(seed))
    T_world_home = transforms.from_xyz_yaw([1.0, 0.0, 8.0], 0.0)

    def shoot(xyz):
        p = np.asarray(xyz) + random.normal(0.0, 0.03, 3)
        T = transforms.from_xyz_rpy(p, random.normal(0.0, np.radians(1.0), 3))
        T_home_cam = T @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
        return T_home_cam, *renderer.render(T_world_home @ T_home_cam, CAMERA)

    T_reference, image, depth = shoot([0.0, 0.0, 0.0])
    reference = Picture("reference", "uav1", 0.0, image, CAMERA, T_reference)
    given = []
    for axis, b in configurations:
        T, picture, _ = shoot([0.0, -b, 0.0] if axis == "horizontal" else [0.0, 0.0, b])
        other = Picture(f"{axis} {b:g}", "uav2", 0.0, picture, CAMERA, noisy(T, b, random))
        given.append(ConfigurationInput(Configuration(axis, b, 0.0, other.name), [reference], [other]))
    return MapInput("session", given), depth


def thesis_table(seeds):
    rows = ["| list | seed | within 10 % | covered | wrong of answered | median error | seconds |", "|---" * 7 + "|"]
    for title, configurations in LISTS.items():
        for seed in seeds:
            given, truth = scene(seed, configurations)
            started = time.perf_counter()
            result = map_thesis(given, ThesisOptions(), lambda *_: None)
            seconds = time.perf_counter() - started
            b = band(result.depth, truth, (0.0, 400.0))
            rows.append(
                f"| {title} | {seed} | {b.within_10_percent:.1%} | {b.coverage:.1%} | {b.wrong_of_answered:.1%} "
                f"| {b.median_relative_error:.2%} | {seconds:.1f} |"
            )
            print(rows[-1], flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--out", default="docs/benchmarks.md")
    args = parser.parse_args()
    rows = thesis_table(args.seeds)
    head = [
        "# Benchmarks",
        "",
        f"`make bench`, {time.strftime('%Y-%m-%d')}, {platform.machine()} with {os.cpu_count()} cores, "
        f"Python {platform.python_version()}.",
        "",
        "Method `thesis` on rendered pictures of the simulated town (pixels up to 400 m; places scattered by 3 cm and",
        "1 degree; noise on every pose but the reference's 0.15 degrees per axis and 1 % of the baseline).",
        "",
    ]
    Path(args.out).write_text("\n".join([*head, *rows, ""]))
    print(f"wrote {args.out}")


if __name__ == "__main__":
    main()
