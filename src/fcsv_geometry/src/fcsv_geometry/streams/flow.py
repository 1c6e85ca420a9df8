# SPDX-License-Identifier: Apache-2.0
"""Flows of messages: what was dropped and why, and which of them pass where fewer are wanted. Time is an argument."""

import math
import threading
from collections.abc import Mapping
from typing import Dict, Iterator

_SET_BACK_S = 1.0  # a time that goes back further comes from a clock that was set
_SAME_MOMENT_S = 1e-4  # a stamp that was cut off just before its moment is of that moment


class DropCounter(Mapping):
    """How often something was dropped, by reason (0 where never), and when to tell of it. From any thread.

    >>> drops = DropCounter(quiet_s=5.0)
    >>> drops.count("too old"), drops.count("too old", 2), drops["too old"], drops["too new"], dict(drops)
    (1, 3, 3, 0, {'too old': 3})
    >>> [drops.tells("too old", now_s) for now_s in (0.0, 4.9, 5.0)]
    [True, False, True]
    """

    def __init__(self, quiet_s: float = 5.0):
        self._lock = threading.Lock()
        self._quiet_s = quiet_s
        self._counts: Dict[str, int] = {}
        self._gates: Dict[str, RateGate] = {}

    def count(self, reason: str, number: int = 1) -> int:
        """Count ``number`` drops; how many there were for this reason so far."""
        with self._lock:
            if number:
                self._counts[reason] = self._counts.get(reason, 0) + number
            return self._counts.get(reason, 0)

    def tells(self, reason: str, now_s: float) -> bool:
        """Whether to tell of this reason now: at most once in ``quiet_s``."""
        with self._lock:
            if reason not in self._gates:
                self._gates[reason] = RateGate(1.0 / self._quiet_s, early=0.0)
            return self._gates[reason].passes(now_s)

    @property
    def total(self) -> int:
        """Counts those of all reasons."""
        with self._lock:
            return sum(self._counts.values())

    def __getitem__(self, reason: str) -> int:
        with self._lock:
            return self._counts.get(reason, 0)

    def __contains__(self, reason: object) -> bool:
        with self._lock:
            return reason in self._counts

    def __iter__(self) -> Iterator[str]:
        with self._lock:
            return iter(list(self._counts))

    def __len__(self) -> int:
        return len(self._counts)


class RateGate:
    """Lets at most ``rate_hz`` messages a second pass, on average and as evenly as they come.

    ``early``: the share of a period by which one may come before its time and pass, so that jitter of the sender does
    not halve the rate of a regular flow; two are then at least 1 - 2 early periods apart. Not for several threads.

    >>> gate = RateGate(10.0)  # 30 Hz come in: every third passes, though some come a little early
    >>> [gate.passes(t_s) for t_s in (0.0, 0.033, 0.067, 0.098, 0.133)]
    [True, False, False, True, False]
    """

    def __init__(self, rate_hz: float, early: float = 0.1):
        if not rate_hz > 0 or not 0.0 <= early < 0.5:
            raise ValueError(f"rate_hz: {rate_hz} must be positive, early: {early} in 0..0.5")
        self._period_s, self._apart = 1.0 / rate_hz, 1.0 - 2.0 * early
        self._last_s = self._next_s = float("-inf")

    @classmethod
    def bursting(cls, rate_hz: float) -> "RateGate":
        """One that makes up for messages that came late: the average is kept also of a flow that it does not divide.

        >>> gate = RateGate.bursting(20.0)  # of 30 Hz two of three pass; RateGate(20.0) would let every other one
        >>> sum(gate.passes(k / 30.0) for k in range(300))
        201
        """
        gate = cls(rate_hz, 0.0)
        gate._apart = 0.0
        return gate

    @property
    def next_s(self) -> float:
        """When the next one may pass; minus infinity before the first."""
        return self._next_s

    def due(self, now_s: float) -> bool:
        """Whether one may pass now; a clock that was set back begins anew."""
        return now_s >= self._next_s or now_s <= self._last_s - _SET_BACK_S

    def admit(self, now_s: float, rate_hz: float = 0.0) -> None:
        """One passes now. ``rate_hz``: of the time until the next, where it changes."""
        if rate_hz:
            self._period_s = 1.0 / rate_hz
        planned_s = self._next_s if now_s >= self._next_s else float("-inf")
        self._last_s = now_s
        self._next_s = max(planned_s + self._period_s, now_s + self._apart * self._period_s)

    def passes(self, now_s: float) -> bool:
        """due() and take() in one."""
        if not self.due(now_s):
            return False
        self.admit(now_s)
        return True


class PhaseGate:
    """Lets the first message of every period pass. Periods are counted from the clock's zero, so that gates on several
    machines let messages of the same moments pass, where these come in phase. Not for several threads.

    >>> gate, later = PhaseGate(2.0), PhaseGate(2.0)  # cameras at 6 Hz; the second is heard from its fifth picture on
    >>> [k for k in range(12) if gate.passes(k / 6.0)], [k for k in range(4, 12) if later.passes(k / 6.0)]
    ([0, 3, 6, 9], [4, 6, 9])
    """

    def __init__(self, rate_hz: float):
        if not rate_hz > 0:
            raise ValueError(f"rate_hz: {rate_hz} must be positive")
        self._rate_hz = rate_hz
        self._period = float("-inf")

    def passes(self, stamp_s: float) -> bool:
        """Whether a message is of another period than the last that passed."""
        period = math.floor((stamp_s + _SAME_MOMENT_S) * self._rate_hz)
        if period == self._period:
            return False
        self._period = period
        return True
