# SPDX-License-Identifier: Apache-2.0
"""Whether MAVROS's process hangs, and which one is to be ended: what it says and whether it
answers; no I/O.

Silence alone is no proof: a MAVROS whose autopilot is off, or whose line is cut, says nothing
either, and to end it would not help. One that hangs does not answer ROS's own question for its
process id either. Only a process that answered before is ended: one that starts up is left alone,
however long that takes.

In flight ending it is the safe way: nothing reaches the autopilot through it anyway, and who asked
it for a mode waits until its connection breaks. ArduCopter keeps its mode and flies on without
poses for about 8 s until its own failsafe lands it; roslaunch starts MAVROS again well before.
"""

from dataclasses import dataclass
from typing import Optional

_STALL_S = 1.5  # between two steps: this program itself had no processor time


@dataclass(frozen=True)
class MavrosWatchRules:
    """``silent_s``: nothing of it for longer is suspicious; ``unanswered``: questions in a row
    before it is ended."""

    silent_s: float = 1.5
    unanswered: int = 3

    def __post_init__(self):
        if not 0.5 <= self.silent_s <= 30.0:
            raise ValueError(f"silent_s: {self.silent_s} must be 0.5 to 30")
        if not 2 <= self.unanswered <= 20:
            raise ValueError(f"unanswered: {self.unanswered} must be 2 to 20")


class MavrosWatch:
    """Told what MAVROS says and answers; ``step`` once a second or more often. Times are monotonic.

    ``ended``: how often one was to be ended.
    """

    def __init__(self, rules: MavrosWatchRules, now_s: float):
        self._rules = rules
        self._heard_s = self._stepped_s = now_s
        self.pid: Optional[int] = None  # of the process that answered last
        self._unanswered = 0
        self.ended = 0

    def on_message(self, now_s: float) -> None:
        """Something of the autopilot came through it."""
        if now_s > self._heard_s:
            self._heard_s, self._unanswered = now_s, 0

    def answered(self, pid: Optional[int]) -> None:
        """What came of a question for its process id; None: no answer in time."""
        if pid is None:
            self._unanswered += 1
        else:
            self.pid, self._unanswered = pid, 0

    def gone(self) -> None:
        """The process that answered is there no more: roslaunch starts the next one."""
        self.pid, self._unanswered = None, 0

    def asks(self, now_s: float) -> bool:
        """Whether to ask it now: while it is silent, and once before, to learn which process it
        is."""
        return self.pid is None or self._silent(now_s)

    def step(self, now_s: float) -> Optional[int]:
        """Time passes; the process that hangs and is to be ended now."""
        stalled_s, self._stepped_s = now_s - self._stepped_s, now_s
        if stalled_s > _STALL_S:  # what came meanwhile is still to be read: no silence of MAVROS
            self._heard_s, self._unanswered = min(now_s, self._heard_s + stalled_s), 0
        if not self.hangs(now_s):
            return None
        pid = self.pid
        self.gone()
        self._heard_s = now_s  # of the next one
        self.ended += 1
        return pid

    def hangs(self, now_s: float) -> bool:
        """Silent, and the process that answered before does not."""
        return (
            self.pid is not None
            and self._silent(now_s)
            and self._unanswered >= self._rules.unanswered
        )

    def _silent(self, now_s: float) -> bool:
        return now_s - self._heard_s > self._rules.silent_s
