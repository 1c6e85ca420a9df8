# SPDX-License-Identifier: Apache-2.0
"""Rays in Embree's own layout (RTCRayHit): one row of 20 floats a ray, filled and read by kernels
in place."""

import numpy as np

COLUMNS = 20
# origin, nearest t, direction, time, then the distance hit
OX, OY, OZ, T_NEAR, DX, DY, DZ, TIME, T = range(9)
MASK, PRIM, GEOMETRY, INSTANCE = 9, 17, 18, 19  # as uint32


def ray_buffer(count: int) -> np.ndarray:
    """(count, 20) float32 aligned to 16 bytes, as Embree wants it."""
    raw = np.zeros(count * COLUMNS + 4, np.float32)
    skip = (-raw.ctypes.data // 4) % 4
    return raw[skip : skip + count * COLUMNS].reshape(count, COLUMNS)


def set_rays(rays: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> None:
    """Fill a buffer from arrays (N,3)."""
    rays[:, OX : OZ + 1], rays[:, DX : DZ + 1] = origin, direction
    rays[:, T_NEAR], rays[:, TIME], rays[:, T] = 0.0, 0.0, np.inf
    rays.view(np.uint32)[:, [MASK, PRIM, GEOMETRY, INSTANCE]] = 0xFFFFFFFF
