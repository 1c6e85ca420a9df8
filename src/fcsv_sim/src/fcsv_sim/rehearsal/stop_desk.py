# SPDX-License-Identifier: Apache-2.0
"""The stop-all node of a rehearsal: the core that flies, over the vehicles' radios, with or without a mission."""

from typing import Callable, Dict

from fcsv_control.agent.messages import Ack, Instruction, Kind
from fcsv_control.stopping import STOP, StopAll, StopOrder
from fcsv_sim.rehearsal.radio import CRITICAL_S, Radio
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

SENDER = "stop_all"


class StopDesk:
    """``clock_s`` gives its machine's monotonic time, whose zero is anywhere, by the rehearsal's."""

    def __init__(self, fleet: Dict[str, RehearsedVehicle], radios: Dict[str, Radio], clock_s: Callable[[float], float]):
        self.core = StopAll(list(fleet))
        self._fleet, self._radios, self._clock_s = fleet, radios, clock_s
        self.alive = True
        self._asked = False

    def call(self, now_s: float, asked: str = STOP, reason: str = "a person") -> None:
        """Somebody calls /stop_all; what is due is sent at once."""
        self._asked = True
        self.core.begin(now_s, asked, reason)
        self.step(now_s)

    def over(self) -> None:
        """The operator resumes."""
        self._asked = False
        self.core.end()

    def state(self, sent_s: float, name: str, mode: str, armed: bool) -> None:
        """What a vehicle showed."""
        self.core.state(sent_s, name, mode, armed)

    def acknowledged(self, now_s: float, name: str, ack: Ack) -> None:
        """An answer to a command."""
        if ack.sender == SENDER:
            self.core.acknowledged(now_s, name, ack.number, "" if ack.result == 0 else ack.reason or "refused")

    def step(self, now_s: float) -> None:
        """Send what is due."""
        for order in self.core.due(now_s) if self._asked and self.alive else ():
            vehicle = self._fleet[order.vehicle]
            self._radios[order.vehicle].send(now_s, vehicle.obey, self._instruction(order, now_s), CRITICAL_S)

    def _instruction(self, order: StopOrder, now_s: float) -> Instruction:
        ordered_s, sent_s = self._clock_s(order.ordered_s), self._clock_s(now_s)
        return Instruction(order.vehicle, SENDER, order.number, Kind.SET_MODE, sent_s, ordered_s, 0.0, order.mode)
