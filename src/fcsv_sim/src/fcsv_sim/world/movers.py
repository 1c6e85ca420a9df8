# SPDX-License-Identifier: Apache-2.0
"""What moves in a town: a car that drives along the first crossing street, and a walker at its
kerb."""

import math
from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.bodies import BoxedThing
from fcsv_sim.world.plan import TownPlan

_PANEL_M = 0.45  # of a car's livery
#: Things of a place that a robot drives through, by the name under which their truth is shared.
ROBOT, CRATE = "robot", "crate"
CRATE_HALF_M = (0.3, 1.0, 0.55)
ROBOT_HALF_M = (0.27, 0.25, 0.35)
_COLOURS = ((0.75, 0.75, 0.72), (0.45, 0.04, 0.03), (0.05, 0.10, 0.30), (0.30, 0.28, 0.05))
_FROM_MIDDLE_M = {"car": -0.4, "walker": -2.6}  # of the crossing street, towards the vehicles


@dataclass(frozen=True)
class Mover:
    """Boxes (K, 11), as bodies have them, that go to and fro along y at one speed and turn around
    at the ends."""

    name: str
    boxes: np.ndarray
    x_m: float
    z_m: float
    reach_m: Tuple[float, float]  # from y to y
    speed_mps: float
    phase_s: float = 0.0

    @property
    def radius_m(self) -> float:
        """Gives the radius of a ball about its origin that holds it."""
        return ball_radius_m(self.boxes)

    def y_m(self, stamp_s: float) -> Tuple[float, float]:
        """Where it is along y, and which way (-1 or 1) it goes."""
        low, high = self.reach_m
        there_s = (high - low) / self.speed_mps
        round_s = math.fmod(stamp_s + self.phase_s, 2.0 * there_s)
        back = round_s > there_s
        way_m = self.speed_mps * (2.0 * there_s - round_s if back else round_s)
        return low + way_m, -1.0 if back else 1.0

    def T_world_body(self, stamp_s: float) -> np.ndarray:
        """Its place on the ground at a time; its x points to where it goes."""
        y, way = self.y_m(stamp_s)
        return transforms.from_xyz_yaw([self.x_m, y, self.z_m], way * np.pi / 2)


def ball_radius_m(boxes: np.ndarray) -> float:
    """Gives the radius of a ball about the origin that holds boxes (K, 11)."""
    return float(np.linalg.norm(np.abs(boxes[:, :3]) + boxes[:, 3:6], axis=1).max())


def things(moving: Sequence[Mover], stamp_s: float) -> List[BoxedThing]:
    """Gives the things as the renderer draws them, at a time."""
    return [BoxedThing(m.boxes, m.T_world_body(stamp_s), m.radius_m) for m in moving]


def mesh(boxes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Vertices (8 K, 3) in the body (m) and triangles (12 K, 3) of boxes (K, 11)."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    local = boxes[:, None, 3:6] * signs
    c, s = boxes[:, None, 6], boxes[:, None, 7]
    turned = np.stack(
        [
            c * local[..., 0] - s * local[..., 1],
            s * local[..., 0] + c * local[..., 1],
            local[..., 2],
        ],
        -1,
    )
    quads = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    first = 8 * np.arange(len(boxes))[:, None, None]
    return (turned + boxes[:, None, :3]).reshape(-1, 3), (faces + first).reshape(-1, 3)


def placed_boxes() -> Dict[str, np.ndarray]:
    """Boxes (K, 11) of the robot and of the crate, by name; they stand on their origin."""
    return {
        ROBOT: panelled(ROBOT_HALF_M, 0.14, np.random.default_rng(5)),
        CRATE: panelled(CRATE_HALF_M, 0.2, np.random.default_rng(6)),
    }


def panelled(half_m, panel_m: float, random: np.random.Generator) -> np.ndarray:
    """A block of panels in several colours: something to be matched on every side."""
    counts = [max(1, int(round(2 * h / panel_m))) for h in half_m]
    size = [h / n for h, n in zip(half_m, counts)]
    rows = []
    for i, j, k in np.ndindex(*counts):
        if all(0 < n < count - 1 for n, count in zip((i, j, k), counts)):
            continue  # inside
        centre = [
            -half_m[0] + (2 * i + 1) * size[0],
            -half_m[1] + (2 * j + 1) * size[1],
            (2 * k + 1) * size[2],
        ]
        colour = np.array(_COLOURS[random.integers(4)]) * random.uniform(0.6, 1.2)
        rows.append(_row(centre, size, colour))
    return np.array(rows)


def movers(plan: TownPlan) -> List[Mover]:
    """Makes the movers of a town; they keep to the road, clear of the cars that are parked at its
    far side.

    Raises SimulationError in a world without a crossing street.
    """
    if not len(plan.crossings_s):
        raise SimulationError(
            "a car and a walker need a street that crosses, as in the worlds street and plain"
        )
    middle = float(plan.crossings_s[0])
    places = {name: middle + off for name, off in _FROM_MIDDLE_M.items()}
    z = {name: float(plan.height(x, 0.0)) for name, x in places.items()}
    return [
        Mover("car", _car(), places["car"], z["car"], (-8.0, 8.0), 4.0),
        Mover("walker", _walker(), places["walker"], z["walker"], (-5.0, 5.0), 1.4, phase_s=3.0),
    ]


def _row(centre, half, colour) -> List[float]:
    return [*centre, *half, 1.0, 0.0, *colour]


def _car() -> np.ndarray:
    """A delivery van, 4.2 m long: painted panels, glass, wheels; something to be matched on every
    side."""
    # panels that repeated themselves would match at other depths, too
    rows, random = [], np.random.default_rng(4)
    for x in np.arange(-2.1 + _PANEL_M / 2, 2.1, _PANEL_M):
        for z in np.arange(0.30 + _PANEL_M / 2, 1.9 if x < 1.0 else 1.2, _PANEL_M):
            colour = np.array(_COLOURS[random.integers(4)]) * random.uniform(0.6, 1.2)
            rows.append(_row((x, 0.0, z), (_PANEL_M / 2, 0.88, _PANEL_M / 2), colour))
    for x in (-1.35, 1.35):
        for y in (-0.85, 0.85):
            rows.append(_row((x, y, 0.31), (0.31, 0.06, 0.31), (0.02, 0.02, 0.02)))
    rows.append(_row((1.1, 0.0, 1.3), (0.25, 0.80, 0.22), (0.03, 0.04, 0.05)))
    return np.array(rows)


def _walker() -> np.ndarray:
    """1.8 m tall: boots, trousers, a jacket in bands, a rucksack, a head, a cap."""
    dark, skin = (0.04, 0.05, 0.09), (0.40, 0.24, 0.17)
    bands = ((0.60, 0.45, 0.05), (0.05, 0.07, 0.20), (0.65, 0.62, 0.58))
    rows = [_row((0.1 * s, 0.11 * s, 0.42), (0.10, 0.08, 0.42), dark) for s in (-1, 1)]
    rows += [
        _row((0.0, 0.0, 0.84 + 0.11 * (2 * k + 1)), (0.14, 0.26, 0.11), bands[k]) for k in range(3)
    ]
    rows.append(_row((-0.22, 0.0, 1.22), (0.10, 0.17, 0.24), (0.30, 0.02, 0.02)))
    rows.append(_row((0.0, 0.0, 1.63), (0.10, 0.10, 0.13), skin))
    rows.append(_row((0.02, 0.0, 1.77), (0.13, 0.12, 0.03), (0.02, 0.02, 0.02)))
    return np.array(rows)
