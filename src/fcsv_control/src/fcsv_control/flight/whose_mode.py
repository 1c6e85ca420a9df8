# SPDX-License-Identifier: Apache-2.0
"""Whose mode it is that shows: asked for on board, or somebody else's. The watchdog lands in the
former alone."""

from typing import Optional

from fcsv_control.flight.mavlink.requests import Outcome, Request


class LinkModeOwner:
    """``is_ours``: the mode that shows is the last one that was asked for here, and no other has
    shown since. A stop that somebody else had chosen before stays his.
    """

    def __init__(self):
        self.is_ours = False
        self._shown = self._asked = ""  # asked for, and not shown yet
        self._request: Optional[Request] = None

    def ask(self, mode: str, request: Request) -> None:
        """It is asked for here."""
        self._asked, self._request = mode, request

    def ask_through_others(self, mode: str) -> None:
        """It is asked for on board by who tells nothing of the answer."""
        self._asked, self._request = "" if mode == self._shown else mode, None

    def refused(self) -> None:
        """Where it shows later, a pilot chose it."""
        self._asked, self._request = "", None

    def shows(self, mode: str) -> bool:
        """A mode shows; whether it is a new one that was not asked for."""
        if mode == self._shown:
            return False
        strange = bool(self._shown) and mode != self._asked
        self._shown, self.is_ours = mode, mode == self._asked
        self._asked = "" if self.is_ours else self._asked
        return strange

    def step(self) -> None:
        """A mode is waited for while it is asked for. One that showed before is ours once it is
        acknowledged; a stop is not even sent then."""
        request = self._request
        if request is None or not request.over:
            return
        if request.outcome is Outcome.DONE and self._shown == self._asked and not request.insists:
            self.is_ours = True
        self.refused()
