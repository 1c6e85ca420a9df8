# SPDX-License-Identifier: Apache-2.0
"""What two vehicles' pictures say where a tracker drifts, and where none does: on drawn towns, or
on sessions.

.venv/bin/python tools/bench_pair.py --seeds 1 2 3 --drifts 10
.venv/bin/python tools/bench_pair.py --sessions out/demo/session
"""

import argparse
import time
from pathlib import Path
from typing import Dict, Iterator, List, Tuple

import cv2
import numpy as np

from bench.scenes import LISTS, SceneName, shoot
from fcsv_geometry import transforms
from fcsv_stereo.in_flight import pair_check
from fcsv_stereo.in_flight.pair_check import PairLook
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement.features import FeatureView, KnownFeatures
from fcsv_stereo.refinement.matching import Matches, match_anywhere
from fcsv_stereo.sessions.read import read_session

WORLDS = ("street", "village", "field", "plain")
DRIFTS_M = (0.5, 1.0, 1.5, 2.0, 4.0, 8.0)
SEEN_ABOVE_M = 0.9  # across the way to the other, from which on a drift is asked to be seen
# rotation per axis (rad), position (m) and its share of the distance
TRACKER = (np.radians(0.3), 0.03, 0.01)
Pair = Tuple[FeatureView, FeatureView, Matches]


def matched(a: Picture, b: Picture, known: KnownFeatures) -> Pair:
    """What ``pair_check.look`` compares."""
    one, other = known.prepare(a, pair_check.FEATURES), known.prepare(b, pair_check.FEATURES)
    return one, other, match_anywhere(one, other)


def drawn(world: str, seed: int) -> Iterator[Pair]:
    """The reference's picture and one from each place, with noise and lens."""
    scene = shoot(SceneName(world, seed), LISTS["and V 5, 7, 10 m"])
    known = KnownFeatures()
    for other in scene.others:
        yield matched(scene.reference, other, known)


def recorded(session: Path, most: int = 4) -> Iterator[Pair]:
    """Of each configuration some of the pictures that both vehicles recorded."""
    for c in read_session(session).configurations:
        count = min(len(c.references), len(c.others))
        for k in range(0, count, max(1, count // most)):
            yield matched(c.references[k], c.others[k], KnownFeatures())


def looked(pair: Pair, told_b: np.ndarray) -> Tuple[PairLook, float]:
    """With the second camera at ``told_b`` by the trackers; and seconds."""
    a, b, matches = pair
    T_a_b = transforms.invert(a.picture.T_home_cam) @ told_b
    started = time.perf_counter()
    seen = pair_check.compare(T_a_b, a.rays[matches.a], b.rays[matches.b], b.camera.fx, b.noise_px)
    return seen, time.perf_counter() - started


def told(pair: Pair, drift_m: np.ndarray, random: np.random.Generator, noisy: bool) -> np.ndarray:
    """T_home_b by a tracker that drifted by (3,), with the errors of one that does not besides
    where ``noisy``."""
    a, b, _ = pair
    T = b.picture.T_home_cam.copy()
    if noisy:
        rotation_rad, m, share = TRACKER
        far_m = np.linalg.norm(T[:3, 3] - a.picture.T_home_cam[:3, 3])
        off_m = random.normal(0.0, np.hypot(m, share * far_m), 3)
        T = T @ transforms.from_xyz_rpy(off_m, random.normal(0.0, rotation_rad, 3))
    T[:3, 3] += drift_m
    return T


def across_m(pair: Pair, drift_m: np.ndarray) -> float:
    """How far a drift takes b off the way from a to b, beyond a where it goes past it."""
    a, b, _ = pair
    p = b.picture.T_home_cam[:3, 3] - a.picture.T_home_cam[:3, 3]
    q, way = p + drift_m, p / np.linalg.norm(p)
    return float(np.linalg.norm(q - max(0.0, q @ way) * way))


def rows(name: str, pairs: List[Pair], drifts: int, noisy: bool) -> Iterator[str]:
    """Of the table: without a drift, and with one of each length, in level ways but for a tenth."""
    random = np.random.default_rng(7)
    for length_m in (0.0, *DRIFTS_M):
        all_looks, seconds, wide = [], [], []
        for pair in pairs:
            for _ in range(drifts):
                way = random.normal(size=3) * [1.0, 1.0, 0.1]
                drift_m = length_m * way / np.linalg.norm(way)
                seen, took_s = looked(pair, told(pair, drift_m, random, noisy))
                all_looks.append(seen)
                seconds.append(took_s)
                if across_m(pair, drift_m) > SEEN_ABOVE_M:
                    wide.append(seen.off)
        off = sum(l.off for l in all_looks)
        enough = np.mean([l.matches >= pair_check.PairRules().matches for l in all_looks])
        far = f"{sum(wide)} of {len(wide)}" if wide else "–"
        most_m = max(l.off_m for l in all_looks)
        figures = (
            f"{enough:.0%}",
            f"{off} of {len(all_looks)}",
            far,
            f"{most_m:.2f}",
            f"{1e3 * np.mean(seconds):.1f}",
        )
        yield f"| {name} | {length_m:g} | {' | '.join(figures)} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=WORLDS)
    parser.add_argument("--drifts", type=int, default=10, help="ways of each length and pair")
    parser.add_argument(
        "--sessions", type=Path, nargs="+", help="instead of drawn towns; poses as they were flown"
    )
    args = parser.parse_args()
    cv2.setNumThreads(1)
    found: Dict[str, List[Pair]] = {}
    if args.sessions:
        found = {str(s): list(recorded(s)) for s in args.sessions}
    else:
        found = {w: [p for seed in args.seeds for p in drawn(w, seed)] for w in args.worlds}
    print(
        f"| pictures | drift (m) | enough matches | off | of those over {SEEN_ABOVE_M:g} m across | most off (m) | ms |"
    )
    print("|---" * 7 + "|")
    for name, pairs in found.items():
        for row in rows(name, pairs, args.drifts, noisy=not args.sessions):
            print(row, flush=True)


if __name__ == "__main__":
    main()
