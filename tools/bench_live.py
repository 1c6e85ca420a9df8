# SPDX-License-Identifier: Apache-2.0
"""Monitoring (thesis 3.6) alone on the machine: depth of two configurations, again and again.

.venv/bin/python tools/bench_live.py --pictures 40
"""

import argparse
import time
from dataclasses import replace

import cv2
import numpy as np

from bench.scenes import NOISES, SceneName, shoot
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.in_flight.live import Corrections
from fcsv_stereo.pipeline import METHODS

PAIRS = [("horizontal", 2.0), ("vertical", 4.0)]  # the thesis's figure 3.15


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=int, default=40)
    parser.add_argument("--refine-every", type=int, default=20)
    args = parser.parse_args()
    scene = shoot(SceneName("street", 1), PAIRS)
    given, corrections = scene.given(PAIRS, NOISES[0]), Corrections()
    # the bench's pictures are all of one vehicle; here each configuration has its own
    given = replace(
        given,
        configurations=[
            replace(c, others=[replace(c.others[0], vehicle=f"uav{i}")])
            for i, c in enumerate(given.configurations, 2)
        ],
    )
    method = METHODS["joint"]
    method.map(given)  # kernels are loaded
    seconds, cores, shares = [], [], []
    for n in range(args.pictures):
        started, busy = time.perf_counter(), time.process_time()
        options = method.monitor
        if n % args.refine_every == 0:
            result = method.map(given, options)
            corrections.learn(result)
        else:
            result = method.map(corrections.apply(given), method.trusting_poses(options))
        seconds.append(time.perf_counter() - started)
        cores.append(time.process_time() - busy)
        depth = cv2.resize(
            result.depth, scene.true_depth.shape[::-1], interpolation=cv2.INTER_NEAREST
        )
        shares.append(band(depth, scene.true_depth, (0.0, 400.0)).within_10_percent)
    print(
        f"{args.pictures / sum(seconds):.2f} depth images a second (median {np.median(seconds):.2f} s, worst "
        f"{max(seconds):.2f} s; {np.mean(cores):.2f} s of processor time), {np.mean(shares):.1%} of all pixels up to "
        "400 m within 10 %"
    )


if __name__ == "__main__":
    main()
