# SPDX-License-Identifier: Apache-2.0
"""A 1.5 kg quadrotor with 4 kg of thrust (thesis table 6.1), flown through lean angles, yaw rate
and thrust.

World frame ENU-like (z up), body forward-left-up, SI. The fast loop is compiled; noise is seeded.
"""

import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numba
import numpy as np

from fcsv_geometry import transforms

G_MPS2 = 9.81
STEP_S = 1.0 / 400.0
_DRAWN_AHEAD = 400  # steps
_GUST_LAG_S = 3.0  # correlation time of gusts near the ground
_P, _V, _Q, _W, _THRUST, _WIND = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 10),
    slice(10, 13),
    13,
    slice(14, 17),
)
_STATE = 17  # position, velocity, quaternion xyzw, body rates, thrust (m/s2), wind (m/s)


@dataclass(frozen=True)
class Airframe:
    """What distinguishes one multirotor from another."""

    mass_kg: float = 1.5
    max_thrust_n: float = 4.0 * G_MPS2
    drag_per_s: float = 0.25  # linear drag coefficient over mass
    motor_lag_s: float = 0.05
    attitude_rate_per_s: float = 7.0  # angle error to rate
    rate_gain_per_s: float = 25.0  # rate error to angular acceleration
    vibration_rms_deg: float = 0.1
    vibration_hz: Tuple[float, float, float] = (23.0, 31.0, 47.0)


@numba.njit(cache=True)
def _rotate(q, v):
    x, y, z, w = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


@numba.njit(cache=True)
def _angles(q):
    x, y, z, w = q
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    return roll, pitch


@numba.njit(cache=True)
def _advance(state, command, gust, params, steps, out):
    """``steps`` steps of 1/400 s; command: roll, pitch (rad), yaw rate (rad/s), thrust (share of
    the maximum)."""
    max_acc, drag, lag, k_angle, k_rate, wind_x, wind_y, gust_lag, gust_mps, gust_per_step = params
    dt = 1.0 / 400.0
    on_ground = False
    for i in range(steps):
        state[13] += (command[3] * max_acc - state[13]) * dt / lag
        for axis in range(3):  # gusts: white noise through a first-order lag
            mean = wind_x if axis == 0 else (wind_y if axis == 1 else 0.0)
            fresh = gust[i, axis] * gust_mps * gust_per_step * (0.4 if axis == 2 else 1.0)
            state[14 + axis] += (mean - state[14 + axis]) * dt / gust_lag + fresh
        roll, pitch = _angles((state[6], state[7], state[8], state[9]))
        rate_target = (k_angle * (command[0] - roll), k_angle * (command[1] - pitch), command[2])
        for axis in range(3):
            state[10 + axis] += k_rate * (rate_target[axis] - state[10 + axis]) * dt
        on_ground = state[2] <= 0.0 and state[13] < 9.81
        if on_ground:
            state[10:13] = 0.0
        lift = _rotate((state[6], state[7], state[8], state[9]), (0.0, 0.0, state[13]))
        for axis in range(3):
            acc = (
                lift[axis]
                - drag * (state[3 + axis] - state[14 + axis])
                - (9.81 if axis == 2 else 0.0)
            )
            state[3 + axis] += acc * dt
        # who falls with full thrust meets the ground, too
        if on_ground or (state[2] <= 0.0 and state[5] < 0.0):
            state[3:6] = 0.0
            state[2] = 0.0
        for axis in range(3):
            state[axis] += state[3 + axis] * dt
        x, y, z, w = state[6], state[7], state[8], state[9]
        p, q, r = state[10] * dt / 2, state[11] * dt / 2, state[12] * dt / 2
        state[6] = x + p * w + r * y - q * z
        state[7] = y + q * w + p * z - r * x
        state[8] = z + r * w + q * x - p * y
        state[9] = w - p * x - q * y - r * z
        length = np.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
        for axis in range(6, 10):
            state[axis] /= length
        out[i] = state
    return on_ground


@numba.njit(cache=True)
def _felt(states, start_s, radps, phases, amplitude_rad):
    """Stamp, position, quaternion turned by the vibration, velocity of each state."""
    felt = np.empty((len(states), 11))
    for i in range(len(states)):
        stamp_s = start_s + (i + 1) / 400.0
        half = np.zeros(3)
        for axis in range(3):
            for k in range(3):
                half[axis] += (
                    0.5 * amplitude_rad * np.sin(radps[k] * (stamp_s % 1000.0) + phases[axis, k])
                )
        x, y, z, w = states[i, 6], states[i, 7], states[i, 8], states[i, 9]
        a, b, c = half[0], half[1], half[2]
        felt[i, 0] = stamp_s
        felt[i, 1:4] = states[i, 0:3]
        felt[i, 4] = x + w * a + y * c - z * b
        felt[i, 5] = y + w * b + z * a - x * c
        felt[i, 6] = z + w * c + x * b - y * a
        felt[i, 7] = w - x * a - y * b - z * c
        felt[i, 4:8] /= np.sqrt(np.sum(felt[i, 4:8] ** 2))
        felt[i, 8:11] = states[i, 3:6]
    return felt


class Quadrotor:
    """One vehicle's body in the world. ``advance`` is told what the attitude controller is to
    reach."""

    def __init__(
        self, airframe: Airframe, T_world_body: np.ndarray, seed: int, wind_mps: float = 1.0
    ):
        self._airframe = airframe
        self._random = np.random.default_rng([seed, 1])
        heading = self._random.uniform(0, 2 * np.pi)
        self._mean_wind = wind_mps * np.array([np.cos(heading), np.sin(heading)])
        self._state = np.zeros(_STATE)
        self._state[_P] = T_world_body[:3, 3]
        self._state[_Q] = transforms.quaternion_xyzw(T_world_body)
        self._phases = self._random.uniform(0, 2 * np.pi, (3, 3))
        self._vibration_radps = 2 * np.pi * np.array(airframe.vibration_hz)
        self._vibration_rad = np.radians(airframe.vibration_rms_deg) * np.sqrt(2.0 / 3.0)
        # on the ground the wind finds no hold
        self._params = np.array(
            [
                airframe.max_thrust_n / airframe.mass_kg,
                airframe.drag_per_s,
                airframe.motor_lag_s,
                airframe.attitude_rate_per_s,
                airframe.rate_gain_per_s,
                *self._mean_wind.tolist(),
                _GUST_LAG_S,
                # standard deviation of gusts (m/s), share in a step
                0.35 * wind_mps,
                math.sqrt(2 * STEP_S / _GUST_LAG_S),
            ]
        )
        self.on_ground = True
        # of this state, where somebody asked for it
        self._T_world_body: Optional[np.ndarray] = None
        self._ahead, self._drawn = np.empty((0, 3)), 0  # gusts

    @property
    def hover_thrust(self) -> float:
        """Share of the maximum that carries the weight."""
        return self._airframe.mass_kg * G_MPS2 / self._airframe.max_thrust_n

    @property
    def position_m(self) -> np.ndarray:
        return self._state[_P].copy()

    @property
    def velocity_mps(self) -> np.ndarray:
        return self._state[_V].copy()

    @property
    def air_mps(self) -> float:
        """Speed through the air."""
        state = self._state.tolist()
        return math.dist(state[_V], state[_WIND])

    @property
    def T_world_body(self) -> np.ndarray:
        """Gives the pose without vibration."""
        if self._T_world_body is None:
            state = self._state.tolist()
            self._T_world_body = transforms.from_xyz_quaternion(state[_P], state[_Q])
        return self._T_world_body.copy()

    def place(self, T_world_body: np.ndarray) -> None:
        """Put it somewhere, at rest."""
        self._state[_P], self._state[_V] = T_world_body[:3, 3], 0.0
        self._state[_Q] = transforms.quaternion_xyzw(T_world_body)
        self._T_world_body = None

    def advance(self, command, steps: int) -> np.ndarray:
        """``steps`` steps of STEP_S under roll, pitch (rad), yaw rate (rad/s), thrust share; states
        (steps, 17)."""
        gust = self._gusts(steps)
        command = tuple(map(float, command))
        out = np.empty((steps, _STATE))
        self._T_world_body = None
        self.on_ground = bool(_advance(self._state, command, gust, self._params, steps, out))
        return out

    def _gusts(self, steps: int) -> np.ndarray:
        """(steps, 3), drawn a second ahead: to draw takes as long for a hundred as for one."""
        if self._drawn + steps > len(self._ahead):
            left = self._ahead[self._drawn :]
            self._ahead = np.concatenate(
                [left, self._random.standard_normal((max(steps, _DRAWN_AHEAD), 3))]
            )
            self._drawn = 0
        self._drawn += steps
        return self._ahead[self._drawn - steps : self._drawn]

    def felt(self, states: np.ndarray, start_s: float, thrust_share: float) -> np.ndarray:
        """What cameras on the airframe feel of ``advance``'s states after a time: its vibration,
        which grows with thrust. Returns (steps, 11): stamp (s), position, quaternion xyzw, velocity
        (world).
        """
        share = min(1.0, thrust_share / self.hover_thrust)
        return _felt(
            states, start_s, self._vibration_radps, self._phases, share * self._vibration_rad
        )
