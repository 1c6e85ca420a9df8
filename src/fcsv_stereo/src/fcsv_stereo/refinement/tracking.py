# SPDX-License-Identifier: Apache-2.0
"""Corners of one view measured to a fraction of a pixel in another, whose pose is nearly known."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fcsv_stereo.refinement.features import FeatureView, corners, rays_of
from fcsv_stereo.refinement.geometry import epipolar_error, project

_LEAST_NCC = 0.85
# depths of so many neighbours are tried: at an edge one may be in front and one behind
_HYPOTHESES = 2
_ROUNDS, _MOST_STEP_PX = 5, 0.7  # of what makes patches alike whatever their exposure
_MOST_GAIN = 3.0  # between two pictures' exposures: what is darker has too few grey levels left
# radius of the means, and how many, that two exposures are compared by
_MEAN_PX, _FEWEST_MEANS = 4, 20
# from where brightness alone puts a corner: beyond, the patches do not lead back to one place
_FARTHEST_PX = 1.5


@dataclass(frozen=True)
class Points:
    """Corners of a view: uv (N, 2) px, rays (N, 3), and candidate inverse depths (N, hypotheses)
    1/m."""

    uv: np.ndarray
    rays: np.ndarray
    rho: np.ndarray


@dataclass(frozen=True)
class Tracks:
    """Points (by index) measured in another view: rays (M, 3), z = 1, in its optical frame."""

    index: np.ndarray
    rays: np.ndarray


def seeded_points(view: FeatureView, uv: np.ndarray, rho: np.ndarray, count: int) -> Points:
    """Corners of a view with the inverse depths of the nearest matched features (uv, rho)."""
    found = corners(view.gray, count)

    _, near = cKDTree(uv).query(found, k=min(_HYPOTHESES, len(uv)))
    return Points(found, rays_of(view.camera, found), rho[near.reshape(len(found), -1)])


def track(
    a: FeatureView,
    b: FeatureView,
    T_a_b: np.ndarray,
    points: Points,
    gate_px: float,
    window_px: int = 9,
) -> Tracks:
    """Points of a found in b by Lucas-Kanade in b turned parallel to a, starting from their
    candidate depths, then whatever the exposures are. Kept where the patches correlate and the
    epipolar error is within the gate (px).
    """
    parallel, inside = _turned(a, b, T_a_b)
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    T_a_parallel = np.eye(4)
    T_a_parallel[:3, 3] = t
    # the start is as good as the features' places
    levels = int(np.clip(np.ceil(np.log2(2.0 * b.noise_px)), 1, 5))
    best_uv, best = np.full(points.uv.shape, np.nan), np.full(len(points.uv), _LEAST_NCC)
    starts = [_pixels(a, project(T_a_parallel, points.rays, rho)) for rho in points.rho.T]
    parallel = as_bright(parallel, inside, starts[0], a.gray, points.uv)
    for start in starts:
        uv = _lucas_kanade(a.gray, parallel, points.uv, start, window_px, levels)
        score = correlation(a.gray, parallel, points.uv, uv)
        better = score > best
        best_uv[better], best[better] = uv[better], score[better]
    index = np.flatnonzero(np.isfinite(best_uv[:, 0]))
    best_uv[index] = in_any_exposure(
        a.gray, parallel, points.uv[index], best_uv[index], window_px // 2
    )
    index = np.flatnonzero(np.isfinite(best_uv[:, 0]))
    index = index[inside[tuple(np.round(best_uv[index]).astype(int).T[::-1])]]
    rays = rays_of(a.camera, best_uv[index]) @ R
    rays = rays / rays[:, 2:]
    error = epipolar_error(T_a_b, points.rays[index], rays)[0] * b.camera.fx
    good = np.abs(error) < gate_px
    return Tracks(index[good], rays[good])


def in_any_exposure(
    image_a: np.ndarray, image_b: np.ndarray, uv_a: np.ndarray, uv_b: np.ndarray, radius_px: int = 4
):
    """Places (N, 2) in b, from ``uv_b`` on, whose patches are most like those at ``uv_a`` but for a
    gain and an offset; NaN where that is too far away. Gauss-Newton, each patch with a gain and an
    offset of its own (Baker et al. 2003, Lucas-Kanade 20 years on, part 3).

    Lucas-Kanade compares brightness itself. Where the vehicle's second picture is darker, an edge
    of a certain brightness lies elsewhere: by up to half a pixel, and by as much at a whole
    skyline.
    """
    if not len(uv_b):
        return uv_b
    first = _unit(_patches(image_a, uv_a, radius_px))
    image_b = image_b.astype(np.float32)
    slopes = [cv2.Sobel(image_b, cv2.CV_32F, *axes, scale=0.125) for axes in ((1, 0), (0, 1))]
    uv = uv_b.copy()
    for _ in range(_ROUNDS):
        there = _patches(image_b, uv, radius_px)
        off = first * _dot(first, there) - there
        J = [_patches(s, uv, radius_px) for s in slopes]
        jx, jy = (j - first * _dot(first, j) for j in J)
        xx, xy, yy = _dot(jx, jx) + 1e-3, _dot(jx, jy), _dot(jy, jy) + 1e-3
        x, y, det = _dot(jx, off), _dot(jy, off), xx * yy - xy * xy
        step = np.hstack([yy * x - xy * y, xx * y - xy * x]) / np.maximum(det, 1e-6)
        uv = uv + np.clip(step, -_MOST_STEP_PX, _MOST_STEP_PX)
    uv[~(np.linalg.norm(uv - uv_b, axis=1) < _FARTHEST_PX)] = np.nan
    return uv


def _unit(patches: np.ndarray) -> np.ndarray:
    return patches / np.maximum(np.linalg.norm(patches, axis=1, keepdims=True), 1e-6)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, 1) row by row."""
    return np.einsum("ij,ij->i", a, b)[:, None]


def correlation(
    image_a: np.ndarray, image_b: np.ndarray, uv_a: np.ndarray, uv_b: np.ndarray, radius_px: int = 5
):
    """Normalised cross-correlation (N,) of square patches about pixels (N, 2); -1 where either
    leaves its picture."""
    inside = _within(image_a, uv_a, radius_px) & _within(image_b, uv_b, radius_px)
    patch_a, patch_b = (
        _patches(i, uv[inside], radius_px) for i, uv in ((image_a, uv_a), (image_b, uv_b))
    )
    norms = np.linalg.norm(patch_a, axis=1) * np.linalg.norm(patch_b, axis=1)
    score = np.full(len(uv_a), -1.0)
    score[inside] = (patch_a * patch_b).sum(1) / np.maximum(norms, 1e-3)
    return score


def _turned(a: FeatureView, b: FeatureView, T_a_b: np.ndarray):
    """b as a camera like a's and parallel to it would have seen it, and where it has a source."""
    H = a.camera.K @ T_a_b[:3, :3] @ np.linalg.inv(b.camera.K)
    size = (a.camera.width, a.camera.height)
    parallel = cv2.warpPerspective(b.gray, H, size, flags=cv2.INTER_CUBIC)
    whole = np.full(b.gray.shape, 255, np.uint8)
    return parallel, cv2.warpPerspective(whole, H, size, flags=cv2.INTER_NEAREST) == 255


def as_bright(
    image: np.ndarray, inside: np.ndarray, uv: np.ndarray, as_this: np.ndarray, uv_this: np.ndarray
) -> np.ndarray:
    """``image`` with about the exposure of ``as_this``, by the means about places (N, 2) that are
    about the same in both and where the image has a source (``inside``): Lucas-Kanade leads nowhere
    where one is much darker."""
    seen = _within(as_this, uv_this, _MEAN_PX) & _within(image, uv, _MEAN_PX)
    seen[seen] = inside[tuple(np.round(uv[seen]).astype(int).T[::-1])]
    if seen.sum() < _FEWEST_MEANS:
        return image
    here, there = (_means(i, at[seen]) for i, at in ((as_this, uv_this), (image, uv)))
    gain, offset = 1.0, float(np.median(here - there))
    for _ in range(2):  # places at edges of depth are of something else
        off = np.abs(here - gain * there - offset)
        same = off <= 3.0 * max(float(np.median(off)), 1.0)
        gain = float(here[same].std() / max(there[same].std(), 1e-3))
        offset = float(here[same].mean() - gain * there[same].mean())
    if not 1.0 / _MOST_GAIN < gain < _MOST_GAIN:
        return image
    return np.clip(np.round(image * np.float32(gain) + np.float32(offset)), 0.0, 255.0).astype(
        np.uint8
    )


def _means(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N,) about pixels (N, 2)."""
    at = np.round(uv).astype(int)
    return cv2.blur(image.astype(np.float32), (2 * _MEAN_PX + 1,) * 2)[at[:, 1], at[:, 0]].astype(
        float
    )


def _lucas_kanade(image_a, image_b, uv, start, window_px, levels):
    known = np.isfinite(start).all(1)
    found = np.full(uv.shape, np.nan)
    if not known.any():
        return found
    first = start[known].astype(np.float32).reshape(-1, 1, 2)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        image_a,
        image_b,
        uv[known].astype(np.float32).reshape(-1, 1, 2),
        first.copy(),
        winSize=(window_px, window_px),
        maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=1e-3,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.005),
    )
    moved = moved.reshape(-1, 2).astype(float)
    moved[status.ravel() == 0] = np.nan
    found[known] = moved
    return found


def _pixels(view: FeatureView, rays: np.ndarray) -> np.ndarray:
    return rays[:, :2] * [view.camera.fx, view.camera.fy] + [view.camera.cx, view.camera.cy]


def _within(image, uv, margin_px):
    height, width = image.shape
    with np.errstate(invalid="ignore"):
        return ((uv >= margin_px) & (uv < np.array([width, height]) - 1 - margin_px)).all(1)


def _patches(image, uv, radius_px):
    """(N, patch) float32 without their mean."""
    offset = np.arange(-radius_px, radius_px + 1)
    du, dv = (d.ravel() for d in np.meshgrid(offset, offset))
    if not len(uv):
        return np.empty((0, len(du)), np.float32)
    maps = [(uv[:, i, None] + d).astype(np.float32) for i, d in enumerate((du, dv))]
    rows = [
        cv2.remap(image, m[i], n[i], cv2.INTER_LINEAR) for m, n in [maps] for i in _chunks(len(uv))
    ]
    patches = np.vstack(rows).astype(np.float32)
    return patches - patches.mean(1, keepdims=True)


def _chunks(count, size=30000):
    """OpenCV's remap takes fewer than 32768 rows."""
    return [slice(i, i + size) for i in range(0, count, size)]
