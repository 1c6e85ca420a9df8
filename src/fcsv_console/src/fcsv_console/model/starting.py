# SPDX-License-Identifier: Apache-2.0
"""What is normal while vehicles start: lines of the flight check that never passed, in a vehicle's
first minute."""

from typing import Dict, FrozenSet, Optional, Sequence, Set, Tuple

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line

NORMAL_S = 60.0  # an autopilot's start, its filter and the clocks' agreement take about so long
Name = Tuple[str, str]  # of a line: vehicle and name


class StartWatch:
    """Told the fleet's table with monotonic time; ``normal_s``: for how long a start is normal."""

    def __init__(self, normal_s: float = NORMAL_S):
        self._normal_s = normal_s
        self._began_s: Dict[str, float] = {}  # by vehicle; "" of this window
        self._passed: Set[Name] = set()

    def tell(self, now_s: float, lines: Sequence[Line]) -> None:
        """The flight check as it is now."""
        for line in lines:
            oldest_s = max(li.since_s for li in lines if li.vehicle == line.vehicle)
            # it may have begun before this window did
            self._began_s.setdefault(line.vehicle, now_s - oldest_s)
            if line.passes:
                self._passed.add((line.vehicle, line.name))

    def opened(self, now_s: float) -> None:
        """This window is there; the first time counts."""
        self._began_s.setdefault("", now_s)

    def starting(self, now_s: float) -> bool:
        """Whether this window was opened a moment ago: what it did not hear yet may still come."""
        self.opened(now_s)
        return now_s - self._began_s[""] < self._normal_s

    def waiting(self, now_s: float, lines: Optional[Sequence[Line]]) -> FrozenSet[Name]:
        """Lines that are red or unknown as they are at every start."""
        return frozenset(
            (li.vehicle, li.name)
            for li in lines or ()
            if li.state in (Grade.RED, Grade.UNKNOWN)
            and (li.vehicle, li.name) not in self._passed
            and now_s - self._began_s.get(li.vehicle, now_s) < self._normal_s
        )
