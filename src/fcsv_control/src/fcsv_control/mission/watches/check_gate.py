# SPDX-License-Identifier: Apache-2.0
"""Nobody is handed over to the mission before the flight check is green, or each amber line was
accepted by name."""

from typing import List, Sequence

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line

REQUIRED, OFF = "required", "off"
CHOICES = (REQUIRED, OFF)
_MOST_TOLD = 4
_THIS_NODE = ("control", "mission")  # after its restart it is not heard for a moment
_ACCEPT = "mend it, or accept it: rosrun fcsv_control flight_check --accept VEHICLE LINE"


class OpenGate:
    """Stands in for rehearsals and benches, where no flight check runs: it lets everybody pass."""

    def tell(self, now_s: float, lines: Sequence[Line], patience_s: float) -> None:
        """A table came."""

    def before_take_off(self, now_s: float) -> List[str]:
        """Why nobody may take off: what is red or not known."""
        return []

    def before_list(self, now_s: float) -> str:
        """Why GUIDED is locked before the list begins; "" where it is not."""
        return ""

    def before_resuming(self, now_s: float) -> str:
        """Says what keeps it waiting, likewise of a list that was begun: what has become amber
        since keeps nobody waiting in the air."""
        return ""


class CheckGate(OpenGate):
    """Locked until a table is heard, and where none comes for ``patience_s``."""

    def __init__(self) -> None:
        self._lines: Sequence[Line] = ()
        self._until_s = float("-inf")

    def tell(self, now_s: float, lines: Sequence[Line], patience_s: float) -> None:
        """A table came; it counts until another one does, or for ``patience_s``."""
        self._lines = [li for li in lines if (li.vehicle, li.name) != _THIS_NODE]
        self._until_s = now_s + patience_s

    def before_take_off(self, now_s: float) -> List[str]:
        """Says what is missing, without texts that change while the line stays as it is."""
        if now_s > self._until_s:
            return ["the flight check is not heard: is fleet_check running?"]
        return [
            f"flight check: {_words(li)}"
            for li in self._lines
            if li.state in (Grade.RED, Grade.UNKNOWN)
        ]

    def before_list(self, now_s: float) -> str:
        """Red, not known, or amber and not accepted."""
        locked = [li for li in self._lines if not li.passes]
        amber = any(li.state is Grade.AMBER for li in locked)
        return self._locked(now_s, locked, _ACCEPT if amber else "mend it")

    def before_resuming(self, now_s: float) -> str:
        """Red, or not known."""
        locked = [li for li in self._lines if li.state in (Grade.RED, Grade.UNKNOWN)]
        return self._locked(now_s, locked, "mend it, or abort to land")

    def _locked(self, now_s: float, lines: Sequence[Line], remedy: str) -> str:
        if now_s > self._until_s:
            return "GUIDED is locked: the flight check is not heard"
        if not lines:
            return ""
        told = [f"{_words(li)} ({li.what})" for li in lines[:_MOST_TOLD]]
        more = [f"{len(lines) - _MOST_TOLD} more"] if len(lines) > _MOST_TOLD else []
        return f"GUIDED is locked: {'; '.join(told + more)}: {remedy}"


def _words(line: Line) -> str:
    return f"{line.vehicle} {line.name} is {line.state.word}"
