# SPDX-License-Identifier: Apache-2.0
"""Corners of one view measured to a fraction of a pixel in another, whose pose is nearly known."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fcsv_stereo.refinement.features import View, corners, rays_of
from fcsv_stereo.refinement.geometry import epipolar_error, project

_LEAST_NCC = 0.85
_HYPOTHESES = 2  # depths of so many neighbours are tried: at an edge one may be in front and one behind


@dataclass(frozen=True)
class Points:
    """Corners of a view: uv (N, 2) px, rays (N, 3), and candidate inverse depths (N, hypotheses) 1/m."""

    uv: np.ndarray
    rays: np.ndarray
    rho: np.ndarray


@dataclass(frozen=True)
class Tracks:
    """Points (by index) measured in another view: rays (M, 3), z = 1, in its optical frame."""

    index: np.ndarray
    rays: np.ndarray


def seeded_points(view: View, uv: np.ndarray, rho: np.ndarray, count: int) -> Points:
    """Corners of a view with the inverse depths of the nearest matched features (uv, rho)."""
    found = corners(view.gray, count)

    _, near = cKDTree(uv).query(found, k=min(_HYPOTHESES, len(uv)))
    return Points(found, rays_of(view.camera, found), rho[near.reshape(len(found), -1)])


def track(a: View, b: View, T_a_b: np.ndarray, points: Points, gate_px: float, window_px: int = 9) -> Tracks:
    """Points of a found in b by Lucas-Kanade in b turned parallel to a, starting from their candidate depths.

    Kept where the patches correlate and the epipolar error is within the gate (px).
    """
    parallel, inside = _turned(a, b, T_a_b)
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    T_a_parallel = np.eye(4)
    T_a_parallel[:3, 3] = t
    levels = int(np.clip(np.ceil(np.log2(2.0 * b.noise_px)), 1, 5))  # the start is as good as the features' places
    best_uv, best = np.full(points.uv.shape, np.nan), np.full(len(points.uv), _LEAST_NCC)
    for rho in points.rho.T:
        start = _pixels(a, project(T_a_parallel, points.rays, rho))
        uv = _lucas_kanade(a.gray, parallel, points.uv, start, window_px, levels)
        score = correlation(a.gray, parallel, points.uv, uv)
        better = score > best
        best_uv[better], best[better] = uv[better], score[better]
    index = np.flatnonzero(np.isfinite(best_uv[:, 0]))
    index = index[inside[tuple(np.round(best_uv[index]).astype(int).T[::-1])]]
    rays = rays_of(a.camera, best_uv[index]) @ R
    rays = rays / rays[:, 2:]
    error = epipolar_error(T_a_b, points.rays[index], rays)[0] * b.camera.fx
    good = np.abs(error) < gate_px
    return Tracks(index[good], rays[good])


def correlation(image_a: np.ndarray, image_b: np.ndarray, uv_a: np.ndarray, uv_b: np.ndarray, radius_px: int = 5):
    """Normalised cross-correlation (N,) of square patches about pixels (N, 2); -1 where either leaves its picture."""
    inside = _within(image_a, uv_a, radius_px) & _within(image_b, uv_b, radius_px)
    patch_a, patch_b = (_patches(i, uv[inside], radius_px) for i, uv in ((image_a, uv_a), (image_b, uv_b)))
    norms = np.linalg.norm(patch_a, axis=1) * np.linalg.norm(patch_b, axis=1)
    score = np.full(len(uv_a), -1.0)
    score[inside] = (patch_a * patch_b).sum(1) / np.maximum(norms, 1e-3)
    return score


def _turned(a: View, b: View, T_a_b: np.ndarray):
    """b as a camera like a's and parallel to it would have seen it, and where it has a source."""
    H = a.camera.K @ T_a_b[:3, :3] @ np.linalg.inv(b.camera.K)
    size = (a.camera.width, a.camera.height)
    parallel = cv2.warpPerspective(b.gray, H, size, flags=cv2.INTER_CUBIC)
    whole = np.full(b.gray.shape, 255, np.uint8)
    return parallel, cv2.warpPerspective(whole, H, size, flags=cv2.INTER_NEAREST) == 255


def _lucas_kanade(image_a, image_b, uv, start, window_px, levels):
    known = np.isfinite(start).all(1)
    found = np.full(uv.shape, np.nan)
    if not known.any():
        return found
    first = start[known].astype(np.float32).reshape(-1, 1, 2)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        image_a, image_b, uv[known].astype(np.float32).reshape(-1, 1, 2), first.copy(),
        winSize=(window_px, window_px), maxLevel=levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-3,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.005),
    )  # fmt: skip
    moved = moved.reshape(-1, 2).astype(float)
    moved[status.ravel() == 0] = np.nan
    found[known] = moved
    return found


def _pixels(view: View, rays: np.ndarray) -> np.ndarray:
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
    rows = [cv2.remap(image, m[i], n[i], cv2.INTER_LINEAR) for m, n in [maps] for i in _chunks(len(uv))]
    patches = np.vstack(rows).astype(np.float32)
    return patches - patches.mean(1, keepdims=True)


def _chunks(count, size=30000):
    """OpenCV's remap takes fewer than 32768 rows."""
    return [slice(i, i + size) for i in range(0, count, size)]
