# SPDX-License-Identifier: Apache-2.0
"""What stands in streets and gardens: lamp posts, parked cars, fences."""

import numpy as np

from fcsv_sim.world.materials import GLASS, PAINT, WOOD
from fcsv_sim.world.mesh import MeshBuilder, Placement

_CAR_PAINT = np.array(
    [
        [0.5, 0.5, 0.52],
        [0.04, 0.04, 0.05],
        [0.62, 0.62, 0.6],
        [0.32, 0.03, 0.03],
        [0.04, 0.08, 0.24],
        [0.2, 0.22, 0.23],
        [0.05, 0.16, 0.12],
        [0.42, 0.30, 0.05],
    ]
)


def lamp_post(mesh: MeshBuilder, place: Placement, height: float = 6.0) -> None:
    """A post with an arm over the road (local +y)."""
    grey = mesh.instance([0.16, 0.18, 0.17])
    mesh.box(place, [-0.07, -0.07, -1.0], [0.07, 0.07, height], PAINT, grey)
    mesh.box(place, [-0.16, -0.16, -1.0], [0.16, 0.16, 0.5], PAINT, grey)
    mesh.box(place, [-0.04, 0.0, height - 0.1], [0.04, 1.4, height], PAINT, grey)
    mesh.box(
        place,
        [-0.15, 1.0, height - 0.18],
        [0.15, 1.7, height - 0.04],
        PAINT,
        mesh.instance([0.6, 0.6, 0.55]),
    )


def car(mesh: MeshBuilder, place: Placement, random: np.random.Generator) -> None:
    """Four metres of painted sheet with a glazed cabin, along local x."""
    colour = _CAR_PAINT[random.integers(len(_CAR_PAINT))] * random.uniform(0.8, 1.2)
    paint = mesh.instance(colour, random.uniform(0, 999))
    black = mesh.instance([0.015, 0.015, 0.015])
    length, width, high = random.uniform(3.7, 4.6), 0.86, random.uniform(0.85, 1.0)
    x = length / 2
    mesh.box(place, [-x, -width, 0.28], [x, width, high], PAINT, paint)
    for wheel in (-0.62 * x, 0.62 * x):
        mesh.box(
            place,
            [wheel - 0.3, -width - 0.01, 0.0],
            [wheel + 0.3, width + 0.01, 0.58],
            PAINT,
            black,
        )
    a, b, c, d, top = -0.75 * x, -0.5 * x, 0.12 * x, 0.45 * x, high + 0.55
    inner = width - 0.22
    lower = np.array([[a, -width], [d, -width], [d, width], [a, width]])
    upper = np.array([[b, -inner], [c, -inner], [c, inner], [b, inner]])
    sides = [
        [[*lower[i], high], [*lower[j], high], [*upper[j], top], [*upper[i], top]]
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0))
    ]
    mesh.faces(
        place.apply(np.array(sides)),
        GLASS,
        mesh.instance([0.03, 0.04, 0.05], random.uniform(0, 999)),
    )
    mesh.faces(place.apply(np.array([[[*p, top + 0.01] for p in upper]])), PAINT, paint)


def fence(
    mesh: MeshBuilder, ground: np.ndarray, height: float, random: np.random.Generator
) -> None:
    """Planks along a line of ground points (K,3)."""
    wood = mesh.instance(
        np.array([0.28, 0.20, 0.13]) * random.uniform(0.6, 1.6), random.uniform(0, 999)
    )
    up = np.array([0.0, 0.0, height])
    quads = np.stack(
        [ground[:-1] - [0, 0, 0.4], ground[1:] - [0, 0, 0.4], ground[1:] + up, ground[:-1] + up], 1
    )
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ground, axis=0), axis=1))])
    uv = np.stack(
        [
            np.stack([run[:-1], run[1:], run[1:], run[:-1]], -1),
            np.broadcast_to([-0.4, -0.4, height, height], (len(quads), 4)),
        ],
        -1,
    )
    mesh.faces(quads, WOOD, wood, uv)
