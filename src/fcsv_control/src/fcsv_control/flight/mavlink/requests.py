# SPDX-License-Identifier: Apache-2.0
"""What was asked of the autopilot and is not answered yet. Nothing here waits: time is given by the
caller.

Every open request speaks with a component id of its own. ArduPilot addresses its COMMAND_ACK to the
component that asked, so that a late answer to one mode command is never taken for the answer to the
next one.
"""

from collections import deque
from enum import Enum
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_control.flight.mavlink import commands
from fcsv_control.flight.mavlink.commands import PendingCommand
from fcsv_control.flight.mavlink.texts import Reasons
from fcsv_control.flight.state import FlightState

COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER: heartbeats, poses and set-points
_COMPONENTS = (192, 193, 194, COMPANION)  # MAV_COMP_ID_ONBOARD_COMPUTER2 to 4 first
_REASON_WAIT_S = 0.3  # the reason may follow its acknowledgement
_SHOWS_S = 2.5  # the heartbeat's armed flag lags up to a second


class Outcome(Enum):
    """How a request ended."""

    DONE = "done"
    REFUSED = "refused"
    NO_ANSWER = "no answer"
    OVERTAKEN = "overtaken"


class Request:
    """One COMMAND_LONG on its way, over when it is refused, unanswered, overtaken, or when its
    effect shows.

    ``shown`` says whether the autopilot's state has what was asked for; without it the
    acknowledgement is enough. ``until_shown`` repeats the command until then, whatever is
    acknowledged.
    """

    def __init__(
        self,
        pending: PendingCommand,
        values: Sequence[float],
        what: str,
        component: int,
        shown: Optional[Callable[[FlightState], bool]] = None,
        until_shown: bool = False,
    ):
        self.pending, self.values, self.what, self.component = (
            pending,
            tuple(values),
            what,
            component,
        )
        self.outcome: Optional[Outcome] = None
        self.reason = ""
        self._shown, self._until_shown = shown, until_shown
        self._answered_s: Optional[float] = None

    @property
    def number(self) -> int:
        """The MAV_CMD."""
        return self.pending.number

    @property
    def over(self) -> bool:
        return self.outcome is not None

    @property
    def insists(self) -> bool:
        """Whether it is repeated until its effect shows."""
        return self._until_shown

    def require_done(self) -> None:
        """Raises CommandRefused with the autopilot's reason, LinkError where it gave no answer.
        Only when over."""
        if self.outcome is Outcome.NO_ANSWER:
            raise LinkError(f"{self.what}: the flight controller does not answer")
        if self.outcome is not Outcome.DONE:
            raise CommandRefused(self.reason)

    def end(self, outcome: Outcome, reason: str = "") -> None:
        """The first outcome stays."""
        if self.outcome is None:
            self.outcome, self.reason = outcome, reason

    def step(self, now_s: float, state: FlightState, reasons: Reasons) -> Optional[int]:
        """The confirmation number with which to send it now, or None. Ends the request where it is
        over."""
        if self.over:
            return None
        accepted = self.pending.result == commands.ACCEPTED
        if self._shown is not None and self._shown(state) and (accepted or self._until_shown):
            self.end(Outcome.DONE)
            return None
        if self.pending.result is None or (self._until_shown and accepted):
            return self._send_again(now_s, state)
        self._answered_s = now_s if self._answered_s is None else self._answered_s
        if not accepted:
            self._refused(now_s, reasons)
        elif self._shown is None:
            self.end(Outcome.DONE)
        elif now_s - self._answered_s > _SHOWS_S:
            self.end(Outcome.REFUSED, self._not_shown(state))
        return None

    def _send_again(self, now_s: float, state: FlightState) -> Optional[int]:
        if self.pending.given_up(now_s):
            acknowledged = self.pending.result is not None
            self.end(Outcome.REFUSED if acknowledged else Outcome.NO_ANSWER, self._not_shown(state))
            return None
        return self.pending.due(now_s, again=self._until_shown)

    def _refused(self, now_s: float, reasons: Reasons) -> None:
        told = reasons.since(self.pending.asked_s)
        if told or now_s - self._answered_s > _REASON_WAIT_S:
            self.end(
                Outcome.REFUSED,
                f"{self.what} refused: {told or commands.result_name(self.pending.result)}",
            )

    def _not_shown(self, state: FlightState) -> str:
        armed = "armed" if state.armed else "not armed"
        return f"{self.what} was acknowledged, but the vehicle is in {state.mode or 'no mode'}, {armed}"


class Requests:
    """All open requests. A newer request of the same MAV_CMD ends the older one as overtaken."""

    def __init__(self, timeout_s: float, tries: int):
        self._timeout_s, self._tries = timeout_s, tries
        self._open: Dict[int, Request] = {}  # by component
        self._components = deque(_COMPONENTS)  # the one that was used longest ago first
        self._reasons = Reasons()

    def ask(
        self,
        now_s: float,
        number: int,
        values: Sequence[float],
        what: str = "",
        shown: Optional[Callable[[FlightState], bool]] = None,
    ) -> Request:
        """A command that is repeated until it is acknowledged; sent by the next ``step``."""
        pending = PendingCommand(number, now_s, self._timeout_s, self._tries)
        return self._begin(
            Request(pending, values, what or f"command {number}", self._component(number), shown)
        )

    def insist(
        self,
        now_s: float,
        number: int,
        values: Sequence[float],
        what: str,
        shown: Callable[[FlightState], bool],
        every_s: float,
        patience_s: float,
    ) -> Request:
        """A command to stop: sent every ``every_s`` until the state shows it, whatever is
        acknowledged."""
        pending = PendingCommand(number, now_s, every_s, int(patience_s / every_s))
        return self._begin(
            Request(pending, values, what, self._component(number), shown, until_shown=True)
        )

    def step(self, now_s: float, state: FlightState) -> List[Tuple[Request, int]]:
        """What to send now, with its confirmation number; requests that are over are forgotten."""
        sending: List[Tuple[Request, int]] = []
        for component, request in list(self._open.items()):
            confirmation = request.step(now_s, state, self._reasons)
            if confirmation is not None:
                sending.append((request, confirmation))
            if request.over:
                del self._open[component]
        return sending

    def withdraw(self, number: int, reason: str) -> None:
        """Requests of this MAV_CMD end unsent, but for those that insist (they stop the
        vehicle)."""
        for component, request in list(self._open.items()):
            if request.number == number and not request.insists:
                request.end(Outcome.OVERTAKEN, f"{request.what} was withdrawn: {reason}")
                del self._open[component]

    def acknowledged(self, now_s: float, number: int, result: int, component: int) -> None:
        """A COMMAND_ACK came; ``component`` 0: it does not say to whom (firmware before 4.1)."""
        for request in self._open.values():
            if request.number == number and component in (0, request.component):
                request.pending.acknowledge(now_s, result)

    def status_text(self, now_s: float, severity: int, text: str) -> None:
        """The autopilot said something, which may be a reason."""
        self._reasons.add(now_s, severity, text)

    def _component(self, number: int) -> int:
        """The one that was used longest ago: an overtaken request's answer may still come to its
        own."""
        for component, request in list(self._open.items()):
            if request.number == number:
                request.end(Outcome.OVERTAKEN, f"{request.what} was overtaken by a newer command")
                del self._open[component]
        component = next((c for c in self._components if c not in self._open), self._components[0])
        # four commands of different kinds at once: the oldest gives way
        if component in self._open:
            self._open.pop(component).end(Outcome.OVERTAKEN, "overtaken by four newer commands")
        self._components.remove(component)
        self._components.append(component)
        return component

    def _begin(self, request: Request) -> Request:
        self._open[request.component] = request
        return request
