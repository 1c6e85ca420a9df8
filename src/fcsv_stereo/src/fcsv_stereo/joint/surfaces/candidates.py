# SPDX-License-Identifier: Apache-2.0
"""The surfaces that a pixel may belong to: planes of inverse depth about places of a coarser map
near it.

The volume's windows carry a surface over its edges, and where nothing is seen or nothing has
texture they know nothing at all. So each pixel is offered its own place's plane and those around
it; where its own place is not known, also those of the nearest known places along sixteen
directions.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Optional, Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.tuning import CANDIDATES, FARTHEST_1_M, PLANE_FIT, SHARED

MOST = CANDIDATES.most
_DIRECTIONS = np.array(
    [
        (y, x)
        for y in range(-2, 3)
        for x in range(-2, 3)
        if max(abs(y), abs(x)) == 1 or abs(x * y) == 2
    ],
    np.int64,
)
_INWARD = CANDIDATES.mixed_px
_ALIKE = SHARED.same
#: Times inverse depth, by which a plane may change over a ring, and over the way to what is not known.
_STRETCH, _FAR_STRETCH = 1.0 + 3 * SHARED.step, CANDIDATES.far_stretch
_LEAST_PLANE_PX = 4  # one more than a plane has unknowns
_FARTHEST = np.float32(FARTHEST_1_M)
#: A plane's surroundings (px about it), what share of inverse depth is still the same surface, and
#: its stiffness.
_NEAR_FIT = PLANE_FIT.radius_px, SHARED.one_surface, CANDIDATES.near_stiffness
_FAR_FIT = CANDIDATES.far_radius_px, 3 * SHARED.one_surface, CANDIDATES.far_stiffness
#: What a plane at a pixel is written down as, in this order.
_VALUE, _SLOPE_X, _SLOPE_Y, _SOURCE = range(4)


@dataclass(frozen=True)
class Candidates:
    """Holds the candidates of pixel (y, x): those from ``start[y, x]`` on, ``count[y, x]`` of them.

    ``w`` (1/m) is the inverse depth at the pixel, ``slope`` (two of N, 1/m per px, along u and v;
    None: let go) its plane's; ``source`` the coarser pixel (row times width plus column) that the
    plane is from, -1 where it is the own place and not known (None: let go). ``step`` (1/m) is the
    inverse depth that moves a pixel by little in the fastest pair.
    """

    start: np.ndarray
    count: np.ndarray
    w: np.ndarray
    slope: Optional[Tuple[np.ndarray, np.ndarray]]
    source: Optional[np.ndarray]
    step: np.float32


def candidates(
    w: np.ndarray,
    known: np.ndarray,
    shape: Tuple[int, int],
    px_per_w: float,
    pool: ThreadPoolExecutor,
) -> Candidates:
    """Finds candidates for a picture of ``shape`` from a coarser map ``w`` (hxw, 1/m) that is
    ``known`` (hxw bool) at places.

    Where it is known and far from every step of depth its own plane is the only one. ``px_per_w``
    is how fast a pixel of the finer picture moves at most with inverse depth (px times metres).
    """
    step = np.float32(CANDIDATES.alike_px / px_per_w)
    planes = _planes(w, known, np.ones_like(known), *_NEAR_FIT, pool)
    row_of, unknown = _numbered(~known)
    distant = np.zeros((unknown, 4, CANDIDATES.most_distant), np.float32)
    if unknown:
        wide = _planes(w, known, _met(known), *_FAR_FIT, pool)
        for_rows(
            pool,
            w.shape[0],
            lambda y0, y1: _distant(*wide, known, row_of, _DIRECTIONS, step, y0, y1, distant),
        )
    count = np.zeros(shape, np.uint8)
    rings, undecided = _ring_offsets(), _undecided(w, known)

    def collect(y0, y1):
        found = np.empty((4, (y1 - y0) * shape[1] * MOST), np.float32)
        n = _collect(*planes, known, undecided, rings, row_of, distant, step, y0, y1, count, found)
        return [row[:n].copy() for row in found]

    parts = [list(rows) for rows in zip(*for_rows(pool, shape[0], collect))]
    # one after the other, its parts let go: each is as large as many pictures
    w, slope_x, slope_y, source = (np.concatenate(parts.pop(0)) for _ in range(4))
    start = np.cumsum(count, dtype=np.int32 if len(w) < 2**31 else np.int64).reshape(shape)
    start -= count
    return Candidates(start, count, w, (slope_x, slope_y), source.astype(np.int32), step)


def _numbered(mask: np.ndarray) -> Tuple[np.ndarray, int]:
    """HxW int32: the place of each pixel of a ``mask`` (HxW bool) among those, -1 of others; and
    how many they are."""
    order = np.full(mask.shape, -1, np.int32)
    count = int(mask.sum())
    order[mask] = np.arange(count, dtype=np.int32)
    return order, count


def _ring_offsets() -> np.ndarray:
    """(N,2) dy, dx; none first."""
    out = [(0, 0)]
    for r in CANDIDATES.rings_px:
        d = int(round(r * np.sqrt(0.5)))
        out += [(-r, 0), (r, 0), (0, -r), (0, r), (-d, -d), (-d, d), (d, -d), (d, d)]
    return np.array(out, np.int64)


def _undecided(w: np.ndarray, known: np.ndarray) -> np.ndarray:
    """HxW bool: where more than one surface is possible."""
    near = np.ones((2 * CANDIDATES.mixed_px + 1,) * 2, np.uint8)
    far = np.maximum(cv2.erode(w, near), FARTHEST_1_M)
    return ~known | (cv2.dilate(w, near) > (1.0 + SHARED.step) * far)


def _met(known: np.ndarray) -> np.ndarray:
    """HxW bool: the places that ``_distant`` takes planes from."""
    met = np.zeros_like(known)
    for way in _DIRECTIONS:
        first = known & _moved(~known, way)
        met |= first | known & _moved(first, _INWARD * way)
    return met


def _moved(mask: np.ndarray, by: np.ndarray) -> np.ndarray:
    """A mask (HxW) moved by (rows, columns)."""
    shift = np.array([[1, 0, by[1]], [0, 1, by[0]]], np.float32)
    return (
        cv2.warpAffine(mask.astype(np.uint8), shift, mask.shape[::-1], flags=cv2.INTER_NEAREST) > 0
    )


def _planes(w, known, wanted, radius: int, same: float, stiffness: float, pool: ThreadPoolExecutor):
    """Value and slopes (along u, v) of the plane about each ``wanted`` pixel: three arrays of w's
    shape."""
    out = np.empty((3, *w.shape), np.float32)
    stiff = np.float32(stiffness * (2 * radius + 1) ** 2)
    w = np.ascontiguousarray(w, np.float32)
    for_rows(
        pool,
        w.shape[0],
        lambda y0, y1: _fit(w, known, wanted, radius, np.float32(same), stiff, y0, y1, out),
    )
    return tuple(out)


@njit(cache=True, nogil=True)
def _fit(w, known, wanted, radius, same, stiff, y0, y1, out):
    """Least squares over what is known and of the same surface; ``stiff``: few pixels have no slope
    of their own."""
    height, width = w.shape
    for y in range(y0, y1):
        for x in range(width):
            if not wanted[y, x]:
                continue
            at = w[y, x]
            n = sx = sy = sw = xx = xy = yy = xw = yw = np.float32(0.0)
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    d = w[v, u] - at
                    if not known[v, u] or abs(d) >= same * at + _FARTHEST:
                        continue
                    a, b = np.float32(u - x), np.float32(v - y)
                    n, sx, sy, sw = n + np.float32(1.0), sx + a, sy + b, sw + d
                    xx, xy, yy, xw, yw = xx + a * a, xy + a * b, yy + b * b, xw + a * d, yw + b * d
            out[0, y, x], out[1, y, x], out[2, y, x] = at, np.float32(0.0), np.float32(0.0)
            if n < _LEAST_PLANE_PX:
                continue
            mx, my, mw = sx / n, sy / n, sw / n
            xx, yy, xy = xx + stiff - n * mx * mx, yy + stiff - n * my * my, xy - n * mx * my
            xw, yw = xw - n * mx * mw, yw - n * my * mw
            det = xx * yy - xy * xy
            a, b = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
            out[0, y, x], out[1, y, x], out[2, y, x] = at + mw - a * mx - b * my, a, b


@njit(cache=True, nogil=True)
def _is_new(value, values, n, step):
    for j in range(n):
        if abs(values[j] - value) <= np.float32(_ALIKE) * max(value, values[j]) + step:
            return False
    return True


@njit(cache=True, nogil=True)
def _distant(w, slope_x, slope_y, known, row_of, directions, step, y0, y1, out):
    """Into ``out`` (pixels that are not known, in rows by ``row_of``; 4, N): value, slopes and
    source of the planes that meet such a pixel."""
    height, width = w.shape
    for y in range(y0, y1):
        for x in range(width):
            n, i = 0, row_of[y, x]
            if i < 0:
                continue
            for k in range(directions.shape[0]):
                dy, dx = directions[k]
                r, c = y + dy, x + dx
                while 0 <= r < height and 0 <= c < width and not known[r, c]:
                    r, c = r + dy, c + dx
                for _ in range(2):
                    if n < out.shape[2] and 0 <= r < height and 0 <= c < width and known[r, c]:
                        at = w[r, c]
                        value = at + slope_x[r, c] * (x - c) + slope_y[r, c] * (y - r)
                        limit = np.float32(_FAR_STRETCH)
                        if at / limit < value < at * limit and _is_new(
                            value, out[i, _VALUE], n, step
                        ):
                            out[i, _VALUE, n], out[i, _SOURCE, n] = value, r * width + c
                            out[i, _SLOPE_X, n], out[i, _SLOPE_Y, n] = slope_x[r, c], slope_y[r, c]
                            n += 1
                    r, c = r + _INWARD * dy, c + _INWARD * dx


@njit(cache=True, nogil=True)
def _collect(  # noqa: PLR0913
    w, slope_x, slope_y, known, undecided, rings, row_of, distant, step, y0, y1, count, found
):
    """All candidates of rows y0 to y1 into ``found`` (w, slopes, source; 4xN), their number into
    ``count``."""
    h, width_coarse = w.shape
    height, width = count.shape
    sy, sx = np.float32(h / height), np.float32(width_coarse / width)
    half, stretch = np.float32(0.5), np.float32(_STRETCH)
    total = 0
    for y in range(y0, y1):
        fy = (y + half) * sy - half
        r0 = min(max(int(fy + half), 0), h - 1)
        for x in range(width):
            fx = (x + half) * sx - half
            c0 = min(max(int(fx + half), 0), width_coarse - 1)
            values, n = found[_VALUE, total : total + MOST], 0
            for k in range(rings.shape[0] if undecided[r0, c0] else 1):
                r, c = r0 + rings[k, 0], c0 + rings[k, 1]
                if (
                    n == MOST
                    or r < 0
                    or c < 0
                    or r >= h
                    or c >= width_coarse
                    or (k > 0 and not known[r, c])
                ):
                    continue
                at = w[r, c]
                value = at + slope_x[r, c] * (fx - c) + slope_y[r, c] * (fy - r)
                value = min(max(value, at / stretch), at * stretch)
                if _is_new(value, values, n, step):
                    source = r * width_coarse + c if known[r, c] else -1
                    found[_VALUE, total + n], found[_SOURCE, total + n] = value, source
                    found[_SLOPE_X, total + n], found[_SLOPE_Y, total + n] = (
                        slope_x[r, c] * sx,
                        slope_y[r, c] * sy,
                    )
                    n += 1
            i = row_of[r0, c0]
            for k in range(distant.shape[2] if i >= 0 else 0):
                value = distant[i, _VALUE, k]
                if n == MOST or value <= 0:
                    break
                slope_u, slope_v = distant[i, _SLOPE_X, k], distant[i, _SLOPE_Y, k]
                value += slope_u * (fx - c0) + slope_v * (fy - r0)
                if value > 0 and _is_new(value, values, n, step):
                    found[_VALUE, total + n], found[_SOURCE, total + n] = (
                        value,
                        distant[i, _SOURCE, k],
                    )
                    found[_SLOPE_X, total + n], found[_SLOPE_Y, total + n] = (
                        slope_u * sx,
                        slope_v * sy,
                    )
                    n += 1
            count[y, x] = n
            total += n
    return total
