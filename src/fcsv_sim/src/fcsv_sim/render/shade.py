# SPDX-License-Identifier: Apache-2.0
"""The kernel that turns hits into pictures: surface colour, sun and shadow, sky light, haze,
response."""

import math
from typing import NamedTuple

import numpy as np

from fcsv_sim.render import compiled
from fcsv_sim.render.layout import BEND, BEND_SIZE, PARAMETERS
from fcsv_sim.render.light import SUN, haze, respond, sky
from fcsv_sim.render.patterns import clamp01
from fcsv_sim.render.rays import DX, DY, DZ, PRIM, T
from fcsv_sim.render.shadows import lit
from fcsv_sim.render.surfaces import facade, foliage, ground, plain, roof, wood
from fcsv_sim.world import materials as m

compiled.drop_stale(
    __file__,
    "layout",
    "light",
    "noise",
    "patterns",
    "rays",
    "shadows",
    "surfaces",
    "../world/materials",
    "../world/plan",
)

_S0, _S1, _S2 = (float(v) for v in SUN)
NO_HIT = np.uint32(0xFFFFFFFF)
_COLUMNS = m.COLUMNS
_LONGEST_PART, _MOST_PARTS = 3.0, 12  # of a pixel on the ground: length over width, and how many


class Tables(NamedTuple):
    """What the kernel looks up (made in tables.py)."""

    # (M,12) f32: normal (3), spare, then u = [4:7] @ p + [7], v = [8:11] @ p + [11]
    triangles: np.ndarray
    material: np.ndarray  # (M) u8
    instance: np.ndarray  # (M) i32
    data: np.ndarray  # layout.py
    shadow_near: np.ndarray
    shadow_far: np.ndarray
    shadow_windows: np.ndarray


@compiled.function
def _ground_albedo(data, x, y, ax, ay, az, bx, by, bz):
    """The ground under a pixel: the mean over the parts of a slanted one, which is long."""
    along, across = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    if across > along:
        ax, ay, bx, by = bx, by, ax, ay
    long, short = max(along, across), min(along, across)
    parts = min(max(int(long / (_LONGEST_PART * short)), 1), _MOST_PARTS)
    ax, ay, long = ax / parts, ay / parts, long / parts
    lf = math.log2(max(short, 0.3 * long))
    hx, hy = (0.25 * ax, 0.25 * ay) if long > 1.8 * short else (0.0, 0.0)
    r, g, b = 0.0, 0.0, 0.0
    for part in range(parts):
        off = part - 0.5 * (parts - 1)
        px, py = x + off * ax, y + off * ay
        at = min(max(px, 0.0), BEND_SIZE - 2.0)
        i = int(at)
        bend = data[BEND + i] + (data[BEND + i + 1] - data[BEND + i]) * (at - i)
        pr, pg, pb = ground(data, px, py - bend, hx, hy, abs(ax) + abs(bx), abs(ay) + abs(by), lf)
        r, g, b = r + pr, g + pg, b + pb
    return r / parts, g / parts, b / parts


@compiled.function
def _wall_albedo(data, row, material, u, v, du, dv):
    """Surfaces with texture coordinates of their own."""
    lf = math.log2(max(min(du, dv), 0.35 * max(du, dv)))
    if material == m.FACADE:
        return facade(data, row, u, v, du, dv, lf)
    if material == m.ROOF:
        return roof(data, row, u, v, du, dv, lf)
    if material == m.WOOD:
        return wood(data, row, u, v, du, lf)
    if material == m.PLAIN_WALL:
        return plain(data, row, u, v, lf, 0.012, 0.11)
    if material == m.BARK:
        return plain(data, row, u, v, lf, 0.25, 0.013)
    if material == m.CONCRETE:
        return plain(data, row, u, v, lf, 0.16, 0.031)
    return plain(data, row, u, v, lf, 0.05, 0.02)


@compiled.inlined
def _light(r, g, b, sun, opening):
    """Radiance of a surface under sun (0..1) and sky (share of it that is seen)."""
    warm = 1.55 * sun
    bounce = 0.10 * (1.0 - opening)
    r *= 1.04 * warm + 0.40 * opening + bounce
    g *= 0.98 * warm + 0.46 * opening + bounce
    b *= 0.86 * warm + 0.58 * opening + bounce
    return r, g, b


@compiled.kernel
def shade_rays(  # noqa: PLR0913
    triangles,
    materials,
    instances,
    data,
    near,
    far,
    windows,
    R_world_cam,
    fx,
    fy,
    rays,
    wanted,
    places,
    exposure,
    out,
):
    """Picture values f32 of the ``wanted`` (K) of cast rays (N,20; rays.py), each into its row of
    ``places`` (K) of ``out`` (any,3).

    R_world_cam and the focal lengths (px) give a pixel's footprint on what was hit.
    """
    rx, ry, rz = R_world_cam[0, 0] / fx, R_world_cam[1, 0] / fx, R_world_cam[2, 0] / fx
    ux, uy, uz = R_world_cam[0, 1] / fy, R_world_cam[1, 1] / fy, R_world_cam[2, 1] / fy
    pixel_rad = 1.0 / fx
    prims = rays.view(np.uint32)
    for n in range(len(wanted)):
        i, to = wanted[n], places[n]
        dx, dy, dz, t, prim = rays[i, DX], rays[i, DY], rays[i, DZ], rays[i, T], prims[i, PRIM]
        if prim == NO_HIT:
            r, g, b = sky(data, dx, dy, dz, pixel_rad, data[BEND + 100] * 0.3)
            out[to, 0], out[to, 1], out[to, 2] = (
                respond(r * exposure),
                respond(g * exposure),
                respond(b * exposure),
            )
            continue
        nx, ny, nz = triangles[prim, 0], triangles[prim, 1], triangles[prim, 2]
        facing = nx * dx + ny * dy + nz * dz
        if facing > 0.0:
            nx, ny, nz, facing = -nx, -ny, -nz, -facing
        facing = min(facing, -1e-3)
        x, y, z = rays[i, 0] + t * dx, rays[i, 1] + t * dy, rays[i, 2] + t * dz
        k = (nx * rx + ny * ry + nz * rz) / facing
        ax, ay, az = t * (rx - dx * k), t * (ry - dy * k), t * (rz - dz * k)
        k = (nx * ux + ny * uy + nz * uz) / facing
        bx, by, bz = t * (ux - dx * k), t * (uy - dy * k), t * (uz - dz * k)
        footprint = t * pixel_rad
        material = materials[prim]
        row = PARAMETERS + _COLUMNS * instances[prim]
        opening = 0.5 + 0.5 * nz
        if material == m.FOLIAGE:
            r, g, b = foliage(data, row, x, y, z, nx, ny, nz, math.log2(footprint) - 0.5)
            # a crown is lit as a whole: the faces of its blobs only modulate that
            cx, cy, cz = x - data[row + 4], y - data[row + 5], z - data[row + 6]
            away = math.sqrt(cx * cx + cy * cy + cz * cz) + 1e-6
            nx, ny, nz = (
                0.45 * nx + 0.6 * cx / away,
                0.45 * ny + 0.6 * cy / away,
                0.45 * nz + 0.6 * cz / away,
            )
            opening = (0.5 + 0.5 * nz) * (0.35 + 0.65 * clamp01(away / data[row + 7]))
            sun = 0.25 + 0.85 * max(0.0, nx * _S0 + ny * _S1 + nz * _S2)
        else:
            sun = max(0.0, nx * _S0 + ny * _S1 + nz * _S2)
            if material == m.GROUND:
                r, g, b = _ground_albedo(data, x, y, ax, ay, az, bx, by, bz)
            else:
                a0, a1, a2 = triangles[prim, 4], triangles[prim, 5], triangles[prim, 6]
                b0, b1, b2 = triangles[prim, 8], triangles[prim, 9], triangles[prim, 10]
                du = abs(a0 * ax + a1 * ay + a2 * az) + abs(a0 * bx + a1 * by + a2 * bz)
                dv = abs(b0 * ax + b1 * ay + b2 * az) + abs(b0 * bx + b1 * by + b2 * bz)
                u = a0 * x + a1 * y + a2 * z + triangles[prim, 7]
                v = b0 * x + b1 * y + b2 * z + triangles[prim, 11]
                r, g, b = _wall_albedo(data, row, material, u, v, max(du, 1e-4), max(dv, 1e-4))
                if material == m.GLASS:
                    r, g, b = r + 0.12 * opening, g + 0.14 * opening, b + 0.17 * opening
        if sun > 0.0:
            off = 0.1 + 0.3 * footprint
            sun *= lit(near, far, windows, x + nx * off, y + ny * off, z + nz * off, footprint)
        r, g, b = _light(r, g, b, sun, opening)
        r, g, b = haze(r, g, b, t)
        out[to, 0], out[to, 1], out[to, 2] = (
            respond(r * exposure),
            respond(g * exposure),
            respond(b * exposure),
        )
