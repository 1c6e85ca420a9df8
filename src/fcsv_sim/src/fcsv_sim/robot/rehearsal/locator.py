# SPDX-License-Identifier: Apache-2.0
"""Where a rehearsed robot gets its place from: what its sensors send, and the tracker of the product
that hears it."""

from typing import Iterable, Protocol, Tuple

from fcsv_guidance.place.tracker import PlaceState, RobotTracker
from fcsv_sim.robot.drive import SimulatedRobot
from fcsv_sim.robot.fixes import DELAY_S, EVERY_S, TagReader

#: A step of simulated time (s), and what a message takes over the radio, one way (s).
STEP_S, RADIO_S = 0.05, 0.08


class RobotLocator(Protocol):
    """A port: messages that arrive and simulated time in, the robot's place out. ``settle_s``: so
    long the robot stands before it is given its goal."""

    settle_s: float

    def sense(self, now_s: float, machine: SimulatedRobot) -> Iterable[Tuple[float, object]]:
        """What its sensors see of the robot where it is now: (arrival, message)."""

    def receive(self, now_s: float, message: object) -> None:
        """A message of sense() or of the wheels arrived."""

    def step(self, now_s: float) -> PlaceState:
        """The place as of now."""


class TagFixes:
    """A vehicle follows the robot and reads its tag (System III)."""

    settle_s = 0.0

    def __init__(self, seed: int):
        self._reader, self._tracker = TagReader(seed), RobotTracker()

    def sense(self, now_s: float, machine: SimulatedRobot) -> Iterable[Tuple[float, object]]:
        """A fix, where it is time for one and the tag is read."""
        if not every(now_s, EVERY_S):
            return []
        fix = self._reader.read(now_s, machine.x_m, machine.y_m, machine.yaw_rad)
        return [] if fix is None else [(now_s + DELAY_S, fix)]

    def receive(self, now_s: float, message: object) -> None:
        """A message arrived."""
        self._tracker.receive(now_s, message)

    def step(self, now_s: float) -> PlaceState:
        """The place as of now."""
        return self._tracker.step(now_s)


def every(now_s: float, period_s: float) -> bool:
    """Whether a step of simulated time is one of a period's."""
    return round(now_s / STEP_S) % round(period_s / STEP_S) == 0
