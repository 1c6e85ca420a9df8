# SPDX-License-Identifier: Apache-2.0
"""Kernels of the ground model: from pixels to points of cells, from these to the lowest layer."""

import numba
import numpy as np

_Z_BITS, INDEX_BITS = 14, 24
Z_STEP_M = 0.005  # heights are sorted so finely


@numba.njit(cache=True)
def points_of_view(depth, sigma, kind, most_pairs, K, R, p, span_factor, longest_m, cell_m):
    """Points (N,6) float32 of a view: x, y, z (home, m), sigma of z (m), distance (m), 1 where
    pairs agree, else 0.

    The surface between two pixels of a column is spanned where it is no longer than level ground
    allows.
    """
    height, width = depth.shape
    out = np.empty((4 * height * width, 6), np.float32)
    n = 0
    before, now = np.full((width, 5), np.nan), np.empty((width, 5))
    for row in range(height):
        ry = (row - K[1, 2]) / K[1, 1]
        for column in range(width):
            d, s, code = depth[row, column], sigma[row, column], kind[row, column]
            now[column, 0] = np.nan
            if not (d > 0 and s > 0 and d < 1e6 and s < 1e6 and 1 <= code <= most_pairs):
                continue
            rx = (column - K[0, 2]) / K[0, 0]
            ux = R[0, 0] * rx + R[0, 1] * ry + R[0, 2]
            uy = R[1, 0] * rx + R[1, 1] * ry + R[1, 2]
            uz = R[2, 0] * rx + R[2, 1] * ry + R[2, 2]
            x, y, z = p[0] + d * ux, p[1] + d * uy, p[2] + d * uz
            now[column, 0], now[column, 1], now[column, 2] = x, y, z
            agreed = 1.0 if code >= 2 else 0.0
            distance = np.hypot(d * ux, d * uy)
            sigma_z = max(s * abs(uz), 1e-4)
            steps = 1
            if not np.isnan(before[column, 0]):
                length = np.hypot(x - before[column, 0], y - before[column, 1])
                rise = abs(p[2] - z)
                level = distance * distance / (max(rise, 0.1) * K[1, 1])
                if length > cell_m and length < min(span_factor * level + cell_m, longest_m):
                    steps = min(int(np.ceil(2 * length / cell_m)), 16)
            for k in range(steps):
                if n == len(out):
                    return out[:n]
                f = (k + 1.0) / steps
                if k == steps - 1:
                    out[n, 0], out[n, 1], out[n, 2] = x, y, z
                else:
                    out[n, 0] = before[column, 0] + f * (x - before[column, 0])
                    out[n, 1] = before[column, 1] + f * (y - before[column, 1])
                    out[n, 2] = before[column, 2] + f * (z - before[column, 2])
                out[n, 3], out[n, 4], out[n, 5] = sigma_z, distance, agreed
                n += 1
        before, now = now, before
    return out[:n]


@numba.njit(cache=True)
def seen_from(depth, K, T, K_other, height, width):
    """(height, width) float32: depth (H,W) of a camera K as another one, K_other, sees it, which T
    (4,4) takes points to; NaN where nothing falls. What is nearer hides what is behind."""
    out = np.full((height, width), np.nan, np.float32)
    for row in range(depth.shape[0]):
        ry = (row - K[1, 2]) / K[1, 1]
        for column in range(depth.shape[1]):
            d = depth[row, column]
            if not d > 0:
                continue
            rx = (column - K[0, 2]) / K[0, 0]
            z = d * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
            if z <= 0.1:
                continue
            x = d * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
            y = d * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
            u = int(np.round(K_other[0, 0] * x / z + K_other[0, 2]))
            v = int(np.round(K_other[1, 1] * y / z + K_other[1, 2]))
            if 0 <= u < width and 0 <= v < height and not out[v, u] <= z:
                out[v, u] = z
    return out


@numba.njit(cache=True)
def keys_of(points, x0_m, y0_m, z0_m, cell_m, rows, columns):
    """Sortable keys (M,) int64 of the points inside the grid: cell, height, index."""
    keys = np.empty(len(points), np.int64)
    n = 0
    top = (1 << _Z_BITS) - 1
    for i in range(len(points)):
        column = int(np.floor((points[i, 0] - x0_m) / cell_m))
        row = int(np.floor((points[i, 1] - y0_m) / cell_m))
        if row < 0 or column < 0 or row >= rows or column >= columns:
            continue
        z = min(max(int((points[i, 2] - z0_m) / Z_STEP_M), 0), top)
        keys[n] = ((row * columns + column) << (_Z_BITS + INDEX_BITS)) | (z << INDEX_BITS) | i
        n += 1
    return keys[:n]


@numba.njit(cache=True)
def lowest_layers(
    keys, points, cells, gap_m, least, low_q, high_q, common, gross_one, gross_agreed
):
    """(cells,8) float32, NaN where unknown: height, sigma, lower and upper edge, roughness (m),
    bottom of what hangs above (m, inf where nothing), trust (probability that the points are no
    gross errors), distance (m).

    ``keys`` is sorted. A layer of fewer than ``least`` points is no ground, but hangs over what
    lies below it.
    """
    out = np.full((cells, 8), np.nan, np.float32)
    mask = (1 << INDEX_BITS) - 1
    i, n = 0, len(keys)
    while i < n:
        cell = keys[i] >> (_Z_BITS + INDEX_BITS)
        end = i
        while end < n and (keys[end] >> (_Z_BITS + INDEX_BITS)) == cell:
            end += 1
        first = i
        while first < end:
            last = first + 1
            while (
                last < end
                and points[keys[last] & mask, 2] - points[keys[last - 1] & mask, 2] < gap_m
            ):
                last += 1
            if last - first >= least:
                _summarise(
                    out[cell],
                    keys,
                    points,
                    first,
                    last,
                    end,
                    low_q,
                    high_q,
                    common,
                    gross_one,
                    gross_agreed,
                )
                break
            first = last
        i = end
    return out


@numba.njit(cache=True)
def _summarise(
    cell, keys, points, first, last, end, low_q, high_q, common, gross_one, gross_agreed
):
    mask = (1 << INDEX_BITS) - 1
    count = last - first
    weight = total = square = variance = distance = agreed = 0.0
    for k in range(first, last):
        j = keys[k] & mask
        w = 1.0 / (points[j, 3] * points[j, 3])
        weight += w
        total += w * points[j, 2]
        variance += points[j, 3] * points[j, 3]
        distance += points[j, 4]
        agreed += points[j, 5]
    mean = total / weight
    for k in range(first, last):
        j = keys[k] & mask
        square += (points[j, 2] - mean) ** 2
    variance /= count
    cell[0] = mean
    cell[1] = np.sqrt(common * variance + (1.0 - common) / weight)
    cell[2] = points[keys[first + int(low_q * (count - 1))] & mask, 2]
    cell[3] = points[keys[first + int(np.ceil(high_q * (count - 1)))] & mask, 2]
    cell[4] = np.sqrt(square / count)
    cell[5] = points[keys[last] & mask, 2] if last < end else np.inf
    share = agreed / count
    cell[6] = 1.0 - (share * gross_agreed + (1.0 - share) * gross_one) ** min(count / 2.0, 3.0)
    cell[7] = distance / count


@numba.njit(cache=True)
def coarser_where_sparse(layers, side, share):
    """Fills, in place, unknown cells of ``layers`` (rows, columns, 8) with what their block of
    ``side`` cells shows, where a ``share`` of the block is known: edges are the extremes, trust the
    least, sigma holds how heights differ.
    """
    rows, columns, _ = layers.shape
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            bottom, right = min(top + side, rows), min(left + side, columns)
            count, height, square, distance = 0, 0.0, 0.0, 0.0
            sigma = roughness = 0.0
            low, high, overhead, trust = np.inf, -np.inf, np.inf, 1.0
            for i in range(top, bottom):
                for j in range(left, right):
                    cell = layers[i, j]
                    if np.isnan(cell[0]):
                        continue
                    count += 1
                    height += cell[0]
                    square += cell[0] * cell[0]
                    distance += cell[7]
                    sigma, roughness = max(sigma, cell[1]), max(roughness, cell[4])
                    low, high = min(low, cell[2]), max(high, cell[3])
                    overhead, trust = min(overhead, cell[5]), min(trust, cell[6])
            if count == side * side or count < share * side * side:
                continue
            mean = height / count
            spread = np.sqrt(sigma * sigma + max(square / count - mean * mean, 0.0))
            for i in range(top, bottom):
                for j in range(left, right):
                    if np.isnan(layers[i, j, 0]):
                        layers[i, j, 0], layers[i, j, 1], layers[i, j, 2] = mean, spread, low
                        layers[i, j, 3], layers[i, j, 4], layers[i, j, 5] = (
                            high,
                            roughness,
                            overhead,
                        )
                        layers[i, j, 6], layers[i, j, 7] = trust, distance / count


@numba.njit(cache=True)
def log_odds(x, feature, threshold, above, first):
    """(N,) sum over trees of what the leaf says that each row of x (N,K) comes to: a node is above
    its threshold (go to ``above``) or not (go to the next); a leaf has feature -1."""
    out = np.zeros(len(x), np.float32)
    for i in range(len(x)):
        for node in first:
            while feature[node] >= 0:
                is_above = x[i, feature[node]] > threshold[node]
                node = above[node] if is_above else node + 1
            out[i] += threshold[node]
    return out


def rays_through(depth, sigma, K, R, p, voxel_m, reach_m, sigmas, stride, corner_m, shape):
    """(x, y, z) uint8: how many rays (every ``stride``-th pixel, 255 at most) pass each voxel of a
    box from ``corner_m``, to ``sigmas`` before their depth and no farther than ``reach_m``; (x, y,
    z) bool: where depths end."""
    # Compiled code must not return two arrays: numba makes each by Python code of its own, and does
    # not look whether that failed. Ctrl-C during the call was a segmentation fault (numba 0.68).
    rays, hits = np.zeros(shape, np.uint8), np.zeros(shape, np.bool_)
    _fill_rays(rays, hits, depth, sigma, K, R, p, voxel_m, reach_m, sigmas, stride, corner_m)
    return rays, hits


@numba.njit(cache=True)
def _fill_rays(rays, hits, depth, sigma, K, R, p, voxel_m, reach_m, sigmas, stride, corner_m):
    shape = rays.shape
    height, width = depth.shape
    u = np.empty(3)
    for row in range(height):
        ry = (row - K[1, 2]) / K[1, 1]
        for column in range(width):
            d = depth[row, column]
            if not (d > 0 and d < 1e6):
                continue
            rx = (column - K[0, 2]) / K[0, 0]
            for k in range(3):
                u[k] = R[k, 0] * rx + R[k, 1] * ry + R[k, 2]
            if d <= reach_m:
                i, j, k = voxel_at(p, u, d, corner_m, voxel_m)
                if within(i, j, k, shape):
                    hits[i, j, k] = True
            if row % stride == 0 and column % stride == 0:
                _pass(
                    rays,
                    p,
                    u,
                    min(d - sigmas * sigma[row, column], reach_m),
                    corner_m,
                    voxel_m,
                    shape,
                )


@numba.njit(cache=True)
def _pass(rays, p, u, end, corner_m, voxel_m, shape):
    """One more ray in each voxel from p along u to depth ``end``, exactly as it crosses them
    (Amanatides, Woo 1987)."""
    i, j, k = voxel_at(p, u, 0.0, corner_m, voxel_m)
    at = np.array([i, j, k])
    step, following, period = np.zeros(3, np.int64), np.full(3, np.inf), np.full(3, np.inf)
    for axis in range(3):
        if u[axis] != 0.0:
            step[axis] = 1 if u[axis] > 0 else -1
            edge = corner_m[axis] + (at[axis] + (1 if u[axis] > 0 else 0)) * voxel_m
            following[axis], period[axis] = (edge - p[axis]) / u[axis], voxel_m / abs(u[axis])
    depth = 0.0
    while depth <= end:
        if within(at[0], at[1], at[2], shape) and rays[at[0], at[1], at[2]] < 255:
            rays[at[0], at[1], at[2]] += 1
        axis = int(np.argmin(following))
        depth = following[axis]
        at[axis] += step[axis]
        following[axis] += period[axis]


@numba.njit(cache=True, inline="always")
def voxel_at(p, u, depth, corner_m, voxel_m):
    """Index along x, y, z of the voxel at a depth along a ray."""
    i = int(np.floor((p[0] + depth * u[0] - corner_m[0]) / voxel_m))
    j = int(np.floor((p[1] + depth * u[1] - corner_m[1]) / voxel_m))
    return i, j, int(np.floor((p[2] + depth * u[2] - corner_m[2]) / voxel_m))


@numba.njit(cache=True, inline="always")
def within(i, j, k, shape):
    """Whether a voxel lies in the box."""
    return 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]
