# SPDX-License-Identifier: Apache-2.0
"""A robot on the ground that is guided, as drawn from above: cells, route, its place, and what is
said of it."""

import math
from dataclasses import dataclass
from typing import Optional, Tuple, Union

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import Aged, AgingFact


@dataclass(frozen=True)
class GuidedRobot:
    """``ground`` holds until another comes; an empty ``route_m``: there is none. ``words``: what
    guidance and the robot's follower said last."""

    ground: Optional[f.RobotGround] = None
    route_m: Tuple[Tuple[float, float], ...] = ()
    robot: Aged[f.RobotSeen] = Aged()
    words: str = ""

    @property
    def points_m(self) -> Tuple[Tuple[float, float], ...]:
        """Places (x, y) in home that the picture has to hold."""
        seen = self.robot.value
        return self.route_m if seen is None else (*self.route_m, (seen.x_m, seen.y_m))

    @property
    def name(self) -> str:
        """The robot's label."""
        return f"robot, {self.robot.words} old" if self.robot.stale else "robot"


RobotFact = Union[f.RobotGround, f.RobotRoute, f.RobotSeen, f.RobotStatus]


class GuidedRobotWatch:
    """The newest of each."""

    def __init__(self):
        self._ground: AgingFact[f.RobotGround] = AgingFact(math.inf)
        self._route: AgingFact[f.RobotRoute] = AgingFact(math.inf)
        self._seen: AgingFact[f.RobotSeen] = AgingFact()
        self._said = {}

    def tell(self, now_s: float, fact: RobotFact) -> None:
        """A fact of guidance came."""
        if isinstance(fact, f.RobotGround):
            self._ground.tell(now_s, fact)
        elif isinstance(fact, f.RobotRoute):
            self._route.tell(now_s, fact)
        elif isinstance(fact, f.RobotSeen):
            self._seen.tell(now_s, fact)
        else:
            self._said[fact.source] = fact.text

    def shown(self, now_s: float) -> GuidedRobot:
        """What is drawn at this moment."""
        route = self._route.value
        return GuidedRobot(
            self._ground.value,
            () if route is None else route.points_m,
            self._seen.at(now_s),
            "; ".join(text for _, text in sorted(self._said.items()) if text),
        )
