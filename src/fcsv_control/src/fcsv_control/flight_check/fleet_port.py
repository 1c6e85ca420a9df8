# SPDX-License-Identifier: Apache-2.0
"""The process of the fleet's check without its transport: what the control PC hears in, the whole
table out."""

import logging
import math
from typing import List, Mapping, Optional, Sequence

from fcsv_control.control_messages import MissionAlive
from fcsv_control.flight_check.acceptance import Acceptances
from fcsv_control.flight_check.fleet import FleetCheckRules, FleetTable
from fcsv_control.flight_check.keys import Keys
from fcsv_control.flight_check.lines import Line, worst
from fcsv_control.flight_check.messages import (
    Accept,
    CheckReport,
    ClockMeasured,
    ParametersReported,
    PositionCounted,
    StopStandsBy,
    TagsCame,
    VehicleReported,
)
from fcsv_control.flight_check.vehicle import Disk
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm

_log = logging.getLogger(__name__)
_NEXT_S = 1.0


class FleetCheckPort:
    """``tags``: id of the tag by vehicle, front first; the rest as FleetTable.

    Gives CheckReport once a second and where a line changed, with its Diagnosis, and tm.Dropped;
    step it twice a second.
    """

    def __init__(
        self,
        tags: Mapping[str, int],
        rules: FleetCheckRules,
        link: str,
        ground: bool = False,
        planned: Optional[FlightBounds] = None,
    ):
        self._table = FleetTable(list(tags), tags, rules, link, ground, planned)
        self._accepted = Acceptances()
        self._lines: List[Line] = []
        self._shown: Sequence[tuple] = ()
        self._shown_s, self._phase = -math.inf, ""
        self._out: List[object] = []
        vehicles, control = self._table.vehicles, self._table.control
        self._take = Takers(
            {
                VehicleReported: self._reported,
                ParametersReported: lambda _now_s, m: setattr(
                    vehicles[m.vehicle], "parameters", m.checked
                ),
                PositionCounted: lambda now_s, m: vehicles[m.vehicle].poses.tell(now_s),
                ClockMeasured: lambda now_s, m: vehicles[m.vehicle].clock.tell(
                    now_s - m.age_s, m.offset
                ),
                tm.OdometryEpoch: lambda _now_s, m: setattr(vehicles[m.vehicle], "epoch", m.number),
                tm.EpochsFound: self._epochs,
                TagsCame: lambda now_s, m: self._table.sightings.saw(now_s, m.vehicle, m.ids),
                MissionAlive: lambda now_s, _m: control.mission.tell(now_s, self._phase),
                tm.MissionPhase: lambda _now_s, m: setattr(self, "_phase", m.phase),
                StopStandsBy: lambda now_s, _m: control.stop_all.tell(now_s, True),
                RecorderReport: control.recorder.tell,
                Disk: control.disk.tell,
                Keys: control.keys.tell,
            },
            "the fleet's check takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def _reported(self, now_s: float, m: VehicleReported) -> None:
        if m.named != m.vehicle:
            why = f"on {m.vehicle}'s topic comes one of '{m.named}'"
            self._out.append(tm.Dropped("flight check", why))
            return
        vehicle = self._table.vehicles[m.vehicle]
        vehicle.patience_s = m.patience_s
        vehicle.report.tell(now_s, m.lines)

    def _epochs(self, _now_s: float, m: tm.EpochsFound) -> None:
        if m.of == tm.CALIBRATION:
            for name, vehicle in self._table.vehicles.items():
                vehicle.calibrated = m.epochs.get(name)

    def serve(self, now_s: float, request: object) -> List[object]:
        """The answer to Accept, and the table with it. Raises TypeError for any other request."""
        if not isinstance(request, Accept):
            raise TypeError(f"the fleet's check does not serve {type(request).__name__}")
        refusal = self._accepted.accept(self._lines, request.vehicle, request.line)
        told = f"{request.vehicle} {request.line}: {refusal or 'accepted by the operator'}"
        _log.warning("flight check: %s", told)
        return [tm.Reply(not refusal, told), *self.step(now_s)]

    def step(self, now_s: float) -> Sequence[object]:
        """The table, where a line changed or a second has passed."""
        out, self._out = self._out, []
        self._lines = self._accepted.apply(now_s, self._table.lines(now_s))
        shown = [(li.vehicle, li.name, li.state, li.accepted) for li in self._lines]
        if shown == self._shown and now_s - self._shown_s < _NEXT_S - 0.1:
            return out
        self._shown, self._shown_s = shown, now_s
        values = {"flight check": worst(self._lines).word}
        return [*out, tm.Diagnosis({}, values), CheckReport(self._lines, _NEXT_S)]
