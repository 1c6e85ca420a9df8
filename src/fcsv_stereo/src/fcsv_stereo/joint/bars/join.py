# SPDX-License-Identifier: Apache-2.0
"""The bars that a map's pairs show, in the map."""

from dataclasses import replace
from typing import List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_stereo.depth import cloud_of, pixels_of
from fcsv_stereo.joint.bars.edges import find_edges
from fcsv_stereo.joint.bars.match import match_edges
from fcsv_stereo.joint.bars.pairing import Bar, bars_of
from fcsv_stereo.joint.tuning import BARS, Bars
from fcsv_stereo.joint.views import camera_matrix, grey, projection
from fcsv_stereo.model import MapResult, Picture, concatenate


def with_bars(
    result: MapResult, pairs: Sequence[Tuple[Picture, Picture]], rules: Bars = BARS
) -> MapResult:
    """The map with the bars at which it has no depth.

    ``pairs``: of each of the map's pairs the reference picture and the other one, posed as the map
    used them. Where the map has another depth at much of a bar it is a stripe on what stands there,
    and left out.
    """
    shape = result.depth.shape
    inverse, sigma, of = (
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.uint8),
    )
    for number, (reference, other) in enumerate(pairs):
        for bar in bars_of_pair(reference, other, rules):
            rows, columns, w = bar.pixels(shape)
            known = np.isfinite(result.depth[rows, columns])
            apart = np.abs(1.0 / np.where(known, result.depth[rows, columns], 1.0) - w)
            spread = np.hypot(
                bar.sigma, result.sigma[rows, columns] / np.square(result.depth[rows, columns])
            )
            denied = known & ~(apart <= rules.agree * spread)
            if not len(w) or denied.mean() > rules.most_denied:
                continue
            better = (w > inverse[rows, columns]) & ~known
            at = rows[better], columns[better]
            inverse[at], sigma[at], of[at] = w[better], bar.sigma, number
    stands = inverse > 0.0
    return _joined(result, stands, inverse, sigma, of) if stands.any() else result


def bars_of_pair(reference: Picture, other: Picture, rules: Bars) -> List[Bar]:
    """The bars of the reference picture that the other one shows."""
    matrices = [camera_matrix(p.camera, p.image.shape[:2]) for p in (reference, other)]
    moves = projection(reference, other, *matrices)
    height, width = reference.image.shape[:2]
    at, b = moves[:9].reshape(3, 3) @ [(width - 1) / 2, (height - 1) / 2, 1.0], moves[9:]
    along = b[:2] * at[2] - at[:2] * b[2]  # how the middle moves as it comes nearer
    if not np.linalg.norm(along) > 0.0:
        return []
    one, two = (find_edges(p.image, along, rules) for p in (reference, other))
    found = match_edges(one, two, moves, other.image.shape[:2], rules)
    bars = bars_of(found, reference.camera.fx, rules)
    return [bar for bar in bars if _differs(bar, reference, other, moves) < rules.inside_differs]


def _differs(bar: Bar, reference: Picture, other: Picture, moves: np.ndarray) -> float:
    """Median difference (grey levels) of what both pictures show between a bar's edges at its
    depth, each less its median: between two conductors each shows another part of what is
    behind."""
    rows, columns, w = bar.pixels(reference.image.shape[:2])
    if not len(w):
        return np.inf
    at = (
        np.stack([columns, rows, np.ones(len(w))], axis=1) @ moves[:9].reshape(3, 3).T
        + w[:, None] * moves[9:]
    )
    x, y = (at[:, :2] / at[:, 2:]).astype(np.float32).T
    there = cv2.remap(
        grey(other), x.copy(), y.copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )[:, 0]
    apart = grey(reference)[rows, columns] - there
    return float(np.median(np.abs(apart - np.median(apart))))


def _joined(
    result: MapResult, stands: np.ndarray, inverse: np.ndarray, sigma: np.ndarray, of: np.ndarray
) -> MapResult:
    """The bars' depth where they stand (HxW bool), in the pictures and in the cloud."""
    w = np.where(stands, inverse, np.float32(np.nan))
    depth, depth_sigma = (1.0 / w).astype(np.float32), (sigma / np.square(w)).astype(np.float32)
    view, cloud = result.reference, result.cloud
    rows, columns, _, inside = pixels_of(view.camera, view.T_home_cam, cloud.points_home_m)
    kept = cloud[~(inside & stands[rows, columns])]
    cloud = concatenate([kept, cloud_of(view, depth, depth_sigma, of)])
    return replace(
        result,
        depth=np.where(stands, depth, result.depth),
        sigma=np.where(stands, depth_sigma, result.sigma),
        kind=np.where(stands, np.uint8(1), result.kind),
        cloud=cloud,
    )
