# SPDX-License-Identifier: Apache-2.0
"""Which of several windows has the goals in rviz: one drag must not change two lists."""

import math
from dataclasses import dataclass
from typing import Dict, Optional

TELL_S = 0.5  # so often each window tells that it is there
_GONE_S = 2.5  # who is silent for so long is gone


@dataclass(frozen=True, order=True)
class Window:
    """``opened_s``: time of day at which it was opened; ``name``: its node's."""

    opened_s: float
    name: str


class Turns:
    """``own`` has the goals while no window is heard that was opened before it, nor in its own
    first moments.

    >>> turns, other = Turns(Window(20.0, "/console_2")), Window(10.0, "/console_1")
    >>> [turns.mine(at_s) for at_s in (0.0, 2.4, 2.6)]
    [False, False, True]
    >>> turns.on_window(3.0, other), turns.mine(3.1), turns.before(3.1).name
    (None, False, '/console_1')
    >>> turns.mine(5.6), turns.before(5.6)
    (True, None)
    """

    def __init__(self, own: Window):
        self.own = own
        self._since_s = math.nan
        self._told_s = -math.inf
        self._others: Dict[Window, float] = {}

    def on_window(self, now_s: float, window: Window) -> None:
        """A window told that it is there; this one's own word is no other's."""
        if window != self.own:
            self._others[window] = now_s

    def mine(self, now_s: float) -> bool:
        """Whether this window shows the goals and takes what is asked of them."""
        if math.isnan(self._since_s):
            self._since_s = now_s
        return now_s - self._since_s > _GONE_S and self.before(now_s) is None

    def before(self, now_s: float) -> Optional[Window]:
        """The window that has them in place of this one; None: there is none."""
        first = min(
            [self.own, *(w for w, at_s in list(self._others.items()) if now_s - at_s <= _GONE_S)]
        )
        return first if first != self.own else None

    def due(self, now_s: float) -> bool:
        """Whether it is to tell now that it is there; then it counts as told."""
        if now_s - self._told_s < TELL_S:
            return False
        self._told_s = now_s
        return True
