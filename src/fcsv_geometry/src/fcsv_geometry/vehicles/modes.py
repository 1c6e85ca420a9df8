# SPDX-License-Identifier: Apache-2.0
"""Flight modes by ArduCopter's names, and whose the mode is that a vehicle shows."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Dict, Optional


class Mode(str, Enum):
    """A flight mode. Those that nothing here depends on keep their names, too.

    >>> Mode("LAND").stops, Mode("LOITER").gives_back, Mode("GUIDED").companions, Mode("DRIFT").value
    (True, True, True, 'DRIFT')
    """

    UNHEARD = ""
    GUIDED = "GUIDED"
    LAND = "LAND"
    BRAKE = "BRAKE"
    LOITER = "LOITER"
    ALT_HOLD = "ALT_HOLD"
    STABILIZE = "STABILIZE"
    AUTO = "AUTO"
    CIRCLE = "CIRCLE"
    FLIP = "FLIP"
    POSHOLD = "POSHOLD"
    RTL = "RTL"
    SMART_RTL = "SMART_RTL"

    __str__, __hash__ = str.__str__, str.__hash__

    @classmethod
    def _missing_(cls, value: object) -> Optional["Mode"]:
        if not isinstance(value, str):
            return None
        mode = str.__new__(cls, value)
        mode._name_ = mode._value_ = value
        return cls._value2member_map_.setdefault(value, mode)

    @property
    def stops(self) -> bool:
        """Whether it ends a flight where it is: it never waits and is never too late."""
        return self in (Mode.LAND, Mode.BRAKE)

    @property
    def companions(self) -> bool:
        """Whether a companion computer may ask for it; every other mode is a pilot's or the
        autopilot's."""
        return self == Mode.GUIDED or self.stops

    @property
    def gives_back(self) -> bool:
        """Whether a pilot who chooses it gives the vehicle back."""
        return self in (Mode.GUIDED, Mode.LOITER)

    @property
    def flies_on_position(self) -> bool:
        """Whether the autopilot needs a position for it."""
        return self in _ON_POSITION


_ON_POSITION = (
    Mode.AUTO,
    Mode.BRAKE,
    Mode.CIRCLE,
    Mode.GUIDED,
    Mode.LOITER,
    Mode.POSHOLD,
    Mode.RTL,
    Mode.SMART_RTL,
)


class Owner(Enum):
    """Whose a mode is."""

    NOBODY = "nobody"
    OURS = "ours"
    OTHERS = "others"


@dataclass(frozen=True)
class OwnerPolicy:
    """What a holder of a ModeOwner can know.

    ``counts_s``: for so long after it was asked for a mode may show. ``several``: all that was
    asked for counts, else the newest alone. ``overtaken``: another mode that shows ends what was
    asked. ``at_once``: one that shows already is ours as it is asked for. ``motors_off_end``: with
    motors off it is nobody's. ``until_given_back``: only what was ours or asked for can be taken,
    and who took it keeps it.
    """

    counts_s: float = math.inf
    several: bool = False
    overtaken: bool = False
    at_once: bool = False
    motors_off_end: bool = False
    until_given_back: bool = False


#: A vehicle's agent is told of all requests on board.
AGENT = OwnerPolicy(overtaken=True, at_once=True)
#: The flight link knows what becomes of its requests: ``done`` and ``refused``.
LINK = OwnerPolicy()
#: The guardian is told what is asked for, and not what becomes of it.
GUARDIAN = OwnerPolicy(counts_s=6.0, several=True, motors_off_end=True)
#: The mission counts on nobody before the operator has confirmed.
MISSION = OwnerPolicy(overtaken=True, at_once=True, motors_off_end=True, until_given_back=True)


class ModeOwner:
    """Whose the mode of one vehicle is: ours where it was asked for on our side, else another's, a
    pilot's or the autopilot's own.

    >>> owner = ModeOwner(AGENT)
    >>> owner.asked(Mode.GUIDED); owner.shows(Mode.GUIDED), owner.ours
    (False, True)
    >>> owner.shows(Mode.LOITER), owner.ours, owner.taken
    (True, False, True)
    """

    def __init__(self, policy: OwnerPolicy):
        self._policy = policy
        self.mode, self.armed, self._owner = Mode.UNHEARD, False, Owner.NOBODY
        self._asked_s: Dict[Mode, float] = {}  # what does not show yet

    @property
    def ours(self) -> bool:
        return self._owner is Owner.OURS

    @property
    def taken(self) -> bool:
        return self._owner is Owner.OTHERS

    @property
    def waits(self) -> bool:
        """Whether something was asked for that does not show yet."""
        return bool(self._asked_s)

    def asked(self, mode: Mode, now_s: float = 0.0) -> None:
        """A mode is asked for on our side."""
        if not self._policy.several:
            self._asked_s.clear()
        if self._policy.at_once and mode == self.mode and not self._kept:
            self._owner = Owner.OURS
        else:
            self._asked_s[mode] = now_s

    def done(self) -> None:
        """What was asked for was acknowledged: it is ours, also where it showed before."""
        if self.mode in self._asked_s:
            self._owner = Owner.OURS
        self._asked_s.clear()

    def refused(self, mode: Optional[Mode] = None) -> None:
        """A mode that was asked for (None: all) does not come: should it show later, another chose
        it."""
        for each in list(self._asked_s) if mode is None else [mode]:
            self._asked_s.pop(each, None)

    def mark_taken(self, mode: Mode) -> None:
        """It is another's, in this mode."""
        self.mode, self._owner = mode, Owner.OTHERS

    def take_over(self) -> None:
        """It was ours, in GUIDED, before this program began."""
        self.mode, self._owner = Mode.GUIDED, Owner.OURS

    def give_back(self) -> None:
        """Who took it has given it back: in GUIDED it is ours."""
        if self.taken:
            self._owner = Owner.OURS if self.mode == Mode.GUIDED else Owner.NOBODY

    def shows(self, mode: Mode, armed: bool = True, now_s: float = 0.0) -> bool:
        """A mode shows; whether it is a new one that was not asked for."""
        policy, before = self._policy, self.mode
        self.mode, self.armed = mode, armed
        if not armed and policy.motors_off_end:
            self._owner = Owner.NOBODY
            if policy.until_given_back:
                self._asked_s.clear()
            return False
        if mode == before or self._kept:
            return False
        if now_s - self._asked_s.pop(mode, -math.inf) < policy.counts_s:
            self._owner = Owner.OURS
            return False
        if mode == Mode.GUIDED and before == Mode.UNHEARD:
            return False  # this program began in flight
        if policy.until_given_back and not (self.ours or self._asked_s):
            return False
        if policy.overtaken:
            self._asked_s.clear()
        self._owner = Owner.OTHERS
        return True

    @property
    def _kept(self) -> bool:
        return self._policy.until_given_back and self.taken
