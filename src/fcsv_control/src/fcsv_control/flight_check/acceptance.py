# SPDX-License-Identifier: Apache-2.0
"""Amber lines that the operator accepted by name."""

from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line

_GREEN_S = 60.0


class Acceptances:
    """An acceptance lasts while its line is amber: it ends where it becomes red or unknown, or was
    green for a minute.

    >>> a, amber = Acceptances(), Line("uav1", "battery", Grade.AMBER, "31%")
    >>> a.accept([amber], "uav1", "battery"), [line.accepted for line in a.apply(0.0, [amber])]
    ('', [True])
    >>> a.accept([amber], "uav1", "feed")
    "uav1 has no line 'feed'; it has battery"
    """

    def __init__(self) -> None:
        # of what is accepted; infinite: it is amber
        self._green_since_s: Dict[Tuple[str, str], float] = {}

    def accept(self, lines: Sequence[Line], vehicle: str, name: str) -> str:
        """Why it cannot be accepted; "" where it is."""
        names = [line.name for line in lines if line.vehicle == vehicle]
        if not names:
            return f"'{vehicle}' is not one of {', '.join(dict.fromkeys(line.vehicle for line in lines))}"
        found = next((line for line in lines if (line.vehicle, line.name) == (vehicle, name)), None)
        if found is None:
            return f"{vehicle} has no line '{name}'; it has {', '.join(names)}"
        if found.state is not Grade.AMBER:
            return f"{vehicle} {name} is {found.state.word}: only amber lines are accepted"
        self._green_since_s[vehicle, name] = float("inf")
        return ""

    def apply(self, now_s: float, lines: Sequence[Line]) -> List[Line]:
        """The lines with what is accepted; call it for each table."""
        for line in lines:
            self._update(now_s, (line.vehicle, line.name), line.state)
        gone = set(self._green_since_s) - {(line.vehicle, line.name) for line in lines}
        for key in gone:
            del self._green_since_s[key]  # its vehicle is not heard
        accepted = self._green_since_s
        return [
            replace(li, accepted=li.state is Grade.AMBER and (li.vehicle, li.name) in accepted)
            for li in lines
        ]

    def _update(self, now_s: float, key: Tuple[str, str], state: Grade) -> None:
        if key not in self._green_since_s:
            return
        if state is Grade.AMBER:
            self._green_since_s[key] = float("inf")
        elif state is Grade.GREEN:
            self._green_since_s[key] = min(self._green_since_s[key], now_s)
        if state in (Grade.RED, Grade.UNKNOWN) or now_s - self._green_since_s[key] > _GREEN_S:
            del self._green_since_s[key]
