# SPDX-License-Identifier: Apache-2.0
"""Numbered commands: each is executed once, its answer repeated, and never one that came too
late."""

from collections import OrderedDict
from dataclasses import dataclass
from enum import Enum, auto
from typing import Dict, Optional, Tuple

_REMEMBERED = 200


class CommandVerdict(Enum):
    """What becomes of a command."""

    EXECUTE = auto()
    REPEAT = auto()  # its answer: it was executed already
    WAIT = auto()  # it is under way
    EXPIRED = auto()  # it came too late
    IGNORE = auto()  # it is another vehicle's


@dataclass(frozen=True)
class Answer:
    """What was answered to a command: CommandAck.result and reason."""

    result: int
    reason: str


class CommandLog:
    """Decides on numbered commands; keyed by sender and number, numbers of one sender rise."""

    def __init__(self, vehicle: str):
        self._vehicle = vehicle
        self._answers: OrderedDict[Tuple[str, int], Optional[Answer]] = OrderedDict()
        self._newest: Dict[str, int] = {}  # number of the last move of each sender

    def decide(
        self,
        now_s: float,
        vehicle: str,
        sender: str,
        number: int,
        moves: bool,
        expires_s: float,
        stops: bool = False,
    ) -> Tuple[CommandVerdict, Optional[Answer]]:
        """(what to do, the answer to repeat). A command under way waits; one never executed may be
        too late.

        Of commands that move the vehicle (``moves``), one that a newer one of its sender overtook
        is too late, too: a way-point that the radio delayed must not undo the hold that came after
        it. A command that ``stops`` (HOLD, BRAKE, LAND) is never too late by the clock, which may
        be wrong on either machine.
        """
        if vehicle != self._vehicle:
            return CommandVerdict.IGNORE, None
        key = (sender, number)
        if key in self._answers:
            answer = self._answers[key]
            return (
                (CommandVerdict.WAIT, None) if answer is None else (CommandVerdict.REPEAT, answer)
            )
        self._answers[key] = None
        while len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
        overtaken = moves and number < self._newest.get(sender, 0)
        if overtaken or (now_s > expires_s and not stops):
            return CommandVerdict.EXPIRED, None
        if moves:
            self._newest[sender] = number
        return CommandVerdict.EXECUTE, None

    def answered(self, sender: str, number: int, answer: Answer) -> None:
        """Remember what was answered."""
        self._answers[(sender, number)] = answer
