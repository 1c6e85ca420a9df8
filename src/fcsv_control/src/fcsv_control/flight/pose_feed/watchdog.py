# SPDX-License-Identifier: Apache-2.0
"""What to do when the pose feed dies: ArduCopter flies on blind for eight seconds, the companion
must not.

LAND, because BRAKE needs the position that is lost and LOITER without a transmitter sinks fast. It
is commanded in modes that the companion flies only: GUIDED, and those that it commanded itself. In
a mode that flies on position and that the pilot chose it speaks, because the pilot always wins.
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Optional

from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import POSE_AGE_S

_REPEAT_S = 1.0


@dataclass(frozen=True)
class WatchdogParameters:
    """Ages of the newest pose (s). ``land_s`` 0: never land, warn only."""

    warn_s: float = POSE_AGE_S.link.amber
    land_s: float = POSE_AGE_S.link.red

    def __post_init__(self):
        if not 0.1 <= self.warn_s <= 5.0:
            raise ValueError(f"warn_s: {self.warn_s} is not in 0.1..5")
        if self.land_s != 0.0 and not self.warn_s <= self.land_s <= 5.0:
            raise ValueError(f"land_s: {self.land_s} is neither 0 (never) nor in warn_s..5")


class Alarm(Enum):
    """What the age of the feed asks for."""

    NONE = auto()
    WARN = auto()  # it is late, or dead in a mode that the pilot chose
    LAND = auto()  # it is dead while the companion flies


class PoseWatchdog:
    """``check`` says what the age of the newest pose asks for."""

    def __init__(self, parameters: WatchdogParameters, now_s: float):
        self._parameters = parameters
        self._last_s = now_s  # a feed that never begins is as dead as one that ends
        self._asked_s: Optional[float] = None
        self._obeyed = False

    def pose_sent(self, now_s: float) -> None:
        """A pose went to the autopilot."""
        self._last_s, self._asked_s, self._obeyed = now_s, None, False

    def slept(self, now_s: float, seconds: float) -> None:
        """The check itself came late. Poses that came meanwhile are still to be read: no silence of
        the feed."""
        self._last_s = min(now_s, self._last_s + seconds)

    def age_s(self, now_s: float) -> float:
        """Age of the newest pose, or of this watchdog where there was none."""
        return now_s - self._last_s

    def check(self, now_s: float, armed: bool, mode: Mode, ours: bool = False) -> Alarm:
        """What to do now. ``ours``: the mode is one that the companion commanded.

        LAND comes again every second until the vehicle is seen in LAND, not thereafter: a pilot who
        then takes over in another mode has the last word.
        """
        if not armed:
            return Alarm.NONE
        if self._asked_s is not None and mode == Mode.LAND:
            self._obeyed = True
        if not mode.flies_on_position or self.age_s(now_s) <= self._parameters.warn_s:
            return Alarm.NONE
        companions = mode == Mode.GUIDED or ours
        dead = companions and 0.0 < self._parameters.land_s < self.age_s(now_s)
        just_asked = self._asked_s is not None and now_s - self._asked_s < _REPEAT_S
        if not dead or self._obeyed or just_asked:
            return Alarm.WARN
        self._asked_s = now_s
        return Alarm.LAND
