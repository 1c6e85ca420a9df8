# SPDX-License-Identifier: Apache-2.0
"""Whether a robot that was sent to a goal arrived, stands, or touched something.

A port: what guidance publishes and monotonic time in; the goal, and at the end a SentDrive out.
"""

from dataclasses import asdict, dataclass, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_sim.robot.reaction import WayClosed, WayWatch

ARRIVED, CONTACT, NO_ROUTE, STANDS, TIME = (
    "arrived",
    "contact",
    "no safe route",
    "stands",
    "not there in time",
)


@dataclass(frozen=True)
class DriveLimits:
    """When a drive is over. ``settle_s``: both nodes have the map and the robot stands still, so
    that its place is known; ``arrived_m``: from the goal, standing."""

    settle_s: float = 8.0
    arrived_m: float = 0.6
    stands_s: float = 20.0
    no_route_s: float = 12.0
    longest_s: float = 300.0
    starts_s: float = 60.0  # until a grid and the robot's place are there


@dataclass(frozen=True)
class SentDrive:
    """How it ended, one of the words above, and why: the last words of guidance. ``routes``: each
    (N,2) in home; ``words``: what was said, with s since the goal was given; ``closed``: fields of
    the WayClosed, None where no way closed."""

    ended: str
    text: str
    goal_m: Tuple[float, float]
    began_s: float
    drove_s: float
    routes: List[List[Tuple[float, float]]]
    words: List[Tuple[float, str, str]]
    closed: Optional[Dict[str, Optional[float]]] = None

    @property
    def says_why(self) -> bool:
        """Whether the robot arrived, or guidance gave a reason for which it did not."""
        return self.ended == ARRIVED or (self.ended in (NO_ROUTE, STANDS) and bool(self.text))

    @property
    def way_closed(self) -> Optional[WayClosed]:
        """How a way that closed was answered; None where none closed."""
        return None if self.closed is None else WayClosed(**self.closed)


class SentRobot:
    """Sends a robot to ``goal_m`` (x, y in home) once a grid is there and its place is known."""

    def __init__(self, goal_m: Tuple[float, float], limits: DriveLimits = DriveLimits()):
        self._goal_m, self._limits = (float(goal_m[0]), float(goal_m[1])), limits
        self._grid = False
        self._at: Optional[Tuple[float, float]] = None
        self._ready_s: Optional[float] = None
        self._made_s: Optional[float] = None
        self._given_s: Optional[float] = None
        self._stood_s: Optional[float] = None
        self._none_s: Optional[float] = None
        self._routes: List[List[Tuple[float, float]]] = []
        self._words: List[Tuple[float, str, str]] = []
        self._touched = ""
        self.way = WayWatch()

    def on_grid(self) -> None:
        """A grid came."""
        self._grid = True

    def on_place(self, x_m: float, y_m: float) -> None:
        """The robot's place came, in home."""
        self._at = (x_m, y_m)

    def on_command(self, now_s: float, speed_mps: float, turning_radps: float) -> None:
        """A command to the robot was heard."""
        self.way.on_command(now_s, bool(speed_mps or turning_radps))
        if speed_mps or turning_radps:
            self._stood_s = None
        elif self._stood_s is None:
            self._stood_s = now_s

    def on_route(self, now_s: float, points_home_m: np.ndarray) -> None:
        """A route came; an empty one says that there is none."""
        if self._given_s is None:
            return
        self.way.on_route(now_s, len(points_home_m) > 0)
        if len(points_home_m):
            self._routes.append([(float(x), float(y)) for x, y in points_home_m])
            self._none_s = None
        elif self._none_s is None:
            self._none_s = now_s

    def on_words(self, now_s: float, topic: str, text: str) -> None:
        """A node said something."""
        if self._given_s is not None:
            self._words.append((round(now_s - self._given_s, 2), topic, text))

    def on_touched(self, text: str) -> None:
        """The robot touched something."""
        self._touched = text

    def step(self, now_s: float) -> Tuple[Optional[Tuple[float, float]], Optional[SentDrive]]:
        """The goal where it is to be given now, and the drive where it is over."""
        self._made_s = now_s if self._made_s is None else self._made_s
        if self._given_s is not None:
            return None, self._over(now_s)
        if not self._grid or self._at is None:
            late = now_s - self._made_s > self._limits.starts_s
            missing = "the robot's place is not known" if self._grid else "no grid has come"
            return None, self._drive(now_s, STANDS, missing) if late else None
        self._ready_s = now_s if self._ready_s is None else self._ready_s
        if now_s - self._ready_s < self._limits.settle_s:
            return None, None
        self._given_s, self._stood_s = now_s, None
        return self._goal_m, None

    def _over(self, now_s: float) -> Optional[SentDrive]:
        limits, stood_s = self._limits, 0.0 if self._stood_s is None else now_s - self._stood_s
        if self._touched:
            return self._drive(now_s, CONTACT, self._touched)
        off_m = float(np.hypot(self._at[0] - self._goal_m[0], self._at[1] - self._goal_m[1]))
        if self._routes and stood_s > 1.0 and off_m <= limits.arrived_m:
            return self._drive(now_s, ARRIVED, self._last_words())
        if self._none_s is not None and now_s - self._none_s > limits.no_route_s:
            return self._drive(now_s, NO_ROUTE, self._last_words("status"))
        if stood_s > limits.stands_s:
            return self._drive(now_s, STANDS, self._last_words())
        return self._drive(now_s, TIME, "") if now_s - self._given_s > limits.longest_s else None

    def _last_words(self, topic: str = "follower/status") -> str:
        return next((text for _, of, text in reversed(self._words) if of == topic), "")

    def _drive(self, now_s: float, ended: str, text: str) -> SentDrive:
        given_s = now_s if self._given_s is None else self._given_s
        drive = SentDrive(
            ended, text, self._goal_m, given_s, now_s - given_s, self._routes, self._words
        )
        closed = self.way.closed
        return drive if closed is None else replace(drive, closed=asdict(closed))
