# SPDX-License-Identifier: Apache-2.0
"""Which commands an agent executes: each number once, none too late, duplicates answered as before."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from fcsv_control.errors import CommandRefused

EXECUTE, REPEAT, WAIT, EXPIRED, IGNORE = "execute", "repeat", "wait", "expired", "ignore"
_REMEMBERED = 200


@dataclass(frozen=True)
class Answer:
    """What was answered to a command: CommandAck.result and reason."""

    result: int
    reason: str


class CommandLog:
    """Decides on numbered commands; keyed by sender and number."""

    def __init__(self, vehicle: str):
        self._vehicle = vehicle
        self._answers: OrderedDict[Tuple[str, int], Optional[Answer]] = OrderedDict()

    def judge(self, now_s: float, vehicle: str, sender: str, number: int, expires_s: float):
        """(what to do, the answer to repeat). A command under way waits; one never executed may be too late."""
        if vehicle != self._vehicle:
            return IGNORE, None
        key = (sender, number)
        if key in self._answers:
            answer = self._answers[key]
            return (WAIT, None) if answer is None else (REPEAT, answer)
        self._answers[key] = None
        while len(self._answers) > _REMEMBERED:
            self._answers.popitem(last=False)
        return (EXPIRED, None) if now_s > expires_s else (EXECUTE, None)

    def answered(self, sender: str, number: int, answer: Answer) -> None:
        """Remember what was answered."""
        self._answers[(sender, number)] = answer


def checked_target(T_odom_body: np.ndarray, frame: str, expected_frame: str, here_m, furthest_m: float) -> np.ndarray:
    """A target that may be flown to. Raises CommandRefused on another frame or one that is too far away."""
    if frame != expected_frame:
        raise CommandRefused(f"target is in frame '{frame}', this vehicle flies in '{expected_frame}'")
    distance_m = float(np.linalg.norm(T_odom_body[:3, 3] - np.asarray(here_m)))
    if not distance_m <= furthest_m:
        raise CommandRefused(f"target is {distance_m:.1f} m away, at most {furthest_m:.0f} m are allowed")
    return T_odom_body
