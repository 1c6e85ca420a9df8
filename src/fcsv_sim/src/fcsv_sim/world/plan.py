# SPDX-License-Identifier: Apache-2.0
"""Where streets run, how the ground rises, and where parcels lie.

Streets are straight in plan coordinates (s, t) = (x, y - bend(x)): the bend lets them swing gently.
"""

from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

ROAD_HALF_M = 3.1
PAVEMENT_M = 1.9
FAR_M = 470.0  # the town ends and hills begin
HILLS_END_M = 640.0


@dataclass(frozen=True)
class Plot:
    """A plot: middle and size in plan coordinates (m); its street lies towards ``front`` (-1 or +1)
    in t."""

    s: float
    t: float
    length_m: float
    depth_m: float
    front: int


@dataclass(frozen=True)
class Cover:
    """What lies on the ground (linear rgb) and how much of it hides what is below (0..1): snow,
    sand."""

    colour: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    share: float = 0.0


@dataclass(frozen=True)
class TownPlan:
    """Streets along s at ``avenues_t``, across at ``crossings_s`` (m), bend and ground of one seed.

    ``farmland``: away from streets the ground is a patchwork of crops.
    """

    avenues_t: np.ndarray
    crossings_s: np.ndarray
    bend_phase: np.ndarray
    ground_phase: np.ndarray
    cover: Cover = Cover()
    farmland: bool = False

    @classmethod
    def draw(cls, random: np.random.Generator) -> "TownPlan":
        main = random.choice([-1.0, 1.0]) * random.uniform(3.0, 7.0)
        right = main - np.cumsum(random.uniform(46.0, 58.0, 6))
        left = main + np.cumsum(random.uniform(46.0, 58.0, 6))
        crossings = 24.5 + np.concatenate([[0.0], np.cumsum(random.uniform(58.0, 84.0, 8))])
        return cls(
            np.sort(np.concatenate([right, [main], left])),
            crossings[crossings < FAR_M],
            random.uniform(0.0, 2 * np.pi, 2),
            random.uniform(0.0, 2 * np.pi, 6),
        )

    def bend(self, s):
        """Sideways shift (m) of everything at s: none at the vehicles, some metres in the town."""
        rise = np.clip((np.asarray(s, float) - 20.0) / 60.0, 0.0, 1.0) ** 2
        a, b = self.bend_phase
        return rise * (5.5 * np.sin(s / 83.0 + a) + 1.6 * np.sin(s / 31.0 + b))

    def heading(self, s: float) -> float:
        """Direction (rad) of the avenues at s."""
        return float(np.arctan(self.bend(s + 0.5) - self.bend(s - 0.5)))

    def height(self, x, y):
        """Ground (m): flat field, then rising like a theatre so that far things show above near
        ones."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        p = self.ground_phase
        far = np.clip((x - 55.0) / 400.0, 0.0, None)
        waves = np.sin(x / 47.0 + p[0]) * np.sin(y / 61.0 + p[1]) + 0.6 * np.sin(
            x / 23.0 + y / 29.0 + p[2]
        )
        hill = np.clip((x - FAR_M - 12.0 * np.sin(y / 70.0 + p[3])) / 150.0, 0.0, 1.0)
        crest = 42.0 + 15.0 * np.sin(y / 95.0 + p[4]) + 7.0 * np.sin(y / 33.0 + p[5])
        return (
            72.0 * far**1.12
            + 1.3 * waves * np.clip(far * 6, 0.0, 1.0)
            + crest * hill**2 * (3.0 - 2.0 * hill)
        )

    def world(self, s: float, t: float):
        """x, y, z (m) on the ground of a place in the plan."""
        y = t + float(self.bend(s))
        return s, y, float(self.height(s, y))

    def half_width(self, s):
        """How far sideways (m) the town is built at s: it widens with the view."""
        return np.minimum(300.0, 64.0 + 0.72 * np.asarray(s, float))

    def parcels(self, random: np.random.Generator) -> List[Plot]:
        """Plots along both sides of every avenue, between the crossings."""
        parcels = []
        edge = ROAD_HALF_M + PAVEMENT_M
        ends = np.concatenate([self.crossings_s, [FAR_M + 2 * edge]])
        for i, avenue in enumerate(self.avenues_t):
            for front, j in ((-1, i + 1), (1, i - 1)):
                if not 0 <= j < len(self.avenues_t):
                    continue
                depth = abs(self.avenues_t[j] - avenue) / 2 - edge
                for s0, s1 in zip(ends[:-1] + edge, ends[1:] - edge):
                    count = max(1, int(round((s1 - s0) / random.uniform(14.0, 21.0))))
                    cuts = np.linspace(s0, s1, count + 1)
                    cuts[1:-1] += random.uniform(-1.5, 1.5, count - 1)
                    t = avenue - front * (edge + depth / 2)
                    for a, b in zip(cuts[:-1], cuts[1:]):
                        if abs(t) < self.half_width(b):
                            parcels.append(Plot((a + b) / 2, t, b - a, depth, front))
        return parcels
