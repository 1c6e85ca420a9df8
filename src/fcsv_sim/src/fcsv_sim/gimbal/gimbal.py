# SPDX-License-Identifier: Apache-2.0
"""A simulated gimbal of two MX-12W: delay, ramps, resolution, and encoders a little wrong; no
clock, no ROS."""

from collections import deque
from dataclasses import dataclass
from typing import Callable, Deque, Dict, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry
from fcsv_tracking.gimbal.servos import GimbalReading, GimbalServos

STEP_S = 0.001
RESOLUTION_RAD = 2.0 * np.pi / 4096.0  # 0.088 degrees (the thesis rounds to 0.09)
_KEPT_S = 2.0


@dataclass(frozen=True)
class ServoErrors:
    """What a servo does and gets wrong. Unloaded an MX-12W turns at 470 rpm; with a camera on it,
    held to what a profile allows. ``nonlinearity_deg``: what a calibration of the encoder leaves,
    over a turn; an AS5045 out of the box may be off by half a degree."""

    delay_s: float = 0.02
    delay_jitter_s: float = 0.005  # one-sided
    speed_degps: float = 400.0
    acceleration_degps2: float = 2000.0
    stop_deg: float = 0.05  # stops this far (at most) from the tick it was told
    reading_jitter_s: float = 0.001  # of a reading's stamp
    nonlinearity_deg: float = 0.02


@dataclass(frozen=True)
class MountErrors:
    """Standard deviations of how the gimbal stands other than it was measured in."""

    position_m: float = 0.001
    angle_deg: float = 0.03


class SimulatedServo:
    """One axis. advance() in steps of STEP_S; command() takes effect after the delay."""

    def __init__(self, errors: ServoErrors, random: np.random.Generator, angle_rad: float = 0.0):
        self._errors, self._random = errors, random
        self.limit(errors.speed_degps, errors.acceleration_degps2)
        self.angle_rad, self.rate_radps, self._goal_rad = angle_rad, 0.0, angle_rad
        self._coming: Deque[Tuple[float, float]] = deque()
        self._phase = random.uniform(0.0, 2.0 * np.pi)
        self.torque = True

    def limit(self, speed_degps: float, acceleration_degps2: float) -> None:
        """What a profile allows."""
        self._speed, self._ramp = np.radians(speed_degps), np.radians(acceleration_degps2)

    def command(self, now_s: float, goal_rad: float) -> None:
        ticks = np.round(goal_rad / RESOLUTION_RAD)
        goal_rad = ticks * RESOLUTION_RAD + np.radians(
            self._errors.stop_deg
        ) * self._random.uniform(-1.0, 1.0)
        delay_s = self._errors.delay_s + abs(self._random.normal(0.0, self._errors.delay_jitter_s))
        self._coming.append((now_s + delay_s, goal_rad))

    def step(self, now_s: float) -> None:
        while self._coming and self._coming[0][0] <= now_s:
            self._goal_rad = self._coming.popleft()[1]
        if not self.torque:
            self.rate_radps = 0.0
            return
        ramp = self._ramp
        left = self._goal_rad - self.angle_rad
        if abs(left) < 1e-9 and self.rate_radps == 0.0:
            return
        # the speed from which it still comes to rest at the goal
        wished = np.sign(left) * min(self._speed, np.sqrt(2.0 * ramp * abs(left)))
        self.rate_radps += float(np.clip(wished - self.rate_radps, -ramp * STEP_S, ramp * STEP_S))
        self.angle_rad += self.rate_radps * STEP_S
        if (
            abs(self._goal_rad - self.angle_rad) < ramp * STEP_S**2
            and abs(self.rate_radps) < 2 * ramp * STEP_S
        ):
            self.angle_rad, self.rate_radps = self._goal_rad, 0.0

    def reading_rad(self, angle_rad: float) -> float:
        """What the encoder says when the axis stands at an angle: ticks."""
        bent = angle_rad + np.radians(self._errors.nonlinearity_deg) * np.sin(
            2.0 * angle_rad + self._phase
        )
        return float(np.round(bent / RESOLUTION_RAD) * RESOLUTION_RAD)


class SimulatedGimbal(GimbalServos):
    """A gimbal behind the interface of the real one; ``true`` is its geometry as it really
    stands."""

    def __init__(
        self,
        geometry: GimbalGeometry,
        seed: int,
        clock: Callable[[], float],
        errors: ServoErrors = ServoErrors(),
        mount: MountErrors = MountErrors(),
    ):
        random = np.random.default_rng([seed, 21])
        self._clock, self._errors, self._random = clock, errors, random
        self.true = _moved(geometry, mount, random)
        start = (0.0, np.radians(20.0))
        self.servos = tuple(SimulatedServo(errors, random, a) for a in start)
        self._log: Deque[Tuple[float, float, float]] = deque()
        self._now_s = clock()
        self._log.append((self._now_s, *start))

    def turn(self, angles: Angles) -> None:
        self.advance()
        for servo, angle in zip(self.servos, angles):
            servo.command(self._now_s, angle)

    def read(self) -> GimbalReading:
        self.advance()
        pan, tilt = (s.reading_rad(s.angle_rad) for s in self.servos)
        return GimbalReading(
            self._now_s + self._random.normal(0.0, self._errors.reading_jitter_s), Angles(pan, tilt)
        )

    def health(self) -> Dict[str, str]:
        return {
            f"{name} rate [deg/s]": f"{np.degrees(s.rate_radps):.0f}"
            for name, s in zip(("pan", "tilt"), self.servos)
        }

    def close(self) -> None:
        for servo in self.servos:
            servo.torque = False

    def advance(self) -> None:
        """Up to the clock's time."""
        until_s = self._clock()
        if until_s - self._now_s > 1.0:  # after a long hiccup time is skipped
            self._now_s = until_s - 1.0
        while self._now_s + STEP_S <= until_s + 1e-9:
            self._now_s += STEP_S
            for servo in self.servos:
                servo.step(self._now_s)
            self._log.append((self._now_s, self.servos[0].angle_rad, self.servos[1].angle_rad))
        while self._log[0][0] < self._now_s - _KEPT_S:
            self._log.popleft()

    def angles_at(self, stamp_s: float) -> Angles:
        """True angles at a moment of the last seconds. Raises PoseUnavailable."""
        index = int(round((stamp_s - self._log[-1][0]) / STEP_S)) + len(self._log) - 1
        index = min(index, len(self._log) - 1)
        if index < 0 or stamp_s - self._log[-1][0] > 5 * STEP_S:
            raise PoseUnavailable(f"simulated gimbal: no angles at {stamp_s:.3f} s")
        t_s, pan, tilt = self._log[index]
        # on along the last step: shutters are open for several of them
        if 0 < index and abs(stamp_s - t_s) > 1e-9:
            t0_s, pan0, tilt0 = self._log[index - 1]
            share = (stamp_s - t_s) / max(t_s - t0_s, 1e-9)
            pan, tilt = pan + (pan - pan0) * share, tilt + (tilt - tilt0) * share
        return Angles(pan, tilt)

    def T_ground_cam(self, stamp_s: float) -> np.ndarray:
        """Where its camera truly is."""
        return self.true.T_ground_cam(self.angles_at(stamp_s))

    @property
    def still(self) -> bool:
        """Neither axis turns faster than a degree per second."""
        return all(abs(s.rate_radps) < np.radians(1.0) for s in self.servos)


def _moved(
    geometry: GimbalGeometry, errors: MountErrors, random: np.random.Generator
) -> GimbalGeometry:
    base = geometry.base
    xyz_m = tuple(np.add(base.xyz_m, random.normal(0.0, errors.position_m, 3)))
    rpy_deg = tuple(np.add(base.rpy_deg, random.normal(0.0, errors.angle_deg, 3)))
    return GimbalGeometry(
        Mount(xyz_m, rpy_deg),
        geometry.tilt_axis_xyz_m,
        geometry.camera,
        geometry.pan_limits_deg,
        geometry.tilt_limits_deg,
    )


def turned(
    T_a_b: np.ndarray, position_m: float, angle_deg: float, random: np.random.Generator
) -> np.ndarray:
    """T_a_b as it is when it was put a little wrong (standard deviations per axis)."""
    wrong = transforms.from_xyz_rpy(
        random.normal(0.0, position_m, 3), random.normal(0.0, np.radians(angle_deg), 3)
    )
    return T_a_b @ wrong
