# SPDX-License-Identifier: Apache-2.0
"""A port in its process: it runs, is stopped for a while, is killed, and is started again."""

from typing import Callable, List, Sequence

from fcsv_control.agent.messages import SetPoint
from fcsv_control.flight.messages import PoseFed
from fcsv_control.ports import Port
from fcsv_geometry.vehicles.telemetry import SceneLook

# of which a process that was stopped reads the newest message
_TOPICS = (PoseFed, SetPoint, SceneLook)
_MOST_UNREAD = 2000  # what a socket keeps of a line that nobody reads


class RehearsedProcess:
    """``make`` makes the port of a new process at a time. What is killed hears nothing and says
    nothing."""

    def __init__(self, make: Callable[[float], Port]):
        self._make = make
        self.port = make(0.0)
        self.lives, self._sleeps = True, False
        self.runs = True  # neither killed nor stopped
        self._unread: List[object] = []

    def receive(self, now_s: float, message: object) -> None:
        """A message comes; where the process is stopped it waits."""
        if self.runs:
            self.port.receive(now_s, message)
        elif self.lives:
            if isinstance(message, _TOPICS):
                self._unread = [m for m in self._unread if type(m) is not type(message)]
            if len(self._unread) < _MOST_UNREAD:
                self._unread.append(message)

    def step(self, now_s: float) -> Sequence[object]:
        """What it sends, while it runs."""
        return self.port.step(now_s) if self.runs else ()

    def stop(self) -> None:
        """SIGSTOP."""
        self._sleeps, self.runs = True, False

    def go_on(self, now_s: float) -> None:
        """SIGCONT: it reads what came meanwhile."""
        self._sleeps, self.runs, unread = False, self.lives, self._unread
        self._unread = []
        for message in unread:
            self.receive(now_s, message)

    def kill(self) -> None:
        """Kills it until ``start``."""
        self.lives = self._sleeps = self.runs = False
        self._unread = []

    def start(self, now_s: float) -> None:
        """A new process, which knows nothing of what was before."""
        self.port, self.lives, self.runs = self._make(now_s), True, not self._sleeps
