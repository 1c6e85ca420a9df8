# SPDX-License-Identifier: Apache-2.0
"""Poses adjusted to the pictures themselves: what features alone leave uncertain, all pixels
together determine.

A turn that grows with the baseline looks like a shift of all inverse depths; only its small
vertical part at the picture's corners tells them apart. Features are too few for it, the whole
picture is not (direct alignment, as in Engel, Koltun and Cremers 2018, with the inverse depth of
small cells eliminated by Schur's complement).
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Iterator, List, Optional, Sequence, Tuple

import cv2
import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_stereo.joint.projecting import place, ray
from fcsv_stereo.joint.refine.residuals import NOISE_GREY
from fcsv_stereo.joint.tuning import (
    LEAST_WEIGHT,
    POSE_ALIGNMENT,
    REFERENCE_SIZE_PX,
    RESIDUALS,
    SCALE_HELD,
    SHARED,
    SUBPIXEL,
)
from fcsv_stereo.joint.views import Views, camera_matrix, projection
from fcsv_stereo.model import Picture

_CELL = POSE_ALIGNMENT.cell_px
_WINDOW = (SHARED.window_px,) * 2
#: Features determine a turn that grows with the baseline badly, and alike in every picture, which
#: covariances picture by picture cannot say; nor are they other evidence than the pixels. So their
#: turns weigh little here.
_LOOSENED = np.repeat([POSE_ALIGNMENT.loosened_turns, 1.0], 3)
_BEHIND = np.float32(-1e6)  # px: far outside of every picture
# px about a cell that its windows and slopes reach
_MARGIN = max(SHARED.window_px // 2, 1)
_ROUNDING = 1 / 12  # grey levels squared: variance of whole grey levels
_BAND = 256  # rows that are changed at a time
# as many as in the pictures that the method was made on; of larger ones evenly spread
_MOST_CELLS = REFERENCE_SIZE_PX[0] * REFERENCE_SIZE_PX[1] // _CELL**2


@dataclass(frozen=True)
class _Sample:
    """The reference's pixels that cells and the windows about them need, beside each other:
    ``rows`` and ``columns`` of the picture, and where the cells' first pixels are in the sample
    (``corners``, Nx2) and in the picture (``cells``). Where cells lie side by side it is the whole
    picture."""

    rows: np.ndarray
    columns: np.ndarray
    corners: np.ndarray
    cells: np.ndarray
    whole: bool

    @classmethod
    def of(cls, cells: np.ndarray, shape: Tuple[int, int]) -> "_Sample":
        """``cells`` (Nx2) are row and column of the cells' first pixels in a picture of
        ``shape``."""
        firsts = [np.unique(cells[:, axis]) for axis in range(2)]
        if all(len(f) == n // _CELL for f, n in zip(firsts, shape)):
            return cls(*map(np.arange, shape), cells, cells, True)
        wide = _CELL + 2 * _MARGIN
        rows, columns = (
            _mirrored(f[:, None] + np.arange(wide) - _MARGIN, n).ravel()
            for f, n in zip(firsts, shape)
        )
        at = [np.searchsorted(f, cells[:, axis]) * wide + _MARGIN for axis, f in enumerate(firsts)]
        return cls(rows, columns, np.stack(at, axis=-1), cells, False)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """What it holds of an HxW image."""
        return image if self.whole else image[np.ix_(self.rows, self.columns)]


def _mirrored(at: np.ndarray, count: int) -> np.ndarray:
    """Indices with those outside of 0 to ``count`` - 1 mirrored at the ends, as OpenCV's filters
    have a border."""
    return (count - 1) - np.abs((count - 1) - np.abs(at))


def adjust(
    reference: Picture,
    others: Sequence[Picture],
    covariances: Sequence[np.ndarray],
    found: Views,
    w: np.ndarray,
    known: np.ndarray,
    iterations: int,
    pool: ThreadPoolExecutor,
    pixel_errors: Optional[Sequence[Optional[np.ndarray]]] = None,
) -> Tuple[List[Picture], List[np.ndarray], np.ndarray]:
    """The others with adjusted poses, their 6x6 covariances (rad in camera axes, m in home's), and
    ``w`` with them.

    ``found`` holds the pictures without their local mean (``residuals.detail``); ``w`` is HxW (1/m)
    and ``known`` (HxW bool) where it may be relied on. The covariances given are the prior; too
    little texture leaves it as it is. A picture that has ``pixel_errors`` (6x6) has a prior that is
    no other pictures' word: it is taken as it is, and what the pixels say of the pose errs by
    ``pixel_errors`` besides their noise.
    """
    pixel_errors = pixel_errors or [None] * len(others)
    prior, scale, scale_variance = _prior(reference, others, covariances, pixel_errors)
    start, total = list(others), np.zeros(6 * len(others))
    pictures, out, now = start, list(covariances), w.astype(np.float32)
    if known.sum() < SHARED.least_pixels * _CELL**2:
        return pictures, out, now
    corners = _corners(w.shape)
    sample = _Sample.of(corners, w.shape)
    here = sample(found.reference)
    contrast, known = cv2.blur(np.abs(here), _WINDOW) + NOISE_GREY, sample(known)
    for _ in range(iterations):
        at = sample(now)
        jobs = [
            pool.submit(_pair, reference, o, i, found, here, contrast, at, known, sample)
            for i, o in enumerate(pictures)
        ]
        middles = now[tuple(corners.T + _CELL // 2)]
        H, g, energy, solve_w, weight = _reduced([job.result() for job in jobs], middles)
        information, push = _weakened(H, g, energy * POSE_ALIGNMENT.correlated, pixel_errors)
        step = np.linalg.solve(information + prior, push - prior @ total)
        total = total + step
        _add(corners, solve_w(step), now)
        pictures = [moved(o, total[6 * i : 6 * i + 6]) for i, o in enumerate(start)]
        covariance = np.linalg.inv(information + prior) + scale_variance * np.outer(scale, scale)
        out = [covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] for i in range(len(start))]
    return pictures, out, _smooth_change(w, now, corners, weight)


def _corners(shape: Tuple[int, int]) -> np.ndarray:
    """(N,2) row and column of the cells' first pixels, evenly spread where there would be too
    many."""
    rows, columns = (_CELL * np.arange(n // _CELL) for n in shape)
    every = int(np.ceil(np.sqrt(len(rows) * len(columns) / _MOST_CELLS)))
    return np.stack(np.meshgrid(rows[::every], columns[::every], indexing="ij"), axis=-1).reshape(
        -1, 2
    )


def _smooth_change(
    before: np.ndarray, after: np.ndarray, corners: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """``before`` with what the poses changed in it: smooth over the picture, unlike what cells make
    of noise.

    ``weight`` (N,) is that of the cells.
    """

    def basis(v, u, w):
        x, y = u / before.shape[1] - 0.5, v / before.shape[0] - 0.5
        return np.stack([np.ones_like(x), x, y, w, x * x, x * y, y * y], axis=-1).astype(np.float32)

    at = tuple(corners.T + _CELL // 2)
    change, weight = (after - before)[at], np.sqrt(weight)
    at_most = SHARED.beyond * np.median(np.abs(change[weight > 0])) if (weight > 0).any() else 0.0
    weight[np.abs(change) > at_most] = 0.0
    factors = np.linalg.lstsq(
        basis(*at, before[at]) * weight[:, None], change * weight, rcond=None
    )[0]
    factors, out = factors.astype(np.float32), np.empty(before.shape, np.float32)
    for y in range(0, len(before), _BAND):
        band = before[y : y + _BAND]
        v, u = np.indices(band.shape, np.float32)
        out[y : y + _BAND] = np.maximum(band + basis(v + np.float32(y), u, band) @ factors, 0.0)
    return out


def moved(picture: Picture, change: np.ndarray) -> Picture:
    """Turned by ``change[:3]`` (rad, camera axes) and moved by ``change[3:]`` (m, home axes)."""
    T = picture.T_home_cam
    rotation = T[:3, :3] @ Rotation.from_rotvec(change[:3]).as_matrix()
    return replace(picture, T_home_cam=transforms.transform(rotation, T[:3, 3] + change[3:]))


def _weakened(
    H: np.ndarray, g: np.ndarray, variance: float, pixel_errors: Sequence[Optional[np.ndarray]]
):
    """The pixels' information (6N, 6N) and gradient (6N,), less what errors of covariance
    ``pixel_errors`` leave: (H^-1 + S)^-1, without inverting an H that does not tell the scale."""
    information, push = H / variance, g / variance
    if all(s is None for s in pixel_errors):
        return information, push
    S = np.zeros_like(information)
    for i, s in enumerate(pixel_errors):
        if s is not None:
            S[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = s
    left = np.linalg.solve(np.eye(len(S)) + information @ S, np.c_[information, push])
    return 0.5 * (left[:, :-1] + left[:, :-1].T), left[:, -1]


def _prior(
    reference: Picture,
    others: Sequence[Picture],
    covariances: Sequence[np.ndarray],
    pixel_errors: Sequence[Optional[np.ndarray]],
):
    """Information matrix of all poses, the direction (6N) in which the scale grows, and the scale's
    variance.

    Pictures do not tell the scale: it is held, lest the noise in their slopes shifts it.
    """
    n = len(others)
    prior, scale = np.zeros((6 * n, 6 * n)), np.zeros((n, 6))
    for i, (o, c) in enumerate(zip(others, covariances)):
        loosened = _LOOSENED if pixel_errors[i] is None else np.ones(6)
        prior[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.linalg.inv(
            c * np.outer(loosened, loosened)
        )
        scale[i, 3:] = o.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
    along = scale[:, 3:] / np.square(np.linalg.norm(scale[:, 3:], axis=1, keepdims=True))
    variances = [a @ c[3:, 3:] @ a for a, c in zip(along, covariances)]
    scale = scale.ravel()
    held = scale / (scale @ scale)
    return prior + np.outer(held, held) / SCALE_HELD**2, scale, float(min(variances))


def _other(found: Views, i: int) -> np.ndarray:
    height, width = found.sizes[i]
    return np.ascontiguousarray(found.others[i][:height, :width])


def _slopes(image: np.ndarray) -> Iterator[np.ndarray]:
    """Along u and v, per pixel; one by one (large pictures)."""
    return (cv2.Sobel(image, cv2.CV_32F, *d, scale=0.125) for d in ((1, 0), (0, 1)))


def _pair(
    reference: Picture,
    other: Picture,
    i: int,
    found: Views,
    here: np.ndarray,
    contrast: np.ndarray,
    w: np.ndarray,
    known: np.ndarray,
    sample: _Sample,
) -> Tuple[np.ndarray, ...]:
    """Sums over one pair: of its pose H (6x6) and g (6,); of each cell (N, 8) own, push and mixed
    with the pose; and (2,) of weights and of weighted squares. ``here`` is the reference, it and
    all after it of the ``sample``."""
    height, width = found.sizes[i]
    K = camera_matrix(other.camera, (height, width))
    T = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    p = projection(reference, other, camera_matrix(reference.camera, found.shape), K).astype(
        np.float32
    )[None]
    x, y = np.empty_like(w), np.empty_like(w)
    _places(p, w, sample.rows, sample.columns, x, y)
    image = _other(found, i)
    warped = cv2.remap(image, x, y, cv2.INTER_LINEAR)
    # both pictures' slopes: their mean halves the noise and makes the steps second order
    there = (cv2.remap(s, x, y, cv2.INTER_LINEAR) for s in _slopes(image))
    slopes = [0.5 * (a + b) for a, b in zip(there, _slopes(warped))]
    difference = here - warped
    unlike = cv2.blur(np.abs(difference), _WINDOW) / contrast / RESIDUALS.unlike
    inside = known & (x >= 1) & (y >= 1) & (x <= width - 2) & (y <= height - 2)
    weight = inside / np.square(1.0 + np.square(unlike))
    weight *= np.minimum(1.0, SUBPIXEL.huber_grey / np.maximum(np.abs(difference), 1e-6))
    H, g, cells, sums = np.zeros((6, 6)), np.zeros(6), np.zeros((len(sample.cells), 8)), np.zeros(2)
    _sum(
        sample.corners,
        sample.cells,
        weight.astype(np.float32),
        difference,
        *slopes,
        x,
        y,
        p,
        w,
        K,
        T[:3, 3],
        other.T_home_cam[:3, :3],
        H,
        g,
        cells,
        sums,
    )
    return H, g, cells, sums


def _reduced(pairs, w: np.ndarray):
    """Normal equations of the poses with the cells' inverse depths (``w``, N) eliminated; the
    variance; what gives the inverse depths back; and the cells' weights (N,)."""
    n = len(pairs)
    H, g = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for i, (own_H, own_g, _, _) in enumerate(pairs):
        part = slice(6 * i, 6 * i + 6)
        H[part, part], g[part] = own_H, own_g
    weights, squares = sum(sums for _, _, _, sums in pairs)
    weight = sum(cells[:, 0] for _, _, cells, _ in pairs)
    push = sum(cells[:, 1] for _, _, cells, _ in pairs)
    mixed = np.concatenate([cells[:, 2:] for _, _, cells, _ in pairs], axis=1)
    energy = squares / max(weights, 1.0) + _ROUNDING
    own = weight + LEAST_WEIGHT * float(np.mean(weight))
    own = own + energy / np.square(
        POSE_ALIGNMENT.loose * np.maximum(w, POSE_ALIGNMENT.farthest_1_m)
    )
    H -= mixed.T @ (mixed / own[:, None])
    g -= mixed.T @ (push / own)

    def solve_w(step: np.ndarray) -> np.ndarray:
        return (push - mixed @ step) / own

    return H, g, energy, solve_w, weight


@njit(cache=True, nogil=True, fastmath=True)
def _places(p, w, rows, columns, x, y):
    """Where the reference's pixels in ``rows`` and ``columns`` are in the other picture; far
    outside what is behind it."""
    for r in range(w.shape[0]):
        for k in range(w.shape[1]):
            a, b, c = ray(p, 0, columns[k], rows[r])
            across, down, z, _ = place(a, b, c, p, 0, w[r, k])
            x[r, k] = across if z > 0 else _BEHIND
            y[r, k] = down if z > 0 else _BEHIND


@njit(cache=True, nogil=True)
def _add(corners, change, w):
    for k in range(len(corners)):
        for v in range(corners[k, 0], corners[k, 0] + _CELL):
            for u in range(corners[k, 1], corners[k, 1] + _CELL):
                w[v, u] = max(w[v, u] + change[k], 0.0)


@njit(cache=True, nogil=True)
def _sum(  # noqa: PLR0913
    corners,
    first,
    weight,
    difference,
    slope_x,
    slope_y,
    x,
    y,
    p,
    w,
    K,
    t,
    R_home_cam,
    H,
    g,
    cells,
    sums,
):
    """Into ``H``, ``g``, ``cells`` and ``sums`` as ``_pair`` gives them; ``p`` (1x12) is the pair's
    projection. Cells begin at ``corners`` of the arrays, and at ``first`` of the reference."""
    j = np.zeros(6)
    for k in range(len(corners)):
        down, along = first[k, 0] - corners[k, 0], first[k, 1] - corners[k, 1]
        for v in range(corners[k, 0], corners[k, 0] + _CELL):
            for u in range(corners[k, 1], corners[k, 1] + _CELL):
                s = float(weight[v, u])
                if s <= 0.0:
                    continue
                _, _, c = ray(p, 0, u + along, v + down)
                _, _, z, _ = place(0.0, 0.0, c, p, 0, w[v, u])
                qx, qy = (x[v, u] - K[0, 2]) / K[0, 0] * z, (y[v, u] - K[1, 2]) / K[1, 1] * z
                ax, ay = slope_x[v, u] * K[0, 0] / z, slope_y[v, u] * K[1, 1] / z
                az = -(ax * qx + ay * qy) / z
                j[0], j[1], j[2] = ay * z - az * qy, az * qx - ax * z, ax * qy - ay * qx
                for i in range(3):
                    j[3 + i] = -w[v, u] * (
                        ax * R_home_cam[i, 0] + ay * R_home_cam[i, 1] + az * R_home_cam[i, 2]
                    )
                by_w, off = ax * t[0] + ay * t[1] + az * t[2], float(difference[v, u])
                cells[k, 0] += s * by_w * by_w
                cells[k, 1] += s * by_w * off
                for a in range(6):
                    cells[k, 2 + a] += s * j[a] * by_w
                    g[a] += s * j[a] * off
                    for b in range(a, 6):
                        H[a, b] += s * j[a] * j[b]
                sums[0] += s
                sums[1] += s * off * off
    for a in range(6):
        for b in range(a):
            H[a, b] = H[b, a]
