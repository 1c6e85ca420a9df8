# SPDX-License-Identifier: Apache-2.0
"""Regular patterns averaged exactly over a pixel's footprint (box filter): pulses, bands, hashes of
cells."""

import math

from fcsv_sim.render import compiled


@compiled.inlined
def clamp01(x):
    return min(max(x, 0.0), 1.0)


@compiled.inlined
def _integral(x, low, high):
    whole = math.floor(x)
    return whole * (high - low) + min(max(x - whole - low, 0.0), high - low)


@compiled.function
def pulse(x, width, low, high):
    """Share of [x - width/2, x + width/2] inside [low, high] of every unit period."""
    width = max(width, 1e-3)
    return (_integral(x + 0.5 * width, low, high) - _integral(x - 0.5 * width, low, high)) / width


@compiled.inlined
def band(x, width, low, high):
    """Share of [x - width/2, x + width/2] inside [low, high]."""
    width = max(width, 1e-4)
    return max(0.0, min(x + 0.5 * width, high) - max(x - 0.5 * width, low)) / width


@compiled.function
def cell_hash(i, j, k):
    """A number in [0, 1) for a cell."""
    h = (i * 374761393 + j * 668265263 + k * 2147483647) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 16)) * 2246822519) & 0xFFFFFFFF
    return ((h ^ (h >> 13)) & 0xFFFFFF) / 16777216.0


@compiled.inlined
def detail(width):
    """Weight of what differs from cell to cell: one while a cell spans pixels, none when a pixel
    spans cells."""
    return clamp01(1.6 - 2.2 * width)
