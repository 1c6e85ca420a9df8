# SPDX-License-Identifier: Apache-2.0
"""Rays of a picture, and where one ray a pixel is not enough."""

import numpy as np

from fcsv_sim.render import compiled
from fcsv_sim.render.rays import (
    DX,
    DY,
    DZ,
    GEOMETRY,
    INSTANCE,
    MASK,
    OX,
    OY,
    OZ,
    PRIM,
    T_NEAR,
    TIME,
    T,
)
from fcsv_sim.world.materials import FOLIAGE

compiled.drop_stale(__file__, "rays")

#: Where inside a pixel the extra rays go, by rays per pixel: symmetric about the centre (which is
#: always one of them), so that edges stay where they are.
OFFSETS = {
    3: np.array([[-0.30, -0.22], [0.30, 0.22]], np.float32),
    5: np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]], np.float32),
}


def tiled(height: int, width: int, side: int = 8) -> np.ndarray:
    """Pixel indices (N) i32 tile by tile: rays that follow each other stay together."""
    v, u = np.mgrid[:height, :width]
    return np.lexsort((u.ravel(), v.ravel(), u.ravel() // side, v.ravel() // side)).astype(np.int32)


@compiled.inlined
def _set_ray(rays, ints, n, p, R, x, y, z):
    rays[n, OX], rays[n, OY], rays[n, OZ] = p[0], p[1], p[2]
    rays[n, DX] = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
    rays[n, DY] = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    rays[n, DZ] = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    rays[n, T_NEAR], rays[n, TIME], rays[n, T] = 0.0, 0.0, np.inf
    ints[n, MASK], ints[n, PRIM], ints[n, GEOMETRY], ints[n, INSTANCE] = (
        np.uint32(0xFFFFFFFF),
        np.uint32(0xFFFFFFFF),
        np.uint32(0xFFFFFFFF),
        np.uint32(0xFFFFFFFF),
    )


@compiled.kernel
def fill_rays(directions_cam, order, R_world_cam, p_world_cam, rays):
    """World rays of the pixels in an order (N) from directions (N,3) in the camera."""
    ints = rays.view(np.uint32)
    for n in range(len(order)):
        i = order[n]
        _set_ray(
            rays,
            ints,
            n,
            p_world_cam,
            R_world_cam,
            directions_cam[i, 0],
            directions_cam[i, 1],
            directions_cam[i, 2],
        )


def surface_numbers(
    triangles: np.ndarray, materials: np.ndarray, instances: np.ndarray
) -> np.ndarray:
    """A number (M) i64 for each triangle of Tables that differs where instance or orientation
    differ (of a crown: instance alone); 0 is the sky's."""
    a, b, c = (triangles[:, :3].astype(np.float64) * 4.0 + 9.5).astype(np.int64).T
    orientation = np.where(materials == FOLIAGE, 0, (a * 19 + b) * 19 + c)
    return 1 + instances.astype(np.int64) * 6859 + orientation


@compiled.kernel
def collect(rays, order, numbers, depth, surface):
    """Back into picture order: depth (N; NaN for none), and the surface's number."""
    ints = rays.view(np.uint32)
    for n in range(len(order)):
        i, p = order[n], ints[n, PRIM]
        if p == np.uint32(0xFFFFFFFF):
            depth[i], surface[i] = np.nan, 0
        else:
            depth[i], surface[i] = rays[n, T], numbers[p]


@compiled.kernel
def find_edges(values, surface, threshold, marked):
    """Marks pixels (H,W bool) whose neighbour shows another surface in another colour; returns how
    many."""
    height, width = surface.shape
    marked[:] = False
    for v in range(height):
        for u in range(width):
            for dv, du in ((0, 1), (1, 0)):
                q, p = v + dv, u + du
                if q >= height or p >= width or surface[v, u] == surface[q, p]:
                    continue
                contrast = 0.0
                for k in range(3):
                    contrast = max(contrast, abs(values[v, u, k] - values[q, p, k]))
                if contrast > threshold:
                    marked[v, u] = True
                    marked[q, p] = True
    count = 0
    for v in range(height):
        for u in range(width):
            count += marked[v, u]
    return count


@compiled.kernel
def fill_edge_rays(directions_cam, marked, order, offsets, R_world_cam, p_world_cam, rays):
    """len(offsets) rays for every marked pixel, in the order of the tiles."""
    height, width = marked.shape
    ints = rays.view(np.uint32)
    n = 0
    for i in order:
        v, u = i // width, i % width
        if not marked[v, u]:
            continue
        u0, u1, v0, v1 = max(u - 1, 0), min(u + 1, width - 1), max(v - 1, 0), min(v + 1, height - 1)
        for s in range(len(offsets)):
            a, b = offsets[s, 0] / (u1 - u0), offsets[s, 1] / (v1 - v0)
            x, y = directions_cam[v, u, 0], directions_cam[v, u, 1]  # z is one
            x += a * (directions_cam[v, u1, 0] - directions_cam[v, u0, 0])
            x += b * (directions_cam[v1, u, 0] - directions_cam[v0, u, 0])
            y += a * (directions_cam[v, u1, 1] - directions_cam[v, u0, 1])
            y += b * (directions_cam[v1, u, 1] - directions_cam[v0, u, 1])
            _set_ray(rays, ints, n, p_world_cam, R_world_cam, x, y, 1.0)
            n += 1


@compiled.kernel
def new_surfaces(rays, numbers, surface, marked, order, per_pixel, source, wanted):
    """Which extra rays show a surface that their pixel has not been shaded for yet: colour is
    filtered over the whole pixel, so once per surface is enough. ``source`` (N): -1 for the pixel's
    own colour, else an index into ``wanted``, the rays to shade; returns how many those are."""
    ints = rays.view(np.uint32)
    width = marked.shape[1]
    n, count = 0, 0
    keys = np.zeros(per_pixel, np.int64)
    for i in order:
        if not marked[i // width, i % width]:
            continue
        for s in range(per_pixel):
            p = ints[n + s, PRIM]
            keys[s] = 0 if p == np.uint32(0xFFFFFFFF) else numbers[p]
            found = -2
            if keys[s] == surface[i // width, i % width]:
                found = -1
            for before in range(s):
                if found == -2 and keys[before] == keys[s]:
                    found = source[n + before]
            if found == -2:
                wanted[count] = n + s
                found = count
                count += 1
            source[n + s] = found
        n += per_pixel
    return count


@compiled.kernel
def average_edges(values, marked, order, extra, source, per_pixel):
    """Marked pixels become the mean of their own sample and of the extra ones."""
    width = marked.shape[1]
    n = 0
    for i in order:
        v, u = i // width, i % width
        if marked[v, u]:
            for k in range(3):
                own = values[v, u, k]
                total = own
                for s in range(per_pixel):
                    total += own if source[n + s] < 0 else extra[source[n + s], k]
                values[v, u, k] = total / (per_pixel + 1)
            n += per_pixel
