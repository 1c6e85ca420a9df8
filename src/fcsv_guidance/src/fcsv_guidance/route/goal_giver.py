# SPDX-License-Identifier: Apache-2.0
"""Gives a robot that plans for itself (``move_base``) the goals along a route, one after the other.

A port: messages and time in, goals and their end out.
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Union

import numpy as np

from fcsv_geometry.config import require_positive
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.messages import GroundDated, HoldRobot, PlaceLost, RobotPlace, StopRobot
from fcsv_guidance.route.following import (
    PLACE_UNKNOWN,
    Holds,
    Polyline,
    RouteToFollow,
    too_old_to_drive,
)


@dataclass(frozen=True)
class GoalEnded:
    """``move_base`` is done with goal ``number``: whether it is reached, and what it said."""

    number: int
    reached: bool
    text: str


@dataclass(frozen=True)
class GiveGoal:
    """Goal ``number``: x, y (m), yaw (rad) in home."""

    number: int
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True)
class CancelGoal:
    """The robot shall stand, for this reason."""

    reason: str


@dataclass(frozen=True)
class GivingRules:
    """Where goals lie, and what ends them."""

    apart_m: float = 3.0  # along the route, from goal to goal
    near_m: float = 1.0  # so near a goal the next is given
    oldest_place_s: float = 1.0
    oldest_map_s: float = 60.0  # older ground holds the robot
    most_off_m: float = 1.0  # beside the route

    def __post_init__(self):
        require_positive(self)


class GoalGiver:
    """Goals along the last route that came."""

    def __init__(self, rules: GivingRules = GivingRules()):
        self._rules = rules
        self._route: Optional[Polyline] = None
        self._place: Optional[RobotPlace] = None
        self._lost = PLACE_UNKNOWN  # why, where it is None
        self._given: Optional[GiveGoal] = None
        self._given_at_m, self._before_m, self._number = 0.0, 0.0, 0
        self._holds = Holds()
        self._ground: Optional[GroundDated] = None
        self._too_old = ""
        self.text = "no route has come"
        self._ended: Optional[GoalEnded] = None
        self._due: List[CancelGoal] = []

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a route is
        none."""
        if isinstance(message, RobotPlace):
            self._place, self._lost = message if message.is_sound else None, PLACE_UNKNOWN
        elif isinstance(message, PlaceLost):
            self._place, self._lost = None, f"{PLACE_UNKNOWN}: {message.reason}"
        elif isinstance(message, RouteToFollow):
            self._route, self._given = message.polyline(), None
            self._given_at_m = self._before_m = 0.0
            self._ended = None
        elif isinstance(message, GroundDated):
            self._ground = message
        elif isinstance(message, HoldRobot):
            self._holds.receive(message)
        elif isinstance(message, GoalEnded):
            self._ended = message
        elif isinstance(message, StopRobot):
            if self._route is not None or message == StopRobot():  # as in RouteFollower
                self._end(message.reason)
        else:
            raise TypeError(f"a giver of goals does not know {type(message).__name__}")

    def step(self, now_s: float) -> Sequence[Union[GiveGoal, CancelGoal]]:
        """What move_base is told now."""
        if self._route is not None:
            doubt = self._doubt(now_s)
            if doubt:
                self._end(doubt)
        too_old = too_old_to_drive(now_s, self._ground, self._rules.oldest_map_s)
        self._too_old = too_old and (self._too_old or too_old)  # said once: the age counts up
        held = self._too_old or self._holds.reason
        if self._route is not None and held:
            self._cancel(held)
        due, self._due = self._due, []
        if due or self._route is None or held:
            return due
        if self._given is None or self._is_due():
            return self._next()
        return []

    def _doubt(self, now_s: float) -> str:
        place, rules = self._place, self._rules
        if place is None:
            return f"{self._lost}; plan the route again when it is"
        ahead = ahead_of_clock(now_s, place.stamp_s)
        if ahead:
            return f"the robot's place {ahead}; then plan the route again"
        if now_s - place.stamp_s > rules.oldest_place_s:
            return f"the robot's place is {now_s - place.stamp_s:.1f} s old; plan the route again when it is known"
        along = self._route.at(np.arange(0.0, self._route.length_m + 0.1, 0.1))
        off_m = float(np.hypot(*(along - [place.x_m, place.y_m]).T).min())
        if off_m > rules.most_off_m:
            return f"the robot is {off_m:.1f} m beside its route; plan it again"
        ended = self._ended
        if (
            ended is not None
            and self._given is not None
            and ended.number == self._given.number
            and not ended.reached
        ):
            return f"move_base gave up ({ended.text}); plan the route again"
        return ""

    def _end(self, reason: str) -> None:
        self._cancel(reason)
        self._route = None

    def _cancel(self, reason: str) -> None:
        """The goal is given again, where the route stays."""
        if self._given is not None:
            self._due.append(CancelGoal(reason))
            self._given_at_m = self._before_m
        self._given, self.text = None, reason

    def _is_due(self) -> bool:
        """Whether the next goal is to be given, or the last one was reached."""
        ended = self._ended
        reached = ended is not None and ended.number == self._given.number and ended.reached
        if self._given_at_m >= self._route.length_m:
            if reached:
                self._route, self._given, self.text = None, None, "the goal is reached"
            return False
        left_m = np.hypot(self._given.x_m - self._place.x_m, self._given.y_m - self._place.y_m)
        return reached or left_m <= self._rules.near_m

    def _next(self) -> Sequence[GiveGoal]:
        at_m = min(self._given_at_m + self._rules.apart_m, self._route.length_m)
        if self._route.length_m - at_m < 0.5 * self._rules.apart_m:
            at_m = self._route.length_m
        here, before = self._route.at(at_m), self._route.at(at_m - 0.2)
        self._number += 1
        yaw_rad = float(np.arctan2(here[1] - before[1], here[0] - before[0]))
        self._before_m, self._given_at_m = self._given_at_m, at_m
        self._given = GiveGoal(self._number, float(here[0]), float(here[1]), yaw_rad)
        self.text = f"goal {self._number}: {at_m:.1f} of {self._route.length_m:.1f} m"
        return [self._given]
