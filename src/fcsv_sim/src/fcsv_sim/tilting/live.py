# SPDX-License-Identifier: Apache-2.0
"""What the live map shows of one of the rig's pairs, without bars and with them, and what they
cost."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Tuple

import cv2
import numpy as np

from fcsv_sim.tilting.trial import PairOutcome, right_pixels
from fcsv_stereo import pipeline
from fcsv_stereo.in_flight import monitoring
from fcsv_stereo.model import MapResult

RANGE_M = (0.3, 20.0)  # of the colours, as launch/tilting.launch has it
_RUNS = 2  # the shorter one counts: the first may load kernels


@dataclass(frozen=True)
class LiveDepth:
    """``right``: share of the thing's pixels in the picture that are within 10 %; ``took_s``:
    processor time."""

    result: MapResult
    right: float
    took_s: float


def live_depths(folder: Path, outcome: PairOutcome) -> Tuple[LiveDepth, LiveDepth]:
    """Maps the pair without bars and with them, as ``live_map`` makes them in between refinements:
    poses are the rig's own.

    ``folder`` holds the pair of ``outcome`` (``shots.photographed``). Raises StereoError where there is no
    depth.
    """
    method, given = pipeline.METHODS[pipeline.DEFAULT_METHOD], pipeline.load(folder)
    plain = method.trusting_poses(method.monitor)
    found = []
    for options in (plain, method.with_bars(plain)):
        took_s = float("inf")
        for _ in range(_RUNS):
            begun_s = time.process_time()
            result = method.map(given, options)
            took_s = min(took_s, time.process_time() - begun_s)
        size = result.depth.shape[::-1]
        thing = (
            cv2.resize(outcome.view.thing.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
            > 0
        )
        truth = cv2.resize(outcome.view.depth, size, interpolation=cv2.INTER_NEAREST)
        found.append(
            LiveDepth(
                result, right_pixels(result.depth, truth, thing) / max(int(thing.sum()), 1), took_s
            )
        )
    return found[0], found[1]


def write_live(outcome: PairOutcome, depths: Tuple[LiveDepth, LiveDepth], file: Path) -> None:
    """Both as /map/monitor shows them, one above the other."""
    rows = []
    for depth, name in zip(depths, ("without bars", "with bars")):
        words = f"{outcome.thing} at {outcome.distance_m:g} m, live, {name}: {depth.right:.0%} within 10 %"
        rows.append(
            monitoring.picture(depth.result.reference.image, depth.result.depth, words, RANGE_M)
        )
    cv2.imwrite(str(file), np.vstack(rows)[..., ::-1])
