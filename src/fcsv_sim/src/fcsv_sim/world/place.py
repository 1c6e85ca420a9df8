# SPDX-License-Identifier: Apache-2.0
"""Places that a robot on the ground drives through: solids on a height field, a start and a
goal."""

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from fcsv_sim.world import land
from fcsv_sim.world.mesh import MeshBuilder
from fcsv_sim.world.plan import TownPlan

_FINE_M = 0.2  # spacing of the drawn ground's nodes inside of the area
_BOX = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
_QUADS = np.array(
    [[0, 2, 6, 4], [3, 1, 5, 7], [1, 0, 4, 5], [2, 3, 7, 6], [4, 5, 7, 6], [1, 0, 2, 3]]
)


@dataclass(frozen=True)
class Solid:
    """A box: ``middle_m`` (3,) and half sizes (3,) in m, ``R_world_solid`` (3,3), material and
    linear rgb."""

    middle_m: np.ndarray
    half_m: np.ndarray
    R_world_solid: np.ndarray
    material: int
    colour: Tuple[float, float, float]

    @property
    def corners_m(self) -> np.ndarray:
        """(8,3) in the world."""
        return (_BOX * self.half_m) @ self.R_world_solid.T + self.middle_m

    def draw(self, mesh: MeshBuilder, random: np.random.Generator) -> None:
        """Adds its six faces."""
        mesh.faces(
            self.corners_m[_QUADS],
            self.material,
            mesh.instance(self.colour, random.uniform(0, 999)),
        )

    def span_m(self, x_m: np.ndarray, y_m: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Lowest and highest z (m) on vertical lines at x, y; inf and -inf where a line passes
        by."""
        apart = np.stack(
            [x_m - self.middle_m[0], y_m - self.middle_m[1], np.full_like(x_m, -self.middle_m[2])],
            -1,
        )
        at, along = apart @ self.R_world_solid, self.R_world_solid[2]
        low, high = np.full(x_m.shape, -np.inf), np.full(x_m.shape, np.inf)
        for k in range(3):
            if abs(along[k]) < 1e-9:
                beside = np.abs(at[..., k]) > self.half_m[k]
                low, high = np.where(beside, np.inf, low), np.where(beside, -np.inf, high)
            else:
                a, b = ((side * self.half_m[k] - at[..., k]) / along[k] for side in (-1, 1))
                low, high = np.maximum(low, np.minimum(a, b)), np.minimum(high, np.maximum(a, b))
        beside = low > high
        return np.where(beside, np.inf, low), np.where(beside, -np.inf, high)


@dataclass(frozen=True)
class PlacePlan(TownPlan):
    """A plan without streets: ``area_m`` (x0, x1, y0, y1) is what a robot may drive in, with
    ``solids`` in it; it starts at ``start_m`` (x, y) and shall come to ``goal_m``."""

    area_m: Tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0)
    start_m: Tuple[float, float] = (0.0, 0.0)
    goal_m: Tuple[float, float] = (0.0, 0.0)
    solids: Tuple[Solid, ...] = ()

    @property
    def ground_axes_m(self) -> Tuple[np.ndarray, np.ndarray]:
        """x (N) and y (M) of the drawn ground's nodes: fine inside of the area."""
        x0, x1, y0, y1 = self.area_m
        coarse_x, coarse_y = land.ground_axes_m()
        return _refined(coarse_x, x0, x1), _refined(coarse_y, y0, y1)

    def drawn_height(self, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Height (m) of the ground as drawn, between its nodes."""
        xs, ys = self.ground_axes_m
        z = self.height(*np.meshgrid(xs, ys, indexing="ij"))
        i = np.clip(np.searchsorted(xs, x_m) - 1, 0, len(xs) - 2)
        j = np.clip(np.searchsorted(ys, y_m) - 1, 0, len(ys) - 2)
        a, b = (x_m - xs[i]) / (xs[i + 1] - xs[i]), (y_m - ys[j]) / (ys[j + 1] - ys[j])
        return (z[i, j] * (1 - a) + z[i + 1, j] * a) * (1 - b) + (
            z[i, j + 1] * (1 - a) + z[i + 1, j + 1] * a
        ) * b


def draw_place(mesh: MeshBuilder, plan: PlacePlan, random: np.random.Generator) -> PlacePlan:
    """The ground, the solids, and trees and hills far behind; the plan back."""
    land.ground(mesh, plan, plan.ground_axes_m)
    for solid in plan.solids:
        solid.draw(mesh, random)
    far = np.column_stack(
        [random.uniform(plan.area_m[1] + 45.0, 420.0, 220), random.uniform(-1, 1, 220)]
    )
    far[:, 1] *= plan.half_width(far[:, 0])
    land.plant(mesh, plan, far, random)
    land.hills(mesh, plan, random)
    return plan


def _refined(coarse: np.ndarray, low: float, high: float) -> np.ndarray:
    fine = np.arange(low - 1.0, high + 1.0 + 1e-6, _FINE_M)
    return np.concatenate([coarse[coarse < low - 1.5], fine, coarse[coarse > high + 1.5]])
