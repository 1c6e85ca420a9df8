# SPDX-License-Identifier: Apache-2.0
"""Sub-pixel inverse depth: planes fitted to small surroundings, straight to the pictures'
differences."""

import numpy as np
from numba import njit

from fcsv_stereo.joint.tuning import PLANE_FIT

_RADIUS, _STIFFNESS = PLANE_FIT.radius_px, np.float32(PLANE_FIT.stiffness)
_TINY = np.float32(1e-30)  # keeps divisions finite


@njit(cache=True, nogil=True, fastmath=True)
def fit_band(w, tau, information, push, residual, prior, y0, y1, out, variance):
    """One Gauss-Newton step of a plane of inverse depth about every pixel of rows y0 to y1.

    ``information`` and ``push`` (HxW) are the sums over the pairs of weight slope^2 and weight
    slope difference: pixel q asks for ``w_q + push/information``. Only pixels whose ``w`` is within
    ``tau`` of the centre's take part: others are of another surface. ``residual`` is the weighted
    squared difference. Into ``out`` the plane's value at the centre and into ``variance`` its
    variance (1/m^2) for the residuals found.
    """
    height, width = w.shape
    for y in range(y0, y1):
        for x in range(width):
            m00 = m10 = m01 = m20 = m11 = m02 = np.float32(0.0)
            b0 = b1 = b2 = np.float32(0.0)
            energy = weight = count = np.float32(0.0)
            centre, limit = w[y, x], tau[y, x]
            for r in range(max(y - _RADIUS, 0), min(y + _RADIUS + 1, height)):
                for c in range(max(x - _RADIUS, 0), min(x + _RADIUS + 1, width)):
                    step = w[r, c] - centre
                    if abs(step) > limit:
                        continue
                    dx, dy = np.float32(c - x), np.float32(r - y)
                    a = information[r, c] + prior[r, c]
                    b = a * step + push[r, c]
                    m00 += a
                    m10 += a * dx
                    m01 += a * dy
                    m20 += a * dx * dx
                    m11 += a * dx * dy
                    m02 += a * dy * dy
                    b0 += b
                    b1 += b * dx
                    b2 += b * dy
                    energy += residual[r, c]
                    weight += information[r, c]
                    count += np.float32(1.0)
            # by their sum: information is up to 1e13 in large pictures, and its third power more
            # than float32 holds
            each = np.float32(1.0) / max(m00, _TINY)
            m10, m01, m20, m11, m02 = m10 * each, m01 * each, m20 * each, m11 * each, m02 * each
            b0, b1, b2 = b0 * each, b1 * each, b2 * each
            # a little stiffness of the slope: windows of one row or a few pixels have none of their
            # own
            m20 += _STIFFNESS
            m02 += _STIFFNESS
            c00 = m20 * m02 - m11 * m11
            c01 = m11 * m01 - m10 * m02
            c02 = m10 * m11 - m20 * m01
            det = c00 + m10 * c01 + m01 * c02
            shift = (c00 * b0 + c01 * b1 + c02 * b2) / max(det, _TINY)
            out[y, x] = centre + min(max(shift, -limit), limit)
            variance[y, x] = c00 / max(det, _TINY) * each * (energy / max(count, np.float32(1.0)))
