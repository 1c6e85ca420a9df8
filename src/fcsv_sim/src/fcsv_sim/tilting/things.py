# SPDX-License-Identifier: Apache-2.0
"""Thin things as meshes, about the origin of a place: x away from the viewer, y left, z up (m)."""

from typing import Callable, Dict

import numpy as np

from fcsv_sim.world.materials import BARK, CONCRETE, FOLIAGE, PAINT
from fcsv_sim.world.mesh import MeshBuilder

Thing = Callable[[MeshBuilder, np.ndarray], None]
_SIDES = 12


def tube(
    mesh: MeshBuilder, points: np.ndarray, radii: np.ndarray, material: int, instance: int
) -> None:
    """A round bar along points (K,3) with radii (K) (m); texture in metres around and along."""
    points, radii = (
        np.asarray(points, float),
        np.broadcast_to(np.asarray(radii, float), (len(points),)),
    )
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(along).max(axis=0))]
    across = np.cross(along, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(along, across)
    angle = np.arange(_SIDES + 1) * 2.0 * np.pi / _SIDES
    ring = np.cos(angle)[:, None, None] * across + np.sin(angle)[:, None, None] * third
    rings = points + ring * radii[:, None]  # (sides + 1, K, 3)
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    u = np.broadcast_to(angle[:, None] * float(radii.mean()), rings.shape[:2])
    uv = np.stack([u, np.broadcast_to(run, rings.shape[:2])], axis=-1)

    def quads(a: np.ndarray) -> np.ndarray:
        return np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, 1:]], axis=2).reshape(
            -1, 4, a.shape[-1]
        )

    mesh.faces(quads(rings), material, instance, quads(uv))


def power_lines(mesh: MeshBuilder, at: np.ndarray) -> None:
    """Three conductors of 22 mm, 0.3 m apart. They rise steeply: the rig is rolled so that its
    baseline crosses them, since a line along the baseline has no disparity."""
    rises = np.array([0.06, np.sin(np.radians(20.0)), np.cos(np.radians(20.0))])
    for k, aside_m in enumerate((-0.3, 0.0, 0.3)):
        t = np.linspace(-6.0, 6.0, 25)
        line = at + t[:, None] * rises + [0.08 * k, aside_m, 0.0]
        tube(mesh, line, 0.011, CONCRETE, mesh.instance([0.42, 0.43, 0.45], 40.0 + 9.0 * k))


def valve(mesh: MeshBuilder, at: np.ndarray) -> None:
    """A handwheel of 0.25 m with a rim of 20 mm and five spokes of 13 mm, on a pipe half a metre
    before a wall."""
    red, grey = mesh.instance([0.45, 0.05, 0.04], 11.0), mesh.instance([0.30, 0.31, 0.33], 23.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    rim = np.stack([0.0 * angle, 0.115 * np.cos(angle), 0.115 * np.sin(angle)], axis=-1)
    tube(mesh, at + rim, 0.010, CONCRETE, red)
    for k in range(5):
        a = 0.4 + 2.0 * np.pi * k / 5.0
        r = np.linspace(0.02, 0.11, 6)
        spoke = np.stack([0.02 - 0.18 * r, r * np.cos(a), r * np.sin(a)], axis=-1)
        tube(mesh, at + spoke, 0.0065, CONCRETE, red)
    tube(mesh, at + [[-0.01, 0.0, 0.0], [0.03, 0.0, 0.0]], 0.024, PAINT, grey)
    tube(mesh, at + [[0.03, 0.0, 0.0], [0.20, 0.0, 0.0]], 0.012, CONCRETE, grey)
    z = np.linspace(-1.4, 2.5, 14)
    tube(mesh, at + np.stack([np.full(14, 0.20), 0.0 * z, z], axis=-1), 0.045, CONCRETE, grey)


def wall(mesh: MeshBuilder, at: np.ndarray) -> None:
    """Behind the valve: rough concrete, 12 by 9 m."""
    low, high = at + [0.5, -6.0, -1.5], at + [0.5, 6.0, 7.5]
    corners = np.array(
        [
            [low[0], low[1], low[2]],
            [low[0], high[1], low[2]],
            [low[0], high[1], high[2]],
            [low[0], low[1], high[2]],
        ]
    )
    mesh.faces(corners[None], CONCRETE, mesh.instance([0.34, 0.33, 0.31], 5.0))


def branch(mesh: MeshBuilder, at: np.ndarray) -> None:
    """A limb of 36 mm that tapers to 12 mm, twigs of 12 to 4 mm on it, some leaves; the same on
    every machine."""
    random = np.random.default_rng(725)
    bark = mesh.instance([0.16, 0.12, 0.085], 71.0)
    t = np.linspace(-1.6, 1.6, 33)
    limb = np.stack([0.05 * np.sin(2.1 * t), 0.62 * t, 0.78 * t + 0.05 * np.sin(3.3 * t)], axis=-1)
    tube(mesh, at + limb, np.interp(t, [-1.6, 1.6], [0.018, 0.006]), BARK, bark)
    leaves = []
    for start in limb[3:-2]:
        out = random.normal(0.0, 1.0, 3) * [0.5, 1.0, 1.0] + [0.0, 0.4, 0.5]
        out /= np.linalg.norm(out)
        s = np.linspace(0.0, random.uniform(0.25, 0.6), 9)[:, None]
        twig = start + s * out + s**2 * random.normal(0.0, 0.5, 3)
        tube(mesh, at + twig, np.linspace(0.006, 0.002, 9), BARK, bark)
        tips = twig[random.integers(4, 9, 3)]
        leaves += list(tips[:, None] + random.normal(0.0, 0.018, (3, 3, 3)))
    green = mesh.instance([0.13, 0.19, 0.05], 3.0, [*at, 2.0])
    mesh.faces(at + np.array(leaves), FOLIAGE, green, np.zeros((len(leaves), 3, 2)))


#: What the rig looks at, by name; the wall stands behind the valve and is none of it.
THINGS: Dict[str, Thing] = {"lines": power_lines, "valve": valve, "branch": branch}
BEHIND: Dict[str, Thing] = {"valve": wall}
