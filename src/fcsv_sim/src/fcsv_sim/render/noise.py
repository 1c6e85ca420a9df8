# SPDX-License-Identifier: Apache-2.0
"""A fractal noise texture with mip levels, and filtered lookups: texture at every distance, no
aliasing."""

import math

import numpy as np

from fcsv_sim.render import compiled

SIZE = 512
PYRAMID_SIZE = (4 * SIZE * SIZE - 1) // 3
_FADED = 6.5
_FAR = float(SIZE << 20)


def noise_pyramid(seed: int = 0) -> np.ndarray:
    """Flat float32 array of all mip levels, finest first: periodic noise of unit variance,
    amplitude ~ 1/f."""
    random = np.random.default_rng([seed, 11])
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None]) * SIZE
    spectrum = np.fft.rfft2(random.standard_normal((SIZE, SIZE)))
    # flatter than 1/f for the longest waves: those would show as a repeating pattern
    spectrum *= np.where(f > 0, 1.0 / np.maximum(f, 6.0) ** 0.95, 0.0)
    level = np.fft.irfft2(spectrum, (SIZE, SIZE))
    level /= level.std()
    levels = []
    while True:
        levels.append(level.ravel())
        if level.shape[0] == 1:
            return np.concatenate(levels).astype(np.float32)
        level = level.reshape(level.shape[0] // 2, 2, level.shape[1] // 2, 2).mean((1, 3))


@compiled.inlined
def _bilinear(data, x, y, level):
    size = SIZE >> level
    base = (4 * SIZE * SIZE - 4 * size * size) // 3
    mask = size - 1
    scale = 1.0 / (1 << level)
    x = x * scale + (_FAR - 0.5)  # positive: the cast to integers is then the floor
    y = y * scale + (_FAR - 0.5)
    i, j = np.int64(x), np.int64(y)
    ax, ay = x - i, y - j
    i0, i1 = i & mask, (i + 1) & mask
    r0, r1 = base + (j & mask) * size, base + ((j + 1) & mask) * size
    top = data[r0 + i0] + (data[r0 + i1] - data[r0 + i0]) * ax
    bottom = data[r1 + i0] + (data[r1 + i1] - data[r1 + i0]) * ax
    return top + (bottom - top) * ay


@compiled.inlined
def fractal(data, x_m, y_m, texel_m, log2_footprint_m):
    """Noise at a place with texels of ``texel_m``, averaged over a footprint (log2 of metres); the
    pyramid is at the beginning of ``data``. Coarse levels hardly vary: they fade out and are not
    read at all. One level is read, the nearest: blending two costs twice the time and cannot be
    told apart in this noise."""
    level = log2_footprint_m - math.log2(texel_m)
    if level >= _FADED:
        return 0.0
    x, y = x_m / texel_m, y_m / texel_m
    if level <= 0.0:
        return _bilinear(data, x, y, 0)
    return _bilinear(data, x, y, np.int64(level + 0.5)) * min(1.0, _FADED - level)
