# SPDX-License-Identifier: Apache-2.0
"""Stop or land everybody, without the mission: who is commanded, again and again until the mode
shows, and who is not.

No ROS, no clock: states, acknowledgements and monotonic time in, commands and a report out.
"""

import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Set

from fcsv_geometry.frozen import frozen
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import STATE_AGE_S

STOP, LAND = "stop", "land"
REPEAT_S = 0.2
_AGAIN_S = 1.0  # after an answer the mode must show within this time, or it is asked anew
_UNHEARD_S = STATE_AGE_S.stop_all.red
# a mission that lives shows within this time that it lands everybody, upper vehicles aside first
_MISSION_S = 1.0
_MODES = {STOP: Mode.BRAKE, LAND: Mode.LAND}


@dataclass
class StopOrder:
    """The command to one vehicle: SET_MODE ``mode``, the same number until it is answered."""

    vehicle: str
    number: int
    mode: Mode
    ordered_s: float
    sent_s: float = -math.inf
    answered_s: Optional[float] = None
    refused: str = ""
    by_hand: bool = False  # its agent refused it because a pilot flies it


@frozen
class Report:
    """What became of the call, by vehicles' names; see fcsv_msgs/StopReport."""

    asked: str = ""
    reason: str = ""
    done: List[str] = field(default_factory=list)
    by_hand: List[str] = field(default_factory=list)
    under_way: List[str] = field(default_factory=list)
    unheard: List[str] = field(default_factory=list)
    problems: List[str] = field(default_factory=list)

    def in_words(self) -> str:
        """One line for the operator."""
        parts = [("done", self.done), ("under way", self.under_way), ("NOT HEARD", self.unheard)]
        said = [f"{what}: {', '.join(names)}" for what, names in parts if names]
        said += (
            [f"flown by hand, tell the pilot: {', '.join(self.by_hand)}"] if self.by_hand else []
        )
        return "; ".join([f"{self.asked} all ({self.reason})", *said, *self.problems])


@dataclass
class _Seen:
    mode: Mode = Mode.UNHEARD
    armed: bool = True  # until something else was heard
    heard_s: float = -math.inf

    @property
    def by_hand(self) -> bool:
        """Whether it is flown by hand for sure; its agent knows whose BRAKE and LAND are."""
        return bool(self.mode) and not self.mode.companions


class StopAll:
    """``begin`` is the call; ``due`` is asked often and gives what is to be sent now."""

    def __init__(self, vehicles: Sequence[str]):
        self._seen = {n: _Seen() for n in vehicles}
        self._orders: Dict[str, StopOrder] = {}
        self._stopped: Set[str] = set()  # showed BRAKE since the call to stop
        self._asked, self._reason, self._since_s = "", "", -math.inf
        self._number = 0
        self._mission_lands_s = -math.inf

    def begin(self, now_s: float, asked: str, reason: str) -> None:
        """Stop or land everybody; a call to land outranks one to stop that is under way."""
        self._asked, self._reason, self._since_s = asked, reason, now_s
        self._orders, self._stopped = {}, set()

    def end(self) -> None:
        """The operator goes on: nobody is commanded any more."""
        self._asked, self._orders = "", {}

    def state(self, now_s: float, name: str, mode: Mode, armed: bool) -> None:
        """What a vehicle shows. Without a mode its link hears no autopilot (yet): what it showed
        before stays."""
        seen = self._seen[name]
        self._seen[name] = (
            _Seen(mode, armed, now_s) if mode else _Seen(seen.mode, seen.armed, now_s)
        )
        if self._asked == STOP and mode == Mode.BRAKE:
            self._stopped.add(name)

    def mission(self, now_s: float, phase: str) -> None:
        """The mission lives; in LAND it lands everybody whom it flies, and knows who stands above
        whom."""
        if phase == "LAND":
            self._mission_lands_s = now_s

    def acknowledged(
        self, now_s: float, name: str, number: int, refusal: str, by_hand: bool = False
    ) -> None:
        """An answer came: "" when done, else why not; ``by_hand``: a pilot flies it."""
        order = self._orders.get(name)
        if order is not None and order.number == number and order.answered_s is None:
            order.answered_s, order.refused, order.by_hand = now_s, refusal, by_hand

    def due(self, now_s: float) -> List[StopOrder]:
        """Commands to send now."""
        if not self._asked or self._mission_does(now_s):
            return []
        return [o for o in (self._due(now_s, name) for name in self._seen) if o is not None]

    def report(self, now_s: float) -> Report:
        """What became of the last call."""
        report = Report(self._asked, self._reason)
        for name, seen in self._seen.items() if self._asked else ():
            order = self._orders.get(name)
            refused = order.refused if order is not None else ""
            if now_s - seen.heard_s > _UNHEARD_S:
                report.unheard.append(name)
            elif self._stands(name, seen):
                report.done.append(name)
            elif seen.by_hand or (order is not None and order.by_hand):
                report.by_hand.append(name)
            else:
                report.under_way.append(name)
                report.problems.extend([f"{name}: {refused}"] if refused else [])
        return report

    def _mission_does(self, now_s: float) -> bool:
        return (
            self._asked == LAND and max(self._since_s, self._mission_lands_s) > now_s - _MISSION_S
        )

    def _stands(self, name: str, seen: _Seen) -> bool:
        """Whether a vehicle is where the call wants it. One that was stopped and lands now has a
        newer reason: its guardian's, or that nobody confirmed for too long."""
        lands = seen.mode == Mode.LAND and name in self._stopped
        return not seen.armed or (self._asked == STOP and (seen.mode == Mode.BRAKE or lands))

    def _due(self, now_s: float, name: str) -> Optional[StopOrder]:
        seen, mode = self._seen[name], _MODES[self._asked]
        heard = now_s - seen.heard_s <= _UNHEARD_S
        if heard and (self._stands(name, seen) or seen.mode == mode or seen.by_hand):
            return None
        order = self._orders.get(name)
        answered_s = math.inf if order is None or order.answered_s is None else order.answered_s
        if order is None or now_s - answered_s > _AGAIN_S:
            self._number += 1
            # is said until there is another answer
            before = ("", False) if order is None else (order.refused, order.by_hand)
            order = StopOrder(name, self._number, mode, now_s, -math.inf, None, *before)
            self._orders[name] = order
        if order.answered_s is not None or now_s - order.sent_s < REPEAT_S:
            return None
        order.sent_s = now_s
        return order
