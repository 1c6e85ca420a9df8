# SPDX-License-Identifier: Apache-2.0
"""What the flight check's processes hear and give, as data."""

from dataclasses import dataclass
from typing import Sequence

from fcsv_control.flight.messages import ParametersChecked
from fcsv_control.flight_check.digest import Status
from fcsv_control.flight_check.lines import Line
from fcsv_tracking.devices.clocks import ClockOffset


@dataclass(frozen=True)
class PositionCounted:
    """A pose of the vehicle came: they are counted."""

    vehicle: str = ""


@dataclass(frozen=True)
class PictureCounted:
    """A picture of the camera came: they are counted."""


@dataclass(frozen=True)
class TrackerTrusts:
    """The variance (m2) of a position by the tracking camera."""

    variance_m2: float


@dataclass(frozen=True)
class DiagnosticsCame:
    """Lines of diagnostics came."""

    statuses: Sequence[Status]


@dataclass(frozen=True)
class WorstDiagnostics:
    """The worst of them, for the radio."""

    statuses: Sequence[Status]


@dataclass(frozen=True)
class CheckReport:
    """A table of lines; the next one comes in ``next_s`` at the latest."""

    lines: Sequence[Line]
    next_s: float


@dataclass(frozen=True)
class VehicleReported:
    """The report of ``named`` came on a vehicle's topic; it counts for ``patience_s``."""

    vehicle: str
    named: str
    lines: Sequence[Line]
    patience_s: float


@dataclass(frozen=True)
class ParametersReported:
    """A vehicle's parameters against its profile."""

    vehicle: str
    checked: ParametersChecked


@dataclass(frozen=True)
class ClockMeasured:
    """How far a vehicle's clock is ahead, as it was measured ``age_s`` ago."""

    vehicle: str
    age_s: float
    offset: ClockOffset


@dataclass(frozen=True)
class TagsCame:
    """A picture of a vehicle shows these tags."""

    vehicle: str
    ids: Sequence[int]


@dataclass(frozen=True)
class StopStandsBy:
    """The node that stops everybody lives."""


@dataclass(frozen=True)
class Accept:
    """The operator accepts an amber line."""

    vehicle: str
    line: str
