# SPDX-License-Identifier: Apache-2.0
"""What the sun sees: two depth maps (near the vehicles, and all), made once as town and sun stand
still."""

import math
from typing import Tuple

import numpy as np

from fcsv_sim.render import compiled
from fcsv_sim.render.light import SUN

_RIGHT = np.cross([0.0, 0.0, 1.0], SUN) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], SUN))
_UP = np.cross(SUN, _RIGHT)
_FRAME = np.stack([_RIGHT, _UP, SUN])
_REGIONS = (  # lowest and highest corner (m), texel (m)
    ((-10.0, -60.0, -2.0), (120.0, 60.0, 25.0), 0.12),
    ((-40.0, -330.0, -2.0), (640.0, 330.0, 130.0), 0.5),
)
_ROWS = 64  # of a map that are cast together
_R0, _R1, _R2 = (float(v) for v in _RIGHT)
_U0, _U1, _U2 = (float(v) for v in _UP)
_S0, _S1, _S2 = (float(v) for v in SUN)


def shadow_maps(cast) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """near, far maps (H,W) f32: height along the sun's direction of the topmost surface; windows
    (2,3) f64: their origins and texels. ``cast`` takes origins and directions (N,3) and gives
    distances (N)."""
    maps, windows = [], []
    for low, high, texel in _REGIONS:
        corners = np.array(np.meshgrid(*zip(low, high))).reshape(3, -1)
        across = _FRAME @ corners
        origin, end = across.min(1), across.max(1)
        a = np.arange(origin[0], end[0], texel)
        b = np.arange(origin[1], end[1], texel)
        top = end[2] + 200.0
        height = np.empty((len(b), len(a)), np.float32)
        for first in range(0, len(b), _ROWS):  # few at a time: they stay in the processor's cache
            rows = b[first : first + _ROWS, None, None]
            origins = (a[:, None] * _RIGHT + rows * _UP + top * SUN).reshape(-1, 3)
            distance = cast(origins, np.broadcast_to(-SUN, origins.shape))
            height[first : first + _ROWS] = (top - distance).reshape(-1, len(a))
        maps.append(height)
        windows.append([origin[0], origin[1], texel])
    return maps[0], maps[1], np.array(windows)


@compiled.inlined
def lit(near, far, windows, x, y, z, soft_m):
    """Share of the sun's light that reaches a place, over a soft edge of about ``soft_m``."""
    a = x * _R0 + y * _R1 + z * _R2
    b = x * _U0 + y * _U1 + z * _U2
    height = x * _S0 + y * _S1 + z * _S2
    i = (a - windows[0, 0]) / windows[0, 2]
    j = (b - windows[0, 1]) / windows[0, 2]
    if 1.0 < i < near.shape[1] - 2.0 and 1.0 < j < near.shape[0] - 2.0 and soft_m < 0.3:
        return _compare(near, i, j, height + 0.12)
    i = (a - windows[1, 0]) / windows[1, 2]
    j = (b - windows[1, 1]) / windows[1, 2]
    if 1.0 < i < far.shape[1] - 2.0 and 1.0 < j < far.shape[0] - 2.0:
        return _compare(far, i, j, height + 0.45)
    return 1.0


@compiled.inlined
def _compare(depth, i, j, height):
    fi, fj = math.floor(i), math.floor(j)
    p, q = int(fi), int(fj)
    a, b = i - fi, j - fj
    s00 = 1.0 if depth[q, p] <= height else 0.0
    s01 = 1.0 if depth[q, p + 1] <= height else 0.0
    s10 = 1.0 if depth[q + 1, p] <= height else 0.0
    s11 = 1.0 if depth[q + 1, p + 1] <= height else 0.0
    return (s00 * (1 - a) + s01 * a) * (1 - b) + (s10 * (1 - a) + s11 * a) * b
