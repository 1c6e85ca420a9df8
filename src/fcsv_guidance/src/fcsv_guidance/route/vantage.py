# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle holds that reads the tags on a robot: near enough, with the robot in its picture,
where nothing known hides it, above all that is known to stand there."""

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.config import require_positive
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.route.look_from import nothing_hides

_HEADINGS, _DISTANCES = 24, 4
_AROUND_M = 20.0  # of the robot: what the vehicle may fly over
_OTHER_PLACE_M = 3.0  # from one that was of no use
_LINE_M = 2.0  # a vehicle nearer to the line of sight hides the robot from who watches
_HANGS_M = 0.5  # what hangs is so thick, as far as anybody can say
_FLIES_PER_M, _TURNS_PER_RAD = 0.01, 0.02  # what a place costs, against the share that it shows


@dataclass(frozen=True)
class VantageRules:
    """``nearest_m``, ``farthest_m``: of the camera from the robot, level; ``half_width_deg``,
    ``half_height_deg``: of its picture to the right and below, without a margin for its tilt;
    ``above_m`` what stands there, ``low_m`` the robot's tags; ``ahead_m``: of the robot's way that it
    should see."""

    nearest_m: float = 8.0
    farthest_m: float = 13.0
    half_width_deg: float = 23.0
    half_height_deg: float = 18.5
    above_m: float = 1.5
    low_m: float = 2.2
    ahead_m: float = 4.0

    def __post_init__(self):
        require_positive(self)
        if self.nearest_m >= self.farthest_m:
            raise ValueError(f"nearest_m: {self.nearest_m:g} must be below farthest_m")


@dataclass(frozen=True)
class Vantage:
    """``p_home_cam`` (3,) m, ``yaw_rad`` of its level view to the left of home's x; ``sees``: the
    share of the robot's way, the nearest part of which counts most."""

    p_home_cam: np.ndarray
    yaw_rad: float
    sees: float


def shown_to(
    ground: Ground, tags_home_m: np.ndarray, vantage: Vantage, rules: VantageRules
) -> float:
    """The share of places (N,3) of the robot's tags along its way that a camera at a ``vantage``
    shows; earlier ones count more."""
    return _shown(ground, _hiding(ground), tags_home_m, vantage, rules)


def best_vantage(
    ground: Ground,
    tags_home_m: np.ndarray,
    now: Vantage,
    rules: VantageRules = VantageRules(),
    but: Sequence[np.ndarray] = (),
    eye_m: Optional[np.ndarray] = None,
) -> Optional[Vantage]:
    """The place that shows most of ``tags_home_m`` (N,3), the robot's tags along its way, at little
    cost from where the camera is ``now``; near none of the places (3,) ``but``, and beside the line
    along which a camera at ``eye_m`` (3,) watches the robot. None where no place shows any: nothing
    is known there, what stands there is too high, or hides the robot."""
    clear_m = clear_height_m(ground, tags_home_m[0, :2], rules)
    z_m = max(clear_m, float(tags_home_m[0, 2]) + rules.low_m)
    deep_m = z_m - float(tags_home_m[:, 2].min())
    nearest_m = max(rules.nearest_m, deep_m / np.tan(np.radians(rules.half_height_deg)) + 0.5)
    if not np.isfinite(clear_m) or nearest_m >= rules.farthest_m:
        return None
    hiding, middle = _hiding(ground), tags_home_m[: max(1, len(tags_home_m) // 2), :2].mean(0)
    best, best_rated = None, 0.0
    for yaw_rad in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS - np.pi:
        for away_m in np.linspace(nearest_m, rules.farthest_m - 1.0, _DISTANCES):
            at = middle - away_m * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
            place = Vantage(np.array([*at, z_m]), float(yaw_rad), 0.0)
            if any(np.hypot(*(at - p[:2])) < _OTHER_PLACE_M for p in but):
                continue
            if eye_m is not None and _off_line_m(place.p_home_cam, eye_m, tags_home_m[0]) < _LINE_M:
                continue
            sees = _shown(ground, hiding, tags_home_m, place, rules)
            flies_m = float(np.linalg.norm(place.p_home_cam - now.p_home_cam))
            turns_rad = abs(rotations.wrap(float(yaw_rad - now.yaw_rad)))
            rated = sees - _FLIES_PER_M * flies_m - _TURNS_PER_RAD * turns_rad
            if sees > 0 and (best is None or rated > best_rated):
                best, best_rated = Vantage(place.p_home_cam, float(yaw_rad), sees), rated
    return best


def clear_height_m(ground: Ground, about_m: np.ndarray, rules: VantageRules) -> float:
    """Height in home that is above all that is known within _AROUND_M of a place (2,), also of what
    hangs there; -inf where nothing is."""
    grid = ground.grid
    xy = grid.middle_of(*np.indices(grid.shape))
    near = ground.known & (np.hypot(*np.moveaxis(xy - about_m, -1, 0)) <= _AROUND_M)
    hangs = np.where(np.isfinite(ground.overhead_m), ground.overhead_m + _HANGS_M, -np.inf)
    return float(np.fmax(ground.high_m, hangs)[near].max(initial=-np.inf)) + rules.above_m


def _hiding(ground: Ground) -> np.ndarray:
    return np.where(ground.known, ground.high_m, -np.inf)


def _shown(ground: Ground, hiding: np.ndarray, tags_home_m, vantage: Vantage, rules) -> float:
    off = tags_home_m - vantage.p_home_cam
    c, s = np.cos(vantage.yaw_rad), np.sin(vantage.yaw_rad)
    ahead, right = c * off[:, 0] + s * off[:, 1], s * off[:, 0] - c * off[:, 1]
    seen = (ahead > 0) & (np.hypot(off[:, 0], off[:, 1]) <= rules.farthest_m)
    seen &= np.abs(right) <= ahead * np.tan(np.radians(rules.half_width_deg))
    seen &= np.abs(off[:, 2]) <= ahead * np.tan(np.radians(rules.half_height_deg))
    if seen.any():
        seen[seen] &= nothing_hides(ground, hiding, tags_home_m[seen], vantage.p_home_cam)
    weight = np.linspace(1.0, 0.5, len(tags_home_m))
    return float((weight * seen).sum() / weight.sum())


def _off_line_m(p_m: np.ndarray, eye_m: np.ndarray, end_m: np.ndarray) -> float:
    """Distance of a place (3,) from the line between two others.

    >>> _off_line_m(np.array([5.0, 2.0, 0.0]), np.zeros(3), np.array([10.0, 0.0, 0.0]))
    2.0
    """
    along = end_m - eye_m
    share = float(np.clip((p_m - eye_m) @ along / max(along @ along, 1e-9), 0.0, 1.0))
    return float(np.linalg.norm(p_m - eye_m - share * along))
