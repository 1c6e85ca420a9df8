# SPDX-License-Identifier: Apache-2.0
"""Nearest useful depth of a baseline against truth: the lower bound that thesis 7.2 asks for."""

from typing import List, Tuple

import methods
import numpy as np
from page import Page, metres
from scenes import CAMERA, Scene, Shot, city

from fcsv_geometry import transforms
from fcsv_stereo.equations import ErrorThreshold, farthest
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.planning.overlap import overlap_starts_m
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

_TENTH = ErrorThreshold(0.1, True)
_WINDOW = DisparityWindow(11, 256)  # 3.1
_BANDS_PER_DOUBLING = 4
_LEAST_PIXELS = 300
_USEFUL = 0.5  # of a band's pixels within 10 %
_LOW_M = 0.3  # above flat ground, which is seen from 0.75 m on
_RIG_M, _FLOWN_M = (0.1, 0.2, 0.3), (2.0, 4.0, 6.0, 8.0)


def nearest(page: Page) -> None:
    """Baselines of a rig and of flights from a hand's breadth above the ground; those of flights
    from 8 m too."""
    flown, low = city(), Scene(1, transforms.from_xyz_yaw([1.0, 0.0, _LOW_M], 0.0))
    rows = []
    for scene, baselines in ((low, (*_RIG_M, *_FLOWN_M)), (flown, _FLOWN_M)):
        for b in baselines:
            given, truth = scene.given([Shot("horizontal", b)])
            meet_m, far_m = overlap_starts_m(b, np.radians(56.0)), farthest(b, CAMERA.fx, _TENTH)
            seen_m = float(np.nanmin(truth))
            for name in methods.names():
                result = methods.run(
                    name, given, ThesisOptions(window=_WINDOW, threshold=methods.UNTRIMMED)
                )
                true_m = nearest_by_truth(result.depth, truth, far_m)
                told_m = result.pairs[0].effective_range_m[0] if name == "joint" else float("nan")
                height_m = scene.T_world_home[2, 3]
                rows.append(
                    (
                        f"{b:g} m",
                        f"{height_m:g} m",
                        name,
                        metres(seen_m),
                        metres(meet_m),
                        metres(true_m),
                        "–" if not np.isfinite(true_m) else f"{true_m / b:.1f}",
                        metres(told_m),
                        f"{far_m:.0f} m",
                    )
                )
    page.text(
        "## Nearest useful depth of a baseline (7.2)",
        "The thesis knows how far a baseline sees (3.1) and not from where on. Against truth: in bands of depth, "
        f"{_BANDS_PER_DOUBLING} per doubling, the share of all pixels within 10 %; the baseline is useful from "
        f"the nearest band on from which every band up to 3.1's farthest has {_USEFUL:.0%} and more. *Told*: "
        "what `joint` says of it in `effective_range_m`, from the evidence alone, without truth. *Nearest seen*: "
        "the nearest thing in the reference's picture. *Height*: of both cameras above the ground. Poses exact, "
        "one pair at a time.",
    )
    page.table(
        (
            "baseline",
            "height",
            "method",
            "nearest seen",
            "views meet",
            "useful from",
            "in baselines",
            "told",
            "farthest (3.1, 10 %)",
        ),
        rows,
    )


def nearest_by_truth(depth: np.ndarray, truth: np.ndarray, far_m: float) -> float:
    """The depth (m) from which on outwards, up to ``far_m``, half of every band's pixels are within
    10 %; NaN: none."""
    useful_m = float("nan")
    for low_m, high_m in _bands(truth, far_m)[::-1]:
        found = band(depth, truth, (low_m, high_m))
        if found.pixels < _LEAST_PIXELS:
            continue
        if found.within_10_percent < _USEFUL:
            break
        useful_m = low_m
    return useful_m


def _bands(truth: np.ndarray, far_m: float) -> List[Tuple[float, float]]:
    """Ranges (m) from the nearest truth to ``far_m``."""
    near_m = float(np.nanmin(truth))
    count = max(1, int(np.ceil(np.log2(max(far_m / near_m, 1.01)) * _BANDS_PER_DOUBLING)))
    edges = np.geomspace(near_m, max(far_m, 1.01 * near_m), count + 1)
    return [(float(a), float(b)) for a, b in zip(edges, edges[1:])]
