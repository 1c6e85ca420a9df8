# SPDX-License-Identifier: Apache-2.0
"""What the autopilot decides on the ground: arming with the sticks, when a landing has ended, when
it complains."""

from typing import Optional, Sequence

# the filter begins and arming is possible this long after power-on (17 to 26 s were measured)
READY_S = 20.0
_GESTURE_S = 2.0
_LANDED_S = 1.0
_COMPLAINS_S = 30.0  # the first time after half of it
# LAND lowers the throttle slowly on the ground: 9.0 s from 3 m to disarmed were measured
_SPOOL_DOWN_S = 1.9


class StickArming:
    """Throttle low and rudder right for two seconds arms; rudder left disarms."""

    def __init__(self):
        self._since_s: Optional[float] = None

    def step(self, now_s: float, sticks: Optional[Sequence[float]]) -> Optional[bool]:
        """True: arm now; False: disarm now; None: nothing. ``sticks``: roll, pitch, throttle, yaw
        (-1..1) of a vehicle on the ground with a transmitter, else None."""
        if sticks is None or not (sticks[2] < -0.9 and abs(sticks[3]) > 0.9):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s > _GESTURE_S:
            self._since_s = None
            return sticks[3] > 0
        return None


class LandDetector:
    """Motors off some time after the ground was reached with low throttle."""

    def __init__(self):
        self._since_s: Optional[float] = None

    def landed(self, now_s: float, down: bool, in_land: bool) -> bool:
        """Whether the motors are switched off now."""
        if not down:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s > _LANDED_S + (_SPOOL_DOWN_S if in_land else 0.0):
            self._since_s = None
            return True
        return False


class PreArmTalk:
    """Says every half minute why it does not arm, until it would."""

    def __init__(self):
        self._next_s: Optional[float] = None

    def due(self, now_s: float, armed: bool) -> bool:
        """Whether the reasons are to be said now."""
        if self._next_s is None:
            self._next_s = now_s + 0.5 * _COMPLAINS_S
        if armed or now_s < self._next_s:
            return False
        self._next_s = now_s + _COMPLAINS_S
        return True
