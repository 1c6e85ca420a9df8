# SPDX-License-Identifier: Apache-2.0
"""Where two vehicles hold so that gimbals on a robot see one of them at least all along its way
(thesis 4.1)."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.route.following import Polyline
from fcsv_tracking.gimbal.config import Gimbal
from fcsv_tracking.gimbal.reach import gimbal_problem

#: Above the ground, of vehicles that hold.
HOLD_HEIGHT_M = 1.8
_AROUND_M, _STEP_M = 2.4, 0.4  # of the way, in which vehicles may hold, and the lattice there
_BESIDE_M = 0.6  # from the robot's way: nothing shall fall on it
_APART_M = 1.2
_PASS_M = 1.0  # off the robot and the other vehicle, of a vehicle that flies to its place
_BEST_M = 2.2  # level, from the robot: not steep, and 1.5 m before tags are too small
_NEAR_M, _FAR_M = 1.5, 3.7  # of a vehicle from the robot, level and in space: 0.3 m are drift's
_ALONG_M = 0.25
_SPARE_RAD = np.radians(8.0)  # to the limits of pan: half the picture


@dataclass(frozen=True)
class HoldPlaces:
    """Where each gimbal's vehicle holds (x, y in m, HOLD_HEIGHT_M above the ground); ``seen``: the
    share of the way along which a gimbal has its vehicle near enough, ``seen_twice``: both."""

    places_m: Tuple[Tuple[float, float], ...]
    seen: float
    seen_twice: float

    def in_words(self) -> str:
        """Says where they hold, and how much of the way they serve."""
        at = " and ".join(f"({x:.1f}, {y:.1f})" for x, y in self.places_m)
        return f"vehicles hold at {at} m: one seen along {self.seen:.0%}, both along {self.seen_twice:.0%} of the way"


def hold_places(
    way_m: np.ndarray,
    gimbals: Sequence[Gimbal],
    yaw_rad: float,
    from_m: Sequence[Tuple[float, float]] = (),
) -> Optional[HoldPlaces]:
    """The places for two vehicles from which their gimbals see most of a way (N,2), and which both
    see from its start, where the robot stands with ``yaw_rad``; neither is above it. From
    ``from_m``, where they are now, they come there past the robot, and past the place where the
    other is now. None where there are none."""
    line = Polyline.of(np.asarray(way_m, float))
    along = line.at(np.append(np.arange(0.0, line.length_m, _ALONG_M), line.length_m))
    low, high = along.min(0) - _AROUND_M, along.max(0) + _AROUND_M
    axes = [np.arange(a, b, _STEP_M) for a, b in zip(low, high)]
    at = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    level = np.hypot(*(at[:, None] - along[None]).transpose(2, 0, 1))
    kept = level.min(1) >= _BESIDE_M
    at, level = at[kept], level[kept]
    eye_m = gimbals[0].geometry.base.xyz_m[2]
    away = np.hypot(level, HOLD_HEIGHT_M - eye_m)
    sees = (away <= _FAR_M) & (level >= _NEAR_M) & _within_limits(at, along, gimbals[0])
    able = _seen_from(along[0], yaw_rad, at, gimbals)
    for k in range(len(from_m)):
        kept_off = along[0], from_m[1 - k]
        able[k] = [i for i in able[k] if all(_passes(from_m[k], at[i], o) for o in kept_off)]
    best, chosen, off_m = (-1.0, -1.0, 0.0), None, np.abs(level - _BEST_M).mean(1)
    for i in able[0]:
        js = [j for j in able[1] if np.hypot(*(at[i] - at[j])) >= _APART_M]
        if js:
            one, both = (f(sees[i], sees[js]).mean(1) for f in (np.logical_or, np.logical_and))
            k = np.lexsort((-off_m[js], both, one))[-1]
            found = float(one[k]), float(both[k]), -off_m[i] - off_m[js[k]]
            if found > best:
                best, chosen = found, (i, js[k])
    if chosen is None:
        return None
    return HoldPlaces(tuple((float(at[i, 0]), float(at[i, 1])) for i in chosen), *best[:2])


def _seen_from(
    robot_m: np.ndarray, yaw_rad: float, at: np.ndarray, gimbals: Sequence[Gimbal]
) -> List[List[int]]:
    """Finds the rows of ``at`` (N,2) at which each gimbal sees its vehicle."""
    T_ground_level = transforms.invert(transforms.from_xyz_yaw([*robot_m, 0.0], yaw_rad))
    bodies = [T_ground_level @ transforms.from_xyz_yaw([*xy, HOLD_HEIGHT_M], 0.0) for xy in at]
    return [[i for i, T in enumerate(bodies) if not gimbal_problem(g, T)] for g in gimbals]


def _passes(a_m: Tuple[float, float], b_m: np.ndarray, other_m: np.ndarray) -> bool:
    """Whether straight on from ``a_m`` to ``b_m`` a vehicle keeps off ``other_m`` by _PASS_M, or
    comes no nearer to it than it is."""
    line = np.linspace(a_m, b_m, 12) - other_m
    return bool(np.hypot(*line.T).min() >= min(_PASS_M, float(np.hypot(*line[0])) - 0.05))


def _within_limits(at: np.ndarray, along: np.ndarray, gimbal: Gimbal) -> np.ndarray:
    """(N,M) bool: whether the gimbal of a robot that drives through ``along`` (M,2) can turn to
    places ``at`` (N,2), with the heading with which it comes, and that with which it leaves."""
    steps = np.diff(along, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    off = at[:, None] - along[None]
    bearings = np.arctan2(off[..., 1], off[..., 0])
    most = np.radians(min(np.abs(gimbal.geometry.pan_limits_deg))) - _SPARE_RAD
    able = np.ones(bearings.shape, bool)
    for heading in (np.append(headings[:1], headings), np.append(headings, headings[-1:])):
        able &= np.cos(bearings - heading) >= np.cos(most)
    return able
