# SPDX-License-Identifier: Apache-2.0
"""Poses adjusted to the pictures themselves: what features alone leave uncertain, all pixels together determine.

A turn that grows with the baseline looks like a shift of all inverse depths; only its small vertical part at the
picture's corners tells them apart. Features are too few for it, the whole picture is not (direct alignment, as in
Engel, Koltun and Cremers 2018, with the inverse depth of small cells eliminated by Schur's complement).
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import List, Sequence, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_stereo.inputs import Picture
from fcsv_stereo.joint.sweep import Views, camera_matrix

_CELL = 4  # px: one correction of inverse depth each
_HUBER = 3.0  # grey levels
_UNLIKE = 0.6  # as photometric.residuals': above it a place is occluded or mismatched
_NOISE = 1.5  # grey levels
_CORRELATED = 8.0  # pixels that count as one: interpolation, blur and cells that straddle surfaces
_LEAST_CELLS = 200
_SCALE = 1e-5  # by which the scale may change
#: Features determine a turn that grows with the baseline badly, and alike in every picture, which covariances picture
#: by picture cannot say; nor are they other evidence than the pixels. So their turns weigh little here.
_LOOSENED = np.repeat([3.0, 1.0], 3)


def adjust(
    reference: Picture, others: Sequence[Picture], covariances: Sequence[np.ndarray], found: Views, w: np.ndarray,
    known: np.ndarray, iterations: int, pool: ThreadPoolExecutor,
) -> Tuple[List[Picture], List[np.ndarray], np.ndarray]:  # fmt: skip
    """The others with adjusted poses, their 6x6 covariances (rad in camera axes, m in home's), and ``w`` with them.

    ``found`` holds the pictures without their local mean (``photometric.detail``); ``w`` is HxW (1/m) and ``known``
    (HxW bool) where it may be relied on. The covariances given are the prior; too little texture leaves it as it is.
    """
    prior, scale, scale_variance = _prior(reference, others, covariances)
    start, total = list(others), np.zeros(6 * len(others))
    pictures, first, out = start, w.astype(np.float32), list(covariances)
    w = first
    if known.sum() < _LEAST_CELLS * _CELL**2:
        return pictures, out, w
    for _ in range(iterations):
        jobs = [pool.submit(_linear, reference, o, i, found, w, known) for i, o in enumerate(pictures)]
        terms = [job.result() for job in jobs]
        H, g, energy, solve_w = _reduced(terms, w.shape)
        information = H / (energy * _CORRELATED)
        step = np.linalg.solve(information + prior, g / (energy * _CORRELATED) - prior @ total)
        total = total + step
        w = np.maximum(w + solve_w(step), 0.0).astype(np.float32)
        pictures = [moved(o, total[6 * i : 6 * i + 6]) for i, o in enumerate(start)]
        covariance = np.linalg.inv(information + prior) + scale_variance * np.outer(scale, scale)
        out = [covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] for i in range(len(start))]
    return pictures, out, _smooth_change(first, w, terms)


def _smooth_change(before: np.ndarray, after: np.ndarray, terms) -> np.ndarray:
    """``before`` with what the poses changed in it: smooth over the picture, unlike what cells make of noise."""
    height, width = before.shape
    v, u = np.indices(before.shape, np.float32)
    x, y = u / width - 0.5, v / height - 0.5
    basis = np.stack([np.ones_like(x), x, y, before, x * x, x * y, y * y], axis=-1).reshape(-1, 7)
    weight = np.sqrt(sum(t[0] * np.square(t[2]) for t in terms)).ravel()
    change = (after - before).ravel()
    at_most = 3.0 * np.median(np.abs(change[weight > 0])) if (weight > 0).any() else 0.0
    weight[np.abs(change) > at_most] = 0.0
    factors = np.linalg.lstsq(basis * weight[:, None], change * weight, rcond=None)[0]
    return np.maximum(before + (basis @ factors).reshape(before.shape), 0.0).astype(np.float32)


def moved(picture: Picture, change: np.ndarray) -> Picture:
    """Turned by ``change[:3]`` (rad, camera axes) and moved by ``change[3:]`` (m, home axes)."""
    T = picture.T_home_cam
    rotation = T[:3, :3] @ Rotation.from_rotvec(change[:3]).as_matrix()
    return replace(picture, T_home_cam=transforms.transform(rotation, T[:3, 3] + change[3:]))


def _prior(reference: Picture, others: Sequence[Picture], covariances: Sequence[np.ndarray]):
    """Information matrix of all poses, the direction (6N) in which the scale grows, and the scale's variance.

    Pictures do not tell the scale: it is held, lest the noise in their slopes shifts it.
    """
    n = len(others)
    prior, scale = np.zeros((6 * n, 6 * n)), np.zeros((n, 6))
    for i, (o, c) in enumerate(zip(others, covariances)):
        prior[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.linalg.inv(c * np.outer(_LOOSENED, _LOOSENED))
        scale[i, 3:] = o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
    along = scale[:, 3:] / np.square(np.linalg.norm(scale[:, 3:], axis=1, keepdims=True))
    variances = [a @ c[3:, 3:] @ a for a, c in zip(along, covariances)]
    scale = scale.ravel()
    held = scale / (scale @ scale)
    return prior + np.outer(held, held) / _SCALE**2, scale, float(min(variances))


def _linear(reference: Picture, other: Picture, i: int, found: Views, w: np.ndarray, known: np.ndarray):
    """Weight, difference, slope by w (HxW) and by the pose (HxWx6) of one pair."""
    height, width = found.sizes[i]
    K_ref, K = camera_matrix(reference.camera, w.shape), camera_matrix(other.camera, (height, width))
    T = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    v, u = np.indices(w.shape, np.float32)
    rays = np.stack([(u - K_ref[0, 2]) / K_ref[0, 0], (v - K_ref[1, 2]) / K_ref[1, 1], np.ones_like(u)], axis=-1)
    q = rays @ T[:3, :3].T.astype(np.float32) + w[..., None] * T[:3, 3].astype(np.float32)
    z = np.maximum(q[..., 2], 1e-9)
    x, y = K[0, 0] * q[..., 0] / z + K[0, 2], K[1, 1] * q[..., 1] / z + K[1, 2]
    inside = known & (q[..., 2] > 0) & (x >= 1) & (y >= 1) & (x <= width - 2) & (y <= height - 2)
    image = np.ascontiguousarray(found.others[i][:height, :width])
    maps = x.astype(np.float32), y.astype(np.float32)
    warped = cv2.remap(image, *maps, cv2.INTER_LINEAR)
    # both pictures' slopes: their mean halves the noise and makes the steps second order
    g = [
        0.5 * (cv2.remap(cv2.Sobel(image, cv2.CV_32F, *d, scale=0.125), *maps, cv2.INTER_LINEAR)
               + cv2.Sobel(warped, cv2.CV_32F, *d, scale=0.125))
        for d in ((1, 0), (0, 1))
    ]  # fmt: skip
    difference = found.reference - warped
    contrast = cv2.blur(np.abs(found.reference), (5, 5)) + _NOISE
    unlike = cv2.blur(np.abs(difference), (5, 5)) / contrast / _UNLIKE
    weight = inside / np.square(1.0 + np.square(unlike))
    weight = weight * np.minimum(1.0, _HUBER / np.maximum(np.abs(difference), 1e-6))
    a = np.stack([g[0] * K[0, 0], g[1] * K[1, 1], np.zeros_like(u)], axis=-1)
    a[..., 2] = -(a[..., 0] * q[..., 0] + a[..., 1] * q[..., 1]) / z
    a /= z[..., None]
    by_w = a @ T[:3, 3].astype(np.float32)
    by_pose = np.concatenate([np.cross(a, q), -w[..., None] * (a @ other.T_home_cam[:3, :3].T)], axis=-1)
    return weight.astype(np.float32), difference, by_w, by_pose.astype(np.float32)


def _reduced(terms, shape: Tuple[int, int]):
    """Normal equations of the poses with the cells' inverse depths eliminated; what gives those back; the variance."""
    n = len(terms)
    H, g = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    own, push, mixed = 0.0, 0.0, []
    for i, (weight, difference, by_w, by_pose) in enumerate(terms):
        part = slice(6 * i, 6 * i + 6)
        weighed = weight[..., None] * by_pose
        H[part, part] = weighed.reshape(-1, 6).T.astype(float) @ by_pose.reshape(-1, 6)
        g[part] = weighed.reshape(-1, 6).T.astype(float) @ difference.ravel()
        own = own + _cells(weight * by_w * by_w)
        push = push + _cells(weight * by_w * difference)
        mixed.append(np.stack([_cells(weighed[..., k] * by_w) for k in range(6)], axis=-1))
    mixed = np.concatenate(mixed, axis=-1).reshape(-1, 6 * n).astype(float)
    own = np.ravel(own) + 1e-3 * float(np.mean(own)) + 1e-9
    push = np.ravel(push)
    H -= mixed.T @ (mixed / own[:, None])
    g -= mixed.T @ (push / own)
    weights = sum(float(t[0].sum()) for t in terms)
    energy = sum(float((t[0] * np.square(t[1])).sum()) for t in terms) / max(weights, 1.0) + 0.1
    cells = [s // _CELL for s in shape]

    def solve_w(step: np.ndarray) -> np.ndarray:
        change = ((push - mixed @ step) / own).reshape(cells).astype(np.float32)
        full = np.zeros(shape, np.float32)
        full[: cells[0] * _CELL, : cells[1] * _CELL] = np.repeat(np.repeat(change, _CELL, 0), _CELL, 1)
        return full

    return H, g, energy, solve_w


def _cells(a: np.ndarray) -> np.ndarray:
    """Sums over cells; what is left over at the lower and right edges is dropped."""
    height, width = (s // _CELL for s in a.shape)
    a = a[: height * _CELL, : width * _CELL]
    return a.reshape(height, _CELL, width, _CELL).sum(axis=(1, 3))
