# SPDX-License-Identifier: Apache-2.0
"""Confidence fusion against trimming (7.2): depths of four baselines put together in three ways,
and their seams."""

from typing import Sequence, Tuple

import methods
import numpy as np
from page import Page, panels, percent
from scenes import CAMERA, FLIGHT, Shot, city

from fcsv_stereo.equations import ErrorThreshold, depth_error, farthest
from fcsv_stereo.evaluating.evaluation import band
from fcsv_stereo.thesis import ThesisOptions
from fcsv_stereo.thesis.matchers import DisparityWindow

_WINDOW = DisparityWindow(11, 256)  # 3.1
_TENTH = ErrorThreshold(0.1, True)
_BASELINES_M = (2.0, 4.0, 6.0, 8.0)
_MOST_M = 400.0
_SEAM = 0.05  # of a trim point
# of the depth: neighbours whose truth differs by less stand on one surface; a step
_SURFACE, _STEP = 0.01, 0.05
_AGREE = 3.0  # standard deviations between two depths that may be averaged


def seams(page: Page) -> None:
    """Exact poses, and as flown; trimmed, weighted by confidence, and `joint`."""
    shots = [Shot("horizontal", b) for b in _BASELINES_M]
    ends_m = [farthest(b, CAMERA.fx, _TENTH) for b in _BASELINES_M[:-1]]
    rows, shown, titles = [], [], []
    for words, scatter in (("exact", None), ("as flown", FLIGHT)):
        given, truth = city().given(shots, scatter)
        results = methods.run_all(given, ThesisOptions(window=_WINDOW))
        weighted = by_confidence(
            [p.depth for p in results["thesis"].pairs], _BASELINES_M, CAMERA.fx
        )
        ways = {
            "trimmed (3.2)": results["thesis"].depth,
            "weighted by 2.12": weighted,
            "joint": results["joint"].depth,
        }
        for name, depth in ways.items():
            whole, at = band(depth, truth, (0.0, _MOST_M)), near_ends(truth, ends_m)
            there = at_seams(depth, truth, at)
            rows.append(
                (
                    words,
                    name,
                    percent(whole.within_10_percent),
                    percent(whole.wrong_of_answered),
                    *map(percent, there),
                    percent(broken(depth, truth, ~at)),
                )
            )
        shown += [] if scatter else list(ways.values())
        titles += [] if scatter else list(ways)
    ends = ", ".join(f"{m:.0f}" for m in ends_m)
    page.text(
        "## Confidence against trimming (7.2)",
        f"The thesis trims each baseline at its range (here at {ends} m) and asks for a confidence of each "
        "point instead. *Weighted by 2.12*: depths of its matcher "
        f"within {_AGREE:g} standard deviations of the surest, averaged by their inverse "
        "variances (2.12 for one pixel). "
        f"*At seams*: pixels whose truth is within {_SEAM:.0%} of a trim point. *Broken*: of neighbouring pixels "
        f"with a depth that stand on one surface, those between which the map steps by {_STEP:.0%} and more.",
    )
    head = (
        "poses",
        "put together",
        "within 10 %",
        "wrong of answered",
        "at seams: covered",
        "within 10 %",
        "broken",
        "broken elsewhere",
    )
    page.table(head, rows)
    page.figure(
        panels(shown, titles, 3),
        "7_2_seams",
        "Four baselines trimmed, weighted, and joint; exact poses",
    )


def by_confidence(
    depths: Sequence[np.ndarray], baselines_m: Sequence[float], focal_px: float
) -> np.ndarray:
    """(H, W) m: of untrimmed depths (H, W) of one view the mean of those that agree with the
    surest, by equation 2.12.

    >>> by_confidence([np.array([[50.0, 9.0]]), np.array([[51.0, np.nan]])], (2.0, 4.0), 600.0).round(1).tolist()
    [[50.8, 9.0]]
    """
    z = np.stack(depths).astype(float)
    sigma = np.stack([depth_error(d, b, focal_px) for d, b in zip(z, baselines_m)])
    relative = np.where(np.isfinite(z), sigma / z, np.inf)
    best = relative.argmin(axis=0)[None]
    z_best, sigma_best = (np.take_along_axis(a, best, axis=0) for a in (z, sigma))
    with np.errstate(invalid="ignore"):
        agree = np.abs(z - z_best) <= _AGREE * np.hypot(sigma, sigma_best)
    weight = np.where(agree, sigma**-2.0, 0.0)
    total = weight.sum(axis=0)
    mean = (weight * np.where(agree, z, 0.0)).sum(axis=0) / np.maximum(total, 1e-30)
    return np.where(total > 0, mean, np.nan)


def near_ends(truth: np.ndarray, ends_m: Sequence[float]) -> np.ndarray:
    """(H, W) bool: whose truth (m) is near one of the trim points."""
    with np.errstate(invalid="ignore"):
        return np.any([np.abs(truth / end_m - 1.0) < _SEAM for end_m in ends_m], axis=0)


def at_seams(depth: np.ndarray, truth: np.ndarray, at: np.ndarray) -> Tuple[float, float, float]:
    """Shares of the pixels ``at`` (H, W; bool) that are covered and within 10 %, and of neighbours
    that are broken."""
    with np.errstate(invalid="ignore"):
        right = np.abs(depth[at] / truth[at] - 1.0) <= 0.1
    return float(np.isfinite(depth[at]).mean()), float(right.mean()), broken(depth, truth, at)


def broken(depth: np.ndarray, truth: np.ndarray, at: np.ndarray) -> float:
    """Share of the neighbours on one surface, both ``at`` and with a depth, between which the depth
    steps."""
    count = steps = 0
    for axis in (0, 1):
        z, true, here = (np.moveaxis(a, axis, 0) for a in (depth, truth, at))
        with np.errstate(invalid="ignore"):
            true_step = true[1:] / true[:-1] - 1.0
            step = np.abs(z[1:] / z[:-1] - 1.0 - true_step)
            judged = here[1:] & here[:-1] & (np.abs(true_step) < _SURFACE) & np.isfinite(step)
        count, steps = count + int(judged.sum()), steps + int((step[judged] > _STEP).sum())
    return steps / count if count else float("nan")
