# SPDX-License-Identifier: Apache-2.0
"""Commands and their answers between threads: callers wait here, the reading thread reports here."""

import threading
import time
from typing import Callable, Dict, Sequence

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight import commands
from fcsv_control.flight.commands import PendingCommand
from fcsv_control.flight.texts import Reasons

_REASON_WAIT_S = 0.3  # the reason may follow its acknowledgement


class Exchange:
    """``send(number, values, confirmation)`` puts a COMMAND_LONG on the line."""

    def __init__(self, send: Callable, timeout_s: float, tries: int):
        self._send, self._timeout_s, self._tries = send, timeout_s, tries
        self._changed = threading.Condition()
        self._pending: Dict[int, PendingCommand] = {}
        self._turns: Dict[int, threading.Lock] = {}
        self._reasons = Reasons()

    def run(self, number: int, values: Sequence[float]) -> PendingCommand:
        """Send until answered or given up; waits only for a running command of the same number."""
        with self._changed:
            turn = self._turns.setdefault(number, threading.Lock())
        with turn:
            pending = PendingCommand(number, time.monotonic(), self._timeout_s, self._tries)
            self._pending[number] = pending
            while not pending.over(time.monotonic()):
                confirmation = pending.due(time.monotonic())
                if confirmation is not None:
                    self._send(number, values, confirmation)
                self.wait(lambda: pending.result is not None, pending.wait_s(time.monotonic()))
            return pending

    def require_accepted(self, pending: PendingCommand, what: str) -> None:
        """Raises CommandRefused with the reason that the autopilot gave, LinkError where it gave no answer."""
        if pending.result is None:
            raise LinkError(f"{what}: the flight controller does not answer")
        if pending.result == commands.ACCEPTED:
            return
        self.wait(lambda: bool(self._reasons.since(pending.asked_s)), _REASON_WAIT_S)
        reason = self._reasons.since(pending.asked_s) or commands.result_name(pending.result)
        raise CommandRefused(f"{what} refused: {reason}")

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until ``condition`` holds, looked at whenever something was heard; whether it does."""
        with self._changed:
            return self._changed.wait_for(condition, timeout_s)

    # ---- from the reading thread ---------------------------------------------------------------------------

    def acknowledged(self, now_s: float, number: int, result: int) -> None:
        """A COMMAND_ACK for us came."""
        pending = self._pending.get(number)
        if pending is not None:
            pending.acknowledge(now_s, result)

    def said(self, now_s: float, severity: int, text: str) -> None:
        """The autopilot said something, which may be a reason."""
        self._reasons.add(now_s, severity, text)

    def heard(self) -> None:
        """A message was handled: whoever waits shall look."""
        with self._changed:
            self._changed.notify_all()
