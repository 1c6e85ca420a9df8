# SPDX-License-Identifier: Apache-2.0
"""A take-off: the Tello's own to about a metre, then sticks up to the altitude by its own
height."""

from typing import Optional, Union

import numpy as np

from fcsv_control.tello.messages import LandNow, TakeOffNow
from fcsv_control.tello.pid import Sticks
from fcsv_control.tello.rules import TelloRules

_P_PER_S, _MOST = 1.2, 0.5  # stick per metre, and the most of a stick
_THERE_M = 0.15
_AFTER_S = 1.5  # it stops by itself after its own take-off


class Climb:
    """``step`` until ``over``. ``failed`` says why it did not come about."""

    def __init__(self, now_s: float, altitude_m: float, rules: TelloRules):
        self._rules, self._altitude_m, self._begun_s = rules, altitude_m, now_s
        self._asked_s = float("-inf")
        self._up_s: Optional[float] = None
        self.over, self.failed = False, ""

    def step(
        self, now_s: float, in_the_air: bool, height_m: float
    ) -> Union[TakeOffNow, Sticks, LandNow]:
        """What to do now."""
        if self._up_s is None and not in_the_air:
            if now_s - self._begun_s > self._rules.take_off_s:
                self.over, self.failed = (
                    True,
                    f"it did not leave the ground in {self._rules.take_off_s:g} s",
                )
                return LandNow()
            if now_s - self._asked_s >= self._rules.repeat_s:
                self._asked_s = now_s
                return TakeOffNow()
            return Sticks()
        self._up_s = now_s if self._up_s is None else self._up_s
        if now_s - self._up_s < _AFTER_S:
            return Sticks()
        left_m = self._altitude_m - height_m
        if abs(left_m) < _THERE_M or not in_the_air:
            self.over = True
            return Sticks()
        if now_s - self._up_s > self._rules.climb_s:
            self.over, self.failed = True, f"{left_m:.1f} m are left to its altitude; holding here"
            return Sticks()
        return Sticks(up=float(np.clip(_P_PER_S * left_m, -_MOST, _MOST)))
