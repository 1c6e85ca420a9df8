# SPDX-License-Identifier: Apache-2.0
"""What moved while the vehicles flew from one configuration to the next, seen in the reference
camera's own pictures.

A thing that moves along the baselines as they grow looks like one at another depth, and all pairs
agree on it. But each configuration has a reference picture of its own, of the moment of its other
picture and from nearly the same place: there it shows itself. Where the first and a later one
differ, that configuration's pair does not count (docs/design/decisions/0008).
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.joint.checks.visibility import seen_from, visible
from fcsv_stereo.joint.tuning import MOVED, SHARED
from fcsv_stereo.model import ConfigurationInput, MapInput, MapResult, Picture, Reference, as_grey
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.refinement.features import corners

_WINDOW = (SHARED.window_px,) * 2
_SAMPLES = 5000  # px that tell the exposure: time alone


@dataclass(frozen=True)
class _Still:
    """The reference picture (HxWxC float32) with its depth and sigma (HxW, m) and corners (N, 2) px
    to align by."""

    image: np.ndarray
    depth: np.ndarray
    sigma: np.ndarray
    corners: np.ndarray
    full: np.ndarray  # HxW bool: there is picture


@dataclass(frozen=True)
class Moment:
    """A later picture of the reference camera: ``changed`` HxW bool where it shows something else,
    ``comparable`` HxW bool where it shows the place at all."""

    stamp_s: float
    changed: np.ndarray
    comparable: np.ndarray


def leave_out_moved(given: MapInput, result: MapResult) -> MapResult:
    """The result without the depths that rest on pairs before which something moved; it says so.

    Without reference pictures of later configurations (photographs) there is nothing to go by: the
    result as it is.
    """
    still: Optional[_Still] = None
    moments: Dict[str, Optional[Moment]] = {}  # pairs of one instant share their reference picture
    changed: Dict[int, np.ndarray] = {}
    watched = []
    for k, pair in enumerate(result.pairs):
        later = _reference_of(given.configurations, pair.other_name)
        if later is None or later.name == result.reference.name:
            continue
        still = still or _still(result.reference, result.depth, result.sigma)
        if later.name not in moments:
            scale = result.reference.camera.width / later.camera.width
            moments[later.name] = changes(
                result.reference, later.shrunk(scale) if scale < 1.0 else later, still
            )
        moment = moments[later.name]
        if moment is None:
            continue
        watched.append(pair.other_name)
        if moment.changed.any():
            changed[k] = moment.changed
    result = replace(result, watched=watched)
    seen = [m for m in moments.values() if m is not None]
    return (
        _without(result, changed, _never_again(result.reference.stamp_s, seen))
        if changed
        else result
    )


def _never_again(stamp_s: float, moments: List[Moment]) -> np.ndarray:
    """HxW bool: what no other moment shows as the reference picture does, though some could: it
    moves, and pairs of the reference picture's own instant agree on where it was only then.

    A moment so near in time that a walker has hardly moved tells nothing.
    """
    apart = [m for m in moments if abs(m.stamp_s - stamp_s) >= MOVED.apart_s]
    if not apart:
        return np.zeros(moments[0].changed.shape, bool)
    same = np.any([m.comparable & ~m.changed for m in apart], axis=0)
    return np.any([m.changed for m in apart], axis=0) & ~same


def changes(reference: Reference, later: Picture, still: _Still) -> Optional[Moment]:
    """Where ``later`` (from nearly the same place) shows something else; None where it cannot be
    compared."""
    T_later_ref = _aligned(reference, later, still)
    if T_later_ref is None:
        return None
    uv, z = seen_from(still.depth, reference.camera, T_later_ref, later.camera)
    here, there = still.image, cv2.remap(later.image.astype(np.float32), *uv, cv2.INTER_CUBIC)
    full = still.full & (cv2.remap(_full(later.image).astype(np.uint8), *uv, cv2.INTER_NEAREST) > 0)
    comparable = visible(uv, z, later.image.shape[:2]) & full
    difference = np.abs(here - _same_exposure(here, there, comparable)).mean(axis=2)
    grey = here.mean(axis=2)
    slope = np.hypot(
        cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125),
        cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125),
    )
    noise = float(np.median(difference[comparable])) if comparable.any() else 0.0
    explained = MOVED.noise * noise + cv2.blur(
        slope * _off_px(reference, T_later_ref, still), _WINDOW
    )
    unlike = (cv2.blur(difference, _WINDOW) > SHARED.beyond * explained) & comparable
    return Moment(later.stamp_s, _spots(unlike), comparable)


def _full(image: np.ndarray) -> np.ndarray:
    """HxW bool: not near the black that taking out the distortion leaves along the borders."""
    dark = (image == 0).reshape(*image.shape[:2], -1).all(axis=2)
    inside = np.zeros(dark.shape, bool)
    inside[1:-1, 1:-1] = True
    _, labels = cv2.connectedComponents(dark.astype(np.uint8), connectivity=8)
    empty = dark & np.isin(labels, np.unique(labels[dark & ~inside]))
    return cv2.dilate(empty.astype(np.uint8), np.ones(_WINDOW, np.uint8), iterations=2) == 0


def _off_px(reference: Reference, T_later_ref: np.ndarray, still: _Still) -> np.ndarray:
    """HxW: how far a place may lie from where it is looked for, as places differ and depth is
    uncertain."""
    off_1_m = np.nan_to_num(still.sigma / np.square(still.depth), nan=MOVED.unknown_1_m)
    return MOVED.off_px + reference.camera.fx * float(np.linalg.norm(T_later_ref[:3, 3])) * off_1_m


def _still(reference: Reference, depth: np.ndarray, sigma: np.ndarray) -> _Still:
    image = reference.image
    image = image if image.ndim == 3 else image[..., None]
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.shape[2] == 3 else image[..., 0]
    return _Still(
        image.astype(np.float32), depth, sigma, corners(grey, MOVED.corners), _full(image)
    )


def _reference_of(configurations: List[ConfigurationInput], other_name: str) -> Optional[Picture]:
    """The reference camera's picture nearest in time to another one, of its configuration."""
    for c in configurations:
        for other in c.others:
            if other.name == other_name and c.references:
                return min(c.references, key=lambda p: abs(p.stamp_s - other.stamp_s))
    return None


def _aligned(reference: Reference, later: Picture, still: _Still) -> Optional[np.ndarray]:
    """T_later_ref from corners tracked between the two, beginning with the priors; None where they
    do not agree."""
    T = transforms.invert(later.T_home_cam) @ reference.T_home_cam
    uv = still.corners
    at = np.round(uv).astype(int)
    z = still.depth[at[:, 1], at[:, 0]] if len(uv) else np.empty(0)
    uv, z = uv[np.isfinite(z)], z[np.isfinite(z)]
    if len(uv) < MOVED.least_corners:
        return None
    camera = reference.camera
    rays = np.column_stack(
        [(uv[:, 0] - camera.cx) / camera.fx, (uv[:, 1] - camera.cy) / camera.fy, np.ones(len(uv))]
    )
    points = rays * z[:, None]
    rotation, position = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].copy()
    start = cv2.projectPoints(points, rotation, position, later.camera.K, None)[0].astype(
        np.float32
    )
    a, b = as_grey(reference.image), as_grey(later.image)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        a,
        b,
        uv.astype(np.float32).reshape(-1, 1, 2),
        start,
        winSize=(MOVED.track_px,) * 2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    good = status.ravel() > 0
    if good.sum() < MOVED.least_corners:
        return None
    ok, rotation, position, inliers = cv2.solvePnPRansac(
        points[good],
        found[good].astype(float),
        later.camera.K,
        None,
        rotation,
        position,
        useExtrinsicGuess=True,
        reprojectionError=MOVED.most_off_px,
    )
    if (
        not ok
        or inliers is None
        or len(inliers) < max(MOVED.least_corners, MOVED.least_inliers * good.sum())
    ):
        return None
    chosen = inliers.ravel()
    rotation, position = cv2.solvePnPRefineLM(
        points[good][chosen],
        found[good][chosen].astype(float),
        later.camera.K,
        None,
        rotation,
        position,
    )
    return transforms.transform(cv2.Rodrigues(rotation)[0], position.ravel())


def _same_exposure(here: np.ndarray, there: np.ndarray, comparable: np.ndarray) -> np.ndarray:
    """``there`` with the brightness and contrast of ``here``, by channel, from what most pixels
    show."""
    there = there.reshape(here.shape)
    out = np.empty_like(there)
    for i in range(here.shape[2]):
        a, b = (
            x[..., i][comparable][:: max(1, int(comparable.sum()) // _SAMPLES)]
            for x in (here, there)
        )
        gain, offset = 1.0, 0.0
        for _ in range(MOVED.exposure_rounds if len(a) > SHARED.least_pixels else 0):
            off = np.abs(gain * b + offset - a)
            usual = off <= MOVED.noise * np.median(off) + 1.0
            gain, offset = np.polyfit(b[usual], a[usual], 1) if b[usual].std() > 1.0 else (1.0, 0.0)
        out[..., i] = gain * there[..., i] + offset
    return out


def _spots(unlike: np.ndarray) -> np.ndarray:
    """Connected places of some size, with a margin."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        unlike.astype(np.uint8), connectivity=8
    )
    large = stats[:, cv2.CC_STAT_AREA] >= max(MOVED.least_share * unlike.size, MOVED.least_spot_px)
    large[0] = False
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * MOVED.margin_px + 1,) * 2)
    return cv2.dilate(large[labels].astype(np.uint8), kernel) > 0


def _without(result: MapResult, changed: Dict[int, np.ndarray], moves: np.ndarray) -> MapResult:
    """Depths stay where the longest pair that agrees saw no change: a short one agrees with a wrong
    depth, too. Nothing stays of what ``moves`` (HxW bool).

    What stays is as uncertain as that pair alone would leave it.
    """
    unchanged, affected = (np.zeros(result.depth.shape, np.float32) for _ in range(2))
    for k, pair in enumerate(result.pairs):
        reach = np.where(
            np.isfinite(pair.depth), np.float32(pair.configuration.baseline_m), np.float32(0.0)
        )
        seen = changed.get(k, np.zeros(reach.shape, bool))
        np.maximum(affected, np.where(seen, reach, 0.0), out=affected)
        np.maximum(unchanged, np.where(seen, 0.0, reach), out=unchanged)
    somewhere = np.any(list(changed.values()), axis=0)
    known = np.isfinite(result.depth)
    gone = known & somewhere & ((unchanged <= affected) | moves)
    longest = np.float32(max(p.configuration.baseline_m for p in result.pairs))
    sigma = np.where(somewhere, result.sigma * longest / np.maximum(unchanged, 1e-3), result.sigma)
    warnings = list(result.warnings)
    if gone.mean() >= MOVED.warning_share:
        names = ", ".join(result.pairs[k].configuration.name for k in changed)
        warnings.append(
            f"left out: {gone.mean():.1%} of the picture, where something moved between the recordings (the reference "
            f"camera's picture differs in {names})"
        )
    kind = np.where(gone, np.uint8(DepthKind.MOVED), result.kind)
    return replace(
        result.with_sigma(sigma.astype(np.float32)).keep(~gone), warnings=warnings, kind=kind
    )
