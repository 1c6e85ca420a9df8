# SPDX-License-Identifier: Apache-2.0
"""What the demo prints: lines with the flight's time, and one line that shows what goes on now."""

import contextlib
import subprocess
import sys
from typing import Callable, Iterator, Optional, TextIO, Tuple

from fcsv_geometry.programs.live_line import LiveLine, renewed
from fcsv_sim.machines import slow_motion

_CLOCKS_APART_S = 1.0


class Narrator:
    """Prints lines as ``[ 12.3 s] ...``; calling it is :meth:`say`. Several threads may print at
    once.

    ``clocks`` gives the flight's monotonic time and the wall's, s: both are printed once they have
    come apart.
    """

    def __init__(
        self,
        out: Optional[TextIO] = None,
        clocks: Callable[[], Tuple[float, float]] = slow_motion.both_clocks,
        terminal: Optional[bool] = None,
    ):
        self._clocks, self._began = clocks, clocks()
        self._live = LiveLine(sys.stdout if out is None else out, lambda: clocks()[1], terminal)

    def __call__(self, line: str) -> None:
        self.say(line)

    def say(self, line: str) -> None:
        """Prints a line that stays."""
        self._live.say(f"{self._times()} {line}")

    def status(self, line: str) -> None:
        """Shows what goes on now, in one line; call it as often as you like."""
        self._live.status(f"{self._times()} {line}")

    @contextlib.contextmanager
    def shown(self, words: str) -> Iterator[None]:
        """While the body runs, the status says what it does, and for how long."""
        began_s = self._clocks()[1]
        try:
            with renewed(lambda: self.status(f"{words}: {self._clocks()[1] - began_s:.0f} s")):
                yield
        finally:
            self.clear()

    def clear(self) -> None:
        """Removes the status, so that another program may print."""
        self._live.clear()

    def _times(self) -> str:
        flight_s, wall_s = (now - began for now, began in zip(self._clocks(), self._began))
        if wall_s - flight_s < _CLOCKS_APART_S:
            return f"[{flight_s:6.1f} s]"
        return f"[{flight_s:6.1f} s, {wall_s:.0f} s of wall time]"


def wait(child: subprocess.Popen, narrator: Narrator, words: str) -> int:
    """Waits for a quiet program and shows how long it has taken; returns its exit status."""
    with narrator.shown(words):
        return child.wait()


def in_minutes(seconds: float) -> str:
    """Writes the time for people.

    >>> in_minutes(40.0), in_minutes(130.0)
    ('40 s', '2 min')
    """
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
