# SPDX-License-Identifier: Apache-2.0
"""A robot with two driven wheels, whose wheels are not what its computer believes, and slip.

It takes commands and the time, and keeps its true pose and what its wheels report.
"""

from dataclasses import dataclass
from typing import Callable, Optional, Tuple

import numpy as np

from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.place.tracker import WheelOdometry
from fcsv_guidance.robot import Robot

WATCHDOG_S = 0.3
_STEP_S = 0.02
_TRACK_SHARE = 0.8  # of the footprint's diameter between the wheels


@dataclass(frozen=True)
class WheelFlaws:
    """``left_scale``, ``right_scale``: true over believed radius of a wheel; ``track_scale``: true
    over believed track. ``slip``: share of a wheel's way that the ground does not get, its mean and
    the standard deviation of what changes from one half second to the next. ``tick_m``: what the
    encoders resolve."""

    left_scale: float = 1.0
    right_scale: float = 1.0
    track_scale: float = 1.0
    slip: float = 0.0
    slip_sigma: float = 0.0
    tick_m: float = 0.001

    @classmethod
    def drawn(cls, random: np.random.Generator) -> "WheelFlaws":
        """Draws the flaws of a robot that was built and measured with some care."""
        radius = random.normal(1.0, 0.02)
        apart = random.normal(0.0, 0.004)
        return cls(
            radius + apart,
            radius - apart,
            random.normal(1.0, 0.04),
            random.uniform(0.0, 0.03),
            0.03,
        )


class SimulatedRobot:
    """Drives from ``at`` (x, y in m, yaw in rad; world) on. The same seed and commands give the
    same way.

    ``spinning(now_s, x, y)`` says whether the wheels find no hold there.
    """

    def __init__(
        self,
        robot: Robot,
        at: Tuple[float, float, float],
        flaws: WheelFlaws,
        seed: int,
        spinning: Optional[Callable[[float, float, float], bool]] = None,
    ):
        self.robot, self.flaws = robot, flaws
        self.x_m, self.y_m, self.yaw_rad = map(float, at)
        self.now_s = 0.0
        self.watchdog_ended = False
        self._random = np.random.default_rng([seed, 21])
        self._spinning = spinning
        self._track_m = 2.0 * robot.radius_m * _TRACK_SHARE
        self._wheels_mps = np.zeros(2)  # left, right, as its computer believes
        self._turned_m = np.zeros(2)
        self._ticks = np.zeros(2, int)
        self._odometry = np.zeros(3)
        self._command, self._command_s = DriveCommand(0.0, 0.0), -np.inf
        self._slip, self._slip_until_s = np.zeros(2), 0.0

    @property
    def speed_mps(self) -> float:
        """Gives the speed of the wheels' middle, as its computer believes."""
        return float(self._wheels_mps.mean())

    @property
    def stands(self) -> bool:
        """Whether no wheel turns."""
        return bool((self._wheels_mps == 0.0).all())

    def command(self, now_s: float, command: DriveCommand) -> None:
        """A command came. One that is not finite is no command: the watchdog ends the one
        before."""
        if np.isfinite([command.speed_mps, command.turning_radps]).all():
            self._command, self._command_s = command, now_s

    def step(self, now_s: float) -> None:
        """Drive until a time."""
        while self.now_s < now_s - 1e-9:
            self._drive(min(_STEP_S, now_s - self.now_s))

    def odometry(self) -> WheelOdometry:
        """What the wheels report."""
        return WheelOdometry(self.now_s, *map(float, self._odometry))

    def _drive(self, dt_s: float) -> None:
        self.now_s += dt_s
        self.watchdog_ended = self.now_s - self._command_s > WATCHDOG_S
        wanted = np.zeros(2) if self.watchdog_ended else self._wanted_mps()
        slows = np.abs(wanted) < np.abs(self._wheels_mps)
        most_mps = np.where(slows, self.robot.slows_mps2, self.robot.acceleration_mps2) * dt_s
        self._wheels_mps = self._wheels_mps + np.clip(
            wanted - self._wheels_mps, -most_mps, most_mps
        )
        way_m = self._wheels_mps * dt_s
        self._report(way_m)
        flaws = self.flaws
        way_m = way_m * (flaws.left_scale, flaws.right_scale) * (1.0 - self._slipped())
        turn = (way_m[1] - way_m[0]) / (self._track_m * flaws.track_scale)
        heading = self.yaw_rad + 0.5 * turn
        self.x_m += float(way_m.mean() * np.cos(heading))
        self.y_m += float(way_m.mean() * np.sin(heading))
        self.yaw_rad = float(np.arctan2(np.sin(self.yaw_rad + turn), np.cos(self.yaw_rad + turn)))

    def _wanted_mps(self) -> np.ndarray:
        """(2,) of the wheels, within the robot's bounds."""
        robot = self.robot
        speed = float(np.clip(self._command.speed_mps, -robot.speed_mps, robot.speed_mps))
        turning = float(
            np.clip(
                self._command.turning_radps, -robot.turning_rate_radps, robot.turning_rate_radps
            )
        )
        return speed + 0.5 * self._track_m * turning * np.array([-1.0, 1.0])

    def _slipped(self) -> np.ndarray:
        """(2,) share of the way that the ground does not get."""
        if self._spinning is not None and self._spinning(self.now_s, self.x_m, self.y_m):
            return np.ones(2)
        if self.now_s >= self._slip_until_s:
            self._slip = self._random.normal(self.flaws.slip, self.flaws.slip_sigma, 2)
            self._slip_until_s = self.now_s + 0.5
        return np.clip(self._slip, -0.2, 1.0)

    def _report(self, way_m: np.ndarray) -> None:
        self._turned_m += way_m
        ticks = np.floor(self._turned_m / self.flaws.tick_m).astype(int)
        seen_m = (ticks - self._ticks) * self.flaws.tick_m
        self._ticks = ticks
        turn = (seen_m[1] - seen_m[0]) / self._track_m
        heading = self._odometry[2] + 0.5 * turn
        self._odometry += [seen_m.mean() * np.cos(heading), seen_m.mean() * np.sin(heading), turn]
