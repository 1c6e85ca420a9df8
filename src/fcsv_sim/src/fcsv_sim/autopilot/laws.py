# SPDX-License-Identifier: Apache-2.0
"""How each mode is flown: from targets or sticks to the airframe's command."""

import math
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.controller import Controller, WayLimits
from fcsv_sim.autopilot.estimator import Estimator
from fcsv_sim.autopilot.sticks import LoiterVelocity, StickClimb, StickParameters, beyond_dead

_RC_LOST_S = 1.0
_VELOCITY_TIMEOUT_S = 3.0
_LAND_SPEED_MPS = 0.5
_LAND_SPEED_HIGH_MPS = 1.2


class FlightLaws:
    """The part of an autopilot that flies. Who inherits sets mode, targets and sticks, and has an
    ``origin``."""

    def __init__(self, estimator: Estimator, controller: Controller):
        self.estimator, self.controller = estimator, controller
        self.mode = modes.STABILIZE
        self.stick_parameters = StickParameters()
        self._loiters, self._climb = LoiterVelocity(), StickClimb()
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
        # LAND: what is left of the speed with which it began
        self._slowing_mps: List[float] = [0.0, 0.0]

    def fly_by(self, parameters: Dict[str, Tuple[float, int]]) -> None:
        """Parameters (value, type) by name: those that are known were read, or changed."""
        self.controller.limits = WayLimits.of(parameters)
        self.stick_parameters = StickParameters.of(parameters)

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
        self._loiters.begin((self._slowing_mps[0], self._slowing_mps[1]))
        self._climb.begin(float(self.estimator.v_ext_mps[2]) if self._flying else 0.0)
        self._target_yaw_rad = self.estimator.yaw_ext_rad
        self._target_v, self._takeoff_m = None, None
        self._hold_alt_m = self.estimator.baro_m

    def _fly(self, now_s: float, dt_s: float) -> Tuple[float, ...]:
        roll, pitch, throttle, yaw = self._sticks if self.rc_alive(now_s) else (0.0, 0.0, -0.6, 0.0)
        estimate, control = self.estimator, self.controller
        if self.mode == modes.STABILIZE:
            lean = self._leans(roll, pitch, yaw)
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
        return control.to_velocity(
            v, control.yaw_rate(self._target_yaw_rad, estimate), estimate, dt_s
        )

    def _leans(self, roll: float, pitch: float, yaw: float) -> Tuple[float, float, float]:
        """Lean angles and yaw rate of sticks beyond their dead bands."""
        return self.controller.sticks(
            beyond_dead(roll), beyond_dead(pitch), beyond_dead(yaw), self.stick_parameters.lean_rad
        )

    def _climbs(self, throttle: float, now_mps: float, dt_s: float) -> float:
        """Climb rate (m/s) of the throttle stick; 0 while it is let go."""
        wanted_mps = self.stick_parameters.climb_rate(throttle)
        if not wanted_mps:
            self._climb.begin(now_mps)
            return 0.0
        return self._climb.step(self.stick_parameters, wanted_mps, dt_s)

    def _alt_hold(self, roll, pitch, throttle, yaw, dt_s):
        lean_roll, lean_pitch, yaw_rate = self._leans(roll, pitch, yaw)
        climb = self._climbs(throttle, self._climb_mps, dt_s)
        self._hold_alt_m = self.estimator.baro_m if climb else self._hold_alt_m
        climb = climb or min(1.0, max(-1.0, self._hold_alt_m - self.estimator.baro_m))
        command = (lean_roll, lean_pitch, yaw_rate, climb, self._climb_mps, dt_s)
        return self.controller.to_lean(*command, climb_mps2=self._climb.mps2)

    def _loiter(self, roll, pitch, throttle, yaw, dt_s):
        sticks, estimate = self.stick_parameters, self.estimator
        _, _, yaw_rate = self.controller.sticks(0.0, 0.0, beyond_dead(yaw))
        v = [*self._loiters.step(sticks, roll, pitch, estimate.yaw_ext_rad, dt_s)]
        here, up_mps = estimate.p_ext_m.tolist(), float(estimate.v_ext_mps[2])
        v.append(self._climbs(throttle, up_mps, dt_s))
        for k in (0, 1):  # the target flies ahead, but not away
            ahead_m = float(self._target_m[k]) + v[k] * dt_s - here[k]
            self._target_m[k] = here[k] + min(2.0, max(-2.0, ahead_m))
            v[k] += min(1.0, max(-1.0, ahead_m))
        if v[2]:  # a released stick brakes before it holds
            self._target_m[2] = here[2] + 0.5 * min(2.0, max(-2.0, up_mps))
        else:
            v[2] = min(1.0, max(-1.0, float(self._target_m[2]) - here[2]))
        if yaw_rate == 0.0:
            yaw_rate = self.controller.yaw_rate(self._target_yaw_rad, self.estimator)
        else:
            self._target_yaw_rad = self.estimator.yaw_ext_rad
        return self.controller.to_velocity(
            v, yaw_rate, self.estimator, dt_s, sticks.loiter_mps2, ahead=1.0
        )

    def _land(self, now_s, roll, pitch, dt_s):
        sink = -(_LAND_SPEED_HIGH_MPS if self.estimator.baro_m > 3.0 else _LAND_SPEED_MPS)
        if not self._position_usable(now_s):
            lean_roll, lean_pitch, _ = self._leans(roll, pitch, 0.0)
            return self.controller.to_lean(lean_roll, lean_pitch, 0.0, sink, self._climb_mps, dt_s)
        rate = self.controller.yaw_rate(self._target_yaw_rad, self.estimator)
        return self.controller.to_velocity((*self._stopped(dt_s), sink), rate, self.estimator, dt_s)

    def _stopped(self, dt_s: float) -> Tuple[float, float]:
        """Velocity that brings it to a stand and keeps it there: ArduCopter's LAND slows down by
        WPNAV_ACCEL, and holds the place where it stands then. From 2 m/s the real one came down 1.9
        m further on."""
        x, y = self._slowing_mps
        speed_mps = math.hypot(x, y)
        less_mps = self.controller.limits.acceleration_mps2 * dt_s
        if speed_mps > less_mps:
            share = 1.0 - less_mps / speed_mps
            self._slowing_mps = [x * share, y * share]
            self._target_m[:2] = self.estimator.p_ext_m[:2]
            return x * share, y * share
        x, y = (
            float(target) - p
            for target, p in zip(self._target_m[:2], self.estimator.p_ext_m.tolist())
        )
        return min(1.0, max(-1.0, x)), min(1.0, max(-1.0, y))
