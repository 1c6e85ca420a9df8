# SPDX-License-Identifier: Apache-2.0
"""When a silent control PC means landing."""

from typing import Optional


class LinkLoss:
    """Whether to land because the control PC is silent. ``land_s`` 0: hold for ever."""

    _REPEAT_S = 5.0

    def __init__(self, land_s: float):
        self._land_s = land_s
        self._heard_s: Optional[float] = None
        self._said_s: Optional[float] = None
        self._obeyed = False

    def heard(self, now_s: float) -> None:
        """Something came from the control PC."""
        self._heard_s, self._said_s, self._obeyed = now_s, None, False

    def land(self, now_s: float, mode: str, armed: bool) -> bool:
        """Whether to land now: only a vehicle that this agent flies (armed in GUIDED), again until it leaves GUIDED."""
        if self._said_s is not None and mode != "GUIDED":
            self._obeyed = True  # who then goes back to GUIDED means it
        if not self._land_s or self._heard_s is None or self._obeyed or not armed or mode != "GUIDED":
            return False
        silent = now_s - self._heard_s > self._land_s
        if not silent or (self._said_s is not None and now_s - self._said_s < self._REPEAT_S):
            return False
        self._said_s = now_s
        return True
