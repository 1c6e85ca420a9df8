# SPDX-License-Identifier: Apache-2.0
"""How long each kind of pause may last, and what the mission does after that."""

from enum import Enum
from functools import lru_cache
from typing import Dict, Iterable, List, Mapping, Optional

from fcsv_geometry.missions.flight_limits import PauseLimits


class Pause(Enum):
    """Why the mission does not go on."""

    LOST = "no pose or state, a guardian that acts, or vehicles too near"
    BATTERY = "a battery"
    RECORDER = "a recorder"
    PILOT = "a vehicle in a pilot's hands"
    HANDOVER = "GUIDED is not taken"
    OPERATOR = "the operator has not confirmed"


#: Said only after half of the limit: until then they are the ordinary way.
_ORDINARY = (Pause.HANDOVER, Pause.OPERATOR)
BACK, LAND, BY_HAND = (
    "back to the column, then landing",
    "landing",
    "the mission ends, pilots land by hand",
)


@lru_cache(maxsize=None)
def what_follows(
    phase: str, going_back: bool, by_hand: bool, lands_there: bool = False
) -> Mapping[Pause, str]:
    """What follows each kind of pause, where that has a limit; ``by_hand``: people fly; ``lands_there``:
    no vehicle goes back."""
    if phase == "CONFIGURATIONS":
        then = LAND if lands_there else BACK
        return {**({} if going_back else dict.fromkeys(Pause, then)), Pause.LOST: LAND}
    if phase == "GUIDED":
        return dict.fromkeys(Pause, LAND)
    return dict.fromkeys((Pause.BATTERY, Pause.OPERATOR), BY_HAND) if by_hand else {}


class PauseTimers:
    """Since when each kind of pause lasts."""

    def __init__(self, limits: PauseLimits):
        self._most_s: Dict[Pause, float] = {
            Pause.LOST: limits.pause_s,
            Pause.BATTERY: limits.low_battery_s,
            Pause.RECORDER: limits.recorder_s,
            Pause.PILOT: limits.pilot_s,
            Pause.HANDOVER: limits.handover_s,
            Pause.OPERATOR: limits.operator_s,
        }
        self._since_s: Dict[Pause, float] = {}

    def begin_anew(self) -> None:
        """What was waited for has come: another wait begins."""
        self._since_s = {}

    def update(self, now_s: float, kinds: Iterable[Pause]) -> Optional[Pause]:
        """These kinds last; the first whose limit has passed."""
        self._since_s = {k: self._since_s.get(k, now_s) for k in kinds}
        over = {k for k in self._since_s if self._lasts_s(now_s, k) > self._most_s[k]}
        return next((k for k in Pause if k in over), None) if over else None

    def announcements(self, now_s: float, then: Mapping[Pause, str]) -> List[str]:
        """What happens next, a line per kind of pause; texts that do not change while it lasts."""
        told = [
            k
            for k in self._since_s
            if k not in _ORDINARY or self._lasts_s(now_s, k) > 0.5 * self._most_s[k]
        ]
        return [
            f"{k.value}: after {self._most_s[k]:g} s {then[k]}"
            for k in (Pause if told else ())
            if k in told and k in then
        ]

    def ended(self, kind: Pause) -> str:
        """Says, in words, what ended the mission's patience."""
        return f"{kind.value} for {self._most_s[kind]:g} s"

    def _lasts_s(self, now_s: float, kind: Pause) -> float:
        return now_s - self._since_s.get(kind, now_s)
