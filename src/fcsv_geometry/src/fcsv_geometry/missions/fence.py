# SPDX-License-Identifier: Apache-2.0
"""Where vehicles may be: what the mission checks before take-off, and each guardian in flight."""

import math
from dataclasses import dataclass, field
from typing import List, Sequence, Tuple

import numpy as np

_CORNERS = 3


@dataclass(frozen=True)
class Fence:
    """Where cameras may be. Heights above the take-off place; x, y along home's axes, from home."""

    floor_m: float = 0.5  # above the take-off place, at least
    ceiling_m: float = 40.0  # above the take-off place, at most
    radius_m: float = 60.0  # around home, at most
    # corners x, y (m); none: the circle alone
    polygon: List[Tuple[float, float]] = field(default_factory=list)

    def __post_init__(self):
        if not 0.0 < self.floor_m < self.ceiling_m:
            raise ValueError(
                f"ceiling_m: {self.ceiling_m} must be above floor_m {self.floor_m}, and that above 0"
            )
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: {self.radius_m} must be positive")
        if self.polygon and len(self.polygon) < _CORNERS:
            raise ValueError(
                f"polygon: {len(self.polygon)} corners are no area; give three or more, or none"
            )
        if not all(math.isfinite(v) for corner in self.polygon for v in corner):
            raise ValueError("polygon: holds NaN or infinity")

    def outside_m(self, xy_m: Sequence[float], height_m: float, by_polygon: bool = True) -> float:
        """How far (m) a place is outside, 0 inside: x, y from home, or (``by_polygon`` False) from
        the take-off place, where home is not known yet; height above the take-off place.

        >>> Fence().outside_m((0.0, 63.0), 10.0), Fence().outside_m((0.0, 0.0), 38.0)
        (3.0, 0.0)
        >>> Fence(polygon=[(0.0, 0.0), (9.0, 0.0), (0.0, 9.0)]).outside_m((-2.0, 4.0), 10.0)
        2.0
        """
        x_m, y_m = float(xy_m[0]), float(xy_m[1])
        out_m = max(
            self.floor_m - height_m,
            height_m - self.ceiling_m,
            math.hypot(x_m, y_m) - self.radius_m,
            0.0,
        )
        if by_polygon and self.polygon and not _inside(self.polygon, x_m, y_m):
            out_m = max(out_m, _edge_m(self.polygon, x_m, y_m))
        return out_m

    def outside(self, p_home_m: np.ndarray, home_height_m: float) -> str:
        """Why a place (3,) in home is out of bounds, "" where it is within; home is so high (m)
        above the take-off.

        >>> Fence().outside(np.array([0.0, 0.0, 60.0]), 8.0)
        '68 m above take-off, the fence ends at 40 m'
        >>> Fence().outside(np.array([1.0, -4.0, 0.0]), 8.0)
        ''
        """
        height_m, away_m = (
            float(p_home_m[2]) + home_height_m,
            float(np.hypot(p_home_m[0], p_home_m[1])),
        )
        if height_m > self.ceiling_m:
            return f"{height_m:g} m above take-off, the fence ends at {self.ceiling_m:g} m"
        if height_m < self.floor_m:
            return f"{height_m:.1f} m above take-off, the fence begins at {self.floor_m:g} m"
        if away_m > self.radius_m:
            return f"{away_m:.0f} m from home, the fence ends at {self.radius_m:g} m"
        if self.polygon and not _inside(self.polygon, float(p_home_m[0]), float(p_home_m[1])):
            return f"({p_home_m[0]:.1f}, {p_home_m[1]:.1f}) m in home is outside of the fence's polygon"
        return ""


def _inside(polygon: List[Tuple[float, float]], x_m: float, y_m: float) -> bool:
    """Whether an odd number of edges lies to the right of the point."""
    crossed = False
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]]):
        if (ay > y_m) != (by > y_m) and x_m < ax + (y_m - ay) * (bx - ax) / (by - ay):
            crossed = not crossed
    return crossed


def _edge_m(polygon: List[Tuple[float, float]], x_m: float, y_m: float) -> float:
    """Distance (m) of a point from the nearest edge."""
    least_m = math.inf
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]]):
        dx, dy = bx - ax, by - ay
        share = ((x_m - ax) * dx + (y_m - ay) * dy) / max(dx * dx + dy * dy, 1e-12)
        share = min(1.0, max(0.0, share))
        least_m = min(least_m, math.hypot(ax + share * dx - x_m, ay + share * dy - y_m))
    return least_m
