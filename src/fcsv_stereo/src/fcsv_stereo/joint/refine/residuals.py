# SPDX-License-Identifier: Apache-2.0
"""How each pair's picture differs from the reference at a map of inverse depth, and how that
changes with it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import Optional, Tuple

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.projecting import motion, place, ray
from fcsv_stereo.joint.tuning import RESIDUALS, SHARED
from fcsv_stereo.joint.views import Views

_WINDOW = (SHARED.window_px,) * 2
#: Contrast (grey levels) below it tells nothing: both pixels of a difference have noise.
NOISE_GREY = 2.0 * SHARED.noise_grey
# a box about as wide (its standard deviation) as the bell by which a picture's mean is taken
_MEAN_PX = 2 * round(3**0.5 * RESIDUALS.mean_sigma_px) - 1
_BAND = 64  # rows at a time: time alone


@dataclass(frozen=True)
class Residuals:
    """Per pair (N,H,W) float32: ``difference`` of the reference and the other without its local
    mean (grey levels; None where it was let go), its ``slope`` by inverse depth (grey levels times
    metres; None: let go), ``speed`` (px of movement times metres), ``seen`` (1 or 0) and ``trust``
    (0 to 1, low where the pair does not look like the reference: occluded or mismatched).
    """

    difference: Optional[np.ndarray]
    slope: Optional[np.ndarray]
    speed: np.ndarray
    seen: np.ndarray
    trust: np.ndarray

    def rows(self, rows: slice) -> "Residuals":
        """The same of a part of the rows."""
        parts = (getattr(self, f.name) for f in fields(self))
        return Residuals(*(None if p is None else p[:, rows] for p in parts))


def detail(found: Views) -> Views:
    """The pictures without their local mean."""

    others = np.zeros_like(found.others)
    for o, g, (h, w) in zip(others, found.others, found.sizes):
        o[:h, :w] = without_mean(np.ascontiguousarray(g[:h, :w]))
    return replace(found, reference=without_mean(found.reference), others=others)


def without_mean(image: np.ndarray) -> np.ndarray:
    """HxW float32 of a grey picture: what differs from the brightness about it."""
    return image - cv2.GaussianBlur(image, (0, 0), RESIDUALS.mean_sigma_px)


def residuals(found: Views, w: np.ndarray, pool: ThreadPoolExecutor) -> Residuals:
    """Compares the pictures at inverse depth ``w`` (HxW float32, 1/m).

    The local mean is taken of the differences, each pixel at its own depth, and not of the
    pictures: before what is far behind it a thin thing has other surroundings in every picture, and
    their means would count as its own brightness.
    """
    shape = (len(found), *found.shape)
    out = Residuals(*(np.empty(shape, np.float32) for _ in range(5)))
    contrast = found.once("contrast", lambda: _contrast(found.reference))

    def run(i: int) -> None:
        _compare(found, i, w, out.difference[i], out.slope[i], out.speed[i], out.seen[i])
        out.difference[i] -= _local_mean(out.difference[i], out.seen[i])
        _trust(mean_unlike(out.difference[i]), contrast, out.seen[i], out.trust[i])

    list(pool.map(run, range(len(found))))
    return out


def _trust(
    unlike_here: np.ndarray, contrast: np.ndarray, seen: np.ndarray, out: np.ndarray
) -> None:
    """Works out trust in ``unlike_here``, which is written over: large pictures."""
    unlike_here /= contrast
    unlike_here /= np.float32(RESIDUALS.unlike)
    np.square(unlike_here, out=unlike_here)
    unlike_here += np.float32(1.0)
    np.square(unlike_here, out=unlike_here)
    np.divide(seen, unlike_here, out=out)


def _contrast(image: np.ndarray) -> np.ndarray:
    return cv2.blur(np.abs(without_mean(image)), _WINDOW) + NOISE_GREY


def unlike(found: Views, i: int, w: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """HxW float32 each, of pair ``i`` at inverse depth ``w`` (HxW, 1/m): mean absolute difference
    in the window (grey levels) as ``residuals`` has it, and seen (1 or 0)."""
    difference, slope, speed, seen = np.empty((4, *found.shape), np.float32)
    _compare(found, i, w, difference, slope, speed, seen)
    return mean_unlike(difference - _local_mean(difference, seen)), seen


def mean_unlike(difference: np.ndarray) -> np.ndarray:
    """HxW: mean absolute difference in the window."""
    return cv2.blur(np.abs(difference), _WINDOW)


def differences(found: Views, w: np.ndarray, pool: ThreadPoolExecutor) -> np.ndarray:
    """(N,H,W) float32, grey levels: of the reference and each other picture at inverse depth ``w``
    (HxW, 1/m)."""
    out = np.empty((len(found), *found.shape), np.float32)
    list(
        pool.map(
            lambda i: _compare(found, i, w, out[i], *np.empty((3, *found.shape), np.float32)),
            range(len(found)),
        )
    )
    return out


def _compare(found: Views, i: int, w: np.ndarray, *arrays: np.ndarray) -> None:
    """Into ``arrays`` (HxW each): difference, slope, speed and seen of pair ``i``."""
    for y in range(0, found.shape[0], _BAND):
        end = min(y + _BAND, found.shape[0])
        _residual_band(
            found.reference,
            found.others[i],
            found.sizes[i],
            found.projections,
            i,
            w,
            y,
            end,
            *arrays,
        )


def _local_mean(difference: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """HxW float32, grey levels: by how much exposures differ there. What differs much more than
    most tells less of it: it is another surface."""
    weight = difference / np.float32(SHARED.surface_grey)
    np.square(weight, out=weight)  # in place: large pictures
    weight += np.float32(1.0)
    np.divide(seen, weight, out=weight)
    window = (_MEAN_PX,) * 2
    mean = cv2.blur(weight * difference, window)
    weight = cv2.blur(weight, window)
    mean /= np.maximum(weight, np.float32(1e-3), out=weight)
    return mean


def support_bits(r: Residuals, least_trust: float) -> np.ndarray:
    """HxW uint16: bit i is set where pair i agrees."""
    bits = np.zeros(r.trust.shape[1:], np.uint16)
    for i in range(min(len(r.trust), 16)):
        bits |= np.where(r.trust[i] >= least_trust, np.uint16(1 << i), np.uint16(0))
    return bits


@njit(cache=True, nogil=True, fastmath=True)
def _cubic(t):
    """Weights of the four samples about a place ``t`` (0 to 1) between the middle two, and their
    slopes by it: a cubic through the middle two with central differences there (Keys 1981, a =
    -1/2)."""
    half, one, rest = np.float32(0.5), np.float32(1.0), np.float32(1.0) - t
    first, last = -half * t * rest * rest, -half * t * t * rest
    second = one + t * t * (np.float32(1.5) * t - np.float32(2.5))
    values = first, second, one - first - second - last, last
    first, last = rest * (t - half * rest), t * (half * t - rest)
    second = t * (np.float32(4.5) * t - np.float32(5.0))
    slopes = first, second, -first - second - last, last
    return values, slopes


@njit(cache=True, nogil=True, fastmath=True)
def _sample_cubic(image, height, width, x, y):
    """A picture's value between its pixels, and its slopes along x and y.

    Not bilinear: that blurs most half-way between pixels, and the best agreement moves away from
    there.
    """
    x = min(max(x, np.float32(0.0)), np.float32(width - 1))
    y = min(max(y, np.float32(0.0)), np.float32(height - 1))
    xi, yi = min(np.int32(x), width - 2), min(np.int32(y), height - 2)
    a, da = _cubic(x - np.float32(xi))
    b, db = _cubic(y - np.float32(yi))
    x0, x3 = max(xi - 1, 0), min(xi + 2, width - 1)
    y0, y3 = max(yi - 1, 0), min(yi + 2, height - 1)
    value = gx = gy = np.float32(0.0)
    for k, r in enumerate((y0, yi, yi + 1, y3)):
        p, q, s, t = image[r, x0], image[r, xi], image[r, xi + 1], image[r, x3]
        along = a[0] * p + a[1] * q + a[2] * s + a[3] * t
        value += b[k] * along
        gy += db[k] * along
        gx += b[k] * (da[0] * p + da[1] * q + da[2] * s + da[3] * t)
    return value, gx, gy


@njit(cache=True, nogil=True, fastmath=True)
def _residual_band(reference, image, size, p, i, w, y0, y1, difference, slope, speed, seen):
    height, width = size[0], size[1]
    for v in range(y0, y1):
        for u in range(reference.shape[1]):
            a, b, c = ray(p, i, u, v)
            x, y, z, inverse = place(a, b, c, p, i, w[v, u])
            inside = z > 0 and x >= 0 and x <= width - 1 and y >= 0 and y <= height - 1
            dx, dy = motion(x, y, inverse, p, i)
            rate = np.sqrt(dx * dx + dy * dy)
            value, gx, gy = _sample_cubic(image, height, width, x, y)
            seen[v, u] = np.float32(1.0) if inside else np.float32(0.0)
            difference[v, u] = reference[v, u] - value
            slope[v, u] = gx * dx + gy * dy
            speed[v, u] = rate
