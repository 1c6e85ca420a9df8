# SPDX-License-Identifier: Apache-2.0
"""The lie of the land outside towns: rolling ground, few lanes; and what stands about there."""

from typing import Sequence

import numpy as np

from fcsv_sim.world.materials import PAINT, WOOD
from fcsv_sim.world.mesh import MeshBuilder, Placement
from fcsv_sim.world.plan import FAR_M, PAVEMENT_M, ROAD_HALF_M, TownPlan

_VERGE_M = ROAD_HALF_M + PAVEMENT_M


class CountryPlan(TownPlan):
    """Lanes swing more than streets and the ground rolls; it still rises, so that far things show
    above near ones."""

    @classmethod
    def of(
        cls, random: np.random.Generator, avenues_t: Sequence[float], crossings_s: Sequence[float]
    ) -> "CountryPlan":
        """A plan with these lanes, farmland around them."""
        phases = random.uniform(0.0, 2 * np.pi, 2), random.uniform(0.0, 2 * np.pi, 6)
        return cls(
            np.sort(np.array(avenues_t, float)),
            np.sort(np.array(crossings_s, float)),
            *phases,
            farmland=True,
        )

    def bend(self, s):
        """Sideways shift (m) of everything at s: none at the vehicles."""
        s = np.asarray(s, float)
        a, b = self.bend_phase
        rise = np.clip((s - 20.0) / 90.0, 0.0, 1.0) ** 2
        return rise * (13.0 * np.sin(s / 96.0 + a) + 3.0 * np.sin(s / 37.0 + b))

    def height(self, x, y):
        """Ground (m): flat field, then swells that grow, then hills."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        p = self.ground_phase
        far = np.clip((x - 50.0) / 400.0, 0.0, None)
        swell = np.sin(x / 71.0 + p[0]) * np.sin(y / 83.0 + p[1]) + 0.5 * np.sin(
            x / 37.0 - y / 45.0 + p[2]
        )
        hill = np.clip((x - FAR_M - 15.0 * np.sin(y / 80.0 + p[3])) / 150.0, 0.0, 1.0)
        crest = 46.0 + 18.0 * np.sin(y / 105.0 + p[4]) + 6.0 * np.sin(y / 39.0 + p[5])
        return (
            74.0 * far**1.12
            + 3.6 * swell * np.clip(far * 5, 0.0, 1.0)
            + crest * hill**2 * (3.0 - 2.0 * hill)
        )

    def from_lane_m(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Distance (m) of places to the verge of the nearest lane; negative on it."""
        s, t = np.asarray(s, float)[..., None], np.asarray(t, float)[..., None]
        first = self.crossings_s[0] if len(self.crossings_s) else np.inf
        lanes = [np.full(s.shape[:-1], 1e3)]
        if len(self.crossings_s):
            along = np.abs(t - self.avenues_t).min(-1) if len(self.avenues_t) else lanes[0]
            lanes += [np.where(s[..., 0] > first, along, 1e3), np.abs(s - self.crossings_s).min(-1)]
        return np.min(lanes, axis=0) - _VERGE_M


def apart(random, candidates: np.ndarray, distance_m: float, most: int) -> np.ndarray:
    """Up to ``most`` of candidates (K,2), in their order, no two nearer than a distance."""
    kept = np.zeros((0, 2))
    for p in candidates:
        if len(kept) == most:
            break
        if not len(kept) or np.hypot(*(kept - p).T).min() > distance_m:
            kept = np.vstack([kept, p])
    return kept


def power_line(mesh: MeshBuilder, plan: TownPlan, s: np.ndarray, t: np.ndarray) -> None:
    """Wooden poles with a cross-arm and insulators at plan places (K)."""
    for a, b in zip(s, t):
        x, y, z = plan.world(float(a), float(b))
        place = Placement(x, y, z, 0.0)
        wood = mesh.instance([0.12, 0.09, 0.06], float(a))
        mesh.box(place, [-0.14, -0.14, -1.0], [0.14, 0.14, 9.5], WOOD, wood)
        mesh.box(place, [-0.08, -1.3, 8.7], [0.08, 1.3, 8.95], WOOD, wood)
        glass = mesh.instance([0.45, 0.45, 0.42])
        for offset in (-1.2, 0.0, 1.2):
            mesh.box(place, [-0.07, offset - 0.07, 8.95], [0.07, offset + 0.07, 9.3], PAINT, glass)


def bales(mesh: MeshBuilder, plan: TownPlan, spots: np.ndarray, random) -> None:
    """Round bales of straw (12-sided, 1.5 m) lying on plan places (K,2)."""
    angle = np.arange(12) * np.pi / 6
    ring = np.stack([np.zeros(12), 0.75 * np.cos(angle), 0.75 + 0.75 * np.sin(angle)], -1)
    for s, t in spots:
        x, y, z = plan.world(float(s), float(t))
        place = Placement(x, y, z - 0.04, random.uniform(0.0, np.pi))
        straw = mesh.instance(
            np.array([0.42, 0.34, 0.16]) * random.uniform(0.8, 1.15), random.uniform(0, 999)
        )
        a, b = ring + [-0.62, 0, 0], ring + [0.62, 0, 0]
        around = np.stack([a, np.roll(a, -1, 0), np.roll(b, -1, 0), b], 1)
        mesh.faces(place.apply(around), WOOD, straw)
        for side in (a, b):
            middle = np.broadcast_to(side.mean(0), side.shape)
            mesh.faces(place.apply(np.stack([side, np.roll(side, -1, 0), middle], 1)), WOOD, straw)


def pasture_fence(mesh: MeshBuilder, plan: TownPlan, s: np.ndarray, t: np.ndarray) -> None:
    """Posts at plan places (K) and two rails between them."""
    wood = mesh.instance([0.24, 0.19, 0.14], 3.0)
    points = np.array([plan.world(float(a), float(b)) for a, b in zip(s, t)])
    for p in points:
        mesh.box(Placement(*p), [-0.07, -0.07, -0.4], [0.07, 0.07, 1.25], WOOD, wood)
    for low in (0.55, 1.0):
        a, b = points[:-1] + [0, 0, low], points[1:] + [0, 0, low]
        mesh.faces(np.stack([a, b, b + [0, 0, 0.14], a + [0, 0, 0.14]], 1), WOOD, wood)
