# SPDX-License-Identifier: Apache-2.0
"""What the pictures say of each surface that a pixel may belong to.

By small windows, pair by pair where the pair can see it: nothing known is in front of it there. A
place that is hidden counts the same for all surfaces. In front of what a pair itself is known to
show there is nothing, however alike it looks.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit

from fcsv_stereo.joint.bands import for_rows
from fcsv_stereo.joint.projecting import place, ray
from fcsv_stereo.joint.surfaces.candidates import Candidates
from fcsv_stereo.joint.surfaces.colour import alike_bits
from fcsv_stereo.joint.tuning import DATA_COST, FARTHEST_1_M, SELECT, SHARED
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.census import CUT, census
from fcsv_stereo.joint.volume.cost_volume import pair_weights
from fcsv_stereo.joint.volume.intrinsics import differing_bits

#: Times inverse depth: what is nearer than this before what a pair shows is denied (1.17 to 1.33 give
#: the same map within 0.3 points, on street, field, plain 3 and village 5).
SEEN_THROUGH = 1.0 + 2 * SHARED.step
# brightness at its most objects as much as a pair that sees nothing
_MOST_GREY = 3 * SHARED.surface_grey
_BITS, _BRIGHTNESS = DATA_COST.per_bit, DATA_COST.unseen / _MOST_GREY
# denied outweighs the largest jump: 30 to 120 give the same map within 0.3 points
_UNSEEN, _DENIED = DATA_COST.unseen, 3 * SELECT.p2 / 2
# a pair objects at most as much as unrelated places differ, in bits and in brightness
_CUT = _BITS * CUT + _UNSEEN
_FRONT, _FRONT_1_M = 1.0 + SHARED.step, 10 * FARTHEST_1_M


def evidence(
    found: Views,
    in_front: np.ndarray,
    shown: np.ndarray,
    given: Candidates,
    image: np.ndarray,
    pool: ThreadPoolExecutor,
) -> np.ndarray:
    """(N,) cost of each candidate by the pictures; the pairs' costs sorted, the better ones weigh
    more.

    ``image`` is the reference in colour (HxWx3); ``in_front`` and ``shown`` are ``fronts`` of what
    is certain and of what each pair has confirmed.
    """
    codes = np.zeros(found.others.shape, np.uint32)
    for c, other, (h, w) in zip(codes, found.others, found.sizes):
        c[:h, :w] = census(np.ascontiguousarray(other[:h, :w]))
    here = found.reference, census(found.reference), *alike_bits(image, given, pool)
    there = found.others, codes, found.sizes, found.projections, in_front, shown
    weights, cost = pair_weights(len(found)), np.zeros(len(given.w), np.float32)

    def run(y0, y1):
        _score(*here, *there, given.start, given.count, given.w, weights, y0, y1, cost)

    for_rows(pool, found.shape[0], run)
    return cost


def fronts(found: Views, w: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(N,Ho,Wo) the nearest inverse depth (1/m) that each pixel of the other pictures shows, of
    what is ``known`` to its pair (NxHxW bool); 0 where none."""
    out = np.zeros(found.others.shape, np.float32)
    for i, front in enumerate(out):
        _draw(w, known[i], found.projections, i, found.sizes[i], front)
    return out


@njit(cache=True, nogil=True)
def _draw(w, known, projections, i, size, front):
    for v in range(w.shape[0]):
        for u in range(w.shape[1]):
            a, b, c = ray(projections, i, u, v)
            across, down, z, _ = place(a, b, c, projections, i, w[v, u])
            if not known[v, u] or z <= 0:
                continue
            x, y = int(np.floor(across)), int(np.floor(down))
            for r in range(max(y, 0), min(y + 2, size[0])):
                for k in range(max(x, 0), min(x + 2, size[1])):
                    front[r, k] = max(front[r, k], w[v, u])


# Only numbers go into what is called for every candidate: arrays are counted references, and
# counting them took six sevenths of the time.


@njit(cache=True, nogil=True, fastmath=True)
def _score(  # noqa: PLR0913
    reference,
    code,
    mask,
    scale,
    others,
    codes,
    sizes,
    p,
    in_front,
    shown,
    start,
    count,
    values,
    weights,
    y0,
    y1,
    cost,
):
    one, half = np.uintp(1), np.float32(0.5)
    down, along = (
        np.float32(in_front.shape[1] / others.shape[1]),
        np.float32(in_front.shape[2] / others.shape[2]),
    )
    pairs = len(others)
    ranked, rays = np.empty(pairs, np.float32), np.empty((pairs, 3), np.float32)
    for y in range(y0, y1):
        for x in range(reference.shape[1]):
            if count[y, x] < 2:
                continue
            u, v = np.float32(x), np.float32(y)
            for i in range(pairs):
                rays[i, 0], rays[i, 1], rays[i, 2] = ray(p, i, u, v)
            for k in range(start[y, x], start[y, x] + count[y, x]):
                w = values[k]
                for i in range(pairs):
                    a, b, z, _ = place(rays[i, 0], rays[i, 1], rays[i, 2], p, i, w)
                    value = np.float32(_UNSEEN)
                    if _inside(a, b, z, sizes[i, 1], sizes[i, 0]):
                        r, c = np.uintp((b + half) * down), np.uintp((a + half) * along)
                        value = _standing(w, in_front[i, r, c], shown[i, r, c])
                    if value == 0.0:
                        bits = _unlike(
                            code[y, x], codes[i, np.uintp(b + half), np.uintp(a + half)], mask[y, x]
                        )
                        r, c = np.uintp(b), np.uintp(a)
                        below, right = (
                            min(r + one, np.uintp(sizes[i, 0] - 1)),
                            min(c + one, np.uintp(sizes[i, 1] - 1)),
                        )
                        there = _between(
                            others[i, r, c],
                            others[i, r, right],
                            others[i, below, c],
                            others[i, below, right],
                            a - np.float32(c),
                            b - np.float32(r),
                        )
                        step = min(abs(reference[y, x] - there), np.float32(_MOST_GREY))
                        value = (
                            np.float32(_BITS) * scale[y, x] * bits + np.float32(_BRIGHTNESS) * step
                        )
                        value = min(value, np.float32(_CUT))
                    j = i
                    while j > 0 and ranked[j - 1] > value:
                        ranked[j] = ranked[j - 1]
                        j -= 1
                    ranked[j] = value
                total = np.float32(0.0)
                for i in range(pairs):
                    total += weights[i] * ranked[i]
                cost[k] = total


@njit(cache=True, nogil=True, fastmath=True)
def _inside(x, y, z, width, height):
    """Whether a place is in front of a picture and inside of it."""
    zero, one = np.float32(0.0), np.float32(1.0)
    return (
        z > zero
        and x >= zero
        and y >= zero
        and x <= np.float32(width) - one
        and y <= np.float32(height) - one
    )


@njit(cache=True, nogil=True, fastmath=True)
def _standing(w, in_front, shown):
    """What a pair counts by what is known to be in front of inverse depth w or seen behind it; 0:
    let it judge."""
    if in_front > w * np.float32(_FRONT) + np.float32(_FRONT_1_M):
        return np.float32(_UNSEEN)
    if np.float32(0.0) < shown * np.float32(SEEN_THROUGH) < w:
        return np.float32(_DENIED)
    return np.float32(0.0)


@njit(cache=True, nogil=True, fastmath=True)
def _unlike(code, there, alike):
    """How many of a pixel's bits that matter differ."""
    return differing_bits(np.uint32(code & alike), np.uint32(there & alike))


@njit(cache=True, nogil=True, fastmath=True)
def _between(upper_left, upper_right, lower_left, lower_right, right, down):
    """A picture's value between four of its pixels."""
    top = upper_left + right * (upper_right - upper_left)
    low = lower_left + right * (lower_right - lower_left)
    return top + down * (low - top)
