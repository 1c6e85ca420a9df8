# SPDX-License-Identifier: Apache-2.0
"""What no pair sees is taken from its surroundings."""

import cv2
import numpy as np
from numba import njit

from fcsv_stereo.joint.coarse import Coarse
from fcsv_stereo.joint.photometric import detail, sample
from fcsv_stereo.joint.sweep import Views, epipolar_directions

_DIRECTIONS = np.array(
    [(y, x) for y in range(-2, 3) for x in range(-2, 3) if max(abs(y), abs(x)) == 1 or abs(x * y) == 2], np.int64
)
_MOST_COST = 90  # volume units: nine bits of 32 differ
_LEAST_MARGIN = 0.03
_SPECKLE_PX, _SPECKLE_LEVELS = 60, 3
_DISTANCE = 0.5  # grey levels that a pixel of distance counts as
_ASIDE = 6.0  # grey levels that a direction in which nothing hidden goes on counts as
_COLOUR = 2.0
_ALLOWED, _MOST_UNLIKE = 3.0, 12.0  # grey levels: noise, and the most that one picture may object
_PLANE = 8  # px about a pixel that its plane is fitted to
_SAME = 0.08  # of inverse depth: one surface
_SLOPE = 1.33  # by which a plane may differ from the place it comes from


def trusted(found: Coarse, unique: np.ndarray) -> np.ndarray:
    """HxW bool: where the match is good, beats the next, is ``unique`` (HxW bool) and part of a surface."""
    good = (found.cost < _MOST_COST) & (found.margin > _LEAST_MARGIN) & unique
    level = (np.searchsorted(found.levels, found.w) * 16).astype(np.int16)
    level[~good] = -16
    cv2.filterSpeckles(level, -16, _SPECKLE_PX, 16 * _SPECKLE_LEVELS)
    return level >= 0


def filled(found: Coarse, known: np.ndarray, seen: np.ndarray, views: Views, colour: np.ndarray) -> np.ndarray:
    """HxW inverse depth; where a place is not known although some pair sees it, something hides it there.

    The planes of the nearest known places along sixteen directions are the candidates. One is likely if its colour
    (``colour``, HxWx3 float32) is the pixel's, if it is near, and if it lies in the direction in which pixels move as
    they come nearer: what hides moves farther than what is behind it, which goes on there. It is unlikely if some
    picture should see it, because nothing known is in front of it there, and shows something else.
    """
    out = np.empty_like(found.w)
    fronts = np.zeros(views.others.shape, np.float32)
    for front, p, size in zip(fronts, views.projections, views.sizes):
        _draw(found.w, known, p, size, front)
    plain = detail(views)
    _fill(
        found.w, known, known | ~seen, colour, plain.reference, plain.others, views.sizes, views.projections, fronts,
        _DIRECTIONS, _aside(views), out,
    )  # fmt: skip
    return out


def _aside(views: Views) -> np.ndarray:
    """(16,) float32: what each direction costs, none where pixels move so in some pair as they come nearer."""
    directions = _DIRECTIONS[:, ::-1] / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
    return (_ASIDE * (1.0 - (directions @ epipolar_directions(views).T).max(axis=1))).astype(np.float32)


@njit(cache=True, nogil=True)
def _draw(w, known, p, size, front):
    """The nearest known inverse depth that each pixel of another picture shows, into ``front``."""
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            z = p[6] * u + p[7] * v + p[8] + w[v, u] * p[11]
            if not known[v, u] or z <= 0:
                continue
            x = int(np.floor((p[0] * u + p[1] * v + p[2] + w[v, u] * p[9]) / z))
            y = int(np.floor((p[3] * u + p[4] * v + p[5] + w[v, u] * p[10]) / z))
            for b in range(max(y, 0), min(y + 2, size[0])):
                for a in range(max(x, 0), min(x + 2, size[1])):
                    front[b, a] = max(front[b, a], w[v, u])


@njit(cache=True, nogil=True)
def _fill(w, known, keep, colour, reference, others, sizes, projections, fronts, directions, aside, out):
    height, width = w.shape
    for y in range(height):
        for x in range(width):
            out[y, x] = w[y, x]
            least = np.float32(1e9)
            for k in range(directions.shape[0]):
                if keep[y, x]:
                    break
                dy, dx = directions[k]
                r, c = y + dy, x + dx
                while 0 <= r < height and 0 <= c < width and not known[r, c]:
                    r, c = r + dy, c + dx
                if not (0 <= r < height and 0 <= c < width):
                    continue
                cost = aside[k] + np.float32(_DISTANCE * np.sqrt((r - y) ** 2 + (c - x) ** 2))
                cost += np.float32(_COLOUR) * _colour_step(w, known, colour, y, x, r, c, dy, dx)
                if cost >= least:
                    continue
                candidate = _plane_at(w, known, r, c, y, x)
                for i in range(others.shape[0]):
                    cost += _objection(
                        reference, others[i], sizes[i], projections[i], fronts[i], y, x, candidate
                    ) / np.float32(others.shape[0])  # fmt: skip
                if cost < least:
                    least = cost
                    out[y, x] = candidate


@njit(cache=True, nogil=True)
def _colour_step(w, known, colour, y, x, r, c, dy, dx):
    """The least difference of colour to three known pixels from (r, c) on: the first may be a mixed one."""
    best, at = np.float32(1e9), w[r, c]
    for _ in range(3):
        if 0 <= r < w.shape[0] and 0 <= c < w.shape[1] and known[r, c] and abs(w[r, c] - at) < 0.1 * at:
            step = np.float32(0.0)
            for k in range(3):
                step += abs(colour[r, c, k] - colour[y, x, k])
            best = min(best, step / np.float32(3.0))
        r, c = r + dy, c + dx
    return best


@njit(cache=True, nogil=True)
def _plane_at(w, known, r, c, y, x):
    """The inverse depth at (y, x) of the plane about the known pixel (r, c)."""
    at = w[r, c]
    n = sx = sy = sw = xx = xy = yy = xw = yw = 0.0
    for v in range(max(r - _PLANE, 0), min(r + _PLANE + 1, w.shape[0])):
        for u in range(max(c - _PLANE, 0), min(c + _PLANE + 1, w.shape[1])):
            if not known[v, u] or (u + v - r - c) & 1 or abs(w[v, u] - at) >= _SAME * at + 1e-5:
                continue
            a, b, d = u - c, v - r, w[v, u] - at
            n, sx, sy, sw = n + 1.0, sx + a, sy + b, sw + d
            xx, xy, yy, xw, yw = xx + a * a, xy + a * b, yy + b * b, xw + a * d, yw + b * d
    mx, my, mw = sx / n, sy / n, sw / n
    stiff = 0.3 * (2 * _PLANE + 1) ** 2  # few pixels have no slope of their own
    xx, yy, xy = xx - n * mx * mx + stiff, yy - n * my * my + stiff, xy - n * mx * my
    xw, yw = xw - n * mx * mw, yw - n * my * mw
    det = xx * yy - xy * xy
    a, b = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
    value = at + mw + a * (x - c - mx) + b * (y - r - my)
    return np.float32(min(max(value, at / _SLOPE), at * _SLOPE))


@njit(cache=True, nogil=True)
def _objection(reference, image, size, p, front, y, x, w):
    """How unlike (grey levels) a picture is that should see a place; 0 where it cannot, or something is in front."""
    z = p[6] * x + p[7] * y + p[8] + w * p[11]
    if z <= 0:
        return np.float32(0.0)
    a = (p[0] * x + p[1] * y + p[2] + w * p[9]) / z
    b = (p[3] * x + p[4] * y + p[5] + w * p[10]) / z
    if a < 0 or b < 0 or a > size[1] - 1 or b > size[0] - 1:
        return np.float32(0.0)
    if front[int(b + 0.5), int(a + 0.5)] > w * (1.0 + _SAME):
        return np.float32(0.0)
    unlike = np.float32(0.0)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            v, u = min(max(y + dy, 0), reference.shape[0] - 1), min(max(x + dx, 0), reference.shape[1] - 1)
            there = sample(image, size[0], size[1], np.float32(a + dx), np.float32(b + dy))
            unlike += min(abs(reference[v, u] - there), np.float32(30.0)) / np.float32(9.0)
    return min(max(unlike - np.float32(_ALLOWED), np.float32(0.0)), np.float32(_MOST_UNLIKE))
