# SPDX-License-Identifier: Apache-2.0
"""All that an agent asks of its flight link: which service to call when, and how each request
ended."""

import math
from dataclasses import dataclass, replace
from typing import Dict, List, Tuple

from fcsv_control.agent.asking import Asking, Shown
from fcsv_control.agent.messages import Ask, AskAnswered, Kind
from fcsv_control.errors import ControlError
from fcsv_control.flight.mavlink.texts import WARNING
from fcsv_control.flight.messages import TextReceived

_REASON_WAIT_S = 0.5  # the reason and the service's answer come by different ways
_NO_REASON = "the flight link refused without a reason"


@dataclass
class _OpenRequest:
    """A request that is not over. ``waits``: for the answer to a call; ``refusals``: that came
    before that call."""

    ask: Ask
    asking: Asking
    called_s: float
    refusals: int
    waits: bool = False
    refused_s: float = math.inf
    error: str = ""


class LinkRequests:
    """Our flight link answers when the effect shows. MAVROS answers a mode when it is sent, and
    repeats nothing."""

    def __init__(self):
        self.shown = Shown()
        self._open: Dict[int, _OpenRequest] = {}
        self._texts: List[Tuple[float, str]] = []
        self._home_m = 0.0

    def status_text(self, now_s: float, m: TextReceived) -> None:
        """The autopilot said something, which may be why it refuses."""
        if m.severity <= WARNING:
            self._texts = [*self._texts[-10:], (now_s, m.text)]

    def home(self, above_origin_m: float) -> None:
        """MAVROS counts a take-off's altitude from the autopilot's home, our own flight link from
        the odometry's zero; that one does not tell this."""
        self._home_m = above_origin_m

    def answered(self, now_s: float, m: AskAnswered) -> None:
        """A call was answered; of a request that is over it is passed over."""
        request = self._open.get(m.number)
        if request is None:
            return
        request.waits, request.error = False, m.error
        if m.took:
            request.asking.answered(now_s)
        else:
            request.refused_s = now_s

    def begin(self, now_s: float, ask: Ask) -> None:
        """Ask for this from now on; ``due`` gives its first call."""
        self._open[ask.number] = _OpenRequest(
            ask, Asking.of(self.shown, now_s, ask), now_s, self.shown.refusals
        )

    def due(self, now_s: float) -> Tuple[List[Ask], List[Tuple[Ask, str]]]:
        """What to call now; what is over, and why it was not done (empty: it was)."""
        calls: List[Ask] = []
        over: List[Tuple[Ask, str]] = []
        for request in list(self._open.values()):
            try:
                if self._calls(now_s, request):
                    calls.append(self._call(now_s, request))
                if not request.asking.over:
                    continue
                refusal = ""
            except ControlError as error:
                refusal = str(error)
            del self._open[request.ask.number]
            over.append((request.ask, refusal))
        return calls, over

    def _calls(self, now_s: float, request: _OpenRequest) -> bool:
        """Whether to call for it now. Raises ControlError where it ends."""
        if request.refused_s < math.inf:
            reason = request.error or self.shown.refusal(request.refusals)
            if reason or now_s >= request.refused_s + _REASON_WAIT_S:
                raise ControlError(reason or self._last_text(request.called_s))
            return False
        return not request.waits and request.asking.step(now_s)

    def _call(self, now_s: float, request: _OpenRequest) -> Ask:
        request.waits, request.called_s, request.refusals = True, now_s, self.shown.refusals
        if request.ask.kind is Kind.TAKEOFF:
            return replace(request.ask, altitude_m=request.ask.altitude_m - self._home_m)
        return request.ask

    def _last_text(self, since_s: float) -> str:
        return [_NO_REASON, *(text for at_s, text in self._texts if at_s >= since_s)][-1]
