# SPDX-License-Identifier: Apache-2.0
"""What ArduCopter makes of the pilot's sticks, by its parameters: climb rates, leans, and in LOITER
a velocity that is pushed by a lean, dragged, and braked some time after the stick was let go."""

import math
from dataclasses import dataclass
from typing import Dict, List, Tuple

_G = 9.81
_LEVEL_DEAD = 0.04  # RC1_DZ, RC2_DZ and RC4_DZ: 20 of 500 us
_LEANS_S = 0.15  # so long the attitude takes to follow a stick
_CLIMB_MPS3 = 5.0  # PSC_JERK_Z
_BRAKE_PER_S = 1.0  # half of PSC_VELXY_P: braking per speed


@dataclass(frozen=True)
class StickParameters:
    """ArduCopter's own defaults."""

    throttle_dead: float = 0.2  # THR_DZ 100 of 500 us
    climb_mps: float = 2.5
    sink_mps: float = 2.5  # PILOT_SPEED_DN 0: as upwards
    loiter_mps: float = 12.5
    loiter_mps2: float = 5.0  # of its corrections
    brake_delay_s: float = 1.0
    brake_mps2: float = 2.5
    brake_mps3: float = 5.0
    loiter_lean_rad: float = math.radians(20.0)  # LOIT_ANG_MAX 0: two thirds of ANGLE_MAX
    lean_rad: float = math.radians(30.0)
    climb_mps2: float = 2.5  # PILOT_ACCEL_Z

    @classmethod
    def of(cls, parameters: Dict[str, Tuple[float, int]]) -> "StickParameters":
        """Reads the parameters from parameters (value, type), in us, cm/s, cm/s^2, cm/s^3, s,
        degrees and hundredths of a degree."""
        value = lambda name: float(parameters[name][0])  # noqa: E731
        lean_deg = min(80.0, max(10.0, 0.01 * value("ANGLE_MAX")))
        up, down = value("PILOT_SPEED_UP"), value("PILOT_SPEED_DN")
        return cls(
            min(0.6, max(0.0, value("THR_DZ") / 500.0)),
            0.01 * up,
            0.01 * (down or up),
            max(0.2, 0.01 * value("LOIT_SPEED")),
            max(1.0, 0.01 * value("LOIT_ACC_MAX")),
            value("LOIT_BRK_DELAY"),
            0.01 * value("LOIT_BRK_ACCEL"),
            max(0.1, 0.01 * value("LOIT_BRK_JERK")),
            math.radians(value("LOIT_ANG_MAX") or 2.0 / 3.0 * lean_deg),
            math.radians(lean_deg),
            max(0.5, 0.01 * value("PILOT_ACCEL_Z")),
        )

    def climb_rate(self, throttle: float) -> float:
        """m/s of the throttle stick (-1..1): nothing within the dead band, and from its edge on
        evenly.

        >>> s = StickParameters()
        >>> s.climb_rate(0.19), round(s.climb_rate(0.6), 2), s.climb_rate(-1.0)
        (0.0, 1.25, -2.5)
        """
        beyond = beyond_dead(throttle, self.throttle_dead)
        return beyond * (self.climb_mps if beyond > 0.0 else self.sink_mps)


def beyond_dead(stick: float, dead: float = _LEVEL_DEAD) -> float:
    """-1..1 of what a stick is beyond its dead band."""
    return 0.0 if abs(stick) <= dead else math.copysign((abs(stick) - dead) / (1.0 - dead), stick)


class StickClimb:
    """The climb rate (m/s) that a stick brings about, eased in and out; ``mps2``: how it changes
    now."""

    def __init__(self):
        self.begin(0.0)

    def begin(self, mps: float) -> None:
        """Begins from this one, without acceleration."""
        self._mps, self.mps2 = mps, 0.0

    def step(self, p: StickParameters, wanted_mps: float, dt_s: float) -> float:
        """Towards ``wanted_mps``."""
        most_mps2 = min(p.climb_mps2, math.sqrt(2.0 * _CLIMB_MPS3 * abs(wanted_mps - self._mps)))
        wanted_mps2 = math.copysign(most_mps2, wanted_mps - self._mps)
        self.mps2 += min(_CLIMB_MPS3 * dt_s, max(-_CLIMB_MPS3 * dt_s, wanted_mps2 - self.mps2))
        self._mps += self.mps2 * dt_s
        return self._mps


class LoiterVelocity:
    """The velocity (m/s, level) that LOITER aims at: forward and left of a heading, which the
    caller turns."""

    def __init__(self):
        self.begin((0.0, 0.0))

    def begin(self, v_mps: Tuple[float, float]) -> None:
        """The mode begins in flight at this velocity, or on the ground."""
        self.v_mps: List[float] = [float(v_mps[0]), float(v_mps[1])]
        self._leans: List[float] = [0.0, 0.0]  # acceleration (m/s^2) of the lean that it has
        self._brake_mps2 = self._free_s = 0.0

    def step(
        self, p: StickParameters, right: float, forward: float, yaw_rad: float, dt_s: float
    ) -> List[float]:
        """(2,) world; sticks -1..1."""
        wanted = self._wanted(p, beyond_dead(right), beyond_dead(forward), yaw_rad)
        self._free_s = 0.0 if any(wanted) else self._free_s + dt_s
        share = min(1.0, dt_s / _LEANS_S)
        for k in (0, 1):
            self._leans[k] += share * (wanted[k] - self._leans[k])
            self.v_mps[k] += self._leans[k] * dt_s
        speed_mps = math.hypot(*self.v_mps)
        if speed_mps > 0.0:
            slower = max(
                0.0,
                speed_mps
                - (self._drag_mps2(p, speed_mps) + self._braked(p, speed_mps, dt_s)) * dt_s,
            )
            scale = min(slower, p.loiter_mps) / speed_mps
            self.v_mps = [scale * v for v in self.v_mps]
        return self.v_mps

    @staticmethod
    def _wanted(
        p: StickParameters, right: float, forward: float, yaw_rad: float
    ) -> Tuple[float, float]:
        """Acceleration of the lean that the sticks ask for."""
        stick = math.hypot(right, forward)
        if stick == 0.0:
            return 0.0, 0.0
        acc = _G * math.tan(min(1.0, stick) * p.loiter_lean_rad) / stick
        ahead, left = forward * acc, -right * acc
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return c * ahead - s * left, s * ahead + c * left

    @staticmethod
    def _drag_mps2(p: StickParameters, speed_mps: float) -> float:
        """So that the whole stick ends at LOIT_SPEED."""
        return _G * math.tan(p.loiter_lean_rad) * speed_mps / p.loiter_mps

    def _braked(self, p: StickParameters, speed_mps: float, dt_s: float) -> float:
        wanted = (
            min(_BRAKE_PER_S * speed_mps, p.brake_mps2) if self._free_s > p.brake_delay_s else 0.0
        )
        step = p.brake_mps3 * dt_s
        self._brake_mps2 += min(step, max(-step, wanted - self._brake_mps2))
        return self._brake_mps2
