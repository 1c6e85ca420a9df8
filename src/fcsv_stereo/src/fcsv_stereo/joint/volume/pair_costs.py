# SPDX-License-Identifier: Apache-2.0
"""The pairs' costs on one plane of the sweep, sorted, in quarters of a bit.

Kernels are handed a row of arrays to write on (``scratch``): allocated once for a band, not for
every plane.
"""

from pathlib import Path

import numpy as np
from numba import njit

from fcsv_stereo.joint.tuning import VOLUME
from fcsv_stereo.joint.volume.census import RADIUS, STEPS, census_row, whole_code
from fcsv_stereo.joint.volume.intrinsics import quarters_that_differ, whole_16

QUARTERS = 4  # of a bit: 32 of them have room in 8
_BLOCK = 32  # columns: time alone
_MOST_DRIFT = np.float32(2.0 * VOLUME.most_drift_px)  # from one end of a block to the other


def must_compile() -> bool:
    """Whether this machine has not compiled the kernels since they changed: the next map waits for
    that."""
    if rank.signatures:
        return False  # this process has them: maps in flight follow one another
    kept = Path(rank.stats.cache_path).glob("pair_costs.rank-*.nbi")
    written = Path(__file__).stat().st_mtime
    return not any(index.stat().st_mtime > written for index in kept)


@njit(cache=True, nogil=True, fastmath=True)
def rank(reference, others, sizes, projections, w, offsets, unseen, y0, room, ranked):
    """Costs (uint8) of a band of rows from ``y0`` on at inverse depth ``w`` into ``ranked`` (rows,
    N, W).

    ``reference`` (H,W) are its census codes; ``unseen`` (H,W) is what counts for a pair that sees
    nothing.
    """
    warped, seen, at, least, lower, upper, costs = room
    rows, pairs, width = ranked.shape
    for i in range(pairs):
        low, high = width, 0
        for r in range(rows):
            a, b = in_view(projections[i], sizes[i], w, np.float32(y0 + r), width)
            low, high = min(low, a), max(high, b)
        if low < high:
            for r in range(rows + 2 * RADIUS):
                warp_row(
                    others[i],
                    sizes[i],
                    projections[i],
                    w,
                    np.float32(y0 - RADIUS + r),
                    low - RADIUS,
                    at,
                    warped[r, low : high + 2 * RADIUS],
                    seen[r, low : high + 2 * RADIUS],
                )
        for r in range(rows):
            nothing = unseen[y0 + r]
            costs[:] = nothing
            if low < high:
                codes = lower[low:high], upper[low:high]
                census_row(warped, r + RADIUS, low, offsets, least, *codes)
                inside = seen[r + RADIUS, low + RADIUS : high + RADIUS]
                _differ(
                    *codes, reference[y0 + r, low:high], inside, nothing[low:high], costs[low:high]
                )
            _insert(ranked[r], i, costs)


@njit(cache=True, nogil=True, fastmath=True)
def _differ(lower, upper, reference, inside, unseen, costs):
    """A row's costs by census codes."""
    for x in range(costs.shape[0]):
        differ = quarters_that_differ(whole_code(lower[x], upper[x]), reference[x])
        costs[x] = differ if inside[x] > np.float32(0.5) else unseen[x]


@njit(cache=True, nogil=True)
def scratch(rows, width):
    """What ``rank`` writes on its way."""
    shape = (rows + 2 * RADIUS, width + 2 * RADIUS)
    places, part = np.empty(_BLOCK, np.int32), np.empty((2, _BLOCK), np.float32)
    at = places, part[0], part[1], np.arange(_BLOCK).astype(np.float32)
    lower, upper, least = (
        np.empty(width, np.uint16),
        np.empty(width, np.uint16),
        np.empty(width, np.int16),
    )
    warped, seen, costs = (
        np.empty(shape, np.int16),
        np.empty(shape, np.float32),
        np.empty(width, np.uint8),
    )
    return warped, seen, at, least, lower, upper, costs


@njit(cache=True, nogil=True, fastmath=True)
def weigh(ranked, weights, total):
    """Mean of sorted costs (N,W), the better ones weighing more, in bits."""
    total[:] = np.float32(0.0)
    for j in range(ranked.shape[0]):
        weight = weights[j] / np.float32(QUARTERS)
        for x in range(total.shape[0]):
            total[x] += weight * np.float32(ranked[j, x])


@njit(cache=True, nogil=True, fastmath=True)
def warp_row(image, size, p, w, v, u0, at, out, seen):
    """A row of the reference's pixels (u0 on, at height v) sampled from another picture at inverse
    depth w, in STEPS.

    By blocks of columns that move as one but for a drift: neighbours there are neighbours here, and
    vector code loads them so. Where the picture ends or the drift is too large, place by place:
    first where each is, then what is there; only apart does the first become vector code. What a
    row has in common is summed once, in another order than in ``projecting``: with its functions
    the last bits would differ. (All in one function: a call counts references to its arrays, and
    two threads that count wait for each other.)
    """
    index, parts_x, parts_y, ramp = at
    height, width = np.float32(size[0] - 1), np.float32(size[1] - 1)
    last_x, last_y, stride = (
        np.int32(max(size[1] - 2, 0)),
        np.int32(max(size[0] - 2, 0)),
        np.int32(image.shape[1]),
    )
    zero, half, one, steps = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(STEPS)
    x0, y0 = p[1] * v + p[2] + w * p[9], p[4] * v + p[5] + w * p[10]
    z0 = p[7] * v + p[8] + w * p[11]
    flat, right, down = (
        image.reshape(-1),
        np.uintp(size[1] > 1),
        np.uintp(stride if size[0] > 1 else 0),
    )
    for first in range(0, out.shape[0], _BLOCK):
        count = min(_BLOCK, out.shape[0] - first)
        to, span, u = np.uintp(first), np.float32(max(count - 1, 1)), np.float32(u0 + first)
        za, zb = p[6] * u + z0, p[6] * (u + span) + z0
        inverse_a, inverse_b = one / max(za, np.float32(1e-9)), one / max(zb, np.float32(1e-9))
        xa, ya = (p[0] * u + x0) * inverse_a, (p[3] * u + y0) * inverse_a
        xb, yb = (p[0] * (u + span) + x0) * inverse_b, (p[3] * (u + span) + y0) * inverse_b
        drift_x, drift_y = (xb - xa) / span - one, (yb - ya) / span
        x_low, y_low = half * (xa + xb - span), half * (ya + yb)
        inside = (
            (x_low >= one) & (y_low >= one) & (x_low < width - span - one) & (y_low < height - one)
        )
        if inside & (min(za, zb) > zero) & (max(abs(drift_x), abs(drift_y)) * span < _MOST_DRIFT):
            c, r = np.int32(x_low), np.int32(y_low)
            fx, fy = xa - np.float32(c), ya - np.float32(r)
            upper = np.uintp(r * stride + c)
            for i in range(np.uintp(count)):
                x, y = fx + drift_x * ramp[i], fy + drift_y * ramp[i]
                a, b = flat[upper + i], flat[upper + down + i]
                top = a + x * (flat[upper + right + i] - a)
                low = b + x * (flat[upper + down + right + i] - b)
                out[to + i] = whole_16(steps * (top + y * (low - top)))
            for i in range(np.uintp(count)):
                seen[to + i] = one
            continue
        for i in range(np.uintp(count)):
            z = p[6] * (u + ramp[i]) + z0
            inverse = one / max(z, np.float32(1e-9))
            x = (p[0] * (u + ramp[i]) + x0) * inverse
            y = (p[3] * (u + ramp[i]) + y0) * inverse
            seen[to + i] = (
                one
                if (z > zero) & (x >= zero) & (x <= width) & (y >= zero) & (y <= height)
                else zero
            )
            x, y = min(max(x, zero), width), min(max(y, zero), height)
            xi, yi = min(np.int32(x), last_x), min(np.int32(y), last_y)
            index[i] = yi * stride + xi
            parts_x[i], parts_y[i] = x - np.float32(xi), y - np.float32(yi)
        for i in range(np.uintp(count)):
            k = np.uintp(index[i])
            top = flat[k] + parts_x[i] * (flat[k + right] - flat[k])
            low = flat[k + down] + parts_x[i] * (flat[k + down + right] - flat[k + down])
            out[to + i] = whole_16(steps * (top + parts_y[i] * (low - top)))


@njit(cache=True, nogil=True, fastmath=True)
def _insert(ranked, count, costs):
    """A row of costs into ``count`` sorted ones."""
    for j in range(count):
        row = ranked[j]
        for x in range(costs.shape[0]):
            low, high = min(row[x], costs[x]), max(row[x], costs[x])
            row[x] = low
            costs[x] = high
    ranked[count, :] = costs


@njit(cache=True, nogil=True)
def in_view(p, size, w, v, width):
    """Columns of the reference's row ``v`` from the first to behind the last that another picture
    sees at inverse depth ``w``, and up to two beside them: each of its bounds is a line in the
    column."""
    z0, slope = p[7] * v + p[8] + w * p[11], p[6]
    low, high = np.float32(-1.0), np.float32(width)
    for k in range(5):
        a, b = slope, z0  # in front of the camera: a u + b >= 0
        if k > 0:
            axis = (k - 1) // 2
            a, b = p[3 * axis], p[3 * axis + 1] * v + p[3 * axis + 2] + w * p[9 + axis]
            if k % 2 == 0:
                last = np.float32(size[1 - axis] - 1)
                a, b = last * slope - a, last * z0 - b
        if a > 0:
            low = max(low, -b / a)
        elif a < 0:
            high = min(high, -b / a)
        elif b < 0:
            return width, 0
    if low > high + np.float32(1.0):
        return width, 0
    return min(max(int(low) - 1, 0), width), max(min(int(high) + 3, width), 0)
