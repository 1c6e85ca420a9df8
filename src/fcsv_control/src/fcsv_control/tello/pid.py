# SPDX-License-Identifier: Apache-2.0
"""PID on position and yaw: to velocities (thesis 5.3) or to lean angles (thesis 4.3), both as sticks.

Forward and left are controlled in the heading's axes, the derivative is on the measured velocity, so that a new
set-point gives no kick. Output is saturated as a vector; an integrator stops while its axis is saturated and drives it
further, and far from the set-point.
"""

import math
from dataclasses import dataclass, field
from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.rotations import turn_about_z, wrap

_G_MPS2 = 9.81
VELOCITY, ATTITUDE = "velocity", "attitude"


@dataclass(frozen=True)
class Gains:
    """Of one axis. Output is m/s (rad/s for yaw) or, horizontally with ``attitude``, m/s2.

    ``integral_most`` bounds the integrator's output; ``integral_within``: error (m, rad) beyond which it waits.
    """

    p: float
    i: float
    d: float
    most: float
    integral_most: float
    integral_within: float

    def __post_init__(self):
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: {value} must not be negative")
        if not (self.p > 0.0 and self.most > 0.0):
            raise ValueError("p, most: must be positive")


@dataclass(frozen=True)
class FullSticks:
    """What a stick at its end asks for, in the slow mode of the sticks; down as fast as up."""

    horizontal_mps: float = 1.5
    vertical_mps: float = 1.0
    turn_dps: float = 60.0
    lean_deg: float = 9.0

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class PidConfig:
    """config/tello/NAME.yaml. ``command``: what the horizontal sticks mean, "velocity" or "attitude"."""

    command: str = VELOCITY
    horizontal: Gains = field(default_factory=lambda: Gains(1.8, 0.5, 0.4, 0.6, 0.3, 0.6))
    vertical: Gains = field(default_factory=lambda: Gains(1.4, 0.3, 0.1, 0.4, 0.2, 0.6))
    yaw: Gains = field(default_factory=lambda: Gains(1.0, 0.1, 0.0, 0.5, 0.1, 0.3))
    full_sticks: FullSticks = field(default_factory=FullSticks)

    def __post_init__(self):
        if self.command not in (VELOCITY, ATTITUDE):
            raise ValueError(f"command: '{self.command}' is not one of {VELOCITY}, {ATTITUDE}")


@dataclass(frozen=True)
class Sticks:
    """-1..1: forward, left, up, turn to the left."""

    forward: float = 0.0
    left: float = 0.0
    up: float = 0.0
    turn: float = 0.0

    @property
    def moved(self) -> float:
        """The largest deflection."""
        return max(abs(self.forward), abs(self.left), abs(self.up), abs(self.turn))


class PositionPid:
    """``sticks`` at each step of ``dt_s``; poses and velocity are in one level frame."""

    def __init__(self, config: PidConfig):
        self.config = config
        self._integral = np.zeros(4)  # output of the integrators: x, y, z (frame's axes), yaw

    def reset(self) -> None:
        """Forget what the integrators learnt."""
        self._integral = np.zeros(4)

    def sticks(self, dt_s: float, T_odom_body: np.ndarray, v_odom_mps: np.ndarray, T_odom_target: np.ndarray) -> Sticks:
        """Sticks from where it is towards where it should be."""
        c, heading = self.config, transforms.yaw(T_odom_body)
        error = T_odom_target[:3, 3] - T_odom_body[:3, 3]
        flat = self._axis(dt_s, slice(0, 2), error[:2], v_odom_mps[:2], c.horizontal)
        up = self._axis(dt_s, slice(2, 3), error[2:], v_odom_mps[2:], c.vertical)
        turn = self._axis(
            dt_s, slice(3, 4), np.array([wrap(transforms.yaw(T_odom_target) - heading)]), np.zeros(1), c.yaw
        )
        forward, left = (turn_about_z(-heading)[:2, :2] @ flat).tolist()
        full, at_end = c.full_sticks, self._at_end
        return Sticks(
            _stick(forward / at_end), _stick(left / at_end), _stick(float(up[0]) / full.vertical_mps),
            _stick(float(turn[0]) / math.radians(full.turn_dps)),
        )  # fmt: skip

    def asked(self, sticks: Sticks) -> Tuple[np.ndarray, float]:
        """What sticks ask for: forward, left (m/s, or m/s2 with ``attitude``), up (m/s), and the turn (rad/s)."""
        full = self.config.full_sticks
        v = np.array([sticks.forward * self._at_end, sticks.left * self._at_end, sticks.up * full.vertical_mps])
        return v, sticks.turn * math.radians(full.turn_dps)

    @property
    def _at_end(self) -> float:
        """What a horizontal stick at its end asks for."""
        c = self.config
        lean_rad = math.radians(c.full_sticks.lean_deg)
        return c.full_sticks.horizontal_mps if c.command == VELOCITY else _G_MPS2 * math.tan(lean_rad)

    def _axis(self, dt_s: float, axes: slice, error: np.ndarray, v: np.ndarray, gains: Gains) -> np.ndarray:
        """Output of axes that share gains and one saturation."""
        before = self._integral[axes]
        wished = gains.p * error + before - gains.d * v
        length = float(np.linalg.norm(wished))
        saturated = length > gains.most
        within = float(np.linalg.norm(error)) <= gains.integral_within
        if within and not (saturated and float(error @ wished) > 0.0):
            self._integral[axes] = np.clip(before + gains.i * error * dt_s, -gains.integral_most, gains.integral_most)
        return wished * (gains.most / length) if saturated else wished


def _stick(value: float) -> float:
    return float(np.clip(value, -1.0, 1.0)) if math.isfinite(value) else 0.0
