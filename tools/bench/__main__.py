# SPDX-License-Identifier: Apache-2.0
"""The command behind ``make bench``."""

import argparse
import os
import platform
import sys
import time
from pathlib import Path
from typing import List, Optional

import numpy as np

from bench import colmap_poses, growth, large, pandora_intervals, tables
from bench.measure import measure, prior_errors_deg, run
from bench.pairs import measure_pairs
from bench.real import measure_answered, measure_real
from bench.rig_pairs import measure_rigs
from bench.scenes import LISTS, NOISES, SCENES, VERTICAL, SceneName, shoot, smaller
from fcsv_stereo.pipeline import METHODS

_PLOT = "../pictures/growth.png"  # from the page
_PAGE = ("methods", "colmap", "pandora", "growth")
_PARTS = (*_PAGE, "answered", "real", "rigs", "large")


def main(argv: Optional[List[str]] = None) -> int:
    """Measure, print while it goes, write the page; parts of it alone are printed where no file is
    named."""
    args = _parse(argv)
    scenes = args.scenes or (SCENES[::4] if args.quick else SCENES)
    if args.install_pandora:
        pandora_intervals.install()
    results, priors, poses = {}, {}, []
    why_not = colmap_poses.missing()
    for name in scenes if {"methods", "colmap"} & args.parts else []:
        print(f"{name}:", flush=True)
        scene = shoot(name, LISTS["and V 5, 7, 10 m"], clean=args.clean)
        if name == scenes[0]:
            _warm_up(scene, args.methods)
        if "methods" in args.parts:
            _methods(scene, args.methods, results, priors)
        if "colmap" in args.parts and why_not is None:
            poses.append((name, colmap_poses.colmap_on(scene), colmap_poses.ours_on(scene)))
            print(f"    COLMAP: {poses[-1][1]}\n    ours: {poses[-1][2]}", flush=True)
    pairs = measure_pairs(scenes) if "pandora" in args.parts else []
    samples = growth.measure_growth(args.methods, args.quick) if "growth" in args.parts else []
    answered = measure_answered(scenes) if "answered" in args.parts else []
    real = measure_real() if "real" in args.parts else []
    rigs = measure_rigs() if "rigs" in args.parts else []
    waited = large.measure_large(args.quick) if "large" in args.parts else []
    out = Path(args.out) if args.out else None
    if samples:
        growth.plot(
            samples, Path(os.path.normpath((out.parent if out else Path("docs/lab")) / _PLOT))
        )
    measured = (pairs, samples, answered, real, rigs, waited)
    page = "\n".join(_page(args, scenes, results, priors, poses, why_not, *measured)) + "\n"
    if out is None:
        print(page)
        return 0
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page)
    print(f"wrote {out}")
    return 0


def _methods(scene, methods: List[str], results: dict, priors: dict) -> None:
    """Every method with every list and noise on one scene, into ``results`` and ``priors``."""
    for title, baselines in LISTS.items():
        for noise in NOISES[: 1 if baselines[-1] in VERTICAL else 2]:
            given = scene.given(baselines, noise)
            priors.setdefault(str(noise), []).extend(prior_errors_deg(given, scene))
            for method in methods:
                f = measure(method, given, scene)
                results.setdefault((method, title, str(noise)), []).append(f)
                print(
                    f"    {title}, {noise}, {method}: within 10 % {f.within_10:.1%}, wrong "
                    f"{f.wrong_of_answered:.1%}, median {f.median:.2%}, rotation "
                    f"{f.rotation_median_deg:.3f}°, {f.seconds:.1f} s",
                    flush=True,
                )


def _warm_up(scene, methods: List[str]) -> None:
    """Kernels are compiled once and cached: that is not a method's time."""
    small = smaller(scene.given(scene.baselines[:1], NOISES[0]), 2)
    for method in methods:
        run(method, small)


def _page(
    args, scenes, results, priors, poses, why_not, pairs, samples, answered, real, rigs, waited
) -> List[str]:
    names, noises = list(map(str, scenes)), list(map(str, NOISES))
    command = "make bench" + (f' ARGS="{" ".join(args.given)}"' if args.given else "")
    lens = "without" if args.clean else "with"
    lines = [
        "# Benchmarks",
        "",
        f"`{command}`, {time.strftime('%Y-%m-%d')}, {platform.machine()} with {os.cpu_count()} cores shared with other "
        f"work, Python {platform.python_version()}.",
        "",
    ]
    if {"methods", "colmap"} & args.parts:
        lines += [
            "Every method maps the same pictures in the same run. Scenes (the simulator's worlds and seeds):",
            f"{', '.join(names)}. Pictures: 640x480, f = 602 px, {lens} the simulated camera's noise and blur. Places",
            "scatter by 3 cm and 1°. Every pose but the reference's has noise (rotation per axis, position as a share",
            "of the baseline). Figures are of the pixels with truth up to 400 m. Rotation errors are relative to the",
            "reference.",
            "",
        ]
    if results:
        lines += [*tables.requirement_table(results, list(LISTS), noises), ""]
        lines += [
            "Rows without a bound are the field's metrics (`fcsv_stereo/evaluating/depth_metrics.py` defines them), of",
            "the answered pixels; `joint` answers all here (`--complete`). AUSE is 0 where sigma sorts the",
            "pixels as their errors do; the overconfident share is 20 % where sigma says nothing. The worst",
            "band is the worst of all scenes' bands, not a mean.",
            "",
        ]
        lines += [
            "Rotation errors of the priors: "
            + "; ".join(
                f"noise {n}: median {np.median(e):.3f}°, worst {np.max(e):.3f}°"
                for n, e in priors.items()
            )
            + ".",
            "",
        ]
    if "colmap" in args.parts:
        lines += ["## COLMAP on the same eight pictures", ""]
        lines += [f"Left out: {why_not}."] if why_not else tables.pose_table(poses)
        lines.append("")
    if pairs:
        lines += ["## Pandora on the same rectified pairs", "", *pairs, ""]
    if results:
        lines += ["## Scene by scene", *tables.scene_tables(results, names), ""]
    if answered:
        lines += [
            "## Answered without --complete, H 2, 4, 6, 8 m, pose noise 0.15° and 1%",
            "",
            *answered,
            "",
        ]
    if real:
        lines += ["## Hard cases and real photographs", "", *real, ""]
    if rigs:
        lines += ["## Pairs of a stereo rig", "", *rigs, ""]
    if samples:
        lines += [
            "## Growth",
            "",
            f"![time and memory]({_PLOT})",
            "",
            *tables.growth_table(samples),
            "",
        ]
        lines.append(
            "Dotted: linear growth from the first point. Memory: the run's peak, less what the process had before."
        )
    if waited:
        lines += [
            *([""] if samples else []),
            "## What a user waits",
            "",
            *large.large_table(waited),
            "",
        ]
        lines.append(
            "`fcsv map` of photographs from reading them to the report; memory is the process's peak."
        )
    return lines


def scene_of(text: str) -> SceneName:
    world, _, seed = text.partition(":")
    if not seed.isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not WORLD:SEED, as street:1")
    return SceneName(world, int(seed))


def _parse(argv):
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="two scenes, and the small end of growth"
    )
    parser.add_argument(
        "--scenes", type=scene_of, nargs="+", metavar="WORLD:SEED", help="these scenes"
    )
    parser.add_argument(
        "--methods", nargs="+", choices=sorted(METHODS), default=sorted(METHODS, reverse=True)
    )
    parser.add_argument(
        "--clean", action="store_true", help="pictures without the camera's noise and blur"
    )
    parser.add_argument(
        "--no-growth", action="store_true", help="leave time and memory against size out"
    )
    what = "make Pandora's environment first (build/pandora): it needs another numpy"
    parser.add_argument("--install-pandora", action="store_true", help=what)
    parser.add_argument(
        "--only", nargs="+", choices=_PARTS, help="these parts; printed, unless --out is given"
    )
    parser.add_argument("--out", help="the page; docs/lab/benchmarks.md, where all is measured")
    args = parser.parse_args(argv)
    args.parts = set(args.only or _PAGE) - ({"growth"} if args.no_growth else set())
    if not args.only and not args.out:
        args.out = "docs/lab/benchmarks.md"
    args.given = sys.argv[1:] if argv is None else list(argv)
    return args


if __name__ == "__main__":
    sys.exit(main())
