# SPDX-License-Identifier: Apache-2.0
"""The process of /stop_all and /land_all without its transport."""

import logging
import math
from typing import List, Sequence

from fcsv_control.agent.messages import BY_HAND, Instruction, Kind
from fcsv_control.control_messages import CommandAnswered, StopCalled, StopOver
from fcsv_control.stopping.core import StopAll, StopOrder
from fcsv_geometry.vehicles.telemetry import MissionPhase, Reply, VehicleState

_log = logging.getLogger(__name__)
_REPORT_S = 0.5


class StopAllPort:
    """Everybody of ``vehicles`` is stopped; ``sender``: as whom. Step it after each message, and
    often besides.

    Gives StopCalled where the mission must hear of a call, then Instruction and Report.
    """

    def __init__(self, vehicles: Sequence[str], sender: str):
        self._core, self._sender = StopAll(vehicles), sender
        self._said, self._reported_s = "", -math.inf

    def receive(self, now_s: float, message: object) -> None:
        """VehicleState, CommandAnswered, MissionPhase, StopCalled (by a topic) or StopOver came.
        Raises TypeError for anything else."""
        m = message
        if isinstance(m, VehicleState):
            self._core.state(now_s, m.vehicle, m.mode, m.armed)
        elif isinstance(m, CommandAnswered):
            if m.ack.sender == self._sender:
                by_hand = m.ack.result == BY_HAND
                self._core.acknowledged(now_s, m.vehicle, m.ack.number, m.outcome, by_hand)
        elif isinstance(m, MissionPhase):
            self._core.mission(now_s, m.phase)
        elif isinstance(m, StopCalled):
            self._core.begin(now_s, m.asked, m.reason)
        elif isinstance(m, StopOver):
            _log.info("over: %s", m.reason)
            self._core.end()
        else:
            raise TypeError(f"stop-all does not hear {type(message).__name__}")

    def serve(self, now_s: float, request: object) -> List[object]:
        """The answer to StopCalled. The mission is told first: it must not order anything after it.
        Raises TypeError for any other request."""
        if not isinstance(request, StopCalled):
            raise TypeError(f"stop-all does not serve {type(request).__name__}")
        self.receive(now_s, request)
        sent = self.step(now_s)
        answer = Reply(True, f"{self._core.report(now_s).in_words()}; see /stop_all/report")
        return [answer, request, *sent]

    def step(self, now_s: float) -> List[object]:
        """Commands that are due, and what became of the last call."""
        sent: List[object] = [self._instruction(order, now_s) for order in self._core.due(now_s)]
        report = self._core.report(now_s)
        words = report.in_words() if report.asked else ""
        if words == self._said and now_s - self._reported_s < _REPORT_S:
            return sent
        if words and words != self._said:
            _log.warning("%s", words)
        self._said, self._reported_s = words, now_s
        return [*sent, report]

    def _instruction(self, order: StopOrder, now_s: float) -> Instruction:
        return Instruction(
            order.vehicle,
            self._sender,
            order.number,
            Kind.SET_MODE,
            now_s,
            order.ordered_s,
            0.0,
            order.mode,
        )
