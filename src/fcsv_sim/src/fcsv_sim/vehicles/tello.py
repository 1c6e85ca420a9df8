# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello: takes off, lands and holds its speed by itself; a pilot's sticks say which speed.

Like the real one (thesis 4.3) it has no use for positions: who flies it closes that loop with a tracker's poses. It
holds by its flow sensor, which is a little off, so that hands off means to drift slowly.
"""

from dataclasses import dataclass, field
from typing import Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.autopilot.controller import Controller
from fcsv_sim.truth import TruthWriter
from fcsv_sim.vehicles.dynamics import Airframe, Quadrotor
from fcsv_sim.vehicles.vehicle import PASS_S, SteppedBody, yaw_of

MAX_SPEED_MPS = 1.5  # the slow mode of its sticks
MAX_YAW_RATE_RPS = np.radians(60.0)
_HOVER_AT_M = 0.9  # where it stops after take-off
_CLIMB_MPS, _SINK_MPS = 0.6, 0.4
_STICKS_HOLD_S = 0.5  # a stick that is not repeated is let go
_OFF = (0.0, 0.0, 0.0, 0.0)


def tello_airframe() -> Airframe:
    """87 g with markers or tags (table 4.1)."""
    return Airframe(mass_kg=0.1, max_thrust_n=2.0, drag_per_s=0.4, motor_lag_s=0.04, attitude_rate_per_s=9.0,
                    vibration_rms_deg=0.1)  # fmt: skip


@dataclass(frozen=True)
class TelloParameters:
    """Of one simulated Tello; start: x, y, z (m) and yaw (rad) in the world. Errors are standard deviations."""

    vehicle: str
    sim_dir: str
    seed: int = 1
    start_xyz_yaw: Tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    wind_mps: float = 0.5
    flow_bias_mps: float = 0.02
    flow_noise_mps: float = 0.03
    airframe: Airframe = field(default_factory=tello_airframe)


@dataclass
class _Felt:
    """What its own sensors say, as Controller wants it: velocity (m/s) and heading (rad)."""

    v_ext_mps: np.ndarray
    yaw_ext_rad: float


class SimulatedTello(SteppedBody):
    """take_off(), land() and stick() as they come; advance_to() in between."""

    def __init__(self, parameters: TelloParameters, now_s: float):
        p = parameters
        *position, yaw = p.start_xyz_yaw
        body = Quadrotor(p.airframe, transforms.from_xyz_yaw(position, yaw), p.seed, p.wind_mps)
        super().__init__(body, TruthWriter(p.sim_dir, p.vehicle), now_s)
        self._random = np.random.default_rng([p.seed, 41])
        self._bias = p.flow_bias_mps * self._random.standard_normal(2)
        self._noise_mps = p.flow_noise_mps
        self._controller = Controller(body.hover_thrust)
        self._stick = (-np.inf, np.zeros(3), 0.0)
        self.mode = "LANDED"

    @property
    def flying(self) -> bool:
        return self.mode != "LANDED"

    def take_off(self) -> None:
        if not self.flying:
            self._controller.reset()
            self.mode = "TAKE_OFF"

    def land(self) -> None:
        if self.flying:
            self.mode = "LAND"

    def stick(self, now_s: float, v_body_mps, yaw_rate_rps: float) -> None:
        """Speed forward, left, up (m/s) and turn to the left (rad/s); beyond what sticks can ask it is the most."""
        v = np.clip(np.asarray(v_body_mps, float), -MAX_SPEED_MPS, MAX_SPEED_MPS)
        self._stick = (now_s, v, float(np.clip(yaw_rate_rps, -MAX_YAW_RATE_RPS, MAX_YAW_RATE_RPS)))

    def _decide(self, state: np.ndarray):
        if self.mode == "TAKE_OFF" and state[2] > _HOVER_AT_M:
            self.mode = "FLY"
        if self.mode == "LAND" and self.body.on_ground:
            self.mode = "LANDED"
        if not self.flying:
            return _OFF
        yaw = yaw_of(state)
        c, s = np.cos(yaw), np.sin(yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # from its heading to the world
        v_body, yaw_rate = self._wished()
        off = np.append(self._bias, 0.0) + self._random.normal(0.0, self._noise_mps, 3)
        felt = _Felt(state[3:6] + R @ off, yaw)
        command = self._controller.to_velocity(R @ v_body, yaw_rate, felt, PASS_S)
        # on its way down it must not lean on the ground: less and less thrust until it has stopped
        return (*command[:3], 0.0) if self.mode == "LAND" and state[2] < 0.03 else command

    def _wished(self) -> Tuple[np.ndarray, float]:
        if self.mode == "TAKE_OFF":
            return np.array([0.0, 0.0, _CLIMB_MPS]), 0.0
        if self.mode == "LAND":
            return np.array([0.0, 0.0, -_SINK_MPS]), 0.0
        stamp_s, v, yaw_rate = self._stick
        return (v, yaw_rate) if self._now_s - stamp_s < _STICKS_HOLD_S else (np.zeros(3), 0.0)
