# SPDX-License-Identifier: Apache-2.0
"""When and where a gimbal turns: the dead zone of thesis 4.2 (figure 4.4), and the search for a
target that was lost.

The gimbal stands still while the target is inside the zone. When it leaves, the gimbal turns once,
by the angle that its last distance and bearing ask for, to have it in the middle again. Delays:
what a picture shows is old, and a servo needs time to begin and to get there. With ``predict`` the
target is judged where it is by now and met where it will be when the gimbal has arrived, so that a
delay does not narrow the zone; without it the rule is the thesis's own.
"""

from dataclasses import dataclass
from typing import Iterator, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry


@dataclass(frozen=True)
class FollowRules:
    """``zone`` is the share of the half picture, less the target's own radius, that the dead zone
    takes (wide, high).

    ``lead`` brings a moving target not to the middle but so far (share of the zone) to the side
    that it comes from: it stays inside for longer. ``target_radius_m``: of what is to stay in the
    picture, about the middle of the tags.
    """

    zone: Tuple[float, float] = (0.7, 0.6)
    lead: float = 0.5
    predict: bool = True
    target_radius_m: float = 0.09
    servo_delay_s: float = 0.03  # command to the first movement
    speed_degps: float = 400.0  # of the servos, for the time that a turn takes
    acceleration_degps2: float = 2000.0
    lost_s: float = 0.5
    # at every place of a search, once it is there: exposure, delay, detection
    search_dwell_s: float = 0.15
    # longer, until a picture of the place was looked at: a busy machine is behind
    search_patience_s: float = 4.0
    search_step: float = 0.75  # of the field of view between two places

    def __post_init__(self):
        for name in (
            "speed_degps",
            "acceleration_degps2",
            "lost_s",
            "search_dwell_s",
            "search_patience_s",
            "target_radius_m",
        ):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: {getattr(self, name)} must be positive")
        if not all(0.0 < share < 1.0 for share in self.zone):
            raise ValueError(f"zone: {self.zone} must be two shares between 0 and 1")
        if not 0.0 <= self.lead < 1.0:
            raise ValueError(f"lead: {self.lead} is not in 0..1")
        if not 0.0 <= self.servo_delay_s <= 1.0:
            raise ValueError(f"servo_delay_s: {self.servo_delay_s} is not in 0..1")
        if not 0.1 <= self.search_step <= 1.0:
            raise ValueError(f"search_step: {self.search_step} is not in 0.1..1")


@dataclass(frozen=True)
class Target:
    """Where the target was at a stamp, and how it moves; ground robot's frame. ``sighted_s``: its
    last sight, where that was before."""

    stamp_s: float
    p_ground_m: np.ndarray
    v_ground_mps: np.ndarray
    sighted_s: Optional[float] = None

    @property
    def last_sight_s(self) -> float:
        return self.stamp_s if self.sighted_s is None else self.sighted_s

    def at(self, stamp_s: float) -> np.ndarray:
        return self.p_ground_m + self.v_ground_mps * (stamp_s - self.stamp_s)


class Follower:
    """command() says where to turn, or None to stand still; ``goal`` is where the gimbal stands or
    is turning to."""

    def __init__(
        self, geometry: GimbalGeometry, camera: PinholeCamera, rules: FollowRules, start: Angles
    ):
        self._geometry, self._rules = geometry, rules
        self._half_rad = np.array(
            [np.arctan2(camera.width / 2, camera.fx), np.arctan2(camera.height / 2, camera.fy)]
        )
        self.goal = geometry.clipped(start)
        self.searching = False
        self._places: Optional[Iterator[Angles]] = None
        self._centre = self.goal  # of the search
        self._step_rad = 2.0 * self._half_rad * rules.search_step
        self._there_s = self._next_s = -np.inf

    def command(
        self, now_s: float, target: Optional[Target], looked_s: float = np.inf
    ) -> Optional[Angles]:
        """``target``: the last sight there was, None before the first or after the clock was set.

        ``looked_s``: stamp of the newest picture that was searched. A target is lost, and a place
        of the search is left, only once a picture that was taken since then was searched.
        """
        self.searching = target is None or self._lost(now_s, target, looked_s)
        if self.searching:
            return self._search(now_s, target, looked_s)
        self._places = None
        p_now = target.at(now_s) if self._rules.predict else target.p_ground_m
        if self._inside(p_now):
            return None
        return self._turn(self._meeting(now_s, target))

    def zone_rad(self, distance_m: float) -> np.ndarray:
        """Half width and half height (rad) of the dead zone for a target so far away."""
        own = np.arcsin(min(1.0, self._rules.target_radius_m / max(distance_m, 1e-6)))
        return np.array(self._rules.zone) * np.maximum(self._half_rad - own, 0.1 * self._half_rad)

    def _inside(self, p_ground: np.ndarray) -> bool:
        bearing, distance_m = self._bearing(self.goal, p_ground)
        return bool((np.abs(bearing) <= self.zone_rad(distance_m)).all())

    def _bearing(self, angles: Angles, p_ground: np.ndarray) -> Tuple[np.ndarray, float]:
        """Angles (2,) rad right and down of the optical axis, and the distance (m)."""
        x, y, z = transforms.apply(transforms.invert(self._geometry.T_ground_cam(angles)), p_ground)
        return np.array([np.arctan2(x, z), np.arctan2(y, z)]), float(np.sqrt(x * x + y * y + z * z))

    def _meeting(self, now_s: float, target: Target) -> Angles:
        """Where to turn to have the target in the middle on arrival, or ahead of it by the lead."""
        aim = self._geometry.aim
        if not self._rules.predict:
            return aim(target.p_ground_m)
        goal = aim(target.at(now_s))
        for _ in range(2):  # the way there is longer by what it moves meanwhile
            arrival_s = now_s + self._rules.servo_delay_s + self._turning_s(goal)
            goal = aim(target.at(arrival_s))
        after = aim(target.at(arrival_s + 0.1))
        rate = np.array([after.pan_rad - goal.pan_rad, after.tilt_rad - goal.tilt_rad]) / 0.1
        zone = self.zone_rad(self._bearing(goal, target.at(arrival_s))[1])
        # degrees of pan are smaller in the picture the higher it looks
        zone[0] /= max(np.cos(goal.tilt_rad), 0.1)
        # no further ahead than it comes within a second: one that hovers stays in the middle
        time_s = min(1.0, *(self._rules.lead * zone / np.maximum(np.abs(rate), 1e-6)))
        return Angles(
            float(goal.pan_rad + rate[0] * time_s), float(goal.tilt_rad + rate[1] * time_s)
        )

    def _turning_s(self, goal: Angles) -> float:
        """How long the servos take from the last goal to this one: ramps, and full speed
        between."""
        way = float(np.max(np.abs(np.subtract(goal, self.goal))))
        speed, ramp = (
            np.radians(self._rules.speed_degps),
            np.radians(self._rules.acceleration_degps2),
        )
        return 2.0 * np.sqrt(way / ramp) if way < speed**2 / ramp else way / speed + speed / ramp

    def _turn(self, goal: Angles) -> Angles:
        self.goal = self._geometry.clipped(goal)
        return self.goal

    def _lost(self, now_s: float, target: Target, looked_s: float) -> bool:
        silent_s = now_s - target.last_sight_s
        in_vain = looked_s > target.last_sight_s or silent_s > self._rules.search_patience_s
        return silent_s > self._rules.lost_s and in_vain

    def _search(self, now_s: float, target: Optional[Target], looked_s: float) -> Optional[Angles]:
        lost_at = self.goal if self._places is None else self._centre
        if target is not None:  # on along its last velocity, for a bounded time
            lost_at = self._geometry.aim(
                target.at(min(now_s, target.last_sight_s + self._rules.lost_s))
            )
        # the robot may turn meanwhile, and bring it back within the limits
        off = np.abs(np.subtract(lost_at, self._centre))
        if self._places is None or (off > self._step_rad).any():
            self._centre = lost_at
            self._places, self._there_s, self._next_s = self._around(lost_at), -np.inf, now_s
        behind = looked_s < self._there_s and now_s < self._there_s + self._rules.search_patience_s
        if now_s < self._next_s or behind:
            return None
        goal = next(self._places)
        self._there_s = now_s + self._rules.servo_delay_s + self._turning_s(goal)
        self._next_s = self._there_s + self._rules.search_dwell_s
        return self._turn(goal)

    def _around(self, centre: Angles) -> Iterator[Angles]:
        """Places in rings about ``centre`` until every reachable direction was looked at; then
        anew."""
        step = self._step_rad
        low, high = (
            np.radians([self._geometry.pan_limits_deg[k], self._geometry.tilt_limits_deg[k]])
            for k in (0, 1)
        )
        rings = int(np.ceil(np.max((high - low) / step))) + 1
        while True:
            for ring in range(rings):
                for i, j in _ring(ring):
                    place = np.array(centre) + step * [i, j]
                    if ring == 0 or ((place > low - step / 2) & (place < high + step / 2)).all():
                        yield self._geometry.clipped(Angles(*map(float, place)))


def _ring(n: int) -> Iterator[Tuple[int, int]]:
    """Cells of a square ring in order, each beside the last.

    >>> list(_ring(0)), len(list(_ring(2)))
    ([(0, 0)], 16)
    """
    if n == 0:
        yield 0, 0
        return
    for k in range(2 * n):
        yield n, k - n + 1
    for k in range(2 * n):
        yield n - 1 - k, n
    for k in range(2 * n):
        yield -n, n - 1 - k
    for k in range(2 * n):
        yield k - n + 1, -n
