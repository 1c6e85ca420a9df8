# SPDX-License-Identifier: Apache-2.0
"""A crate that comes into a robot's way once, ahead of it on its route, stays, and goes again."""

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.route.following import Polyline
from fcsv_sim.robot.things import Box
from fcsv_sim.world.movers import CRATE_HALF_M
from fcsv_sim.world.place import PlacePlan


@dataclass(frozen=True)
class ClosingRules:
    """The crate comes once ``share`` of the first route is driven, ``ahead_m`` from the robot and
    ``before_goal_m`` and more before the goal, and stays for ``stays_s``."""

    share: float = 0.25
    ahead_m: Tuple[float, float] = (4.5, 7.5)
    before_goal_m: float = 3.0
    stays_s: float = 25.0


class WayCloser:
    """Closes a way of the place ``plan`` across the route that was heard last; ``T_world_home`` is
    level. The same seed, routes and times give the same crate."""

    def __init__(
        self,
        plan: PlacePlan,
        T_world_home: np.ndarray,
        seed: int,
        rules: ClosingRules = ClosingRules(),
    ):
        self._plan, self._rules = plan, rules
        self._T_world_home = transforms.level(T_world_home)
        self._random = np.random.default_rng([seed, 31])
        self._route: Optional[Polyline] = None
        self._due_m, self._way_m = 0.0, 0.0
        self._at: Optional[np.ndarray] = None
        self._goes_s = np.inf
        self.box: Optional[Box] = None

    def on_route(self, points_home_m: np.ndarray) -> None:
        """A route (N,2) in home came; one that is empty counts for nothing."""
        if len(points_home_m) < 2:
            return
        flat = np.pad(np.asarray(points_home_m, float), ((0, 0), (0, 1)))
        points = transforms.apply(self._T_world_home, flat)[:, :2]
        first, self._route = self._route is None, Polyline.of(points)
        if first:
            self._due_m = self._rules.share * self._route.length_m

    def step(self, now_s: float, x_m: float, y_m: float) -> str:
        """The robot is at x, y (world): "closed" where the crate comes now, "opened" where it goes,
        else empty."""
        at = np.array([x_m, y_m])
        if self._at is not None and self._route is not None:
            self._way_m += float(np.hypot(*(at - self._at)))
        self._at = at
        if self.box is not None and now_s >= self._goes_s:
            self.box = None
            return "opened"
        if self._goes_s < np.inf or self._route is None or self._way_m < self._due_m:
            return ""
        self.box = self._placed(at)
        if self.box is None:
            return ""
        self._goes_s = now_s + self._rules.stays_s
        return "closed"

    def _placed(self, at: np.ndarray) -> Optional[Box]:
        """The crate across the way ahead; None where too little of the way is left."""
        route, rules = self._route, self._rules
        along = np.arange(0.0, route.length_m, 0.1)
        here_m = along[int(np.argmin(np.hypot(*(route.at(along) - at).T)))]
        spot_m = here_m + self._random.uniform(*rules.ahead_m)
        if spot_m > route.length_m - rules.before_goal_m:
            return None
        (x, y), (dx, dy) = route.at(spot_m), route.at(spot_m + 0.3) - route.at(spot_m - 0.3)
        z = float(self._plan.drawn_height(np.array(x), np.array(y)))
        yaw_rad = float(np.arctan2(dy, dx))
        return Box(float(x), float(y), z, CRATE_HALF_M[:2], 2 * CRATE_HALF_M[2], yaw_rad)
