# SPDX-License-Identifier: Apache-2.0
"""Houses with pitched roofs and taller blocks, with chimneys, eaves, balconies and roof-top
boxes."""

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_sim.world.materials import CONCRETE, FACADE, GLASS, PAINT, PLAIN_WALL, ROOF
from fcsv_sim.world.mesh import MeshBuilder, Placement

_PLASTER = np.array(
    [
        [0.72, 0.66, 0.52],
        [0.78, 0.75, 0.68],
        [0.66, 0.50, 0.36],
        [0.58, 0.60, 0.58],
        [0.70, 0.58, 0.30],
        [0.55, 0.34, 0.26],
        [0.45, 0.52, 0.56],
        [0.74, 0.70, 0.60],
        [0.50, 0.53, 0.40],
        [0.70, 0.47, 0.38],
    ]
)
_BRICK = np.array([[0.36, 0.15, 0.10], [0.42, 0.22, 0.14], [0.30, 0.13, 0.11], [0.48, 0.34, 0.22]])
_TILES = np.array(
    [
        [0.36, 0.12, 0.07],
        [0.28, 0.11, 0.08],
        [0.42, 0.19, 0.10],
        [0.13, 0.13, 0.15],
        [0.20, 0.14, 0.11],
    ]
)
_TRIM = np.array(
    [
        [0.75, 0.74, 0.70],
        [0.60, 0.58, 0.52],
        [0.25, 0.16, 0.10],
        [0.16, 0.24, 0.20],
        [0.68, 0.66, 0.64],
    ]
)
_UNDER_M = 4.0  # walls reach below the floor, as the ground may fall


@dataclass(frozen=True)
class Body:
    """Outline of a building (m): length along local x, depth along y, height of the eaves,
    storeys."""

    length: float
    depth: float
    floors: int
    floor_m: float

    @property
    def eaves(self) -> float:
        return self.floors * self.floor_m + 0.35


def house(
    mesh: MeshBuilder,
    place: Placement,
    body: Body,
    random: np.random.Generator,
    cover: Optional[Sequence] = None,
) -> None:
    """Walls, a gabled or hipped roof with overhang, a chimney or two. ``cover``: smooth walls, its
    colour above."""
    looks = _Looks(random, cover)
    _walls(mesh, place, body, looks, random)
    roof = mesh.instance(looks.roof, random.uniform(0, 999))
    trim = mesh.instance(looks.trim * 0.8, 0.0)
    turned = random.random() < 0.35
    place_roof = Placement(place.x, place.y, place.z, place.yaw + np.pi / 2) if turned else place
    length, depth = (body.depth, body.length) if turned else (body.length, body.depth)
    rise = depth / 2 * np.tan(np.radians(random.uniform(30.0, 46.0)))
    hip = random.uniform(0.25, 0.5) * depth if random.random() < 0.3 else 0.0
    if not hip:
        wall = mesh.instance(
            looks.wall, random.uniform(0, 999), [1.0, 3.0, 0, 0, 0, 0, looks.brick, -1, *looks.trim]
        )
        gable = [
            [x, y, body.eaves + z]
            for x in (-length / 2, length / 2)
            for y, z in ((-depth / 2, 0.0), (depth / 2, 0.0), (0.0, rise))
        ]
        mesh.faces(place_roof.apply(np.array(gable).reshape(2, 3, 3)), looks.wall_material, wall)
    _pitched_roof(
        mesh, place_roof, (length, depth), body.eaves, rise, hip, roof, trim, looks.roof_material
    )
    for _ in range(random.integers(0, 3)):
        x, y = random.uniform(-0.35, 0.35) * length, random.uniform(-0.2, 0.2) * depth
        top = body.eaves + rise * (1 - abs(y) / depth * 2) + random.uniform(0.6, 1.3)
        brick = mesh.instance(_BRICK[random.integers(4)], random.uniform(0, 999))
        mesh.box(
            place_roof,
            [x - 0.3, y - 0.3, body.eaves],
            [x + 0.3, y + 0.3, top],
            CONCRETE,
            brick,
            range(5),
        )
    if not looks.plain:
        _skylights(mesh, place_roof, (length, depth), body.eaves, rise, random)


def block(
    mesh: MeshBuilder,
    place: Placement,
    body: Body,
    random: np.random.Generator,
    cover: Optional[Sequence] = None,
) -> None:
    """A taller building with a flat roof: parapet, lift house, balconies on some; ``cover`` as of a
    house."""
    looks = _Looks(random, cover)
    _walls(mesh, place, body, looks, random)
    half = np.array([body.length / 2, body.depth / 2])
    concrete = mesh.instance(np.full(3, random.uniform(0.2, 0.45)), random.uniform(0, 999))
    trim = mesh.instance(looks.trim, random.uniform(0, 999))
    mesh.box(place, [*-half, body.eaves - 0.3], [*half, body.eaves], CONCRETE, concrete, [4])
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        low, high = -half - 0.12, half + 0.12
        if sign < 0:
            high[axis] = low[axis] + 0.35
        else:
            low[axis] = high[axis] - 0.35
        mesh.box(place, [*low, body.eaves - 0.25], [*high, body.eaves + 0.6], CONCRETE, trim)
    for _ in range(random.integers(1, 4)):
        corner = random.uniform(-0.6, 0.4, 2) * half
        size = random.uniform(1.5, 4.0, 2)
        mesh.box(
            place,
            [*corner, body.eaves],
            [*(corner + size), body.eaves + random.uniform(1.2, 3.2)],
            CONCRETE,
            concrete,
            range(5),
        )
    if random.random() < 0.5:
        _balconies(mesh, place, body, trim, random)


def hall(
    mesh: MeshBuilder, place: Placement, length: float, depth: float, height: float, colour
) -> None:
    """A windowless building: the low-texture wall."""
    wall = mesh.instance(colour, 7.0)
    mesh.box(
        place,
        [-length / 2, -depth / 2, -_UNDER_M],
        [length / 2, depth / 2, height],
        PLAIN_WALL,
        wall,
        range(4),
    )
    mesh.box(
        place,
        [-length / 2, -depth / 2, height - 0.2],
        [length / 2, depth / 2, height],
        CONCRETE,
        wall,
        [4],
    )


class _Looks:
    """Colours and materials of one building."""

    def __init__(self, random: np.random.Generator, cover: Optional[Sequence] = None):
        self.brick = float(random.random() < 0.35)
        palette = _BRICK if self.brick else _PLASTER
        self.wall = (
            palette[random.integers(len(palette))]
            * random.uniform(0.75, 1.1)
            * random.uniform(0.94, 1.06, 3)
        )
        self.roof = _TILES[random.integers(len(_TILES))] * random.uniform(0.8, 1.25)
        self.trim = _TRIM[random.integers(len(_TRIM))]
        self.plain = cover is not None
        self.wall_material, self.roof_material = (
            (PLAIN_WALL, PLAIN_WALL) if self.plain else (FACADE, ROOF)
        )
        if cover is not None:
            self.brick, self.roof = 0.0, np.asarray(cover) * random.uniform(0.9, 1.05)


def _walls(mesh, place, body: Body, looks: _Looks, random) -> None:
    """Four walls, each with a window grid of its own that fits its width."""
    x, y = body.length / 2, body.depth / 2
    window = [random.uniform(0.95, 1.5), random.uniform(1.15, 1.65), random.uniform(0.75, 1.0)]
    spacing = random.uniform(2.5, 3.6)
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]])
    blank = random.integers(0, 4) if random.random() < 0.3 else -1
    for i in range(4):
        a, b = corners[i], corners[i + 1]
        width = float(np.linalg.norm(b - a))
        bays = max(1, int(width / spacing))
        floors = 0 if i == blank else body.floors
        door = random.integers(0, bays) if random.random() < 0.6 else -1
        row = [width / bays, body.floor_m, *window, floors, looks.brick, door, *looks.trim, bays]
        wall = mesh.instance(looks.wall, random.uniform(0, 999), row)
        quad = np.array([[*a, -_UNDER_M], [*b, -_UNDER_M], [*b, body.eaves], [*a, body.eaves]])
        uv = [[0, -_UNDER_M], [width, -_UNDER_M], [width, body.eaves], [0, body.eaves]]
        material = PLAIN_WALL if looks.plain and random.random() < 0.75 else FACADE
        mesh.faces(place.apply(quad[None]), material, wall, np.array(uv)[None])


def _pitched_roof(mesh, place, size, eaves, rise, hip, roof, trim, material=ROOF) -> None:
    length, depth = size
    over = 0.45
    slope = rise / (depth / 2)
    x, y, low, top = (
        length / 2 + over * 0.7,
        depth / 2 + over,
        eaves - over * slope + 0.12,
        eaves + rise + 0.12,
    )
    ridge = x - hip
    sides, ends = [], []
    for sign in (-1, 1):
        sides.append([[-x, sign * y, low], [x, sign * y, low], [ridge, 0, top], [-ridge, 0, top]])
        ends.append([[sign * x, -y, low], [sign * x, y, low], [sign * ridge, 0, top]])
    mesh.faces(place.apply(np.array(sides, float)), material, roof)
    thick = np.array([0, 0, -0.18])
    fascia = [[q[0], q[1], np.add(q[1], thick), np.add(q[0], thick)] for q in sides]
    if hip:
        mesh.faces(place.apply(np.array(ends, float)), material, roof)
        fascia += [[q[0], q[1], np.add(q[1], thick), np.add(q[0], thick)] for q in ends]
    else:
        for q in ends:
            fascia += [
                [q[0], q[2], np.add(q[2], thick), np.add(q[0], thick)],
                [q[1], q[2], np.add(q[2], thick), np.add(q[1], thick)],
            ]
    mesh.faces(place.apply(np.array(fascia, float)), PAINT, trim)


def _skylights(mesh, place, size, eaves, rise, random) -> None:
    length, depth = size
    count = int(random.integers(0, 3))
    for _ in range(count):
        sign = random.choice([-1.0, 1.0])
        x, f = random.uniform(-0.3, 0.3) * length, random.uniform(0.3, 0.5)
        along = np.array([0.0, -sign * depth / 2, rise]) / np.hypot(depth / 2, rise)
        out = np.array([0.0, sign * rise, depth / 2]) / np.hypot(depth / 2, rise)
        p = np.array([x, sign * depth / 2 * (1 - f), eaves + rise * f + 0.12]) + 0.06 * out
        quad = [
            p + [-0.4, 0, 0] - 0.6 * along,
            p + [0.4, 0, 0] - 0.6 * along,
            p + [0.4, 0, 0] + 0.6 * along,
            p + [-0.4, 0, 0] + 0.6 * along,
        ]
        mesh.faces(
            place.apply(np.array([quad])),
            GLASS,
            mesh.instance([0.05, 0.06, 0.08], random.uniform(0, 999)),
        )


def _balconies(mesh, place, body: Body, trim: int, random) -> None:
    """Slabs with a parapet on the two long walls, one column in two."""
    columns = max(1, int(body.length / 6.0))
    for side in (-1, 1):
        for x in (np.arange(columns) + 0.5) / columns * body.length - body.length / 2:
            for floor in range(1, body.floors):
                z, y = floor * body.floor_m + 0.1, side * body.depth / 2
                low, high = sorted((y, y + side * 1.2))
                mesh.box(place, [x - 1.4, low, z], [x + 1.4, high, z + 0.16], CONCRETE, trim)
                edge = sorted((y + side * 1.12, y + side * 1.2))
                mesh.box(
                    place,
                    [x - 1.4, edge[0], z],
                    [x + 1.4, edge[1], z + 0.95],
                    CONCRETE,
                    trim,
                    range(5),
                )


def church(mesh: MeshBuilder, place: Placement, random: np.random.Generator) -> None:
    """A nave and a tower with a spire: what shows above the roofs of a village."""
    house(mesh, place, Body(22.0, 9.5, 2, 3.6), random)
    looks = _Looks(random)
    tower = Placement(*(place.apply(np.array([-13.2, 0.0, 0.0]))), place.yaw)
    body = Body(5.6, 5.6, 5, 3.7)
    _walls(mesh, tower, body, looks, random)
    roof = mesh.instance(looks.roof, random.uniform(0, 999))
    trim = mesh.instance(looks.trim * 0.8, 0.0)
    _pitched_roof(
        mesh, tower, (body.length, body.depth), body.eaves, 10.5, body.length / 2 + 0.3, roof, trim
    )
