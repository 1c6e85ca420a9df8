# SPDX-License-Identifier: Apache-2.0
"""What guides a rehearsed robot: the ports of ground_map and route_follower as guidance.launch wires
them. Its topics deliver at once."""

from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import DriveCommand, Goal, HoldRobot, StopRobot
from fcsv_guidance.place.tracker import PlaceState
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.following import GOAL_REACHED, FollowerRules, RouteFollower, RouteToFollow
from fcsv_guidance.route.grid_regions import clearance_map, with_region
from fcsv_guidance.route.ground_server import (
    GoalDropped,
    GridChanged,
    GridMessage,
    GroundRules,
    GroundServer,
    MapSeen,
    NoRouteMessage,
    RobotHold,
    RouteMessage,
)
from fcsv_guidance.route.search import NO_ROUTE_KNOWN
from fcsv_sim.robot.rehearsal.locator import every

WAITING, DRIVING, NO_ROUTE, ARRIVED = "waiting", "driving", "no safe route", "arrived"
_PERIOD_S = 0.2  # of ground_map
# of maps, and of a watch as guidance.launch has it
_OLDEST_MAP_S, _OLDEST_WATCH_S = 1800.0, 3.0


@dataclass(frozen=True)
class Guidance:
    """What the robot is told, and why: ``state`` is WAITING, DRIVING, NO_ROUTE or ARRIVED, ``text`` a
    sentence. ``route_m`` (N,2): the last route; None before the first. ``asks``: it stands until
    somebody looked and gives the goal again."""

    command: DriveCommand
    state: str
    text: str
    route_m: Optional[np.ndarray]
    asks: bool


class GuidanceBus:
    """Guides ``robot`` over the ground that ``maps`` show. ``watched``: it drives only while views
    watch the place."""

    def __init__(self, robot: Robot, rules: GroundRules, maps: Sequence[DepthView]):
        oldest_s = _OLDEST_WATCH_S if rules.watched else _OLDEST_MAP_S
        self._server = GroundServer(robot, rules)
        self._follower = RouteFollower(robot, FollowerRules(oldest_map_s=oldest_s))
        self._server.receive(0.0, MapSeen(maps[0], others=tuple(maps[1:])))
        self._percents, self._hold, self._due = np.zeros((0, 0), np.int8), "", True
        self._route_m: Optional[np.ndarray] = None
        self._none, self._asks = "", False

    @property
    def server(self) -> GroundServer:
        """What knows the ground."""
        return self._server

    def receive(self, now_s: float, message: object) -> None:
        """A message came on one of the nodes' topics: a PlaceState, a DepthView of the watch, a
        Goal, or StopRobot."""
        if isinstance(message, PlaceState):
            if message.place is not None:
                self._server.receive(now_s, message.place)
                self._follower.receive(now_s, message.place)
            if message.hold != self._hold:
                self._hold = message.hold
                self._follower.receive(now_s, HoldRobot(message.hold, "place/hold"))
            return
        self._due = True
        if isinstance(message, StopRobot):
            self._server.receive(now_s, GoalDropped(message.reason))
            self._follower.receive(now_s, message)
        elif isinstance(message, DepthView):
            try:
                self._server.receive(now_s, MapSeen(message, watching=True))
            except GroundError:
                pass  # the next may do
        elif isinstance(message, Goal):
            self._server.receive(now_s, message)
        else:
            raise TypeError(f"no node of guidance hears {type(message).__name__}")

    def step(self, now_s: float) -> Guidance:
        """What the robot is told now."""
        if self._due or every(now_s, _PERIOD_S):
            self._due = False
            for output in [*self._server.pending(), *self._server.step(now_s)]:
                self._deliver(now_s, output)
        (command,) = self._follower.step(now_s)
        text = self._none or command.reason or "the robot drives"
        if command.reason == GOAL_REACHED:
            state = ARRIVED
        elif self._none:
            state = NO_ROUTE
        else:
            state = WAITING if command.reason else DRIVING
        return Guidance(command, state, text, self._route_m, self._asks)

    def _deliver(self, now_s: float, output: object) -> None:
        """Passes on what ground_map publishes to route_follower."""
        if isinstance(output, (GridMessage, GridChanged)):
            if isinstance(output, GridMessage):
                self._percents = output.stands
            else:
                self._percents = with_region(self._percents, output.stands)
            grid = self._server.whole_grid.grid
            told: object = clearance_map(output.stamp_s, grid, self._percents)
        elif isinstance(output, RouteMessage):
            self._route_m, self._none = output.points_home_m, ""
            told = RouteToFollow(output.points_home_m)
        elif isinstance(output, NoRouteMessage):
            self._none = "" if output.waits else output.reason
            told = StopRobot(NO_ROUTE_KNOWN)
        elif isinstance(output, RobotHold):
            told, self._asks = HoldRobot(output.reason, "hold"), output.asks
        else:
            raise TypeError(f"ground_map publishes no {type(output).__name__}")
        self._follower.receive(now_s, told)
