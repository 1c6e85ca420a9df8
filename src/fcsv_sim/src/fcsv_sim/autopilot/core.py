# SPDX-License-Identifier: Apache-2.0
"""Modes, arming and failsafes: what ArduCopter does between its estimator and its attitude loop.

The core takes time as an argument and knows no MAVLink; ``texts`` collects what it has to say.
"""

import math
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.controller import LOITER_SPEED_MPS, Controller, climb_rate
from fcsv_sim.autopilot.estimator import Estimator
from fcsv_sim.people import rc

ACCEPTED, FAILED, DENIED, UNSUPPORTED = 0, 4, 2, 3  # MAV_RESULT
CRITICAL, WARNING, INFO = 2, 4, 6  # MAV_SEVERITY
_RC_LOST_S = 1.0
_DISARM_DELAY_S = 10.0
_VELOCITY_TIMEOUT_S = 3.0
_IDLE = (0.0, 0.0, 0.0, 0.0)
_LAND_SPEED_MPS = 0.5
_LAND_SPEED_HIGH_MPS = 1.2
_DEADZONE = 0.05


class Autopilot:
    """One flight controller. ``update`` gives the command for the airframe: roll, pitch, yaw rate, thrust."""

    def __init__(self, hover_thrust: float, seed: int):
        self.estimator = Estimator(seed)
        self.controller = Controller(hover_thrust)
        self.mode = modes.STABILIZE
        self.armed = False
        self.origin: Optional[Tuple[int, int, int]] = None  # lat, lon (1e-7 deg), altitude (mm)
        self.battery_v = 16.8
        self.battery_share = 1.0
        self.texts: List[Tuple[int, str]] = []
        self._now_s = 0.0
        self._sticks: Sequence[float] = (0.0, 0.0, -1.0, 0.0)
        self._rc_s: Optional[float] = None
        self._rc_mode: Optional[str] = None
        self._stick_arming_since_s: Optional[float] = None
        self._armed_s = 0.0
        self._flying = False
        self._on_ground_since_s: Optional[float] = None
        self._target_m = np.zeros(3)
        self._target_yaw_rad = 0.0
        self._target_v: Optional[np.ndarray] = None
        self._target_v_s = 0.0
        self._takeoff_m: Optional[float] = None
        self._hold_alt_m = 0.0
        self._climb_mps = 0.0
        self._failsafe = False

    # ---- what comes in -------------------------------------------------------------------------------------

    def rc_frame(self, now_s: float, pwm: Sequence[int]) -> None:
        """A frame of the transmitter; a moved mode switch sets the mode."""
        roll, pitch, throttle, yaw = (rc.stick(p) for p in pwm[:4])
        self._sticks, self._rc_s = (roll, -pitch, throttle, yaw), now_s
        mode = rc.mode_of(pwm[4])
        if mode != self._rc_mode:
            self._rc_mode = mode
            self.set_mode(now_s, modes.NUMBERS[mode])

    def set_mode(self, now_s: float, mode: int) -> int:
        """MAV_RESULT of a mode change."""
        if mode not in modes.NAMES:
            self.say(WARNING, f"No such mode {mode}")
            return FAILED
        if mode in modes.NEEDS_POSITION and not self._position_usable(now_s):
            self.say(WARNING, f"Mode change to {modes.NAMES[mode]} failed: requires position")
            return FAILED
        if mode != self.mode:
            self.mode = mode
            self._take_over()
        return ACCEPTED

    def arm(self, now_s: float, force: bool = False) -> int:
        """MAV_RESULT of an arming request; the reason of a refusal is said."""
        if self.armed:
            return ACCEPTED
        reasons = self.prearm_failures(now_s)
        if self.mode in modes.NEEDS_POSITION and not self.estimator.position_ok(now_s):
            reasons = ["Need Position Estimate"]
        elif force:
            reasons = []
        if self.mode in (modes.LAND, modes.BRAKE):
            reasons = [f"{modes.NAMES[self.mode]} mode not armable"]
        if reasons:
            for reason in reasons:
                self.say(CRITICAL, f"Arm: {reason}")
            return FAILED
        self.armed, self._armed_s, self._flying = True, now_s, False
        self.controller.reset()
        self._take_over()
        self.say(INFO, "Arming motors")
        return ACCEPTED

    def disarm(self, now_s: float, force: bool = False) -> int:
        """MAV_RESULT of a disarming request; refused in the air."""
        if self.armed and self._flying and not force:
            return FAILED
        if self.armed:
            self.say(INFO, "Disarming motors")
        self.armed, self._flying, self._takeoff_m = False, False, None
        return ACCEPTED

    def takeoff(self, altitude_m: float) -> int:
        """MAV_RESULT of NAV_TAKEOFF: only in GUIDED and armed; altitude above the ext frame's zero."""
        if self.mode != modes.GUIDED or not self.armed or altitude_m <= self.estimator.p_ext_m[2]:
            return FAILED
        self._target_m = np.array([*self.estimator.p_ext_m[:2], altitude_m])
        self._target_yaw_rad, self._target_v = self.estimator.yaw_ext_rad, None
        self._takeoff_m = altitude_m
        self._flying = True
        return ACCEPTED

    def set_point(self, now_s: float, position_m=None, velocity_mps=None, yaw_rad=None) -> bool:
        """A target in the ext frame, heard only in GUIDED; without a yaw it turns to the direction of travel."""
        if self.mode != modes.GUIDED:
            return False
        if position_m is not None:
            step = np.asarray(position_m) - self.estimator.p_ext_m
            if yaw_rad is None and np.linalg.norm(step[:2]) > 0.5:
                yaw_rad = float(np.arctan2(step[1], step[0]))
            self._target_m, self._target_v, self._takeoff_m = np.array(position_m, float), None, None
        elif velocity_mps is not None:
            self._target_v, self._target_v_s, self._takeoff_m = np.array(velocity_mps, float), now_s, None
        else:
            return False
        if yaw_rad is not None:
            self._target_yaw_rad = yaw_rad
        return True

    def set_origin(self, now_s: float, origin: Tuple[int, int, int]) -> bool:
        """Accepted once, and only when the filter runs."""
        if self.origin is not None or not self.estimator.started(now_s):
            return False
        self.origin = origin
        return True

    # ---- what is so ----------------------------------------------------------------------------------------

    @property
    def flying(self) -> bool:
        return self._flying

    def rc_alive(self, now_s: float) -> bool:
        return self._rc_s is not None and now_s - self._rc_s < _RC_LOST_S

    def prearm_failures(self, now_s: float) -> List[str]:
        """Reasons not to arm, as ArduCopter words them."""
        reasons = []
        if not self.estimator.feed_healthy(now_s):
            reasons.append("VisOdom: not healthy")
        if self.origin is None:
            reasons.append("AHRS: waiting for home")
        elif not self.estimator.position_ok(now_s):
            reasons.append("Need Position Estimate")
        if self.battery_share < 0.1:
            reasons.append("Battery 1 below minimum arming capacity")
        return reasons

    def say(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    # ---- the loop ------------------------------------------------------------------------------------------

    def update(self, now_s: float, dt_s: float, on_ground: bool, climb_mps: float) -> Tuple[float, ...]:
        """One pass after the estimator's prediction; the airframe's command."""
        self._now_s, self._climb_mps = now_s, climb_mps
        self._stick_gestures(now_s)
        self._failsafes(now_s)
        self._ground(now_s, on_ground)
        self.battery_share = max(0.0, self.battery_share - (dt_s / 900.0 if self._flying else dt_s / 36000.0))
        self.battery_v = 14.0 + 2.8 * self.battery_share - (0.4 if self._flying else 0.0)
        if not self.armed:
            return _IDLE
        if not self._flying and not self._wants_up():
            return (0.0, 0.0, 0.0, 0.08)  # spinning, not lifting
        self._flying = True
        return self._fly(now_s, dt_s)

    def _wants_up(self) -> bool:
        if self.mode in (modes.STABILIZE, modes.ALT_HOLD, modes.LOITER):
            return self._sticks[2] > 0.1
        return False  # GUIDED lifts off by NAV_TAKEOFF alone

    def _fly(self, now_s: float, dt_s: float) -> Tuple[float, ...]:
        roll, pitch, throttle, yaw = self._sticks if self.rc_alive(now_s) else (0.0, 0.0, -0.6, 0.0)
        estimate, control = self.estimator, self.controller
        if self.mode == modes.STABILIZE:
            lean = control.sticks(roll, pitch, yaw)
            return (*lean, float(np.clip(0.5 + 0.5 * throttle, 0.0, 1.0)))
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
        climb = climb or float(np.clip(self._hold_alt_m - self.estimator.baro_m, -1.0, 1.0))
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
        offset_m = zip(self._target_m[:2].tolist(), self.estimator.p_ext_m.tolist())
        hold = (min(1.0, max(-1.0, target - p)) for target, p in offset_m)
        rate = self.controller.yaw_rate(self._target_yaw_rad, self.estimator)
        return self.controller.to_velocity((*hold, sink), rate, self.estimator, dt_s)

    # ---- rules ---------------------------------------------------------------------------------------------

    def _position_usable(self, now_s: float) -> bool:
        return self.origin is not None and self.estimator.position_ok(now_s)

    def _take_over(self) -> None:
        """Targets of a new mode: here, as it stands."""
        self._target_m = self.estimator.p_ext_m.copy()
        if self._flying and self.mode == modes.BRAKE:
            self._target_m += self.estimator.v_ext_mps * 0.5
        self._target_yaw_rad = self.estimator.yaw_ext_rad
        self._target_v, self._takeoff_m = None, None
        self._hold_alt_m = self.estimator.baro_m

    def _stick_gestures(self, now_s: float) -> None:
        """Throttle low and rudder right for two seconds arms; rudder left disarms on the ground."""
        _, _, throttle, yaw = self._sticks
        gesture = self.rc_alive(now_s) and throttle < -0.9 and abs(yaw) > 0.9 and not self._flying
        if not gesture:
            self._stick_arming_since_s = None
        elif self._stick_arming_since_s is None:
            self._stick_arming_since_s = now_s
        elif now_s - self._stick_arming_since_s > 2.0:
            self._stick_arming_since_s = None
            if yaw < 0:
                self.disarm(now_s)
            elif self.mode in modes.MANUAL_ARMING:
                self.arm(now_s)
            else:
                self.say(CRITICAL, f"Arm: {modes.NAMES[self.mode]} mode not armable by sticks")

    def _failsafes(self, now_s: float) -> None:
        if self._failsafe:
            self._failsafe = not self.estimator.position_ok(now_s)
        elif self.armed and self.mode in modes.NEEDS_POSITION and not self.estimator.position_ok(now_s):
            self._failsafe = True
            self.say(CRITICAL, "EKF Failsafe: changed to LAND Mode")
            self.mode = modes.LAND
            self._take_over()

    def _ground(self, now_s: float, on_ground: bool) -> None:
        """Landing ends with motors off; so does arming without take-off."""
        if not self.armed:
            return
        if not self._flying:
            if now_s - self._armed_s > _DISARM_DELAY_S:
                self.disarm(now_s)
            return
        low = self.mode == modes.LAND or (self.mode != modes.GUIDED and self._sticks[2] < -0.9)
        if not (on_ground and low):
            self._on_ground_since_s = None
        elif self._on_ground_since_s is None:
            self._on_ground_since_s = now_s
        elif now_s - self._on_ground_since_s > 1.0:
            self._on_ground_since_s = None
            self.disarm(now_s, force=True)
