# SPDX-License-Identifier: Apache-2.0
"""Where a pixel of the reference lies in another picture: the one place where compiled loops
compute it.

The functions are inlined before numba compiles the caller, so that they take over the caller's
types and rules of arithmetic, and no array is counted on the way. ``projections`` (Nx12) are those
of ``Views``.

Two places compute whole rows instead, since what is common to a row stands outside of their vector
code (``volume.pair_costs.warp_row`` and ``in_view``); ``views`` projects a few hundred grid points
with numpy.
"""

import numpy as np
from numba import njit

# keeps the division finite; z is 1 for what is straight ahead at infinity
_LEAST_Z = np.float32(1e-9)


@njit(inline="always")
def ray(projections, i, u, v):
    """Homogeneous place (3 numbers) in picture i of the reference's pixel (u, v), were it at
    infinity."""
    return (
        projections[i, 0] * u + projections[i, 1] * v + projections[i, 2],
        projections[i, 3] * u + projections[i, 4] * v + projections[i, 5],
        projections[i, 6] * u + projections[i, 7] * v + projections[i, 8],
    )


@njit(inline="always")
def place(a, b, c, projections, i, w):
    """Places the point of a ``ray`` (a, b, c) at inverse depth w (1/m): x and y (px) in picture i,
    z and its inverse.

    Behind the camera z is not above 0, and x and y mean nothing.
    """
    z = c + w * projections[i, 11]
    inverse = np.float32(1.0) / max(z, _LEAST_Z)
    return (a + w * projections[i, 9]) * inverse, (b + w * projections[i, 10]) * inverse, z, inverse


@njit(inline="always")
def motion(x, y, inverse, projections, i):
    """Says by how many px along x and y a ``place`` in picture i moves per 1/m of inverse depth."""
    return (
        (projections[i, 9] - x * projections[i, 11]) * inverse,
        (projections[i, 10] - y * projections[i, 11]) * inverse,
    )
