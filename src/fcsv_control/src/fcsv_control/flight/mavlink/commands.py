# SPDX-License-Identifier: Apache-2.0
"""One MAVLink command on its way: repeated until it is acknowledged, given up after some tries."""

from typing import Optional

# MAV_RESULT
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
_NAMES = {
    TEMPORARILY_REJECTED: "temporarily rejected",
    DENIED: "denied",
    UNSUPPORTED: "not supported",
    FAILED: "failed",
    CANCELLED: "cancelled",
}
_IN_PROGRESS_S = 5.0  # how long an "in progress" is believed


def result_name(result: int) -> str:
    """A MAV_RESULT in words."""
    return _NAMES.get(result, f"result {result}")


class PendingCommand:
    """A COMMAND_LONG number ``number``; time is given by the caller."""

    def __init__(self, number: int, now_s: float, timeout_s: float, tries: int):
        self.number = number
        self.asked_s = now_s
        self.result: Optional[int] = None  # MAV_RESULT once it is final
        self.sent = 0
        self._timeout_s = timeout_s
        self._tries = tries
        self._until_s = float("-inf")

    def due(self, now_s: float, again: bool = False) -> Optional[int]:
        """The confirmation number with which to send it now; None while waiting, or when over.

        ``again``: an accepted command is repeated, too, because its effect does not show yet.
        """
        answered = self.result is not None and not (again and self.result == ACCEPTED)
        if answered or now_s < self._until_s or self.sent >= self._tries:
            return None
        self._until_s = now_s + self._timeout_s
        self.sent += 1
        return self.sent - 1

    def acknowledge(self, now_s: float, result: int) -> None:
        """A COMMAND_ACK with this number came."""
        if result == IN_PROGRESS:
            self._until_s = now_s + _IN_PROGRESS_S
        elif self.sent and self.result is None:
            self.result = result

    def over(self, now_s: float) -> bool:
        """Answered, or given up."""
        return self.result is not None or self.given_up(now_s)

    def given_up(self, now_s: float) -> bool:
        """Sent as often as allowed, and the last time is over."""
        return self.sent >= self._tries and now_s >= self._until_s
