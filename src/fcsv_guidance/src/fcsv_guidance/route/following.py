# SPDX-License-Identifier: Apache-2.0
"""Follows a route by pure pursuit (Coulter 1992), and stops where the robot's place or the map
cannot be relied on.

A port: messages and monotonic time in, a DriveCommand out.
"""

from dataclasses import dataclass
from typing import Dict, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_geometry.config import require_positive, require_within
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.errors import RouteError
from fcsv_guidance.messages import (
    ClearanceMap,
    DriveCommand,
    GroundDated,
    HoldRobot,
    PlaceLost,
    RobotPlace,
    StopRobot,
)
from fcsv_guidance.robot import Robot

GOAL_REACHED = "the goal is reached"
PLACE_UNKNOWN = "the robot's place is not known"
_MAP_AHEAD_S = 1.0  # a map may be so far ahead of the clock: it is old after minutes only
_BLIND_S = 60.0  # an older place says nothing of where a robot is that drives


@dataclass(frozen=True)
class RouteToFollow:
    """``points_home_m`` (N,2), from where the robot is to the goal."""

    points_home_m: np.ndarray

    def polyline(self) -> "Polyline":
        """Gives the way. Raises RouteError where it is none."""
        points = np.asarray(self.points_home_m, float)
        if (
            points.ndim != 2
            or points.shape[1] != 2
            or len(points) < 2
            or not np.isfinite(points).all()
        ):
            raise RouteError(
                "a route needs two points and more, each with a finite x and y; plan it again"
            )
        return Polyline.of(points)


class Holds:
    """What holds the robot now, by every source."""

    def __init__(self):
        self._reasons: Dict[str, str] = {}

    def receive(self, message: HoldRobot) -> None:
        """A source holds the robot, or no more."""
        self._reasons[message.source] = message.reason

    @property
    def reason(self) -> str:
        """One of the reasons; empty where nothing holds it."""
        return next(filter(None, self._reasons.values()), "")


@dataclass(frozen=True)
class FollowerRules:
    """Bounds of following; ages count from a stamp. ``sigmas`` of the robot's place are kept
    clear; where less is, the robot stands, unless its route leads to so much within ``lead_m``, and
    nowhere nearer to an obstacle: so far it creeps. The goal is reached ``goal_m`` from it by a place
    known to ``goal_sigma_m``."""

    oldest_place_s: float = 0.5
    oldest_map_s: float = 60.0
    sigmas: float = 2.0
    goal_m: float = 0.3
    goal_sigma_m: float = 0.4
    look_ahead_m: float = 0.6
    look_ahead_s: float = 0.8
    least_ahead_m: float = 0.25
    most_off_m: float = 0.5
    lateral_mps2: float = 0.5
    lead_m: float = 0.8
    creep_mps: float = 0.15

    def __post_init__(self):
        require_positive(self)
        require_within(self, 0.0, _BLIND_S, "oldest_place_s")


Message = Union[RobotPlace, PlaceLost, RouteToFollow, ClearanceMap, StopRobot, HoldRobot]


def too_old_to_drive(
    now_s: float, seen: Union[ClearanceMap, GroundDated, None], oldest_s: float
) -> str:
    """Why nobody drives over ground that was seen so long ago, or never; empty where it is new
    enough.

    >>> too_old_to_drive(90.0, GroundDated(20.0), 80.0), too_old_to_drive(0.0, None, 80.0)
    ('', 'no map has come')
    """
    if seen is None:
        return "no map has come"
    age_s = now_s - seen.stamp_s
    if not np.isfinite(age_s):
        return "it is not known when the place was seen: look at it again"
    ahead = ahead_of_clock(now_s, seen.stamp_s, _MAP_AHEAD_S)
    if ahead:
        return f"it is not known when the place was seen: its stamp {ahead}, then look at it again"
    if age_s <= oldest_s:
        return ""
    return (
        f"the place was seen {age_s:.1f} s ago, oldest_map_s allows {oldest_s:g} s: look at it "
        "again, or maps come too slowly (of folders: fresh, where nothing has moved since)"
    )


class RouteFollower:
    """Drives ``robot`` along the last route that came."""

    def __init__(self, robot: Robot, rules: FollowerRules = FollowerRules()):
        self._robot, self._rules = robot, rules
        self._place: Optional[RobotPlace] = None
        self._lost = PLACE_UNKNOWN  # why, where it is None
        self._map: Optional[ClearanceMap] = None
        self._route: Optional[Polyline] = None
        self._reached_m, self._speed_mps, self._stepped_s = 0.0, 0.0, None
        self._standing = "no route has come"
        self._holds = Holds()

    def receive(self, now_s: float, message: Message) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a route is
        none; a place that is not finite counts as lost."""
        if isinstance(message, RobotPlace):
            self._place, self._lost = message if message.is_sound else None, PLACE_UNKNOWN
        elif isinstance(message, PlaceLost):
            self._place, self._lost = None, f"{PLACE_UNKNOWN}: {message.reason}"
        elif isinstance(message, RouteToFollow):
            self._route, self._reached_m, self._standing = message.polyline(), 0.0, ""
        elif isinstance(message, ClearanceMap):
            self._map = message
        elif isinstance(message, HoldRobot):
            self._holds.receive(message)
        elif isinstance(message, StopRobot):
            # a lost route takes no operator's stop back
            if self._route is not None or message == StopRobot():
                self._route, self._standing = None, message.reason
        else:
            raise TypeError(f"a route follower does not know {type(message).__name__}")

    def step(self, now_s: float) -> Sequence[DriveCommand]:
        """The command of now."""
        reason = self._why_not(now_s)
        if reason:
            self._speed_mps, self._stepped_s = 0.0, now_s
            return [DriveCommand(0.0, 0.0, reason)]
        return [self._pursued(now_s)]

    def pause(self) -> None:
        """The robot is held by somebody else: it begins from standing."""
        self._speed_mps = 0.0

    def least_clear_m(self) -> float:
        """Measures the least clearance of what is left of the route; 0 where there is none, or no
        map."""
        if self._route is None or self._map is None:
            return 0.0
        along = np.append(
            np.arange(self._reached_m + 0.3, self._route.length_m, 0.05), self._route.length_m
        )
        return float(self._clear_m(self._route.at(along)).min())

    def _why_not(self, now_s: float) -> str:
        place, rules = self._place, self._rules
        if self._route is None:
            return self._standing
        if place is None:
            return self._lost
        ahead = ahead_of_clock(now_s, place.stamp_s)
        if ahead:  # nor does it count once the clock is as late again
            self._place, self._lost = None, f"the robot's place {ahead}"
            return self._lost
        if now_s - place.stamp_s > rules.oldest_place_s:
            return f"the robot's place is {now_s - place.stamp_s:.1f} s old"
        too_old = too_old_to_drive(now_s, self._map, rules.oldest_map_s)
        if too_old:
            return too_old
        clear_m = self._clear_m(np.array([[place.x_m, place.y_m]]))[0]
        if clear_m <= rules.sigmas * place.sigma_m and not self._leads_out_m():
            return f"the robot's place is known to {place.sigma_m:.2f} m, and {clear_m:.2f} m are clear"
        off_m = self._nearest(place)[1]
        if off_m > rules.most_off_m:
            return f"the robot is {off_m:.2f} m beside its route; plan it again"
        if np.hypot(*(self._route.points[-1] - [place.x_m, place.y_m])) <= rules.goal_m:
            if place.sigma_m > rules.goal_sigma_m:
                return f"the robot may be at the goal: its place is known to {place.sigma_m:.2f} m"
            self._route, self._standing = None, GOAL_REACHED
            return self._standing
        return self._holds.reason

    def _leads_out_m(self) -> float:
        """How far along its route the robot comes to where enough is clear, ever farther from what
        is not; 0 where it does not. A robot that cannot turn on the spot sweeps what is beside it."""
        rules, place = self._rules, self._place
        along = np.arange(0.0, rules.lead_m, 0.05)
        clear_m = self._clear_m(self._route.at(self._nearest(place)[0] + along))
        enough = clear_m > rules.sigmas * place.sigma_m
        if self._robot.turning_radius_m > 0 or not enough.any():
            return 0.0
        k = int(np.argmax(enough))
        nearer_m = np.maximum.accumulate(clear_m[: k + 1]) - clear_m[: k + 1]
        return float(along[k]) if nearer_m.max() <= 0.5 * self._map.grid.cell_m else 0.0

    def _pursued(self, now_s: float) -> DriveCommand:
        """Pure pursuit: the arc through a point of the route that lies ahead by a distance that
        grows with speed."""
        robot, place = self._robot, self._place
        self._reached_m = self._nearest(place)[0]
        off = self._looked_at() - [place.x_m, place.y_m]
        c, s = np.cos(place.yaw_rad), np.sin(place.yaw_rad)
        forward, left = c * off[0] + s * off[1], c * off[1] - s * off[0]
        bearing = float(np.arctan2(left, forward))
        elapsed_s = 0.0 if self._stepped_s is None else max(0.0, now_s - self._stepped_s)
        self._stepped_s = now_s
        if abs(bearing) > np.pi / 3 and robot.turning_radius_m == 0:
            self._speed_mps = 0.0
            return DriveCommand(
                0.0, float(np.clip(2.0 * bearing, -1, 1) * robot.turning_rate_radps)
            )
        curvature = 2.0 * left / max(float(off @ off), 1e-6)
        if robot.turning_radius_m > 0:
            curvature = float(
                np.clip(curvature, -1 / robot.turning_radius_m, 1 / robot.turning_radius_m)
            )
        wanted = self._wanted_mps(curvature)
        if wanted <= 0.0:
            self._speed_mps = 0.0
            return DriveCommand(
                0.0, 0.0, "what lies ahead on the route is not clear; plan it again"
            )
        self._speed_mps = float(
            min(wanted, self._speed_mps + robot.acceleration_mps2 * max(elapsed_s, 0.02))
        )
        return DriveCommand(self._speed_mps, self._speed_mps * curvature)

    def _looked_at(self) -> np.ndarray:
        """(2,): the point of the route to steer to; nearer where the straight way to it is not
        clear, so that corners are not cut too close."""
        rules, at = self._rules, np.array([self._place.x_m, self._place.y_m])
        ahead_m = rules.look_ahead_m + rules.look_ahead_s * self._speed_mps
        while True:
            point = self._route.at(self._reached_m + ahead_m)
            chord = at + np.linspace(0, 1, 12)[1:, None] * (point - at)
            if (
                ahead_m <= rules.least_ahead_m
                or (self._clear_m(chord) > rules.sigmas * self._place.sigma_m).all()
            ):
                return point
            ahead_m = max(rules.least_ahead_m, 0.7 * ahead_m)

    def _wanted_mps(self, curvature: float) -> float:
        """Gives the speed by the robot's own bound, the curvature, and the way to where it could
        stop before what is not clear."""
        robot, rules, place = self._robot, self._rules, self._place
        bounds = [robot.speed_mps]
        if abs(curvature) > 1e-6:
            bounds += [
                robot.turning_rate_radps / abs(curvature),
                np.sqrt(rules.lateral_mps2 / abs(curvature)),
            ]
        braking_m = (
            robot.speed_mps**2 / (2 * robot.slows_mps2) + robot.speed_mps * rules.oldest_place_s
        )
        left_m = self._route.length_m - self._reached_m
        # beyond its end the route is that end
        along = np.arange(0.0, min(braking_m + 0.5, max(left_m, 0.0) + 0.1), 0.05)
        points = self._route.at(self._reached_m + along)
        blocked = self._clear_m(points) <= rules.sigmas * place.sigma_m
        out_m = self._leads_out_m() if blocked[0] else 0.0
        blocked[along <= out_m] = False  # as far as that was judged before
        if out_m > 0:
            bounds.append(rules.creep_mps)
        room_m = min(
            float(along[int(np.argmax(blocked))]) - 0.1 if blocked.any() else np.inf, left_m
        )
        delay_m = rules.oldest_place_s * robot.slows_mps2
        reach = max(room_m, 0.0)
        bounds.append(-delay_m + np.sqrt(delay_m**2 + 2 * robot.slows_mps2 * reach))
        return float(min(bounds))

    def _clear_m(self, points: np.ndarray) -> np.ndarray:
        """(N,) m at points (N,2); 0 outside of the map."""
        row, column, inside = self._map.grid.cells_of(*points.T)
        return np.where(inside, self._map.clear_m[row, column], 0.0)

    def _nearest(self, place: RobotPlace) -> Tuple[float, float]:
        """How far along the route (m) its nearest point is, not far behind what was reached, and
        how far off (m)."""
        last_m = min(self._route.length_m, self._reached_m + 2.0)
        along = np.arange(max(0.0, self._reached_m - 0.5), last_m + 0.05, 0.05)
        points = self._route.at(along)
        off = np.hypot(*(points - [place.x_m, place.y_m]).T)
        k = int(np.argmin(off))
        return float(along[k]), float(off[k])


@dataclass(frozen=True)
class Polyline:
    """Straight pieces between ``points`` (N,2) and how far along it each is, ``run_m`` (N,)."""

    points: np.ndarray
    run_m: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray) -> "Polyline":
        return cls(points, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]))

    @property
    def length_m(self) -> float:
        return float(self.run_m[-1])

    def at(self, along_m) -> np.ndarray:
        """(...,2) at distances (...) m along it, at most its last point.

        >>> Polyline.of(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])).at(3.0).tolist()
        [2.0, 1.0]
        """
        return np.stack([np.interp(along_m, self.run_m, self.points[:, k]) for k in (0, 1)], -1)
