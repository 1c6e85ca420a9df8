# SPDX-License-Identifier: Apache-2.0
"""Guides a robot to a goal: maps become a route, the route is followed, and another is planned
where it closes.

A port: messages and monotonic time in, a Guidance out. Every doubt ends in a command to stand, with
its reason.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Deque, Optional, Sequence, Union

import numpy as np

from fcsv_guidance.errors import RouteError
from fcsv_guidance.following import (
    GOAL_REACHED,
    DriveCommand,
    FollowerRules,
    Goal,
    RobotPlace,
    RouteFollower,
    RouteToFollow,
    StopRobot,
)
from fcsv_guidance.known import MOVING_M, STILL_S, GroundSeen, KnownGround
from fcsv_guidance.place import PlaceState
from fcsv_guidance.planning import RouteRules, plan_clear
from fcsv_guidance.robot import Robot
from fcsv_guidance.route import NO_ROUTE_KNOWN, NoRoute, Route

IDLE, WAITING, DRIVING, NO_ROUTE, ARRIVED = "idle", "waiting", "driving", "no safe route", "arrived"
STATES = (IDLE, WAITING, DRIVING, NO_ROUTE, ARRIVED)


@dataclass(frozen=True)
class RobotContact:
    """Something came from the robot over the radio, sent at ``stamp_s``."""

    stamp_s: float


@dataclass(frozen=True)
class Guidance:
    """What the robot is told, and why: ``state`` is one of STATES, ``text`` a sentence for the
    operator. ``route`` and ``no_route`` are the last that was planned."""

    command: DriveCommand
    state: str
    text: str
    route: Optional[Route] = None
    no_route: Optional[NoRoute] = None


@dataclass(frozen=True)
class GuideRules:
    """``watched``: the robot drives only while views watch its place, none older than
    ``oldest_watch_s``; else maps serve for ``oldest_map_s``. Two plans are ``replan_s`` apart at
    least. The robot stands while something came nearer than ``moving_m`` in the last ``still_s``."""

    watched: bool = False
    oldest_map_s: float = 1800.0
    oldest_watch_s: float = 3.0
    oldest_radio_s: float = 0.5
    moving_m: float = MOVING_M
    still_s: float = STILL_S
    replan_s: float = 1.0
    retry_s: float = 5.0
    route: RouteRules = field(default_factory=RouteRules)
    follower: FollowerRules = field(default_factory=FollowerRules)


Message = Union[GroundSeen, PlaceState, Goal, StopRobot, RobotContact]


class RobotGuide:
    """Guides ``robot`` over the ground that it is told of."""

    def __init__(self, robot: Robot, rules: GuideRules = GuideRules()):
        oldest_s = rules.oldest_watch_s if rules.watched else rules.oldest_map_s
        self._robot, self._rules = robot, rules
        self._follower = RouteFollower(robot, replace(rules.follower, oldest_map_s=oldest_s))
        self.known = KnownGround(robot)
        self._places: Deque[RobotPlace] = deque(maxlen=200)
        self._place = PlaceState(None, "no place has come", np.inf, 0, 0, "")
        self._goal: Optional[Goal] = None
        self._route: Optional[Route] = None
        self._none: Optional[NoRoute] = None
        self._state, self._text = IDLE, "no goal was given"
        self._planned_s, self._planned_version, self._heard_s = -np.inf, -1, -np.inf

    def receive(self, now_s: float, message: Message) -> None:
        """A message came. Raises TypeError where its type is not known, RouteError where a goal is
        not finite, GroundError where a view does not fit those before."""
        if isinstance(message, PlaceState):
            self._place = message
            if message.place is not None:
                self._places.append(message.place)
                self._follower.receive(now_s, message.place)
        elif isinstance(message, GroundSeen):
            self._on_view(now_s, message)
        elif isinstance(message, RobotContact):
            self._heard_s = max(self._heard_s, message.stamp_s)
        elif isinstance(message, Goal):
            message.require_finite()
            self._goal, self._route, self._none = message, None, None
            self._planned_s = -np.inf
        elif isinstance(message, StopRobot):
            self._goal, self._route, self._none = None, None, None
            self._follower.receive(now_s, message)
            self._state, self._text = IDLE, "stopped by the operator; give a goal to drive on"
        else:
            raise TypeError(f"a robot's guide does not know {type(message).__name__}")

    def step(self, now_s: float) -> Sequence[Guidance]:
        """What the robot is told now."""
        if self._goal is None:
            return [self._standing(self._state, self._text)]
        doubt = self._doubt(now_s)
        if doubt:
            return [self._standing(WAITING, doubt)]
        command = None if self._route is None else self._follower.step(now_s)[0]
        if command is not None and command.reason == GOAL_REACHED:
            self._goal, self._route = None, None
            self._state, self._text = ARRIVED, command.reason
            return [self._standing(ARRIVED, command.reason)]
        if self._wants_plan(now_s, command):
            self._plan(now_s)
            command = None if self._route is None else self._follower.step(now_s)[0]
        if command is None:
            state, reason = (
                (WAITING, "a route is planned")
                if self._none is None
                else (NO_ROUTE, self._none.reason)
            )
            return [self._standing(state, reason)]
        rules = self._rules
        moves = self.known.moving(now_s, self._place.place, rules.moving_m, rules.still_s)
        if moves:
            return [self._standing(WAITING, moves)]
        state = WAITING if command.reason else DRIVING
        return [
            Guidance(command, state, command.reason or "the robot drives", self._route, self._none)
        ]

    def _standing(self, state: str, text: str) -> Guidance:
        self._follower.pause()
        return Guidance(DriveCommand(0.0, 0.0, text), state, text, self._route, self._none)

    def _on_view(self, now_s: float, seen: GroundSeen) -> None:
        near = min(self._places, key=lambda p: abs(p.stamp_s - seen.stamp_s), default=None)
        if near is None and seen.compared is not None:
            # the robot, which the picture may show, would be a thing that came
            seen = replace(seen, compared=seen.compared.without_things())
        self.known.receive(seen, near)
        self._follower.receive(now_s, self.known.clearance(self._seen_s()))

    def _seen_s(self) -> float:
        return self.known.oldest_watch_s if self._rules.watched else self.known.newest_map_s

    def _doubt(self, now_s: float) -> str:
        """Why the robot may not drive, whatever its route is; empty where it may."""
        rules, place = self._rules, self._place.place
        if now_s - self._heard_s > rules.oldest_radio_s:
            return "the robot is not heard over the radio"
        if place is None:
            return f"the robot's place is not known: {self._place.reason}"
        if now_s - place.stamp_s > rules.follower.oldest_place_s:
            return f"the robot's place is {now_s - place.stamp_s:.1f} s old"
        if self.known.grid is None:
            return "no map has come"
        if self._place.hold:
            return self._place.hold
        age_s = now_s - self._seen_s()
        if rules.watched and age_s > rules.oldest_watch_s:
            return (
                "nobody watches the place"
                if not np.isfinite(age_s)
                else f"the place was seen {age_s:.1f} s ago"
            )
        return "the maps are too old; look at the place again" if age_s > rules.oldest_map_s else ""

    def _wants_plan(self, now_s: float, command: Optional[DriveCommand]) -> bool:
        """Where there is no route, or the one there is closed or cannot be followed; ``command``:
        the follower's."""
        since_s = now_s - self._planned_s
        changed = self.known.version != self._planned_version
        if command is not None and changed and not self._is_clear():
            return True  # the answer to a way that closes does not wait
        if since_s < self._rules.replan_s:
            return False
        if command is None:
            return changed or since_s > self._rules.retry_s
        return bool(command.reason)

    def _is_clear(self) -> bool:
        """Whether what is left of the route keeps clear of what is known now."""
        return (
            self._follower.least_clear_m() > self._rules.follower.sigmas * self._place.place.sigma_m
        )

    def _plan(self, now_s: float) -> None:
        """A route from where the robot is; where there is none, the robot stands and says so."""
        place = self._place.place
        self._planned_s, self._planned_version = now_s, self.known.version
        start_m, goal_m = (place.x_m, place.y_m), (self._goal.x_m, self._goal.y_m)
        found = plan_over(self.known, start_m, goal_m, place.sigma_m, self._rules)
        if isinstance(found, NoRoute):
            self._route, self._none = None, found
            return
        self._route, self._none = found, None
        self._follower.receive(now_s, RouteToFollow(found.points_home_m))


def plan_over(
    known: KnownGround, start_m, goal_m, place_sigma_m: float, rules: GuideRules = GuideRules()
):
    """A Route over what is known, or a NoRoute; also where no robot can stand at start or goal."""
    try:
        return plan_clear(known.grid, known.stands, start_m, goal_m, place_sigma_m, rules.route)
    except RouteError as error:
        return NoRoute(f"{NO_ROUTE_KNOWN}: {error}", np.empty((0, 2), int))
