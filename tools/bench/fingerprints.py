# SPDX-License-Identifier: Apache-2.0
"""Whether a change leaves the maps of the bench's scenes as they were, to the last bit.

    tools/run same-maps --write before.txt      at the old code
    tools/run same-maps --against before.txt    at the new code: exit status 1 where a map differs

A line is a map: scene, list of baselines, method, and SHA-256 sums of depth, sigma, points and
refined poses.
"""

import argparse
import hashlib
import sys
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from bench.measure import run
from bench.scenes import LISTS, NOISES, SCENES, shoot
from fcsv_stereo.model import MapResult
from fcsv_stereo.pipeline import METHODS

_DIGITS = 16


def main(argv: Optional[List[str]] = None) -> int:
    """Print a line per map; write them or compare them with those of a file."""
    parser = argparse.ArgumentParser(prog="same-maps", description=__doc__)
    parser.add_argument("--write", type=Path, help="file for the lines")
    parser.add_argument("--against", type=Path, help="file that --write made with other code")
    parser.add_argument("--quick", action="store_true", help="every fourth scene")
    args = parser.parse_args(argv)
    before = _read(args.against) if args.against else {}
    lines, differing = [], 0
    for name in SCENES[:: 4 if args.quick else 1]:
        scene = shoot(name, LISTS["and V 5, 7, 10 m"])
        for title, baselines in LISTS.items():
            given = scene.given(baselines, NOISES[0])
            for method in sorted(METHODS):
                key = f"{name} | {title} | {method}"
                sums = fingerprint(run(method, given)[0])
                differs = args.against is not None and before.get(key) != sums
                differing += differs
                lines.append(f"{key} | {sums}")
                print(
                    lines[-1] + ("  DIFFERS from " + before.get(key, "nothing") if differs else ""),
                    flush=True,
                )
    if args.write:
        args.write.write_text("\n".join(lines) + "\n")
    if args.against:
        print(f"{len(lines)} maps, {differing} differ")
    return int(differing > 0)


def fingerprint(result: MapResult) -> str:
    """Sums of depth, sigma, the cloud's points and the refined poses, by name."""
    poses = np.array([i.T_home_cam for i in result.images])
    parts = {
        "depth": result.depth,
        "sigma": result.sigma,
        "points": result.cloud.points_home_m,
        "poses": poses,
    }
    return " ".join(f"{k}={_sum(v)}" for k, v in parts.items())


def _sum(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:_DIGITS]


def _read(path: Path) -> Dict[str, str]:
    return dict(line.rsplit(" | ", 1) for line in path.read_text().splitlines())


if __name__ == "__main__":
    sys.exit(main())
