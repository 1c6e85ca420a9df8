# SPDX-License-Identifier: Apache-2.0
"""A request to a flight link that may answer before its effect shows, as MAVROS does; our own
answers when it shows."""

import math
from typing import Callable, Dict, List, Optional

from fcsv_control.agent.messages import Ask, Kind
from fcsv_control.errors import ControlError
from fcsv_geometry.vehicles.modes import Mode

SHOWS_S, STOP_PATIENCE_S, STOP_REPEAT_S = 2.5, 5.0, 0.2  # as the flight link has them
_STATE_S = 0.5


class Shown:
    """What the autopilot shows, and why it refused, as an agent hears it; the newest request for a
    mode."""

    def __init__(self):
        self.mode, self.armed = Mode.UNHEARD, False
        self.newest: Optional[Asking] = None
        self._heard_s: Dict[Mode, float] = {}  # when a mode was heard last
        self._refusals: List[str] = []

    def state(self, now_s: float, mode: Mode, armed: bool) -> None:
        """mavros/state came."""
        self.mode, self.armed = mode, armed
        self._heard_s[mode] = now_s

    def refused(self, reason: str) -> None:
        """flight_link/refusal came."""
        self._refusals.append(reason)

    @property
    def refusals(self) -> int:
        """How many came so far."""
        return len(self._refusals)

    def refusal(self, after: int) -> str:
        """The newest, where more than ``after`` came; else empty."""
        return self._refusals[-1] if self.refusals > after else ""

    def showed(self, mode: Mode, since_s: float) -> bool:
        """Whether it is in the mode, or was since: a pilot who then takes over has the last
        word."""
        return self.mode == mode or self._heard_s.get(mode, -math.inf) >= since_s


class Asking:
    """``step`` says whether to send it now; ``over`` once its effect shows.

    It raises ControlError where the autopilot refused since it was sent, where a newer mode was
    asked for, and where the effect does not show in time.
    """

    def __init__(
        self,
        shown: Shown,
        now_s: float,
        what: str,
        shows: Callable[[], bool],
        again_s: float = math.inf,
        patience_s: float = SHOWS_S,
    ):
        self.over = False
        self._shown, self._asked_s, self._what, self._shows = shown, now_s, what, shows
        self._again_s, self._until_s, self._next_s = again_s, now_s + patience_s, now_s
        self._newest: Optional[Shown] = None
        self._refusals = shown.refusals
        self._taken = False

    @staticmethod
    def of(shown: Shown, now_s: float, ask: Ask) -> "Asking":
        """What an agent asks for; a take-off is over once the link took it."""
        if ask.kind is Kind.SET_MODE:
            return Asking.mode(shown, now_s, ask.mode)
        if ask.kind is Kind.ARM:
            return Asking.arming(shown, now_s, ask.flag)
        asking = Asking(shown, now_s, "take-off", lambda: asking._taken)
        return asking

    @staticmethod
    def mode(shown: Shown, now_s: float, mode: Mode) -> "Asking":
        """A mode that stops is sent again until it shows, however it was answered. An older request
        ends."""
        stops = mode.stops
        asking = Asking(
            shown,
            now_s,
            f"mode {mode}",
            lambda: shown.showed(mode, now_s),
            STOP_REPEAT_S if stops else math.inf,
            STOP_PATIENCE_S if stops else SHOWS_S,
        )
        asking._newest, shown.newest = shown, asking
        return asking

    @staticmethod
    def arming(shown: Shown, now_s: float, value: bool) -> "Asking":
        """The armed flag in the heartbeat lags by up to a second."""
        return Asking(
            shown, now_s, "arming" if value else "disarming", lambda: shown.armed == value
        )

    def answered(self, now_s: float) -> None:
        """The link took it. One that answers when it shows may have taken long; the state comes by
        another way."""
        self._taken, self._until_s = True, max(self._until_s, now_s + _STATE_S)
        self._next_s = max(self._next_s, now_s + self._again_s)

    def step(self, now_s: float) -> bool:
        """Whether to send it now. The first time always: what shows already may be about to
        change."""
        first = self._next_s == self._asked_s
        if not first and self._shows():
            self.over = True
            return False
        if self._newest is not None and self._newest.newest is not self:
            raise ControlError(f"{self._what} was overtaken by a newer command")
        refusal = self._shown.refusal(self._refusals)
        if refusal:
            raise ControlError(refusal)
        if not first and now_s >= self._until_s:
            armed = "armed" if self._shown.armed else "not armed"
            raise ControlError(
                f"{self._what} was sent, but the vehicle is in {self._shown.mode or 'no mode'}, {armed}"
            )
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._again_s
        return True
