# SPDX-License-Identifier: Apache-2.0
"""Trees, bushes and hedges out of irregular blobs; near ones have more of them and loose leaves on
top."""

from functools import lru_cache
from typing import Tuple

import numpy as np

from fcsv_sim.world.materials import BARK, FOLIAGE
from fcsv_sim.world.mesh import MeshBuilder

_GREENS = np.array(
    [
        [0.075, 0.13, 0.03],
        [0.10, 0.15, 0.035],
        [0.055, 0.10, 0.03],
        [0.13, 0.15, 0.04],
        [0.16, 0.12, 0.04],
    ]
)


@lru_cache(maxsize=4)
def icosphere(level: int) -> Tuple[np.ndarray, np.ndarray]:
    """Unit vertices (V,3) and triangles (F,3): 20 * 4**level of them."""
    g = (1 + 5**0.5) / 2
    v = np.array(
        [
            [-1, g, 0],
            [1, g, 0],
            [-1, -g, 0],
            [1, -g, 0],
            [0, -1, g],
            [0, 1, g],
            [0, -1, -g],
            [0, 1, -g],
            [g, 0, -1],
            [g, 0, 1],
            [-g, 0, -1],
            [-g, 0, 1],
        ],
        float,
    )
    f = np.array(
        [
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ]
    )
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(level):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = v[unique].sum(1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        a, b, c = index.reshape(3, -1) + len(v)
        f = np.concatenate(
            [np.stack(t, 1) for t in ((f[:, 0], a, c), (f[:, 1], b, a), (f[:, 2], c, b), (a, b, c))]
        )
        v = np.concatenate([v, middle])
    return v, f


def trees(
    mesh: MeshBuilder,
    base: np.ndarray,
    height: np.ndarray,
    random,
    blobs: int,
    level: int,
    leaves: int = 0,
) -> None:
    """Trees at ``base`` (K,3), ``height`` (K) m: ``blobs`` spheres of 20*4**level faces, ``leaves``
    loose triangles."""
    if len(base) == 0:
        return
    count = len(base)
    crown = height * random.uniform(0.30, 0.42, count)  # half height of the crown
    width = crown * random.uniform(0.55, 0.95, count)
    centre = base + np.stack([np.zeros(count), np.zeros(count), height - crown], -1)
    rows = np.zeros((count, 8))
    rows[:, :3] = _GREENS[random.integers(0, len(_GREENS), count)] * random.uniform(
        0.75, 1.35, (count, 1)
    )
    rows[:, 3] = random.uniform(0, 999, count)
    rows[:, 4:7], rows[:, 7] = centre, np.maximum(crown, width)
    instance = mesh.instances(rows)
    at = _within_ball(random, (count, blobs)) * 0.72
    size = random.uniform(0.34, 0.56, (count, blobs)) * (1.15 if blobs < 6 else 1.0)
    scale = np.stack([width, width, crown], -1)[:, None]
    middle = centre[:, None] + at * scale
    radius = size[..., None] * scale
    _blobs(mesh, middle, radius, instance, level, random)
    if leaves:
        _leaves(mesh, middle, radius, instance, leaves, random)
    _trunks(mesh, base, centre, height, random)


def bushes(
    mesh: MeshBuilder, middle: np.ndarray, radius: np.ndarray, random, level: int = 1
) -> None:
    """Single blobs (K,3) of radii (K,3): bushes, and hedges when lined up."""
    if len(middle) == 0:
        return
    rows = np.zeros((len(middle), 8))
    rows[:, :3] = _GREENS[random.integers(0, 3, len(middle))] * random.uniform(
        0.7, 1.2, (len(middle), 1)
    )
    rows[:, 3] = random.uniform(0, 999, len(middle))
    rows[:, 4:7], rows[:, 7] = middle - [0, 0, 0.5], radius.max(1)
    _blobs(mesh, middle[:, None], radius[:, None], mesh.instances(rows), level, random)


def _blobs(mesh, middle, radius, instance, level, random) -> None:
    """middle, radius (K, B, 3); every vertex is pushed in or out so that no outline is round."""
    vertices, faces = icosphere(level)
    shape = (*middle.shape[:2], len(vertices), 1)
    push = random.uniform(0.74, 1.26, shape)
    points = middle[:, :, None] + vertices * radius[:, :, None] * push
    mesh.copies(
        points.reshape(-1, len(vertices), 3), faces, FOLIAGE, np.repeat(instance, middle.shape[1])
    )


def _leaves(mesh, middle, radius, instance, leaves, random) -> None:
    """Loose triangles around the blobs: twigs against the sky."""
    count, blobs = middle.shape[:2]
    which = random.integers(0, blobs, (count, leaves))
    rows = np.arange(count)[:, None]
    out = random.standard_normal((count, leaves, 3))
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    p = middle[rows, which] + out * radius[rows, which] * random.uniform(
        0.9, 1.28, (count, leaves, 1)
    )
    size = random.uniform(0.14, 0.34, (count, leaves, 1, 1))
    corners = p[:, :, None] + random.standard_normal((count, leaves, 3, 3)) * size * 0.6
    corners = corners.reshape(-1, 3, 3)
    mesh.faces(corners, FOLIAGE, np.repeat(instance, leaves), np.zeros((len(corners), 3, 2)))


def _trunks(mesh, base, centre, height, random) -> None:
    """Five-sided, tapering, from under the ground into the crown."""
    angle = np.arange(5) * 2 * np.pi / 5
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(5)], -1)
    thick = (0.018 * height + 0.06)[:, None, None]
    low = base[:, None] + ring * thick * 1.2 - [0, 0, 0.5]
    high = centre[:, None] + ring * thick * 0.5
    quads = np.stack([low, np.roll(low, -1, 1), np.roll(high, -1, 1), high], 2).reshape(-1, 4, 3)
    shade = random.uniform(0.7, 1.2, (len(base), 1)) * [[0.11, 0.08, 0.055]]
    bark = mesh.instances(np.concatenate([shade, random.uniform(0, 999, (len(base), 1))], 1))
    mesh.faces(quads, BARK, np.repeat(bark, 5))


def _within_ball(random, shape) -> np.ndarray:
    p = random.standard_normal((*shape, 3))
    p /= np.linalg.norm(p, axis=-1, keepdims=True)
    return p * random.uniform(0.25, 1.0, (*shape, 1)) ** (1 / 2)
