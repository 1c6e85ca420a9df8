# SPDX-License-Identifier: Apache-2.0
"""What to do when the pose feed dies: ArduCopter flies on blind for eight seconds, the companion must not."""

from dataclasses import dataclass
from typing import Optional

_POSITION_MODES = {"GUIDED", "LOITER", "BRAKE"}


@dataclass
class FeedWatchdog:
    """``check`` says "warn" once the feed is late and "land" once it is dead while flying on position."""

    warn_s: float = 0.4
    land_s: float = 0.8
    _last_s: Optional[float] = None
    _landed: bool = False

    def feed(self, now_s: float) -> None:
        self._last_s, self._landed = now_s, False

    def age_s(self, now_s: float) -> float:
        return float("inf") if self._last_s is None else now_s - self._last_s

    def check(self, now_s: float, armed: bool, mode: str) -> str:
        """ "" , "warn" or "land"; "land" is said once for each death of the feed."""
        if self._last_s is None or not armed or mode not in _POSITION_MODES:
            return ""
        age_s = now_s - self._last_s
        if age_s > self.land_s and not self._landed:
            self._landed = True
            return "land"
        return "warn" if age_s > self.warn_s else ""
