# SPDX-License-Identifier: Apache-2.0
"""The process of a vehicle's own check without its transport: what is heard on board in, a report
and the worst diagnostics out."""

import logging
import math
from typing import Callable, List, Optional, Sequence

from fcsv_control.agent.messages import AgentAlive
from fcsv_control.conditions import Grade
from fcsv_control.flight.messages import LinkLives, ParametersChecked, TextReceived
from fcsv_control.flight_check import keys
from fcsv_control.flight_check.autopilot_line import AutopilotLine
from fcsv_control.flight_check.digest import Digest, Status
from fcsv_control.flight_check.lines import Check, Judged, Line, worst
from fcsv_control.flight_check.messages import (
    CheckReport,
    DiagnosticsCame,
    PictureCounted,
    PositionCounted,
    TrackerTrusts,
    WorstDiagnostics,
)
from fcsv_control.flight_check.pace import Pace
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import Disk, VehicleFacts
from fcsv_control.guardian.messages import GuardianVerdict
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm

_log = logging.getLogger(__name__)
_JUDGES_S = 0.5


class VehicleCheckPort:
    """``checks``: the lines; ``relay``: which program stands between the machines; ``own``: of
    which names diagnostics count (Digest). ``report_bytes`` and ``worst_bytes``: how many octets a
    report and lines of diagnostics take on the radio.

    Gives CheckReport, WorstDiagnostics and Diagnosis; step it after diagnostics, and twice a second.
    """

    def __init__(
        self,
        vehicle: str,
        checks: Sequence[Check],
        rules: VehicleCheckRules,
        report_bytes: Callable[[Sequence[Line]], int],
        worst_bytes: Callable[[Sequence[Status]], int],
        relay: str = keys.RELAY,
        line: Optional[AutopilotLine] = None,
        own: str = "",
    ):
        self._vehicle, self._rules = vehicle, rules
        self._report_bytes, self._worst_bytes = report_bytes, worst_bytes
        f = self._facts = VehicleFacts(relay=relay, line=line or AutopilotLine())
        self._judged, self._pace, self._digest = Judged(vehicle, checks), Pace(), Digest(own)
        self._judged_s = -math.inf
        self._states: Optional[List[Grade]] = None  # as they were reported
        self._take = Takers(
            {
                PositionCounted: lambda now_s, _m: f.positions.tell(now_s),
                PictureCounted: lambda now_s, _m: f.pictures.tell(now_s),
                TrackerTrusts: lambda now_s, m: f.tracker_variance_m2.tell(now_s, m.variance_m2),
                LinkLives: f.link.tell,
                ParametersChecked: f.parameters.tell,
                tm.VehicleState: lambda now_s, m: f.armed.tell(now_s, m.armed),
                tm.BatteryCharge: lambda now_s, m: f.battery_share.tell(now_s, m.share),
                TextReceived: lambda now_s, m: f.texts.add(now_s, m.text),
                GuardianVerdict: f.guardian.tell,
                AgentAlive: f.agent.tell,
                RecorderReport: f.recorder.tell,
                Disk: f.disk.tell,
                keys.Keys: f.keys.tell,
                DiagnosticsCame: lambda now_s, m: self._digest.tell(now_s, m.statuses),
            },
            "a vehicle's check takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def step(self, now_s: float) -> Sequence[object]:
        """What is to be told now."""
        out: List[object] = []
        if now_s - self._judged_s >= _JUDGES_S - 1e-2:
            self._judged_s = now_s
            out += self._report(now_s, self._judged.lines(now_s, self._facts, self._rules))
        wrong = self._digest.due(now_s, self._worst_bytes)
        return out if wrong is None else [*out, WorstDiagnostics(wrong)]

    def _report(self, now_s: float, lines: List[Line]) -> List[object]:
        states, size = [line.state for line in lines], self._report_bytes(lines)
        if not self._pace.due(now_s, size, states != self._states):
            return []
        self._tell_log(lines)
        self._states = states
        values = {"flight check": worst(lines).word}
        return [tm.Diagnosis({}, values), CheckReport(lines, self._pace.period_s(size))]

    def _tell_log(self, lines: List[Line]) -> None:
        """What changed."""
        for i, line in enumerate(lines):
            if self._states is None or self._states[i] is line.state:
                continue
            log = _log.info if line.state is Grade.GREEN else _log.warning
            log("flight check of %s: %s", self._vehicle, in_words(line))


def in_words(line: Line) -> str:
    """One line for a log.

    >>> in_words(Line("uav1", "battery", Grade.AMBER, "31%", "change it"))
    'battery amber: 31% (change it)'
    """
    return f"{line.name} {line.state.word}: {line.what}" + (
        f" ({line.remedy})" if line.remedy else ""
    )
