# SPDX-License-Identifier: Apache-2.0
"""A line of the flight check, what it may say, and which of several is the worst."""

from dataclasses import dataclass
from typing import Callable, Dict, Iterable, List, Sequence, Tuple

from fcsv_control.conditions import Grade

_FROM_THE_WORST = (Grade.RED, Grade.UNKNOWN, Grade.AMBER, Grade.GREEN)
Found = Tuple[Grade, str]  # and what was found, for a person


@dataclass(frozen=True)
class Check:
    """One line of the table: ``must`` says what must be true, ``remedy`` what to do where it is
    not; ``grade`` is given the monotonic time (s), what was heard, and the rules."""

    name: str
    must: str
    remedy: str
    grade: Callable[..., Found]


@dataclass(frozen=True)
class Line:
    """A line as it is now; ``vehicle`` is "control" for the control PC; ``since_s``: for how long
    it has been so."""

    vehicle: str
    name: str
    state: Grade
    what: str
    remedy: str = ""
    since_s: float = 0.0
    accepted: bool = False

    @property
    def passes(self) -> bool:
        """Whether it keeps nobody from flying."""
        return self.state is Grade.GREEN or (self.state is Grade.AMBER and self.accepted)


def worst(lines: Iterable[Line]) -> Grade:
    """Gives the worst of a table; without a line it is not known.

    >>> worst([Line("uav1", "link", Grade.GREEN, ""), Line("uav1", "feed", Grade.UNKNOWN, "")]).word, worst([]).word
    ('unknown', 'unknown')
    """
    states = {line.state for line in lines}
    return next((s for s in _FROM_THE_WORST if s in states), Grade.UNKNOWN)


class Judged:
    """Judges a table of checks again and again, and knows since when each line has been in its
    state."""

    def __init__(self, vehicle: str, checks: Sequence[Check]):
        self._vehicle, self._checks = vehicle, checks
        self._since: Dict[str, Tuple[Grade, float]] = {}

    def lines(self, now_s: float, facts, rules) -> List[Line]:
        """The table at monotonic time ``now_s``."""
        return [
            self._line(now_s, check, *check.grade(now_s, facts, rules)) for check in self._checks
        ]

    def _line(self, now_s: float, check: Check, state: Grade, what: str) -> Line:
        before, since_s = self._since.get(check.name, (None, now_s))
        if before is not state:
            since_s = now_s
            self._since[check.name] = (state, now_s)
        remedy = "" if state is Grade.GREEN else check.remedy
        return Line(self._vehicle, check.name, state, what, remedy, now_s - since_s)
