# SPDX-License-Identifier: Apache-2.0
"""A simulated robot in its place: its wheels, what it touches, and fixes of it in home.

A port: commands and monotonic time in, a RobotSense out.
"""

from dataclasses import dataclass, replace
from typing import List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.place.tracker import PlaceFix, WheelOdometry
from fcsv_guidance.robot import Robot
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.drive import SimulatedRobot, WheelFlaws
from fcsv_sim.robot.fixes import DELAY_S, EVERY_S, TagReader
from fcsv_sim.robot.things import Box
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.place import PlacePlan
from fcsv_sim.world.town import PLACES, Town


@dataclass(frozen=True)
class RobotSense:
    """What the wheels say, which fixes arrive now, where the robot truly is (x, y in m, yaw in rad;
    world), the room beside its footprint (m), and where it touched something (world; None)."""

    wheels: WheelOdometry
    fixes: Tuple[PlaceFix, ...]
    at: Tuple[float, float, float]
    room_m: float
    touched_m: Tuple[float, ...]


class PlacedRobot:
    """Stands at the start of ``town`` and obeys commands; what it touches ends its drive.

    ``T_world_home`` is level: fixes are given in home, where it carries a ``tag``. ``yaw_rad``: how
    it stands, anyhow where None. The same seed and commands give the same way.
    """

    def __init__(
        self,
        robot: Robot,
        town: Town,
        T_world_home: np.ndarray,
        seed: int,
        yaw_rad: Optional[float] = None,
        tag: bool = True,
    ):
        plan = place_of(town)
        random = np.random.default_rng([seed, 24])
        footing = Footing.of(plan)
        self._true = TrueGround(footing, footing.clearance(robot))
        anyhow_rad = random.uniform(-np.pi, np.pi)
        at = (*plan.start_m, anyhow_rad if yaw_rad is None else yaw_rad)
        self._machine = SimulatedRobot(robot, at, WheelFlaws.drawn(random), seed)
        self._reader, self._tag = TagReader(seed), tag
        self._T_home_world = transforms.invert(transforms.level(T_world_home))
        self._coming: List[PlaceFix] = []
        self._read_s = 0.0
        self._touched_m: Tuple[float, ...] = ()

    def receive(self, now_s: float, command: DriveCommand) -> None:
        """A command came; ``now_s`` counts from the robot's start."""
        if not self._touched_m:
            self._machine.command(now_s, command)

    def step(self, now_s: float, box: Optional[Box] = None) -> RobotSense:
        """Drive until a time; ``box`` is what stands in the way then."""
        machine = self._machine
        machine.step(now_s)
        at = machine.x_m, machine.y_m, machine.yaw_rad
        room_m = self._true.room_m(*at[:2])
        if box is not None:
            room_m = min(room_m, float(box.gap_m(*at[:2])) - machine.robot.radius_m)
        if room_m < 0.0 and not self._touched_m:
            self._touched_m = at[:2]
            machine.command(now_s, DriveCommand(0.0, 0.0))
        if self._tag and now_s - self._read_s >= EVERY_S:
            self._read_s = now_s
            fix = self._reader.read(now_s, *at)
            self._coming += [] if fix is None else [self._in_home(fix)]
        due = tuple(f for f in self._coming if now_s - f.stamp_s >= DELAY_S)
        self._coming = self._coming[len(due) :]
        return RobotSense(machine.odometry(), due, at, room_m, self._touched_m)

    def T_world_robot(self, x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        """4x4: as it stands on the true ground there."""
        return self._true.T_world_robot(x_m, y_m, yaw_rad)

    def _in_home(self, fix: PlaceFix) -> PlaceFix:
        T = self._T_home_world @ transforms.from_xyz_yaw([fix.x_m, fix.y_m, 0.0], fix.yaw_rad)
        R, covariance = self._T_home_world[:2, :2], np.array(fix.covariance)
        covariance[:2, :2] = R @ covariance[:2, :2] @ R.T
        covariance[2, :2] = covariance[:2, 2] = R @ covariance[:2, 2]  # yaw's may be inf
        x_m, y_m = map(float, T[:2, 3])
        return replace(fix, x_m=x_m, y_m=y_m, yaw_rad=transforms.yaw(T), covariance=covariance)


def place_of(town: Town) -> PlacePlan:
    """The plan of a place that a robot drives through. Raises SimulationError where the world is
    none."""
    if not isinstance(town.plan, PlacePlan):
        raise SimulationError(f"no robot drives in this world: give one of {', '.join(PLACES)}")
    return town.plan
