# SPDX-License-Identifier: Apache-2.0
"""What the report states beyond the map, measured from the result: overlap, epipolar offset, seams,
corrections."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.depth import shown_share
from fcsv_stereo.model import Axis, ImageEntry, MapResult, Pair

_FAR_M = 1e5  # where a pixel without depth is taken to look
_STEP_PX = 4  # of the grid on which overlap is counted, at least
_MOST_COUNTED = 100000  # places of that grid: wider steps in large pictures
_CORNERS = 600
_LEAST_CORNERS = 20  # about a seam, for each pair
_LEAST_LOOKED_FOR = 50
_SEAM_SHARE = 0.15  # half-width of the range about a trim point in which two pairs are compared


@dataclass(frozen=True)
class PairEvidence:
    """Holds the evidence of one pair: ``overlap`` is the share of the reference's view that the
    other sees; the epipolar offset (px, rms and median) is that of corners across the epipolar
    line, None where too few were found; ``carried_m`` holds 5th and 95th percentile of the depths
    that the map took from it, None where it took none. ``found`` is the share of the corners looked
    for that are where their depth says, None where there was hardly a corner."""

    overlap: float
    epipolar_rms_px: Optional[float]
    epipolar_median_px: Optional[float]
    corners: int
    points: int
    carried_m: Optional[Tuple[float, float]]
    found: Optional[float] = None
    followed: Optional[Tuple[np.ndarray, np.ndarray]] = None


@dataclass(frozen=True)
class Seam:
    """Two pairs about the range at which one takes over from the other: median of longer over
    shorter, less one.

    ``pixels`` that both saw; corners, where the method gives one depth for all pairs.
    """

    shorter: str
    longer: str
    at_m: float
    pixels: int
    step: float


def pair_evidence(result: MapResult, index: int) -> PairEvidence:
    """All about one pair of the map."""
    p = result.pairs[index]
    start = corners(p)
    there, looked_for = followed(p, start), len(start)
    offsets = there[1][:, 1 - _along(p)]
    found = len(offsets) / looked_for if looked_for >= _LEAST_LOOKED_FOR else None
    enough = len(offsets) >= 20
    # beyond three robust deviations it is a wrong correspondence
    if enough:
        spread = 1.4826 * np.median(np.abs(offsets - np.median(offsets)))
        offsets = offsets[np.abs(offsets - np.median(offsets)) <= 3.0 * max(spread, 0.05)]
    mine = result.cloud.baseline_index == index
    carried = None
    if mine.any():
        T_cam_home = transforms.invert(result.reference.T_home_cam)
        z = result.cloud.points_home_m[mine].astype(float) @ T_cam_home[2, :3] + T_cam_home[2, 3]
        carried = tuple(float(v) for v in np.percentile(z, [5, 95]))
    rms = float(np.sqrt(np.mean(offsets**2))) if enough else None
    middle = float(np.median(np.abs(offsets))) if enough else None
    return PairEvidence(
        overlap(result, p), rms, middle, len(offsets), int(mine.sum()), carried, found, there
    )


def overlap(result: MapResult, p: Pair) -> float:
    """Share of the reference picture's pixels that the other camera sees, at the mapped depth or
    far away."""
    reference = result.reference
    step_px = max(_STEP_PX, int(np.ceil(np.sqrt(result.depth.size / _MOST_COUNTED))))
    depth = result.depth[::step_px, ::step_px]
    z = np.where(np.isfinite(depth), depth, _FAR_M)
    points_cam = (reference.camera.rays(step_px) * z[..., None]).reshape(-1, 3)
    return shown_share(
        reference.camera, p.T_home_cam_other, transforms.apply(reference.T_home_cam, points_cam)
    )


def followed(p: Pair, start: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Disparities (N,) px of corners that start at (N,2) px, and how far (N,2) px from where these
    say they are in the other picture: what is left across the epipolar line is its error. Those
    that optical flow finds, forth and back.
    """
    along = _along(p)
    if not len(start):
        return np.empty(0), np.empty((0, 2))
    a, b = _greys(p)
    u, v = np.rint(start).astype(int).T
    guess = start.copy()
    guess[:, along] -= p.disparity[v, u]
    window = {"winSize": (15, 15), "maxLevel": 1, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    there, good, _ = cv2.calcOpticalFlowPyrLK(a, b, start, guess.copy(), **window)
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(b, a, there, start.copy(), **window)
    kept = (good.ravel() == 1) & (good_back.ravel() == 1) & (np.hypot(*(back - start).T) < 0.5)
    kept &= np.abs(there - guess)[:, along] < 3.0
    return p.disparity[v, u][kept].astype(float), (there - guess)[kept].astype(float)


def corners(p: Pair) -> np.ndarray:
    """(N,2) px float32, in the rectified reference picture, where there is a disparity to look for
    them by."""
    a, b = _greys(p)
    known = np.isfinite(p.disparity)
    if a.shape != b.shape or known.shape != a.shape or not known.any():
        return np.empty((0, 2), np.float32)
    found = cv2.goodFeaturesToTrack(a, _CORNERS, 0.01, 6, mask=known.astype(np.uint8))
    return np.empty((0, 2), np.float32) if found is None else found.reshape(-1, 2)


def _greys(p: Pair) -> Tuple[np.ndarray, np.ndarray]:
    return tuple(
        cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in (p.reference_rectified, p.other_rectified)
    )


def _along(p: Pair) -> int:
    return p.configuration.axis.coordinate


def seams(result: MapResult, evidence: Sequence[PairEvidence] = ()) -> List[Seam]:
    """Where one baseline of an axis takes over from the next shorter one; ``evidence`` of the
    pairs, where it is there."""
    found, known = [], {id(p): e.followed for p, e in zip(result.pairs, evidence)}
    for axis in Axis:
        pairs = [p for p in result.pairs if p.configuration.axis == axis]
        pairs.sort(key=lambda p: p.configuration.baseline_m)
        for a, b in zip(pairs, pairs[1:]):
            at_m = a.effective_range_m[1]
            if not np.isfinite(at_m):
                continue
            if a.shares_depth and b.shares_depth:
                found += _seam_of_shared_depth(result, a, b, at_m, known)
                continue
            with np.errstate(invalid="ignore"):
                near = (np.abs(a.depth / at_m - 1) < _SEAM_SHARE) & (
                    np.abs(b.depth / at_m - 1) < _SEAM_SHARE
                )
            if near.sum() >= 50:
                step = float(np.median(b.depth[near] / a.depth[near]) - 1.0)
                found.append(
                    Seam(a.configuration.name, b.configuration.name, at_m, int(near.sum()), step)
                )
    return found


def _seam_of_shared_depth(
    result: MapResult,
    a: Pair,
    b: Pair,
    at_m: float,
    known: Dict[int, Optional[Tuple[np.ndarray, np.ndarray]]],
) -> List[Seam]:
    """Both pairs gave one depth: what each alone would have made of corners about ``at_m``, as they
    are displaced. ``known``: corners followed already, by the identity of the pair."""
    ratios = []
    for p in (a, b):
        disparity, left = known.get(id(p)) or followed(p, corners(p))
        focal_px = (result.reference.camera.fx, result.reference.camera.fy)[_along(p)]
        near = (
            np.abs(np.abs(disparity) * at_m / (focal_px * p.configuration.baseline_m) - 1.0)
            < _SEAM_SHARE
        )
        ratios.append(disparity[near] / (disparity[near] - left[near, _along(p)]))
    count = min(map(len, ratios))
    if count < _LEAST_CORNERS:
        return []
    step = float(np.median(ratios[1]) / np.median(ratios[0]) - 1.0)
    return [Seam(a.configuration.name, b.configuration.name, at_m, count, step)]


def correction(e: ImageEntry) -> Tuple[float, float]:
    """Degrees and metres between a picture's prior and its pose."""
    return e.turned_deg, e.moved_m


def sigma_bands(
    result: MapResult, edges_m=(0.0, 25.0, 50.0, 100.0, 200.0, 400.0, np.inf)
) -> List[Dict[str, float]]:
    """Gives, by mapped depth: pixels, median sigma (m), median of sigma over depth."""
    rows = []
    known = np.isfinite(result.depth) & np.isfinite(result.sigma)
    for a, b in zip(edges_m, edges_m[1:]):
        inside = known & (result.depth > a) & (result.depth <= b)
        if inside.any():
            sigma = result.sigma[inside]
            share = float(np.median(sigma / result.depth[inside]))
            rows.append(
                {
                    "from_m": a,
                    "to_m": b,
                    "pixels": int(inside.sum()),
                    "sigma_m": float(np.median(sigma)),
                    "share": share,
                }
            )
    return rows
