# SPDX-License-Identifier: Apache-2.0
"""Which of two or three surfaces a pixel at a step of depth belongs to: adaptive support weights at full size.

The window of the coarse match covers both sides of a step; here a pixel asks only those neighbours that look like
itself (Yoon and Kweon 2006).
"""

import numpy as np
from numba import njit

from fcsv_stereo.joint.photometric import sample


@njit(cache=True, nogil=True, fastmath=True)
def choose_band(
    grey, reference, others, sizes, projections, candidates, edge, weights, radius, likeness, cut, y0, y1, best
):
    """Into ``best`` the candidate (K,H,W inverse depths; the first where they tie) that fits each pixel of an edge."""
    height, width = grey.shape
    pairs = others.shape[0]
    ranked = np.empty(pairs, np.float32)
    support = np.empty((2 * radius + 1, 2 * radius + 1), np.float32)
    for y in range(y0, y1):
        for x in range(width):
            best[y, x] = candidates[0, y, x]
            if not edge[y, x]:
                continue
            for r in range(-radius, radius + 1):
                for c in range(-radius, radius + 1):
                    v, u = min(max(y + r, 0), height - 1), min(max(x + c, 0), width - 1)
                    far = np.sqrt(np.float32(r * r + c * c)) / np.float32(radius)
                    support[r + radius, c + radius] = np.exp(-abs(grey[v, u] - grey[y, x]) / likeness - far)
            least = np.float32(1e9)
            for k in range(candidates.shape[0]):
                w = candidates[k, y, x]
                for i in range(pairs):
                    ranked[i] = _unlike(reference, others[i], sizes[i], projections[i], w, support, radius, cut, y, x)
                    for j in range(i, 0, -1):
                        if ranked[j] < ranked[j - 1]:
                            ranked[j], ranked[j - 1] = ranked[j - 1], ranked[j]
                cost = np.float32(0.0)
                for i in range(pairs):
                    cost += weights[i] * ranked[i]
                if cost < least * np.float32(0.98):
                    least = cost
                    best[y, x] = w


@njit(cache=True, nogil=True, fastmath=True)
def _unlike(reference, image, size, p, w, support, radius, cut, y, x):
    """Mean cut-off difference over a window at one inverse depth; half the cut where the pair does not see it."""
    height, width = size[0], size[1]
    total, weight = np.float32(0.0), np.float32(0.0)
    for r in range(-radius, radius + 1):
        for c in range(-radius, radius + 1):
            v, u = y + r, x + c
            if (r + c) & 1 or support[r + radius, c + radius] < np.float32(0.03):
                continue  # every second one tells as much, and one that looks unlike hardly counts
            if v < 0 or u < 0 or v >= reference.shape[0] or u >= reference.shape[1]:
                continue
            s = support[r + radius, c + radius]
            z = p[6] * u + p[7] * v + p[8] + w * p[11]
            inverse = np.float32(1.0) / max(z, np.float32(1e-9))
            a = (p[0] * u + p[1] * v + p[2] + w * p[9]) * inverse
            b = (p[3] * u + p[4] * v + p[5] + w * p[10]) * inverse
            weight += s
            if z <= 0 or a < 0 or a > width - 1 or b < 0 or b > height - 1:
                total += s * cut * np.float32(0.5)
                continue
            total += s * min(abs(reference[v, u] - sample(image, height, width, a, b)), cut)
    return total / max(weight, np.float32(1e-9))
