# SPDX-License-Identifier: Apache-2.0
"""What a fleet still waits for while it starts, in one line; the reasons once it takes longer than
it should."""

from typing import Dict, List, Sequence

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line

NORMAL_S = 60.0  # an autopilot's start, its filter and the clocks' agreement take about so long
_AGAIN_S = 15.0  # reasons are printed anew after so long
_MOST_NAMES = 4
_ABOUT = "starting, normal for about a minute"


class StartUp:
    """Sums up a start that began at ``began_s`` (the flight's monotonic time). Gives lines, prints
    nothing."""

    def __init__(self, began_s: float):
        self._began_s, self._told_s = began_s, float("-inf")
        self._lines: Sequence[Line] = ()
        self._problems: List[str] = []
        self._texts: Dict[str, str] = {}

    def check(self, lines: Sequence[Line]) -> None:
        """Takes the fleet's table of the flight check."""
        self._lines = lines

    def problems(self, problems: Sequence[str]) -> None:
        """Takes the reasons for which the mission does not go on."""
        self._problems = list(problems)

    def text(self, vehicle: str, text: str) -> None:
        """Takes a warning of an autopilot; while it starts, most of them are of the start."""
        self._texts[vehicle] = text

    def status(self) -> str:
        """One line: how many checks are left, and whose."""
        left: Dict[str, List[str]] = {}
        for line in self._lines:
            if line.state in (Grade.RED, Grade.UNKNOWN):
                left.setdefault(line.vehicle, []).append(line.name)
        if not self._lines:
            return f"{_ABOUT}: the vehicles are not heard yet"
        if not left:
            return f"{_ABOUT}: every check has passed"
        count = sum(map(len, left.values()))
        whose = "; ".join(f"{vehicle}: {_named(names)}" for vehicle, names in sorted(left.items()))
        return f"{_ABOUT}: {count} check{'' if count == 1 else 's'} to go ({whose})"

    def reasons(self, now_s: float) -> List[str]:
        """The reasons, a line each, where the start takes too long; none before, and not too
        often."""
        if (
            now_s < self._began_s + NORMAL_S
            or now_s < self._told_s + _AGAIN_S
            or not self._problems
        ):
            return []
        self._told_s = now_s
        took_s = now_s - self._began_s
        return [
            f"still not ready after {took_s:.0f} s:",
            *(f"    {text}" for text in self._detailed()),
        ]

    def _detailed(self) -> List[str]:
        """The check's lines say what was found; the mission's own words where there are none."""
        bad = [li for li in self._lines if li.state in (Grade.RED, Grade.UNKNOWN)]
        found = [
            f"{li.vehicle} {li.name} is {li.state.word}: {li.what}; {li.remedy}".rstrip("; ")
            for li in bad
        ]
        return (found or self._problems) + [
            f"{v}: {text}" for v, text in sorted(self._texts.items())
        ]


def _named(names: Sequence[str]) -> str:
    """
    >>> _named(["origin", "ekf"]), _named(["a", "b", "c", "d", "e", "f"])
    ('origin, ekf', 'a, b, c, d and 2 more')
    """
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
