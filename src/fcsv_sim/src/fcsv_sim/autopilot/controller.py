# SPDX-License-Identifier: Apache-2.0
"""Leads from positions, velocities or sticks to lean angles, yaw rate and thrust (ext frame, SI).

A hundred passes a second of every vehicle go through here: the loop is compiled, the rest are plain
floats.
"""

import math
from dataclasses import dataclass
from typing import Dict, Tuple

import numba
import numpy as np

from fcsv_geometry.rotations import wrap

_RAMP_MPS2 = 3.0
_MAX_LEAN_RAD = math.radians(30.0)
_YAW_STICK_RPS = math.radians(100.0)
_G = 9.81
_SLOWEST, _QUICKEST = 0.1, 50.0  # m/s and m/s^2 of what a parameter asks for


@dataclass(frozen=True)
class WayLimits:
    """How fast it flies to a position, as its WPNAV_* parameters say; ArduCopter's own defaults."""

    speed_mps: float = 5.0
    climb_mps: float = 2.5
    sink_mps: float = 1.5
    acceleration_mps2: float = 2.5
    climb_mps2: float = 1.0

    @classmethod
    def of(cls, parameters: Dict[str, Tuple[float, int]]) -> "WayLimits":
        """Reads the limits from parameters (value, type), which are in cm/s and cm/s^2; too slow
        ones are as slow as it gets."""
        names = ("WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN", "WPNAV_ACCEL", "WPNAV_ACCEL_Z")
        return cls(*(_clip(0.01 * parameters[n][0], _SLOWEST, _QUICKEST) for n in names))

    def along(self, level_m: float, up_m: float) -> Tuple[float, float]:
        """(m/s, m/s^2) on the straight way to a place so far away: horizontal and vertical share
        one clock."""
        away_m = math.hypot(level_m, up_m)
        level, up = max(level_m / away_m, 1e-6), max(abs(up_m) / away_m, 1e-6)
        upright_mps = self.climb_mps if up_m > 0.0 else self.sink_mps
        return (
            min(self.speed_mps / level, upright_mps / up),
            min(self.acceleration_mps2 / level, self.climb_mps2 / up),
        )


def approach_speed(error_m: float, gain_per_s: float, acc_mps2: float) -> float:
    """Speed at which a distance is closed: proportional near, as braking allows far (ArduPilot's
    square root)."""
    linear_m = acc_mps2 / gain_per_s**2
    if error_m <= linear_m:
        return gain_per_s * error_m
    return math.sqrt(2.0 * acc_mps2 * (error_m - linear_m / 2.0))


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


_compiled_clip = numba.njit(_clip)


@numba.njit(cache=True)
def _lean(target, integral, now, x, y, z, limit, ahead, dt_s, yaw_rad, hover):
    """Roll, pitch (rad) and thrust (share) towards a velocity x, y, z; moves target and integral
    (3,) along. ``now`` (3,) is the velocity that it has, ``limit`` (m/s) the target's step."""
    wanted, acc = (x, y, z), np.empty(3)
    for k in range(3):
        step = _compiled_clip(wanted[k] - target[k], -limit, limit)
        target[k] += step
        error = target[k] - now[k]
        integral[k] = _compiled_clip(integral[k] + 0.8 * error * dt_s, -3.0, 3.0)
        acc[k] = 2.2 * error + integral[k] + ahead * step / dt_s
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    forward, left = c * acc[0] + s * acc[1], -s * acc[0] + c * acc[1]
    pitch = _compiled_clip(math.atan2(forward, _G), -_MAX_LEAN_RAD, _MAX_LEAN_RAD)
    roll = _compiled_clip(math.atan2(-left * math.cos(pitch), _G), -_MAX_LEAN_RAD, _MAX_LEAN_RAD)
    thrust = hover * (1.0 + acc[2] / _G) / (math.cos(roll) * math.cos(pitch))
    return roll, pitch, _compiled_clip(thrust, 0.05, 1.0)


class Controller:
    """Cascaded position, velocity and attitude targets with limits on speed, acceleration and
    lean."""

    def __init__(self, hover_thrust: float):
        self._hover = hover_thrust
        self.limits = WayLimits()
        self.reset()

    def reset(self) -> None:
        """Forget integrators: called when the vehicle is armed."""
        self._v_integral, self._v_target = np.zeros(3), np.zeros(3)

    def to_position(self, target_m, yaw_rad, estimate, dt_s: float):
        """Command straight towards a position (ext, m), and to a heading (rad)."""
        (tx, ty, tz), (px, py, pz) = target_m.tolist(), estimate.p_ext_m.tolist()
        x, y, z = tx - px, ty - py, tz - pz
        away_m, share = math.sqrt(x * x + y * y + z * z), 0.0
        if away_m > 1e-6:
            speed_mps, acc_mps2 = self.limits.along(math.hypot(x, y), z)
            share = min(speed_mps, approach_speed(away_m, 1.0, acc_mps2)) / away_m
        rate = self.yaw_rate(yaw_rad, estimate)
        ramp_mps2 = self.limits.acceleration_mps2
        return self.to_velocity((x * share, y * share, z * share), rate, estimate, dt_s, ramp_mps2)

    def yaw_rate(self, yaw_rad: float, estimate) -> float:
        return _clip(2.0 * wrap(yaw_rad - estimate.yaw_ext_rad), -1.0, 1.0)

    def to_velocity(
        self,
        v_ext_mps,
        yaw_rate_rps,
        estimate,
        dt_s: float,
        ramp_mps2: float = _RAMP_MPS2,
        ahead: float = 0.0,
    ):
        """Command towards a velocity (ext, m/s), the target ramped at the acceleration limit;
        ``ahead``: share of the target's own acceleration that is asked for before the velocity
        lacks it."""
        state, yaw_rad = (
            (self._v_target, self._v_integral, estimate.v_ext_mps),
            estimate.yaw_ext_rad,
        )
        how = (ramp_mps2 * dt_s, ahead, dt_s, yaw_rad, self._hover)
        roll, pitch, thrust = _lean(*state, *v_ext_mps, *how)
        return roll, pitch, yaw_rate_rps, thrust

    def to_lean(
        self,
        roll_rad,
        pitch_rad,
        yaw_rate_rps,
        climb_mps,
        climb_now_mps,
        dt_s,
        climb_mps2: float = 0.0,
    ):
        """Lean angles from the sticks with a held climb rate (ALT_HOLD), which changes by
        ``climb_mps2``."""
        error = climb_mps - climb_now_mps
        integral = _clip(float(self._v_integral[2]) + 0.8 * error * dt_s, -3.0, 3.0)
        self._v_integral[2], self._v_target[:] = integral, 0.0
        acc_z = 2.2 * error + integral + climb_mps2
        thrust = (
            self._hover * (1.0 + acc_z / _G) / max(0.5, math.cos(roll_rad) * math.cos(pitch_rad))
        )
        return roll_rad, pitch_rad, yaw_rate_rps, _clip(thrust, 0.05, 1.0)

    def sticks(self, roll, pitch, yaw, lean_rad: float = _MAX_LEAN_RAD):
        """Lean angles and yaw rate of sticks (-1..1); roll right, pitch forward, yaw right."""
        return roll * lean_rad, pitch * lean_rad, -yaw * _YAW_STICK_RPS
