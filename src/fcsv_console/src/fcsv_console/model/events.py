# SPDX-License-Identifier: Apache-2.0
"""What happened, with who asked and what was answered; kept with the session and exportable."""

import csv
import io
import math
from collections import deque
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import Deque, Sequence, Tuple

_MOST = 2000  # a flight of an hour has some hundreds; memory must not grow


@dataclass(frozen=True)
class Event:
    """``wall_s``: time of day; ``answer``: empty while there is none."""

    number: int
    wall_s: float
    who: str
    what: str
    answer: str = ""
    level: str = "info"  # info, warning, error

    @property
    def clock(self) -> str:
        """Local time of day."""
        return (
            datetime.fromtimestamp(self.wall_s).strftime("%H:%M:%S")
            if math.isfinite(self.wall_s)
            else "--:--:--"
        )


class EventLog:
    """The newest last.

    >>> log = EventLog()
    >>> number = log.add(0.0, "operator", "land all"); log.answer(number, "done: uav1", True)
    >>> [(e.who, e.what, e.answer) for e in log.events]
    [('operator', 'land all', 'done: uav1')]
    """

    def __init__(self) -> None:
        self._events: Deque[Event] = deque(maxlen=_MOST)
        self._number = 0
        self.changes = 0  # grows with every one

    @property
    def events(self) -> Tuple[Event, ...]:
        return tuple(self._events)

    def add(self, wall_s: float, who: str, what: str, answer: str = "", level: str = "info") -> int:
        """Its number, by which it is answered."""
        self._number += 1
        self.changes += 1
        self._events.append(Event(self._number, wall_s, who, what, answer, level))
        return self._number

    def answer(self, number: int, answer: str, done: bool) -> None:
        """What became of it; one that is too old to be kept is left alone."""
        for i, event in enumerate(self._events):
            if event.number == number:
                self.changes += 1
                self._events[i] = replace(
                    event, answer=answer, level=event.level if done else "error"
                )

    def as_csv(self) -> str:
        """Gives the events with times in UTC, ISO 8601."""
        out = io.StringIO()
        writer = csv.writer(out)
        writer.writerow(["time_utc", "who", "what", "answer", "level"])
        for e in self._events:
            stamp = datetime.fromtimestamp(e.wall_s, timezone.utc).isoformat(
                timespec="milliseconds"
            )
            writer.writerow([stamp, e.who, e.what, e.answer, e.level])
        return out.getvalue()


def calls_for_a_sound(events: Sequence[Event], number: int) -> bool:
    """Whether something newer than event ``number`` is a warning or an error.

    >>> log = EventLog()
    >>> first = log.add(0.0, "a", "fails", level="error")
    >>> calls_for_a_sound(log.events, 0), calls_for_a_sound(log.events, first)
    (True, False)
    """
    return any(e.level != "info" for e in events if e.number > number)
