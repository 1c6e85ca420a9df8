# SPDX-License-Identifier: Apache-2.0
"""PID on position and yaw: to velocities (thesis 5.3) or to lean angles (thesis 4.3), both as
sticks.

Horizontal sticks of a Tello are lean angles. With "velocity" the PID's output is a velocity, and an
inner loop leans towards it; with "attitude" it is the acceleration itself. The derivative is on the
measured velocity, so that a new set-point gives no kick. Output is saturated as a vector; an
integrator waits while its axis is saturated and would be driven further, and far from the
set-point. An error that would saturate one axis is made smaller in all three, so that the way to a
set-point is straight: a mission keeps vehicles apart along straight legs.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.rotations import turn_about_z, wrap

_G_MPS2 = 9.81
VELOCITY, ATTITUDE = "velocity", "attitude"
# of a stick: where so little is asked for, it is let go and the Tello holds by itself
_NEARLY_NONE = 0.004


@dataclass(frozen=True)
class Gains:
    """Holds the gains of one axis. Output is m/s, rad/s for yaw, m/s2 horizontally with "attitude".

    ``integral_most`` bounds the integrator's output; ``integral_within``: error (m, rad) beyond
    which it waits.
    """

    p: float  # of the error
    i: float  # of its integral
    d: float  # of the measured velocity
    most: float  # of the output
    integral_most: float  # of the integrator's output
    integral_within: float  # error (m, rad) beyond which the integrator waits

    def __post_init__(self):
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: {value} must not be negative")
        if not (self.p > 0.0 and self.most > 0.0):
            raise ValueError("p, most: must be positive")


@dataclass(frozen=True)
class StickModel:
    """What sticks ask a Tello for, in their slow mode (as measured: fcsv_sim/tello/flight.py).

    ``brake_per_s``: how an axis that is let go is stopped by its flow sensor. ``dead_band``: share
    of a stick's way.
    """

    lean_deg: float = 13.0  # of a full stick
    climb_mps: float = 1.0  # of a full stick
    turn_dps: float = 100.0  # of a full stick
    drag_per_s: float = 0.56  # of the air: how a velocity dies away while it leans
    brake_per_s: float = 1.8  # of its flow sensor on an axis that is let go
    dead_band: float = 0.02  # share of a stick's way

    def __post_init__(self):
        require_positive(self)

    @property
    def most_mps2(self) -> float:
        """Horizontal acceleration of a full stick."""
        return _G_MPS2 * math.tan(math.radians(self.lean_deg))

    def stick(self, share: float) -> float:
        """The deflection for a share (-1..1) of what the stick can ask: beyond its dead band, or
        none."""
        if not abs(share) > _NEARLY_NONE:  # also what is no number
            return 0.0
        return math.copysign(min(1.0, self.dead_band + (1.0 - self.dead_band) * abs(share)), share)

    def share(self, stick: float) -> float:
        """Gives the share of what the stick can ask."""
        beyond = max(0.0, abs(stick) - self.dead_band) / (1.0 - self.dead_band)
        return math.copysign(beyond, stick)


@dataclass(frozen=True)
class PidConfig:
    """config/tello/NAME.yaml. ``command``: what the horizontal PID gives, "velocity" or
    "attitude"."""

    # what the horizontal PID gives: a velocity, or a lean angle ("attitude")
    command: str = VELOCITY
    horizontal: Gains = field(default_factory=lambda: Gains(1.2, 0.2, 0.0, 0.6, 0.2, 0.4))
    vertical: Gains = field(default_factory=lambda: Gains(1.4, 0.3, 0.1, 0.4, 0.2, 0.6))
    yaw: Gains = field(default_factory=lambda: Gains(1.0, 0.1, 0.0, 0.5, 0.1, 0.3))
    velocity_per_s: float = 2.5  # of the inner loop: velocity error to acceleration
    sticks: StickModel = field(default_factory=StickModel)

    def __post_init__(self):
        if self.command not in (VELOCITY, ATTITUDE):
            raise ValueError(f"command: '{self.command}' is not one of {VELOCITY}, {ATTITUDE}")
        if not self.velocity_per_s > 0.0:
            raise ValueError(f"velocity_per_s: {self.velocity_per_s} must be positive")


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

    def sticks(
        self,
        dt_s: float,
        T_odom_body: np.ndarray,
        v_odom_mps: np.ndarray,
        T_odom_target: np.ndarray,
    ) -> Sticks:
        """Sticks from where it is towards where it should be."""
        c, heading = self.config, transforms.yaw(T_odom_body)
        error = T_odom_target[:3, 3] - T_odom_body[:3, 3]
        near = (
            min(
                1.0,
                self._most_share(error[:2], c.horizontal),
                self._most_share(error[2:], c.vertical),
            )
            * error
        )
        flat = self._axis(dt_s, slice(0, 2), error[:2], near[:2], v_odom_mps[:2], c.horizontal)
        up = self._axis(dt_s, slice(2, 3), error[2:], near[2:], v_odom_mps[2:], c.vertical)
        turned = np.array([wrap(transforms.yaw(T_odom_target) - heading)])
        turn = self._axis(dt_s, slice(3, 4), turned, turned, np.zeros(1), c.yaw)
        acc = self._acceleration(flat, v_odom_mps[:2])
        forward, left = (turn_about_z(-heading)[:2, :2] @ acc).tolist()
        m = c.sticks
        return Sticks(
            m.stick(forward / m.most_mps2),
            m.stick(left / m.most_mps2),
            m.stick(float(up[0]) / m.climb_mps),
            m.stick(float(turn[0]) / math.radians(m.turn_dps)),
        )

    def _acceleration(self, flat: np.ndarray, v_mps: np.ndarray) -> np.ndarray:
        """Horizontal acceleration (2,) of the PID's output."""
        if self.config.command == ATTITUDE:
            return flat
        return self.config.velocity_per_s * (flat - v_mps) + self.config.sticks.drag_per_s * flat

    @staticmethod
    def _most_share(error: np.ndarray, gains: Gains) -> float:
        """Gives the share of an error, that its proportional part alone does not saturate."""
        asked = gains.p * float(np.linalg.norm(error))
        return gains.most / asked if asked > 0.0 else math.inf

    def _axis(
        self,
        dt_s: float,
        axes: slice,
        error: np.ndarray,
        near: np.ndarray,
        v: np.ndarray,
        gains: Gains,
    ) -> np.ndarray:
        """Output of axes that share gains and one saturation; ``near``: the error that is flown
        by."""
        before = self._integral[axes]
        wished = gains.p * near + before - gains.d * v
        length = float(np.linalg.norm(wished))
        saturated = length > gains.most
        within = float(np.linalg.norm(error)) <= gains.integral_within
        if within and not (saturated and float(error @ wished) > 0.0):
            self._integral[axes] = np.clip(
                before + gains.i * near * dt_s, -gains.integral_most, gains.integral_most
            )
        return wished * (gains.most / length) if saturated else wished
