# SPDX-License-Identifier: Apache-2.0
"""Albedo (linear rgb) of the town's surfaces at a place, averaged over a footprint. All lengths in
metres.

``data`` is the flat array of layout.py, ``row`` where an instance's parameters begin in it, ``lf``
the footprint's log2.
"""

import math

from fcsv_sim.render import compiled
from fcsv_sim.render.layout import AVENUES, COVER, CROSSINGS, FARMLAND
from fcsv_sim.render.noise import fractal
from fcsv_sim.render.patterns import band, cell_hash, clamp01, detail, pulse
from fcsv_sim.world import materials as m
from fcsv_sim.world.plan import PAVEMENT_M, ROAD_HALF_M

_TRIM0 = m.TRIM
_ROAD = ROAD_HALF_M
_KERB = ROAD_HALF_M + PAVEMENT_M


@compiled.function
def window(data, row, u, v, du, dv):
    """Colour and opacity of a facade's windows and doors at (u, v)."""
    bay, floor = data[row + m.BAY_M], data[row + m.FLOOR_M]
    seed = int(data[row + m.SEED] * 64.0)
    iu, iv = int(math.floor(u / bay)), int(math.floor(v / floor))
    x, y = u - (iu + 0.5) * bay, v - iv * floor
    half, sill, high = (
        0.5 * min(data[row + m.WINDOW_WIDTH_M], 0.8 * bay),
        data[row + m.SILL_M],
        data[row + m.WINDOW_HEIGHT_M],
    )
    keep = detail(max(du / bay, dv / floor))
    h1, h2, h3 = cell_hash(iu, iv, seed), cell_hash(iu, iv, seed + 7), cell_hash(iu, iv, seed + 13)
    rows = band(v, dv, 0.0, data[row + m.FLOORS] * floor)
    pu, pv = u / bay, v / floor
    wu, wv = du / bay, dv / floor
    outer = pulse(pu, wu, 0.5 - half / bay, 0.5 + half / bay) * pulse(
        pv, wv, sill / floor, (sill + high) / floor
    )
    a, b = 0.5 - (half - 0.07) / bay, 0.5 + (half - 0.07) / bay
    glass = pulse(pu, wu, a, b) - pulse(pu, wu, 0.5 - 0.025 / bay, 0.5 + 0.025 / bay)
    glass *= pulse(pv, wv, (sill + 0.07) / floor, (sill + high - 0.07) / floor)
    ledge = pulse(pu, wu, 0.5 - (half + 0.1) / bay, 0.5 + (half + 0.1) / bay)
    ledge *= pulse(pv, wv, (sill - 0.12) / floor, sill / floor)
    # what is behind the pane: dark room, curtains at the sides, a blind part of the way down, a
    # lamp
    sky = 0.05 + 0.16 * h1 * clamp01((y - sill) / high)
    r, g, b_ = sky * 0.8 + 0.01, sky * 0.95 + 0.012, sky * 1.15 + 0.015
    if h2 < 0.45:
        inner = (half - 0.07) * (0.35 + 0.9 * h3)
        cloth = (1.0 - band(x, du, -inner, inner)) * (0.35 + 0.4 * h1)
        r, g, b_ = (
            r + (cloth - r) * min(cloth * 2.0, 1.0),
            g + (cloth * 0.93 - g) * cloth,
            b_ + (cloth * 0.82 - b_) * cloth,
        )
    elif h2 < 0.75:
        shut = band(y, dv, sill + high * h3, sill + high + 1.0) * 0.9
        tone = 0.18 + 0.45 * h1
        r, g, b_ = (
            r + (tone - r) * shut,
            g + (tone * 0.96 - g) * shut,
            b_ + (tone * 0.85 - b_) * shut,
        )
    elif h2 > 0.95:
        r, g, b_ = 0.75, 0.55, 0.25
    mean = 0.14
    r, g, b_ = mean + (r - mean) * keep, mean + (g - mean) * keep, mean + (b_ - mean) * keep
    shade = 1.0 - 0.55 * band(y, dv, sill + high - 0.22, sill + high) * keep  # the lintel's shadow
    r, g, b_ = r * shade, g * shade, b_ * shade
    t0, t1, t2 = data[row + _TRIM0], data[row + _TRIM0 + 1], data[row + _TRIM0 + 2]
    trim = max(outer - glass, 0.0) + ledge
    if iv == 0 and iu == int(data[row + m.DOOR_BAY]) and keep > 0.0:
        door = band(x, du, -0.55, 0.55) * band(y, dv, 0.0, 2.15) * keep
        leaf = band(x, du, -0.46, 0.46) * band(y, dv, 0.0, 2.06) * keep
        d0, d1, d2 = 0.08 + 0.3 * h1, 0.06 + 0.22 * h2, 0.05 + 0.2 * h3
        o = 1.0 - keep
        glass, trim = glass * o, trim * o + door - leaf
        r, g, b_ = (r * glass + d0 * leaf), (g * glass + d1 * leaf), (b_ * glass + d2 * leaf)
        glass += leaf
    else:
        r, g, b_ = r * glass, g * glass, b_ * glass
    cover = min(glass + trim, 1.0) * rows
    return (r + t0 * trim) * rows, (g + t1 * trim) * rows, (b_ + t2 * trim) * rows, cover


@compiled.function
def facade(data, row, u, v, du, dv, lf):
    """Plaster or brick with stains, and windows."""
    seed = data[row + m.SEED]
    ox, oy = seed * 13.7, seed * 7.1
    coarse = fractal(data, u + ox, v + oy, 0.045, lf)
    fine = fractal(data, (u + ox) * 0.79 + 0.61 * v, (v + oy) * 0.79 - 0.61 * u, 0.0083, lf)
    streak = fractal(data, u * 1.0 + oy, v * 0.12 + ox, 0.021, lf - 0.5)
    rough = 0.10 + 0.10 * data[row + m.BRICK]
    k = 1.0 + 0.13 * coarse + rough * fine + 0.06 * streak
    k *= 1.0 - 0.28 * clamp01(1.0 - v / (0.7 + 0.25 * coarse))
    if data[row + m.BRICK] > 0.5:
        course = math.floor(v / 0.077)
        joint = pulse(v / 0.077, dv / 0.077, 0.0, 0.14)
        shift = 0.5 * (course - 2.0 * math.floor(0.5 * course))
        joint = max(joint, pulse(u / 0.25 + shift, du / 0.25, 0.0, 0.05) * detail(dv / 0.077))
        tint = cell_hash(int(math.floor(u / 0.25 + shift)), int(course), int(seed)) - 0.5
        k = k * (1.0 + 0.5 * tint * detail(max(du / 0.25, dv / 0.077))) + joint * 0.5
    r, g, b = data[row] * k, data[row + 1] * k, data[row + 2] * k * (1.0 - 0.05 * coarse)
    if data[row + m.FLOORS] > 0.0:
        if seed - 10.0 * math.floor(seed * 0.1) > 6.0:
            line = (
                pulse(
                    v / data[row + m.FLOOR_M],
                    dv / data[row + m.FLOOR_M],
                    0.0,
                    0.16 / data[row + m.FLOOR_M],
                )
                * 0.8
            )
            r, g, b = (
                r + (data[row + 12] * 0.8 - r) * line,
                g + (data[row + 13] * 0.8 - g) * line,
                b + (data[row + 14] * 0.8 - b) * line,
            )
        w0, w1, w2, cover = window(data, row, u, v, du, dv)
        grime = 1.0 + 0.1 * fine
        r, g, b = (
            r * (1.0 - cover) + w0 * grime,
            g * (1.0 - cover) + w1 * grime,
            b * (1.0 - cover) + w2 * grime,
        )
    return r, g, b


@compiled.function
def roof(data, row, u, v, du, dv, lf):
    """Courses of tiles, each tile of its own tone, moss in patches."""
    seed = data[row + m.SEED]
    coarse = fractal(data, u + seed * 3.1, v - seed * 5.3, 0.061, lf)
    fine = fractal(data, (u - seed) * 0.87 + 0.49 * v, v * 0.87 - 0.49 * u, 0.0117, lf)
    course, column = v / 0.34, u / 0.27
    offset = 0.5 * (math.floor(course) - 2.0 * math.floor(0.5 * math.floor(course)))
    tone = cell_hash(int(math.floor(column + offset)), int(math.floor(course)), int(seed * 8)) - 0.5
    k = 1.0 + 0.2 * coarse + 0.17 * fine + 0.55 * tone * detail(max(du / 0.27, dv / 0.34))
    k *= 1.0 - 0.5 * pulse(course, dv / 0.34, 0.0, 0.16)
    k *= 1.0 - 0.3 * pulse(column + offset, du / 0.27, 0.0, 0.12) * detail(dv / 0.34)
    moss = clamp01(0.5 * coarse - 0.35) * 0.7
    r, g, b = data[row] * k, data[row + 1] * k, data[row + 2] * k
    return r + (0.10 - r) * moss, g + (0.12 - g) * moss, b + (0.05 - b) * moss


@compiled.function
def ground(data, s, t, hs, ht, fs, ft, lf):
    """Bare ground (below), and what lies on it: smooth, but what is beneath shows a little."""
    r, g, b = _bare_ground(data, s, t, hs, ht, fs, ft, lf)
    share = data[COVER + 3]
    if share > 0.0:
        k = 1.0 + 0.6 * (g - 0.13)
        r, g, b = (
            r + (data[COVER] * k - r) * share,
            g + (data[COVER + 1] * k - g) * share,
            b + (data[COVER + 2] * k - b) * share,
        )
    return r, g, b


@compiled.function
def _crops(s, t, fs, ft, middle, fine, r, g, b):
    """Fields of one crop each, with grass between them and rows along t in some."""
    u, v = (s + 0.21 * t) / 74.0, (t - 0.17 * s) / 52.0
    i, j = int(math.floor(u)), int(math.floor(v))
    kind, tone = cell_hash(i, j, 11), cell_hash(i, j, 12)
    inside = band((u - i) * 74.0, fs + 0.21 * ft, 1.4, 72.6) * band(
        (v - j) * 52.0, ft + 0.17 * fs, 1.4, 50.6
    )
    if kind < 0.22:  # meadow
        return r, g, b
    row = (pulse(v * 52.0 / 1.7, (ft + 0.17 * fs) / 1.7, 0.0, 0.35) - 0.35) * 0.5
    k = (1.0 + 0.16 * middle + 0.24 * fine + row) * (0.85 + 0.3 * tone)
    if kind < 0.5:  # grain
        cr, cg, cb = 0.34 * k, 0.27 * k, 0.11 * k
    elif kind < 0.75:  # beet
        cr, cg, cb = 0.075 * k, 0.15 * k, 0.035 * k
    else:  # ploughed
        cr, cg, cb = 0.20 * k, 0.145 * k, 0.095 * k
    return r + (cr - r) * inside, g + (cg - g) * inside, b + (cb - b) * inside


@compiled.function
def _bare_ground(data, s, t, hs, ht, fs, ft, lf):
    """Street, pavement, garden or field at plan coordinates (s, t); fs, ft: the footprint's sides.
    It is (2 hs, 2 ht) longer than lf says: noise is read at its two halves."""
    coarse = fractal(data, s * 0.93 + 0.37 * t, t * 0.93 - 0.37 * s, 0.37, lf)
    x, y, hx, hy = (
        s * 0.78 - 0.62 * t,
        t * 0.78 + 0.62 * s,
        hs * 0.78 - 0.62 * ht,
        ht * 0.78 + 0.62 * hs,
    )
    if abs(hs) + abs(ht) > 0.0:
        middle = 0.5 * (
            fractal(data, x - hx, y - hy, 0.053, lf) + fractal(data, x + hx, y + hy, 0.053, lf)
        )
        fine = 0.5 * (
            fractal(data, s - hs, t - ht, 0.0091, lf) + fractal(data, s + hs, t + ht, 0.0091, lf)
        )
    else:
        middle = fractal(data, x, y, 0.053, lf)
        fine = fractal(data, s, t, 0.0091, lf)
    # grass, worn to earth in patches, longer and darker elsewhere; past the town: meadows and
    # woodland floor
    dry = clamp01(0.45 + 0.33 * coarse + 0.15 * middle)
    k = 1.0 + 0.24 * middle + 0.26 * fine
    r, g, b = (0.085 + 0.11 * dry) * k, (0.125 + 0.05 * dry) * k, (0.035 + 0.035 * dry) * k
    earth = clamp01((0.55 * coarse + 0.6 * middle - 0.75) * 1.6)
    k = 1.0 + 0.18 * middle + 0.28 * fine
    r, g, b = r + (0.25 * k - r) * earth, g + (0.20 * k - g) * earth, b + (0.14 * k - b) * earth
    if data[FARMLAND] > 0.0 and s > 22.0:
        r, g, b = _crops(s, t, fs, ft, middle, fine, r, g, b)
    first = data[CROSSINGS + 1]
    if s < first - _KERB - fs:
        return r, g, b
    along, near_t = 1e9, 0.0
    for i in range(int(data[AVENUES])):
        offset = t - data[AVENUES + 1 + i]
        if abs(offset) < along:
            along, near_t = abs(offset), offset
    if s < first - _ROAD:
        along = 1e9
    across = 1e9
    for i in range(int(data[CROSSINGS])):
        across = min(across, abs(s - data[CROSSINGS + 1 + i]))
    d = min(along, across)
    foot = ft if along < across else fs
    if d > 30.0 or s > 485.0:
        return r, g, b
    plot = cell_hash(int(math.floor(s / 17.0)), int(math.floor(t / 23.0)), 5)
    if plot > 0.72 and d < 15.0:  # paved yards
        k = (0.30 + 0.1 * plot) * (1.0 + 0.14 * middle + 0.15 * fine)
        r, g, b = k, k * 0.95, k * 0.87
    slab = 0.88 + 0.08 * middle + 0.13 * fine + 0.06 * coarse
    slab *= (
        1.0
        - 0.25 * pulse(s / 0.6, fs / 0.6, 0.0, 0.05)
        - 0.25 * pulse(t / 0.6, ft / 0.6, 0.0, 0.05)
    )
    pave = band(d, foot, -1.0, _KERB)
    r, g, b = (
        r + (0.33 * slab - r) * pave,
        g + (0.32 * slab - g) * pave,
        b + (0.30 * slab - b) * pave,
    )
    kerb = band(d, foot, _ROAD, _ROAD + 0.18)
    r, g, b = r + (0.5 - r) * kerb, g + (0.5 - g) * kerb, b + (0.48 - b) * kerb
    patch = clamp01((coarse + 0.3 * middle - 0.7) * 4.0)
    tar = (0.095 - 0.035 * patch) * (1.0 + 0.13 * middle + 0.22 * fine + 0.08 * coarse)
    road = band(d, foot, -1.0, _ROAD)
    r, g, b = r + (tar - r) * road, g + (tar - g) * road, b + (tar * 1.05 - b) * road
    dash = (
        band(near_t, ft, -0.07, 0.07) * pulse(s / 6.0, fs / 6.0, 0.0, 0.5)
        if across > _KERB
        else 0.0
    )
    zebra_s = band(across, fs, _KERB + 0.5, _KERB + 3.0) if along < _ROAD else 0.0
    dash = max(dash, zebra_s * pulse(t, ft, 0.0, 0.5) * band(along, ft, -1.0, _ROAD - 0.3))
    dash *= clamp01(0.75 + 0.3 * fine)
    return r + (0.62 - r) * dash, g + (0.62 - g) * dash, b + (0.6 - b) * dash


@compiled.function
def foliage(data, row, x, y, z, nx, ny, nz, lf):
    """Leaves: strong contrast at the scale of leaves and of twigs, projected along the facet's main
    axis."""
    if abs(nz) > max(abs(nx), abs(ny)):
        u, v = x, y
    elif abs(nx) > abs(ny):
        u, v = y, z
    else:
        u, v = x, z
    seed = data[row + m.SEED]
    leaf = fractal(data, u + seed, v - seed, 0.017, lf)
    twig = fractal(data, u * 0.77 - v * 0.64, v * 0.77 + u * 0.64 + seed, 0.041, lf)
    k = max(0.25, 1.0 + 0.42 * leaf + 0.28 * twig)
    return (
        data[row] * k * (1.0 + 0.12 * twig),
        data[row + 1] * k,
        data[row + 2] * k * (1.0 - 0.1 * leaf),
    )


@compiled.function
def plain(data, row, u, v, lf, strength, texel_m):
    """One colour with noise of a strength."""
    k = 1.0 + strength * (
        fractal(data, u + data[row + m.SEED] * 3.3, v, texel_m, lf)
        + 0.7 * fractal(data, v - u * 0.37, u + v * 0.37, texel_m * 0.21, lf)
    )
    k = max(k, 0.1)
    return data[row] * k, data[row + 1] * k, data[row + 2] * k


@compiled.function
def wood(data, row, u, v, du, lf):
    """Planks, each of its own tone, with gaps."""
    plank = cell_hash(int(math.floor(u / 0.16)), 3, int(data[row + m.SEED])) - 0.5
    grain = fractal(data, u + data[row + m.SEED], v * 0.1, 0.011, lf)
    stain = fractal(data, u * 0.9 - data[row + m.SEED], v + 0.3 * u, 0.05, lf)
    k = 1.0 + 0.6 * plank * detail(du / 0.16) + 0.16 * grain + 0.2 * stain
    k *= 1.0 - 0.75 * pulse(u / 0.16, du / 0.16, 0.0, 0.1)
    return data[row] * k, data[row + 1] * k, data[row + 2] * k
