# SPDX-License-Identifier: Apache-2.0
"""Whose hands a vehicle is in, as its guardian can tell.

GUIDED is the companion's. LAND and BRAKE are the companion's where it asked for them. Every other
mode is the pilot's or the autopilot's own, and so is whatever comes after it, until the mission
commands the vehicle again: it does so only when the operator has confirmed that the vehicle was
given back.
"""

from typing import Dict

COMPANIONS_MODES = ("GUIDED", "LAND", "BRAKE")
_ASKED_S = 6.0  # so long after it was asked for a mode may still show


class GuardianModeOwner:
    """``ours``: whether the guardian may command the vehicle now."""

    def __init__(self):
        self._mode = ""
        self._asked_s: Dict[str, float] = {}
        self._taken = False

    @property
    def ours(self) -> bool:
        return not self._taken and self._mode in COMPANIONS_MODES

    def asked(self, now_s: float, mode: str) -> None:
        """Agent or guardian asked for a mode."""
        self._asked_s[mode] = now_s

    def commanded(self, now_s: float) -> None:
        """The mission moves the vehicle, or asks for GUIDED: the operator has confirmed."""
        self._taken = self._taken and self._mode != "GUIDED"
        self.asked(now_s, "GUIDED")

    def see(self, now_s: float, mode: str, armed: bool) -> bool:
        """The mode as it shows; whether somebody else has just changed it."""
        if not armed:
            self._taken, self._mode = False, mode
            return False
        if mode == self._mode:
            return False
        first, self._mode = not self._mode, mode
        asked = now_s - self._asked_s.pop(mode, float("-inf")) < _ASKED_S
        if asked or (first and mode == "GUIDED"):
            self._taken = False
            return False
        self._taken = True
        return True
