# SPDX-License-Identifier: Apache-2.0
"""What is wrong in a vehicle's diagnostics, short enough for the radio: the worst lines, at once
where they change."""

from dataclasses import dataclass
from typing import Callable, Dict, Iterable, Optional, Sequence, Tuple

from fcsv_control.flight_check.pace import Pace

OK, WARN, ERROR, STALE = range(4)  # as diagnostic_msgs/DiagnosticStatus
_FROM_THE_WORST = (ERROR, STALE, WARN)
_MOST_LINES = 3
# octets: a line with a count and all headers is within a second's bytes
_MOST_NAME, _MOST_TEXT = 40, 54
_BYTES_PER_S, _BURST_BYTES = 240.0, 500.0  # within 2 kbit/s over every minute
_SILENT_S, _FORGET_S = 5.0, 60.0
WELL_S = 5.0  # from one report to the next while nothing is wrong


@dataclass(frozen=True)
class Status:
    """One line of diagnostics; ``level`` as above."""

    name: str
    level: int
    text: str


class Digest:
    """``tell`` it all diagnostics, ask ``due`` often. ``own``: only names that begin so count,
    where several vehicles share a ROS master.

    A line that was wrong and is not told any more is STALE after 5 s, and forgotten after a minute.
    """

    def __init__(self, own: str = ""):
        self._own, self._pace = own, Pace(_BYTES_PER_S, _BURST_BYTES)
        # name -> wrong since, told last, line
        self._wrong: Dict[str, Tuple[float, float, Status]] = {}
        self._sent: Optional[Tuple[Tuple[str, int], ...]] = None
        self._sent_s = float("-inf")

    def tell(self, now_s: float, statuses: Iterable[Status]) -> None:
        """Takes the lines of one message, of any level."""
        for status in statuses:
            if not status.name.startswith(self._own):
                continue
            if status.level == OK:
                self._wrong.pop(status.name, None)
            else:
                since_s = self._wrong.get(status.name, (now_s, 0.0, status))[0]
                self._wrong[status.name] = (since_s, now_s, status)

    def lines(self, now_s: float) -> Tuple[Status, ...]:
        """All that is wrong, the worst first, of those as bad the oldest."""
        self._wrong = {n: w for n, w in self._wrong.items() if now_s - w[1] <= _FORGET_S}
        found = []
        for since_s, told_s, status in self._wrong.values():
            known = status.level in _FROM_THE_WORST and now_s - told_s <= _SILENT_S
            level = status.level if known else STALE
            found.append((_FROM_THE_WORST.index(level), since_s, _short(status, level)))
        return tuple(line for _, _, line in sorted(found, key=lambda f: (f[0], f[1], f[2].name)))

    def due(
        self, now_s: float, size_bytes: Callable[[Sequence[Status]], int]
    ) -> Optional[Tuple[Status, ...]]:
        """What goes over the radio now, None: nothing; then it counts as sent. ``size_bytes`` of
        lines on the way.

        The worst line is always there and fits into a second's bytes, so that it never waits
        longer.
        """
        lines = _packed(self.lines(now_s), size_bytes)
        now = tuple((line.name, line.level) for line in lines)
        changed = now != self._sent
        if not lines and not changed and now_s - self._sent_s < WELL_S:
            return None
        if not self._pace.due(now_s, size_bytes(lines), changed):
            return None
        self._sent, self._sent_s = now, now_s
        return lines


def _packed(
    lines: Sequence[Status], size_bytes: Callable[[Sequence[Status]], int]
) -> Tuple[Status, ...]:
    """Packs as many as a second carries, three at most; a last one without a name counts the
    others."""
    for k in range(min(len(lines), _MOST_LINES), 0, -1):
        more = [Status("", lines[k].level, f"and {len(lines) - k} more")] if len(lines) > k else []
        packed = (*lines[:k], *more)
        if size_bytes(packed) <= _BYTES_PER_S:
            break
    return packed if lines else ()


def _short(status: Status, level: int) -> Status:
    return Status(cut(status.name, _MOST_NAME), level, cut(status.text, _MOST_TEXT))


def cut(text: str, most: int) -> str:
    """Cuts the text to at most so many octets of UTF-8, three and more, whole characters, on one
    line; what is missing shows as "…".

    >>> cut("a\\nb", 9), cut("10°±", 5), cut("10°±", 6), len(cut("x" * 99, 40).encode())
    ('a b', '10…', '10°±', 40)
    """
    line = " ".join(text.split())
    if len(line.encode()) <= most:
        return line
    return line.encode()[: most - len("…".encode())].decode(errors="ignore") + "…"
