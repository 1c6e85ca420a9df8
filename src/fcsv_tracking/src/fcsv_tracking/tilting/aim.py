# SPDX-License-Identifier: Apache-2.0
"""Which angles for which distance, and when to turn; how near both cameras still see a thing."""

from dataclasses import dataclass
from typing import Optional

import numpy as np

from fcsv_geometry import config, transforms
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltingCamera, TiltingRig

_STEPS = 8  # of Newton's method
_SEARCH_M = (0.02, 20.0)
_SEARCH_STEPS = 80
_BISECTIONS = 20
PARALLEL = TiltAngles(0.0, 0.0)


@dataclass(frozen=True)
class AimRules:
    """When the rig turns. Beyond ``parallel_beyond_m`` it stands parallel, and tilts again below
    ``again_share`` of that. Angles change once they are ``dead_deg`` off, not faster than
    ``speed_degps``."""

    parallel_beyond_m: float = 5.0
    again_share: float = 0.8
    dead_deg: float = 1.0
    speed_degps: float = 60.0

    def __post_init__(self):
        config.require_positive(self)
        if self.again_share >= 1.0:
            raise ValueError(f"again_share: {self.again_share} must be below 1")


def crossing(rig: TiltingRig, distance_m: float) -> TiltAngles:
    """Angles at which what is ``distance_m`` ahead of the rig's middle is in the middle of both
    pictures: there both see most of the same. Inside the limits as near as they come. Raises
    ValueError where the distance is none.
    """
    if not 0.0 < distance_m < np.inf:
        raise ValueError(f"distance_m: {distance_m} is not a distance")
    point = np.array([distance_m, 0.0, 0.0])
    left, right = (_facing(getattr(rig, side), point) for side in SIDES)
    if rig.coupled:
        left = right = 0.5 * (left + right)
    return rig.clipped(TiltAngles(left, right))


def _facing(camera: TiltingCamera, p_rig_m: np.ndarray) -> float:
    """The angle (rad) that brings a point to the middle column."""
    c, angle = camera.camera, 0.0
    middle = np.arctan2((c.width - 1) / 2.0 - c.cx, c.fx)
    for _ in range(_STEPS):
        step = 1e-4
        off, moved = (_bearing(camera, a, p_rig_m) - middle for a in (angle, angle + step))
        slope = (moved - off) / step
        # the axis lies along the picture's rows: turning moves nothing sideways
        if abs(slope) < 1e-3:
            raise ValueError("axis: does not turn the camera sideways")
        angle = float(np.clip(angle - off / slope, -1.5, 1.5))
    return angle


def _bearing(camera: TiltingCamera, angle_rad: float, p_rig_m: np.ndarray) -> float:
    x, _, z = transforms.apply(transforms.invert(camera.T_rig_cam(angle_rad)), p_rig_m)
    return float(np.arctan2(x, z))


class Aim:
    """Decides the angles from distances as they come. Time is given (s), never read."""

    def __init__(self, rig: TiltingRig, rules: Optional[AimRules] = None):
        self._rig, self._rules = rig, rules or AimRules()
        self._goal = self._told = rig.clipped(PARALLEL)
        self._parallel = True
        self._now_s: Optional[float] = None

    @property
    def goal(self) -> TiltAngles:
        """Where the cameras are to come to."""
        return self._goal

    def look(self, distance_m: float) -> None:
        """Something is looked at there. Raises ValueError where the distance is none; the goal
        stays."""
        rules = self._rules
        if not 0.0 < distance_m < np.inf:
            raise ValueError(f"distance_m: {distance_m} is not a distance")
        near = distance_m < rules.parallel_beyond_m * (rules.again_share if self._parallel else 1.0)
        if not near:
            self._parallel, self._goal = True, self._rig.clipped(PARALLEL)
            return
        wished = crossing(self._rig, distance_m)
        if self._parallel or np.abs(np.subtract(wished, self._goal)).max() > np.radians(
            rules.dead_deg
        ):
            self._goal = wished
        self._parallel = False

    def turn_to(self, angles: TiltAngles) -> None:
        """Turns the rig by hand, inside the limits, until the next distance. Raises ValueError
        where an angle is none."""
        if not np.isfinite(angles).all():
            raise ValueError(f"angles: {tuple(angles)} are not finite")
        self._goal, self._parallel = self._rig.clipped(angles), False

    def step(self, now_s: float) -> TiltAngles:
        """What the servos are to be told now: towards the goal, at most at the speed."""
        if self._now_s is not None:
            most = np.radians(self._rules.speed_degps) * max(0.0, now_s - self._now_s)
            self._told = TiltAngles(
                *(float(t + np.clip(g - t, -most, most)) for t, g in zip(self._told, self._goal))
            )
        self._now_s = now_s
        return self._told


def sees(camera: TiltingCamera, angle_rad: float, p_rig_m: np.ndarray) -> np.ndarray:
    """(N,) bool: which points (N, 3) of R are in its picture."""
    uv = camera.camera.project(
        transforms.apply(transforms.invert(camera.T_rig_cam(angle_rad)), p_rig_m)
    )
    with np.errstate(invalid="ignore"):
        inside = (uv >= 0) & (uv <= [camera.camera.width - 1, camera.camera.height - 1])
    return inside.all(axis=1)


def in_both_views(rig: TiltingRig, angles: TiltAngles, distance_m: float, size_m: float) -> bool:
    """Whether a square of ``size_m`` that faces the rig from ``distance_m`` ahead is whole in both
    pictures."""
    h = size_m / 2.0
    corners = np.array([[distance_m, y, z] for y in (-h, h) for z in (-h, h)])
    return all(bool(sees(getattr(rig, s), a, corners).all()) for s, a in zip(SIDES, angles))


def nearest_m(rig: TiltingRig, size_m: float, tilt: bool = True) -> float:
    """The distance (m) from which on outwards both cameras see the whole of a thing of ``size_m``
    ahead of the middle.

    With ``tilt`` at the angles that cross there, else parallel. Raises ValueError where no distance
    below 20 m does.
    """
    if not size_m > 0:
        raise ValueError(f"size_m: {size_m} must be positive")

    def seen(distance_m: float) -> bool:
        angles = crossing(rig, distance_m) if tilt else rig.clipped(PARALLEL)
        return in_both_views(rig, angles, distance_m, size_m)

    distances = np.geomspace(*_SEARCH_M, _SEARCH_STEPS)[::-1]
    unseen = next((i for i, d in enumerate(distances) if not seen(d)), None)
    if unseen is None:
        return float(distances[-1])
    if unseen == 0:
        raise ValueError(
            f"size_m: {size_m} is in both pictures at no distance below {_SEARCH_M[1]:g} m"
        )
    low, high = distances[unseen], distances[unseen - 1]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if seen(middle) else (middle, high)
    return float(high)
