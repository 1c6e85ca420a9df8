# SPDX-License-Identifier: Apache-2.0
"""How each mode is flown: from targets or sticks to the airframe's command."""

import math
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.controller import LOITER_SPEED_MPS, Controller, climb_rate
from fcsv_sim.autopilot.estimator import Estimator

_RC_LOST_S = 1.0
_VELOCITY_TIMEOUT_S = 3.0
_LAND_SPEED_MPS = 0.5
_LAND_SPEED_HIGH_MPS = 1.2
_DEADZONE = 0.05


class FlightLaws:
    """The part of an autopilot that flies. Who inherits sets mode, targets and sticks, and has an ``origin``."""

    def __init__(self, estimator: Estimator, controller: Controller):
        self.estimator, self.controller = estimator, controller
        self.mode = modes.STABILIZE
        self._flying = False
        self._sticks: Sequence[float] = (0.0, 0.0, -1.0, 0.0)  # roll, pitch, throttle, yaw
        self._rc_s: Optional[float] = None
        self._target_m = np.zeros(3)
        self._target_yaw_rad = 0.0
        self._target_v: Optional[np.ndarray] = None
        self._target_v_s = 0.0
        self._takeoff_m: Optional[float] = None
        self._hold_alt_m = 0.0
        self._climb_mps = 0.0
        self._slowing_mps: List[float] = [0.0, 0.0]  # LAND: what is left of the speed with which it began

    def rc_alive(self, now_s: float) -> bool:
        return self._rc_s is not None and now_s - self._rc_s < _RC_LOST_S

    def _position_usable(self, now_s: float) -> bool:
        return self.origin is not None and self.estimator.position_ok(now_s)

    def _take_over(self) -> None:
        """Targets of a new mode: here, as it stands."""
        self._target_m = self.estimator.p_ext_m.copy()
        if self._flying and self.mode == modes.BRAKE:
            self._target_m += self.estimator.v_ext_mps * 0.5
        self._slowing_mps = self.estimator.v_ext_mps[:2].tolist() if self._flying else [0.0, 0.0]
        self._target_yaw_rad = self.estimator.yaw_ext_rad
        self._target_v, self._takeoff_m = None, None
        self._hold_alt_m = self.estimator.baro_m

    def _fly(self, now_s: float, dt_s: float) -> Tuple[float, ...]:
        roll, pitch, throttle, yaw = self._sticks if self.rc_alive(now_s) else (0.0, 0.0, -0.6, 0.0)
        estimate, control = self.estimator, self.controller
        if self.mode == modes.STABILIZE:
            lean = control.sticks(roll, pitch, yaw)
            return (*lean, min(1.0, max(0.0, 0.5 + 0.5 * throttle)))
        if self.mode == modes.ALT_HOLD:
            return self._alt_hold(roll, pitch, throttle, yaw, dt_s)
        if self.mode == modes.LOITER:
            return self._loiter(roll, pitch, throttle, yaw, dt_s)
        if self.mode == modes.LAND:
            return self._land(now_s, roll, pitch, dt_s)
        if self.mode == modes.BRAKE or self._target_v is None:
            return control.to_position(self._target_m, self._target_yaw_rad, estimate, dt_s)
        v = self._target_v if now_s - self._target_v_s < _VELOCITY_TIMEOUT_S else np.zeros(3)
        return control.to_velocity(v, control.yaw_rate(self._target_yaw_rad, estimate), estimate, dt_s)

    def _alt_hold(self, roll, pitch, throttle, yaw, dt_s):
        lean_roll, lean_pitch, yaw_rate = self.controller.sticks(roll, pitch, yaw)
        climb = climb_rate(throttle)
        self._hold_alt_m = self.estimator.baro_m if climb else self._hold_alt_m
        climb = climb or min(1.0, max(-1.0, self._hold_alt_m - self.estimator.baro_m))
        return self.controller.to_lean(lean_roll, lean_pitch, yaw_rate, climb, self._climb_mps, dt_s)

    def _loiter(self, roll, pitch, throttle, yaw, dt_s):
        _, _, yaw_rate = self.controller.sticks(0.0, 0.0, yaw if abs(yaw) > _DEADZONE else 0.0)
        c, s = math.cos(self.estimator.yaw_ext_rad), math.sin(self.estimator.yaw_ext_rad)
        forward = pitch * LOITER_SPEED_MPS if abs(pitch) > _DEADZONE else 0.0
        left = -roll * LOITER_SPEED_MPS if abs(roll) > _DEADZONE else 0.0
        v = [c * forward - s * left, s * forward + c * left, climb_rate(throttle)]
        for k, (p, v_now) in enumerate(zip(self.estimator.p_ext_m.tolist(), self.estimator.v_ext_mps.tolist())):
            if v[k]:  # a released stick brakes before it holds
                self._target_m[k] = p + (1.0, 1.0, 0.5)[k] * min(2.0, max(-2.0, v_now))
            else:
                v[k] = min(1.0, max(-1.0, float(self._target_m[k]) - p))
        if yaw_rate == 0.0:
            yaw_rate = self.controller.yaw_rate(self._target_yaw_rad, self.estimator)
        else:
            self._target_yaw_rad = self.estimator.yaw_ext_rad
        return self.controller.to_velocity(v, yaw_rate, self.estimator, dt_s)

    def _land(self, now_s, roll, pitch, dt_s):
        sink = -(_LAND_SPEED_HIGH_MPS if self.estimator.baro_m > 3.0 else _LAND_SPEED_MPS)
        if not self._position_usable(now_s):
            lean_roll, lean_pitch, _ = self.controller.sticks(roll, pitch, 0.0)
            return self.controller.to_lean(lean_roll, lean_pitch, 0.0, sink, self._climb_mps, dt_s)
        rate = self.controller.yaw_rate(self._target_yaw_rad, self.estimator)
        return self.controller.to_velocity((*self._stopped(dt_s), sink), rate, self.estimator, dt_s)

    def _stopped(self, dt_s: float) -> Tuple[float, float]:
        """Velocity that brings it to a stand and keeps it there: ArduCopter's LAND slows down by WPNAV_ACCEL, and holds
        the place where it stands then. From 2 m/s the real one came down 1.9 m further on."""
        x, y = self._slowing_mps
        speed_mps = math.hypot(x, y)
        less_mps = self.controller.limits.acceleration_mps2 * dt_s
        if speed_mps > less_mps:
            share = 1.0 - less_mps / speed_mps
            self._slowing_mps = [x * share, y * share]
            self._target_m[:2] = self.estimator.p_ext_m[:2]
            return x * share, y * share
        x, y = (float(target) - p for target, p in zip(self._target_m[:2], self.estimator.p_ext_m.tolist()))
        return min(1.0, max(-1.0, x)), min(1.0, max(-1.0, y))
