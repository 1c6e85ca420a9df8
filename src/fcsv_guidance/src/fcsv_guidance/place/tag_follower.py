# SPDX-License-Identifier: Apache-2.0
"""A vehicle follows a robot so that its camera reads the tags on it (thesis 7.1, figure 2.10).

A port: where the camera is and what it reads, where the robot is and shall drive, and monotonic time
in; where the vehicle shall fly out. It flies to the place that shows most of the way ahead, at its
own height until it is near, and stays there while that place shows enough.
"""

from dataclasses import dataclass, field
from typing import List, Optional, Tuple, Union

import numpy as np

from fcsv_geometry import rotations
from fcsv_geometry.config import require_positive
from fcsv_guidance.errors import RouteError
from fcsv_guidance.ground.model import Ground
from fcsv_guidance.messages import RobotPlace
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.following import Polyline, RouteToFollow
from fcsv_guidance.route.vantage import (
    Vantage,
    VantageRules,
    best_vantage,
    clear_height_m,
    shown_to,
)

_EVERY_M = 0.5  # along the robot's way
_RISES_M = 0.3  # a vehicle that must be so much higher goes up first


@dataclass(frozen=True)
class TagFollowRules:
    """The vehicle is sent on where its place shows less than ``enough`` of the robot's way, once
    another shows more by ``better``, or where it has read no tag for ``unread_s``; by ``step_m`` at
    once (a mission's Following takes 6 m), every ``every_s``. It is there within ``near_m`` and
    ``near_deg``; where it has not moved for ``moves_s`` another place is taken for
    ``refused_s``. A camera older than ``oldest_s`` says nothing."""

    vantage: VantageRules = field(default_factory=VantageRules)
    enough: float = 0.7
    better: float = 0.1
    unread_s: float = 4.0
    step_m: float = 5.0
    every_s: float = 2.0
    near_m: float = 0.8
    near_deg: float = 8.0
    moves_s: float = 20.0
    refused_s: float = 60.0
    oldest_s: float = 2.0

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class FollowingCamera:
    """A picture of the vehicle: its camera's ``T_home_cam`` (4,4), and whether it ``reads`` a tag of
    the robot."""

    stamp_s: float
    T_home_cam: np.ndarray
    reads: bool


@dataclass(frozen=True)
class InitialPlace:
    """Somebody says about where the robot stands, x and y in home (m): nothing has read its tags
    yet."""

    x_m: float
    y_m: float


@dataclass(frozen=True)
class FlyCamera:
    """The vehicle's camera shall be at ``p_home_cam`` (3,) m, its level view turned by ``yaw_rad`` to
    the left of home's x."""

    p_home_cam: np.ndarray
    yaw_rad: float


FollowerMessage = Union[FollowingCamera, InitialPlace, RobotPlace, RouteToFollow]


class TagFollower:
    """Keeps one vehicle where it reads the tags of ``robot``."""

    def __init__(self, robot: Robot, rules: TagFollowRules = TagFollowRules()):
        self._rules = rules
        self._tag_z_m = float(np.mean([tag.T_body_tag[2, 3] for tag in robot.tags]))
        self._camera: Optional[FollowingCamera] = None
        self._camera_s = self._read_s = self._asked_s = -np.inf
        self._looks_s: Optional[float] = None  # since when its place should show the robot
        self._robot: Optional[Tuple[float, float]] = None
        self._route: Optional[Polyline] = None
        self._target: Optional[Vantage] = None
        self._in_vain: List[np.ndarray] = []  # places (3,) from which nothing was read
        self._stays: Optional[Tuple[float, np.ndarray]] = None  # asked to go, since when and where
        self._refused: List[Tuple[float, np.ndarray]] = []  # places (3,), until when (s)
        self._stuck = ""
        #: what is wrong, for the operator; empty where nothing is
        self.problem = ""

    def receive(self, now_s: float, message: FollowerMessage) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a route is
        none."""
        if isinstance(message, FollowingCamera):
            if not np.isfinite(message.T_home_cam).all():
                raise RouteError("the pose of the vehicle that follows is not finite")
            self._camera, self._camera_s = message, now_s
            if message.reads:
                self._read_s, self._in_vain = now_s, []
        elif isinstance(message, InitialPlace):
            if not np.isfinite([message.x_m, message.y_m]).all():
                raise RouteError("the robot's start is not finite; give x and y in home (m)")
            self._robot, self._target, self._in_vain = (message.x_m, message.y_m), None, []
            self._route = None
        elif isinstance(message, RobotPlace):
            if message.is_sound:
                self._robot = message.x_m, message.y_m
        elif isinstance(message, RouteToFollow):
            self._route = message.polyline() if len(message.points_home_m) else None
        else:
            raise TypeError(f"a vehicle that follows does not know {type(message).__name__}")

    def step(
        self, now_s: float, ground: Optional[Ground], eye_m: Optional[np.ndarray] = None
    ) -> Optional[FlyCamera]:
        """Where the vehicle shall fly now; None where it stays, or nobody can say. ``eye_m`` (3,): of a
        camera that watches the robot."""
        missing = self._missing(now_s, ground)
        if missing or now_s - self._asked_s < self._rules.every_s:
            self.problem = missing or self.problem
            return None
        here = self._here
        self._watch_moves(now_s, here)
        self.problem = self._stuck
        self._choose(now_s, ground, self._tags_ahead(ground), here, eye_m)
        target = self._target
        if target is None or self._is_at(target, here):
            self._stays = None
            return None
        self._stays = self._stays or (now_s, here.p_home_cam)
        self._asked_s = now_s
        return self._towards(ground, target, here)

    def _watch_moves(self, now_s: float, here: Vantage) -> None:
        """Where the vehicle does not go where it is asked to, says so and takes another place."""
        rules = self._rules
        self._refused = [(until_s, p_m) for until_s, p_m in self._refused if until_s > now_s]
        if self._stays is None:
            return
        if np.linalg.norm(here.p_home_cam - self._stays[1]) > rules.near_m:
            self._stays, self._stuck = None, ""
        elif now_s - self._stays[0] > rules.moves_s and self._target is not None:
            self._refused.append((now_s + rules.refused_s, self._target.p_home_cam))
            self._stays = self._target = None
            self._stuck = (
                "the vehicle does not go where it is asked to: is a mission with follow_s flown, and "
                "what does it say (/mission/state)?"
            )

    def _missing(self, now_s: float, ground: Optional[Ground]) -> str:
        if ground is None:
            return "no map has come: nobody knows what hides the robot's tags"
        if self._camera is None or now_s - self._camera_s > self._rules.oldest_s:
            return "no picture with a pose has come from the vehicle that follows"
        if self._robot is None:
            return (
                "nobody knows where the robot stands: give a 2D Pose Estimate in rviz (initialpose)"
            )
        return ""

    @property
    def _here(self) -> Vantage:
        T = self._camera.T_home_cam
        return Vantage(T[:3, 3], float(np.arctan2(T[1, 2], T[0, 2])), 0.0)

    def _tags_ahead(self, ground: Ground) -> np.ndarray:
        """(N,3): the robot's tags where it is, and along its route."""
        xy = np.array([self._robot])
        if self._route is not None:
            points = self._route.at(np.arange(0.0, self._route.length_m, _EVERY_M))
            off_m, ahead_m = np.hypot(*(points - xy).T), self._rules.vantage.ahead_m
            nearest = int(np.argmin(off_m))
            ahead = points[nearest + 1 : nearest + 1 + int(ahead_m / _EVERY_M)]
            if off_m[nearest] < ahead_m:  # else it is no more the robot's
                xy = np.concatenate([xy, ahead])
        row, column, inside = ground.grid.cells_of(*xy.T)
        z_m = np.where(inside, ground.height_m[row, column], np.nan)
        known = z_m[np.isfinite(z_m)]
        level_m = float(known.mean() if len(known) else np.nanmedian(ground.height_m))
        z_m = np.where(np.isfinite(z_m), z_m, level_m)
        return np.column_stack([xy, z_m + self._tag_z_m])

    def _choose(
        self,
        now_s: float,
        ground: Ground,
        tags_m: np.ndarray,
        here: Vantage,
        eye_m: Optional[np.ndarray],
    ) -> None:
        """Keeps the target, or takes a better one."""
        rules = self._rules
        is_there = self._target is None or self._is_at(self._target, here)
        shows = shown_to(ground, tags_m, here if is_there else self._target, rules.vantage)
        if self._looks_s is None or not is_there or shows == 0:
            self._looks_s = now_s
        if now_s - max(self._read_s, self._looks_s) > rules.unread_s:
            self._in_vain.append(here.p_home_cam)
            self._looks_s, shows = now_s, 0.0
        if shows >= rules.enough:
            return
        but = [*self._in_vain, *(p_m for _, p_m in self._refused)]
        best = best_vantage(ground, tags_m, here, rules.vantage, but, eye_m)
        if best is None:
            self._in_vain = []  # next time all are tried again
            self.problem = (
                "no place shows the robot's tags: no ground is known there, what stands there is too "
                "high, or hides them"
            )
        elif best.sees > shows + rules.better:
            self._target = best

    def _is_at(self, target: Vantage, here: Vantage) -> bool:
        off_m = float(np.linalg.norm(target.p_home_cam - here.p_home_cam))
        turned = abs(rotations.wrap(target.yaw_rad - here.yaw_rad))
        return off_m <= self._rules.near_m and turned <= np.radians(self._rules.near_deg)

    def _towards(self, ground: Ground, target: Vantage, here: Vantage) -> FlyCamera:
        """One step: up before it flies over what is higher, down at its end only, where the ground is
        known best."""
        rules, off = self._rules, target.p_home_cam - here.p_home_cam
        level_m, z_m = float(np.hypot(off[0], off[1])), float(target.p_home_cam[2])
        if level_m > rules.step_m:
            over_m = clear_height_m(ground, here.p_home_cam[:2], rules.vantage)
            z_m = max(z_m, float(here.p_home_cam[2]), over_m)
        if z_m - here.p_home_cam[2] > _RISES_M:
            return FlyCamera(np.array([*here.p_home_cam[:2], z_m]), target.yaw_rad)
        xy = here.p_home_cam[:2] + off[:2] * min(1.0, rules.step_m / max(level_m, 1e-6))
        return FlyCamera(np.array([*xy, z_m]), target.yaw_rad)
