# SPDX-License-Identifier: Apache-2.0
"""Whether a vehicle is flown by hand, as its agent can tell: by the modes that were asked for on
board."""

from typing import Optional


class AgentModeOwner:
    """GUIDED is flown by the agent. Another mode is somebody else's unless it was asked for here
    and shows since."""

    def __init__(self):
        self._asked: Optional[str] = None
        self._ours: Optional[str] = None
        self._mode, self._armed = "", False

    def asked(self, mode: str) -> None:
        """The flight link is asked for a mode, by the agent or by another guard on board."""
        self._asked = mode
        if mode == self._mode:
            self._ours = mode

    def not_done(self, mode: str) -> None:
        """The flight link did not bring it about: should the mode show later, somebody else chose
        it."""
        if self._asked == mode:
            self._asked = None

    def state(self, mode: str, armed: bool) -> None:
        """What the autopilot shows."""
        if mode == self._asked:
            self._ours, self._asked = mode, None
        elif mode != self._mode:
            self._asked = None
        if mode != self._ours:
            self._ours = None
        self._mode, self._armed = mode, armed

    @property
    def by_hand(self) -> str:
        """The mode in which somebody else flies it; empty: nobody else does."""
        return self._mode if self._armed and self._mode not in ("GUIDED", self._ours) else ""
