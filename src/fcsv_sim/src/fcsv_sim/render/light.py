# SPDX-License-Identifier: Apache-2.0
"""Sun, sky and haze; the response from radiance to a picture's value."""

import math

import numpy as np

from fcsv_sim.render import compiled
from fcsv_sim.render.noise import fractal
from fcsv_sim.render.patterns import clamp01

#: Direction to the sun: behind the vehicles and to one side, so that what they see is lit.
SUN = np.array([-0.52, 0.47, 0.71]) / np.linalg.norm([-0.52, 0.47, 0.71])
_HAZE_M = 2600.0


@compiled.inlined
def respond(x):
    """Radiance to picture value 0..1: a soft shoulder, then gamma 2. Applied before averaging over
    a pixel, so that an edge in the picture lies where it lies in the world (a gamma after averaging
    would move it)."""
    x = max(x, 0.0)
    return math.sqrt(min(x * (1.0 + 0.16 * x) / (1.0 + 0.6 * x), 1.0))


@compiled.function
def sky(data, dx, dy, dz, pixel_rad, drift):
    """Radiance of the sky in a direction: gradient and broken clouds."""
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    up = dz / length
    rise = clamp01(up * 1.9)
    r, g, b = 0.74 - 0.46 * rise, 0.84 - 0.36 * rise, 0.97 - 0.12 * rise
    if up > 0.015:
        low = max(up, 0.03)
        x, y = dx / length / low + drift, dy / length / low - drift
        lf = math.log2(pixel_rad / (low * low))
        cloud = fractal(data, x, y, 0.045, lf) + 0.3 * fractal(data, y * 1.7, x * 1.7, 0.012, lf)
        thick = clamp01(cloud * 0.75 - 0.1) * clamp01((up - 0.015) * 12.0)
        thick = thick * thick * (3.0 - 2.0 * thick)
        tone = 1.15 - 0.3 * clamp01(cloud * 0.5 - 0.4)
        r, g, b = r + (tone - r) * thick, g + (tone - g) * thick, b + (tone * 1.02 - b) * thick
    return r, g, b


@compiled.inlined
def haze(r, g, b, distance_m):
    """Aerial perspective."""
    x = distance_m / _HAZE_M
    clear = 1.0 / (1.0 + x * (1.0 + 0.5 * x))
    return (
        r * clear + 0.72 * (1.0 - clear),
        g * clear + 0.80 * (1.0 - clear),
        b * clear + 0.92 * (1.0 - clear),
    )
