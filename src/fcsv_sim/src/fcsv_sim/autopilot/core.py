# SPDX-License-Identifier: Apache-2.0
"""Modes, arming and failsafes: what ArduCopter does between its estimator and its attitude loop.

The core takes time as an argument and knows no MAVLink; ``texts`` collects what it has to say.
"""

from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.autopilot import modes
from fcsv_sim.autopilot.barometer import Barometer
from fcsv_sim.autopilot.controller import Controller
from fcsv_sim.autopilot.estimator import Estimator
from fcsv_sim.autopilot.gps import GpsReceiver
from fcsv_sim.autopilot.ground import READY_S, LandDetector, PreArmTalk, StickArming
from fcsv_sim.autopilot.laws import FlightLaws
from fcsv_sim.autopilot.origin import EkfOrigin
from fcsv_sim.people import rc

ACCEPTED, FAILED, DENIED, UNSUPPORTED = 0, 4, 2, 3  # MAV_RESULT
CRITICAL, WARNING, INFO = 2, 4, 6  # MAV_SEVERITY
_DISARM_DELAY_S = 10.0
_IDLE = (0.0, 0.0, 0.0, 0.0)


class Autopilot(FlightLaws):
    """One flight controller. ``update`` gives the command for the airframe: roll, pitch, yaw rate,
    thrust."""

    def __init__(self, hover_thrust: float, seed: int, ready_s: float = READY_S):
        super().__init__(Estimator(seed, ready_s), Controller(hover_thrust))
        self.armed = False
        self.boots = 1  # how often it was started: whoever speaks for it begins anew
        self._origin = EkfOrigin()
        self.barometer = Barometer(seed)
        self.gps: Optional[GpsReceiver] = None
        self.battery_v = 16.8
        self.battery_share = 1.0
        self.texts: List[Tuple[int, str]] = []
        self._now_s = 0.0
        self.rc_pwm: Sequence[int] = ()  # the newest frame
        self._rc_mode: Optional[str] = None
        self._stick_arming = StickArming()
        self._land_detector = LandDetector()
        self._pre_arm_talk = PreArmTalk()
        self._armed_s = 0.0
        self._failsafe = False

    # ---- what comes in ---------------------------------------------------------------------------

    def rc_frame(self, now_s: float, pwm: Sequence[int]) -> None:
        """A frame of the transmitter; a moved mode switch sets the mode."""
        roll, pitch, throttle, yaw = map(rc.stick, pwm[:4])
        self._sticks, self._rc_s, self.rc_pwm = (roll, -pitch, throttle, yaw), now_s, pwm
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
        """MAV_RESULT of NAV_TAKEOFF: only in GUIDED and armed; altitude above the ext frame's
        zero."""
        if self.mode != modes.GUIDED or not self.armed or altitude_m <= self.estimator.p_ext_m[2]:
            return FAILED
        self._target_m = np.array([*self.estimator.p_ext_m[:2], altitude_m])
        self._target_yaw_rad, self._target_v = self.estimator.yaw_ext_rad, None
        self._takeoff_m = altitude_m
        self._flying = True
        return ACCEPTED

    def set_point(self, now_s: float, position_m=None, velocity_mps=None, yaw_rad=None) -> bool:
        """A target in the ext frame, heard only in GUIDED; without a yaw it turns to the direction
        of travel."""
        if self.mode != modes.GUIDED:
            return False
        if position_m is not None:
            step = np.asarray(position_m) - self.estimator.p_ext_m
            if yaw_rad is None and np.linalg.norm(step[:2]) > 0.5:
                yaw_rad = float(np.arctan2(step[1], step[0]))
            self._target_m, self._target_v, self._takeoff_m = (
                np.array(position_m, float),
                None,
                None,
            )
        elif velocity_mps is not None:
            self._target_v, self._target_v_s, self._takeoff_m = (
                np.array(velocity_mps, float),
                now_s,
                None,
            )
        else:
            return False
        if yaw_rad is not None:
            self._target_yaw_rad = yaw_rad
        return True

    def set_origin(self, now_s: float, origin: Tuple[int, int, int]) -> bool:
        """Whether it is accepted (see Origin)."""
        return self._origin.set(origin, self.estimator.started(now_s))

    def reboot(self) -> None:
        """Starts anew as if its watchdog reset it in flight: boot time, streams, intervals, origin
        and position are gone, the filter begins anew, the system id stays. Motors and mode go on,
        which is kinder than ArduCopter: that one comes up disarmed and falls. What a companion sees
        is the same, and a position mode ends in the EKF failsafe's LAND.
        """
        self.estimator.begin()
        self.controller.reset()
        self._origin = EkfOrigin()
        self.boots += 1
        self._pre_arm_talk = PreArmTalk()
        self.texts.clear()
        self._take_over()

    # ---- what is so ------------------------------------------------------------------------------

    @property
    def flying(self) -> bool:
        return self._flying

    @property
    def failsafe(self) -> bool:
        """Whether a failsafe has triggered and not ended."""
        return self._failsafe

    @property
    def origin(self) -> Optional[Tuple[int, int, int]]:
        """Latitude, longitude (1e-7 deg) and altitude (mm) that it reports; None where it has
        none."""
        return self._origin.reported(self.estimator.runs)

    def prearm_failures(self, now_s: float) -> List[str]:
        """Reasons not to arm, as ArduCopter words them."""
        reasons = []
        if not self.estimator.vision_healthy(now_s):
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

    # ---- the loop --------------------------------------------------------------------------------

    def update(
        self, now_s: float, dt_s: float, on_ground: bool, climb_mps: float
    ) -> Tuple[float, ...]:
        """One pass after the estimator's prediction; the airframe's command."""
        self._now_s, self._climb_mps = now_s, climb_mps
        self._stick_gestures(now_s)
        self._failsafes(now_s)
        if self._origin.step(now_s, self.armed, self.estimator.runs):
            self.estimator.reset_height_datum()
            self.say(INFO, "Field Elevation Set: 0m")
        if self._pre_arm_talk.due(now_s, self.armed):
            for reason in self.prearm_failures(now_s):
                self.say(CRITICAL, f"PreArm: {reason}")
        self._ground(now_s, on_ground)
        self.battery_share = max(
            0.0, self.battery_share - (dt_s / 900.0 if self._flying else dt_s / 36000.0)
        )
        self.battery_v = 14.0 + 2.8 * self.battery_share - (0.4 if self._flying else 0.0)
        if not self.armed:
            return _IDLE
        if not self._flying and not self._wants_up():
            return (0.0, 0.0, 0.0, 0.08)  # spinning, not lifting
        self._flying = True
        return self._fly(now_s, dt_s)

    def _wants_up(self) -> bool:
        if self.mode in (modes.STABILIZE, modes.ALT_HOLD, modes.LOITER):
            return self._sticks[2] > max(0.1, self.stick_parameters.throttle_dead)
        return False  # GUIDED lifts off by NAV_TAKEOFF alone

    # ---- rules -----------------------------------------------------------------------------------

    def _stick_gestures(self, now_s: float) -> None:
        sticks = self._sticks if not self._flying and self.rc_alive(now_s) else None
        wanted = self._stick_arming.step(now_s, sticks)
        if wanted is False:
            self.disarm(now_s)
        elif wanted and self.mode in modes.MANUAL_ARMING:
            self.arm(now_s)
        elif wanted:
            self.say(CRITICAL, f"Arm: {modes.NAMES[self.mode]} mode not armable by sticks")

    def _failsafes(self, now_s: float) -> None:
        if self._failsafe:
            self._failsafe = not self.estimator.position_ok(now_s)
        elif (
            self.armed
            and self.mode in modes.NEEDS_POSITION
            and not self.estimator.position_ok(now_s)
        ):
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
        if self._land_detector.landed(now_s, on_ground and low, self.mode == modes.LAND):
            self.disarm(now_s, force=True)
