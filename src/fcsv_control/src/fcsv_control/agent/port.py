# SPDX-License-Identifier: Apache-2.0
"""The agent's process without its transport: commands and what is heard on board in, requests and
answers out."""

import math
from typing import List, Sequence

from fcsv_control.agent.core import AgentCore, AgentRules
from fcsv_control.agent.duplicate_agents import DuplicateAgentGuard
from fcsv_control.agent.link_requests import LinkRequests
from fcsv_control.agent.messages import AgentAlive, Ask, AskAnswered, Instruction, Kind
from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight.messages import (
    EstimateMoved,
    HomeReceived,
    ModeAsked,
    PoseEstimated,
    Refused,
    TextReceived,
)
from fcsv_control.guardian.messages import GuardianVerdict
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm

_ALIVE_S = 0.2


class AgentPort:
    """Gives Ack, Ask (a service to call), ModeAsked, Pictures, Said, SetPoint and AgentAlive; step
    it after each message, and at 50 Hz. ``instance``: a name that no other start of an agent
    has."""

    def __init__(self, vehicle: str, rules: AgentRules, instance: str, now_s: float):
        self._vehicle, self._instance, self._started_s = vehicle, instance, now_s
        self._core = core = AgentCore(vehicle, rules, DuplicateAgentGuard(instance, now_s))
        self._requests = requests = LinkRequests()
        self._alive_s = -math.inf
        self._take = Takers(
            {
                AgentAlive: lambda now_s, m: core.duplicates.agent_lives(
                    now_s, m.instance, m.sent_s - m.started_s
                ),
                AskAnswered: requests.answered,
                EstimateMoved: lambda now_s, m: core.estimate_moved(now_s, m.step_m),
                HomeReceived: lambda _now_s, m: requests.home(m.above_origin_m),
                Instruction: core.receive,
                MissionAlive: lambda now_s, m: core.sender_lives(now_s, m.sender, m.sent_s),
                PoseEstimated: lambda now_s, m: core.pose(now_s, m.T_odom_body),
                Refused: lambda _now_s, m: requests.shown.refused(m.reason),
                TextReceived: requests.status_text,
                GuardianVerdict: lambda now_s, m: core.guarded(
                    now_s, m.action, m.holds, "; ".join(m.reasons), m.forbids
                ),
                tm.EpochsFound: self._calibrated,
                tm.OdometryEpoch: lambda _now_s, m: core.epoch(m.number, m.reason),
                tm.VehicleState: self._state,
            },
            "an agent takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def step(self, now_s: float) -> Sequence[object]:
        """What is due, in its order, and a sign of life at 5 Hz."""
        out: List[object] = self._calls(now_s)
        self._core.step(now_s)
        for output in self._core.outgoing():
            out += self._ask(now_s, output) if isinstance(output, Ask) else [output]
        if now_s - self._alive_s >= _ALIVE_S:
            self._alive_s = now_s
            out.append(self._alive(now_s))
        return out

    def _calls(self, now_s: float) -> List[object]:
        """What to call now; the core is told of what is over."""
        calls, over = self._requests.due(now_s)
        for ask, refusal in over:
            self._core.finished(ask, refusal)
        return [*calls]

    def _ask(self, now_s: float, ask: Ask) -> List[object]:
        """Its first call; of a mode others are told before, because it is no pilot's."""
        self._requests.begin(now_s, ask)
        told = [ModeAsked(ask.mode)] if ask.kind is Kind.SET_MODE else []
        return [*told, *self._calls(now_s)]

    def _alive(self, now_s: float) -> AgentAlive:
        older, commander = self._core.duplicates.older(now_s), self._core.rights.lease.holder(now_s)
        problem = (
            f"{self._vehicle}: {older} is its agent already; this second one does nothing, end it"
        )
        return AgentAlive(
            self._instance, self._started_s, now_s, commander, problem if older else ""
        )

    def _state(self, now_s: float, m: tm.VehicleState) -> None:
        self._core.state(now_s, m.mode, m.armed)
        self._requests.shown.state(now_s, m.mode, m.armed)

    def _calibrated(self, _now_s: float, m: tm.EpochsFound) -> None:
        if m.of == tm.CALIBRATION and self._vehicle in m.epochs:
            self._core.rights.frame.calibrated(m.epochs[self._vehicle])
