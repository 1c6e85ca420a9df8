# SPDX-License-Identifier: Apache-2.0
"""Whether an autopilot flies as fast as the mission plans with: its way-point parameters against
``flight``."""

import math
from typing import Dict, List, Mapping, Optional, Tuple

from fcsv_control.conditions import Grade
from fcsv_control.flight.messages import ParametersChecked
from fcsv_control.flight_check.lines import Check, Found
from fcsv_geometry.missions.flight_limits import FlightBounds

_SAME = 0.01  # of the planned value; parameters are set in whole cm/s


def others(have: Mapping[str, float], wanted: Mapping[str, float]) -> Tuple[List[str], List[str]]:
    """Names whose value is faster than what is wanted, and slower; a value that is not known is
    neither.

    >>> others({"WPNAV_SPEED": 200.0, "WPNAV_ACCEL": 99.0}, {"WPNAV_SPEED": 100.0, "WPNAV_ACCEL": 150.0})
    (['WPNAV_SPEED'], ['WPNAV_ACCEL'])
    """
    known = [n for n in wanted if not math.isnan(have.get(n, math.nan))]
    faster = [n for n in known if have[n] > wanted[n] * (1.0 + _SAME)]
    return faster, [n for n in known if have[n] < wanted[n] * (1.0 - _SAME)]


def grade(report: Optional[ParametersChecked], planned: FlightBounds) -> Found:
    """``report``: the newest, or None. Faster is red: ways that are timed
    past each other are flown at other times, and nearer than planned. Slower is amber: it comes
    late.
    """
    if report is None:
        return Grade.UNKNOWN, "its parameters are not heard"
    have, wanted = report.limits.values, planned.autopilot_parameters
    unknown = [name for name in wanted if math.isnan(have.get(name, math.nan))]
    faster, slower = others(have, wanted)
    if faster:
        return Grade.RED, "faster than planned: " + _set(faster, have, wanted)
    if unknown:
        return _without(report, unknown)
    if slower:
        return Grade.AMBER, "slower than planned: " + _set(slower, have, wanted)
    return Grade.GREEN, f"{planned.speed_mps:g} m/s, as planned"


def _without(report: ParametersChecked, unknown) -> Found:
    if not report.complete:
        return Grade.UNKNOWN, "its parameters are being read"
    return Grade.AMBER, f"not known of it: {', '.join(unknown)}"


def _set(names, have: Dict[str, float], wanted: Dict[str, float]) -> str:
    return "; ".join(f"{n} is {have[n]:g}, planned {wanted[n]:g}" for n in names)


def check(planned: FlightBounds) -> Check:
    """The line that needs the mission: of a vehicle whose autopilot's parameters cross the
    radio."""

    def of(now_s, vehicle, _rules) -> Found:
        return grade(None if vehicle.silent(now_s) else vehicle.parameters, planned)

    return Check(
        "speed",
        "the autopilot flies as fast as the mission's `flight` says",
        "rosrun fcsv_control parameters write LINE --set NAME=PLANNED, or mend the mission's flight",
        of,
    )
